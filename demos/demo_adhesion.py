# SPDX-License-Identifier: LGPL-3.0-or-later
# # A bond that is pulled apart: adhesion that damage weakens
#
# This demo illustrates how to:
#
# - give a surface adhesion (`RCCM`), and look at its intensity, force and energies step by step;
# - follow a snap-back with its folds by arc length (`ArcLength`, `--spring`).
#
# A glued block is drawn off; its face opens at a constant speed V. Springs of the stiffness C per
# area hold it. Beyond u0 = (w/C)^(1/2) they lose their intensity beta: without viscosity it is
# (u0/u)^2, the pull w^2/(C u^3), and the work w (1 - u0^2/(2 u^2)). With a viscosity b of u0 w/V
# (`--viscosity 1`) the largest pull is 1.108 (w C)^(1/2), at 1.208 u0. w and C are no source's.
#
# In series with a spring of the stiffness K C, K < 3, the end of the spring must go back for the
# bond to open slowly: u_tot turns at u0 (1 + 1/K), where damage begins, and at 4/3 u0 (3/K)^(1/4).

from mpi4py import MPI

import numpy as np
from demo_linear_triangle import linear_triangle

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.evolution import ArcLength, QuasiStatic
from dolfinx_contact.materials import LinearElastic

C, WORK, U0, YOUNG = 100.0, 1.0, 0.1, 1e4


def arguments(argv=None):
    parser = ScriptParser("A bond that is pulled apart", output="output/adhesion")
    parser.add_argument("--viscosity", type=number(least=0), default=0.0, help="b V/(u0 w)")
    parser.add_argument("--steps", type=number(int, above=0), default=20, help="for each u0 / 2")
    parser.add_argument("--order", type=int, choices=[1, 2], default=1, help="in time")
    parser.add_argument("--spring", type=number(above=0, below=3), help="stiffness in series, of C")
    return parser.parse(argv)


def glued(comm, law):
    """A block glued to a floor, and the Constant that lifts its top; its faces stay plane."""
    domain = mesh.create_unit_square(comm, 2, 2)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, lift = fem.Function(V), fem.Constant(domain, (0.0, 0.0))
    top = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 1))
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    contact = ContactSurface(u, below, obstacle=HalfSpace((0, 0), (0, 1)), law=law)
    energy = LinearElastic.from_young(YOUNG, 0.0).energy(u) * ufl.dx
    return ContactProblem(energy, u, [contact], bcs=[fem.dirichletbc(lift, top, V)]), lift


def opened(args, comm, folder):
    """Open at the speed u0: the top goes ahead by the pull over the stiffness of the block."""
    b, n = args.viscosity * WORK, 12 * args.steps
    problem, lift = glued(comm, RCCM(C, C, WORK, viscosity=b, order=args.order))
    times, beta, dt = np.linspace(0.0, 6.0, n + 1), [1.0], 6.0 / n
    for t in times[1:]:
        part = (args.order == 2 and t > times[1]) / 3  # BDF2
        start, h = beta[-1] + part * (beta[-1] - beta[-2:][0]), dt * (1 - part)
        beta.append(min(beta[-1], (b * start + h * WORK) / (b + h * C * (U0 * t) ** 2)))

    def load(t):
        lift.value[1] = U0 * t * (1 + np.interp(t, times, beta) ** 2 * C / YOUNG)

    with output.EvolutionSeries(folder, problem, every=args.steps) as series:
        history = QuasiStatic(problem, load).run(times, observer=series)
    tables = [s.result.tables["contact"] for s in history.steps]
    u = np.array([t.un.mean() for t in tables]) / U0
    pull = np.array([-t.pressure.mean() for t in tables]) / np.sqrt(WORK * C)
    last, top = history.steps[-1], int(np.argmax(pull))
    spent = last.energies.damage + last.energies.stored - last.result.energies["bulk"]
    if comm.rank == 0:
        names, dotted = ("u / u0", "pull"), {"no viscosity": (u, np.minimum(u, u**-3.0))}
        output.draw_curves(folder / "pull.png", {"bond": (u, pull)}, dotted=dotted, labels=names)
    at = {k: tables[int(2 * float(k)) * args.steps - 1].beta for k in ("1.5", "2", "3", "6")}
    return last.result.summary() | {
        "beta_at": {k: float(beta.mean()) for k, beta in at.items()},
        **{"peak": float(pull[top]), "peak_at": float(u[top]), "work": spent / WORK},
    }


def snapped(K):
    """Folds of a node of one element, whose stiffness is K times that of its bond."""

    def node(stiffness, gamma):
        given = dict(law=lambda _: RCCM(stiffness, 0.0, WORK), comm=MPI.COMM_SELF)
        system = linear_triangle(1, None, (0.0, -1.0), (1.0, 1.0), **given)
        system.set_parameter(gamma)
        return system, float(system.problem.solve().tables["contact"].un.max())

    (_, free), (_, held) = node(0.0, 1e-3), node(1.0, 1e-3)
    stiffness = held / (free - held) / K
    system, u0, scale = node(stiffness, 0.0)[0], np.sqrt(WORK / stiffness), 1e-3 / free
    folds = []
    for step in ArcLength(system).run((0.0, 8 * u0 * scale)).folds:
        u_tot, u = (
            float(step.gamma / scale / u0),
            float(step.result.tables["contact"].un.max() / u0),
        )
        folds.append({"u_tot": u_tot, "u": u, "kind": step.event.split()[0]})
    return folds


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    summary = opened(args, comm, folder) | ({"folds": snapped(args.spring)} if args.spring else {})
    for name in ("beta_at", "peak", "peak_at", "work", "folds"):
        say(f"{name}: {summary.get(name)}")
    return output.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
