# SPDX-License-Identifier: LGPL-3.0-or-later
# # A strip that is peeled off its base: snap-back, with a memory at every point
#
# This demo illustrates how to:
#
# - follow an evolution whose load is unknown by arc length (`ArcLength`): where the strip lets go,
#   the machine must go back for the bond to break slowly;
# - find the folds of the load, smooth ones and those where a node begins to break;
# - compare with beams, and the work with the energy of what was peeled.
#
# A strip of thickness 1 and modulus E lies on a rigid base, bonded (`RCCM`) beyond a crack of the
# length a0. A machine of the stiffness k draws its end up by gamma. For a beam with a crack of the
# length a, force P (per width) and opening D of the end are, as soon as the bond breaks (w)
#
#     P = (2 E I w)^(1/2) / a,    D = (2 w/(9 E I))^(1/2) a^2,    gamma = D + P/k,
#
# so that P^2 D is constant, and gamma falls until the crack has the length (3 E I/(2 k))^(1/3) and
# rises after. The root of the beam, two thicknesses long, gives way and makes a longer, by what
# neither of the two sees. Elements are half as long as the strip is thick: nodes break one by one,
# and each has folds of its own. The numbers are no source's.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.parametric import ParametricContact

E, INERTIA, WORK, ROOT, LENGTH, CRACK, LONGEST = 1.0, 1 / 12, 1e-4, 2.0, 18.0, 5.0, 10.0
MACHINE = 1.5 * E * INERTIA / LONGEST**3  # gamma turns where the crack has the length LONGEST
FORCE = np.sqrt(2 * E * INERTIA * WORK)  # times length: P a
OPENING = np.sqrt(2 * WORK / (9 * E * INERTIA))  # over length squared: D/a^2


def arguments(argv=None):
    parser = ScriptParser("A strip peeled off its base", output="output/peeling", n=2)
    parser.add_argument("--peel", type=number(above=0, below=9), default=6.0, help="so much")
    parser.add_argument("--step", type=number(above=0), default=0.1, help="longest, of arc length")
    return parser.parse(argv)


def strip(comm, n):
    """The problem, its load, and the force of the machine, a spring less what gamma^2 stores."""
    corners, cell = [[0.0, 0.0], [LENGTH, 1.0]], mesh.CellType.quadrilateral
    domain = mesh.create_rectangle(comm, corners, [int(n * LENGTH), max(n // 2, 1)], cell)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, gamma = fem.Function(V, name="displacement"), fem.Constant(domain, 0.0)

    def facets(where):
        return np.sort(mesh.locate_entities_boundary(domain, 1, where))

    end = mesh.meshtags(domain, 1, facets(lambda x: np.isclose(x[0], 0)), 1)
    ds = ufl.Measure("ds", domain, subdomain_data=end)(1)
    law = RCCM(4 * E * INERTIA / ROOT**4, 4 * E * INERTIA / ROOT**4, WORK)
    below = facets(lambda x: np.isclose(x[1], 0) & (x[0] > CRACK - 1e-9))
    bond = ContactSurface(u, below, obstacle=HalfSpace((0, 0), (0, 1)), law=law)
    clamped = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[0], LENGTH))
    spring = MACHINE * (u[1] ** 2 / 2 - gamma * u[1]) * ds
    energy = LinearElastic.from_young(E, 0.0).energy(u) * ufl.dx + spring
    problem = ContactProblem(energy, u, [bond], bcs=[fem.dirichletbc(np.zeros(2), clamped, V)])
    return ParametricContact(problem, gamma), fem.form(MACHINE * (gamma - u[1]) * ds)


def main(argv=None):
    args, comm, pulls = arguments(argv), MPI.COMM_WORLD, []
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    system, force = strip(comm, args.n)
    most = 1.3 * (OPENING * CRACK**2 + FORCE / CRACK / MACHINE)

    def peeled(step):
        bond = step.result.tables["contact"]
        return float(np.dot(1 - bond.beta, bond.area))

    def stop(step):
        return "so much is peeled" if peeled(step) > args.peel else ""

    def seen(step):
        pulls.append(comm.allreduce(fem.assemble_scalar(force)))
        series(step)

    path, control = ArcLength(system), StepControl(maximum=args.step)
    with output.EvolutionSeries(folder, system.problem, every=20) as series:
        there = path.run((0.0, most), control=control, observer=seen, stop=stop)
    back = path.run((1e-3 * most, most), control=control, direction="back")

    gamma, P = np.array([s.gamma for s in there.steps]), np.array(pulls)
    D, area = gamma - P / MACHINE, np.array([peeled(s) for s in there.steps])
    kinds, a = np.array([s.event for s in there.steps]), np.sqrt(D / OPENING)
    last = np.flatnonzero((kinds == "smooth fold") & (area > ROOT))
    names = ("gamma", "event", "before", "after")
    summary = back.steps[-1].result.summary() | {
        "folds": [dict(zip(names, [s.row()[k] for k in names], strict=True)) for s in there.folds],
        "turn": gamma[last].min() / (OPENING * LONGEST**2 + FORCE / LONGEST / MACHINE),
        "constant": (P**2 * D / (FORCE**2 * OPENING))[last].tolist(),
        "crack_over_peeled": np.ptp(a[last]) / np.ptp(area[last]),
        "peeled": float(area[-1]),
        "work_over_peeled": back.energies.external / (WORK * float(area[-1])),
    }
    for name in ("turn", "crack_over_peeled", "peeled", "work_over_peeled"):
        say(f"{name}: {summary[name]}")
    if comm.rank == 0:
        b = np.linspace(CRACK, a[-1], 100)
        beam = OPENING * b**2 + FORCE / b / MACHINE, FORCE / b
        folds = {f"{k}s": (gamma[kinds == k], P[kinds == k]) for k in set(kinds) if "fold" in k}
        shown = dict(marks=folds, dotted={"beam": beam}, labels=("end of the machine", "force"))
        output.draw_curves(folder / "peeling.png", {"strip": (gamma, P)}, **shown)
    return output.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
