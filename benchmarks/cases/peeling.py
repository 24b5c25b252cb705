# SPDX-License-Identifier: LGPL-3.0-or-later
"""A strip peeled off.

Reference: beam theory. `demos/demo_peeling.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    RCCM,
    ContactProblem,
    ContactSurface,
    HalfSpace,
    ParametricContact,
    io,
    plot,
)
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength
from dolfinx_contact.materials import LinearElastic

E = 1.0
INERTIA = 1 / 12
WORK = 1e-4
ROOT = 2.0
LENGTH = 18.0
CRACK = 5.0
LONGEST = 10.0
MACHINE = 1.5 * E * INERTIA / LONGEST**3  # gamma turns where the crack has the length LONGEST
FORCE = np.sqrt(2 * E * INERTIA * WORK)  # times length: P a
OPENING = np.sqrt(2 * WORK / (9 * E * INERTIA))  # over length squared: D/a^2


def arguments(argv=None):
    parser = ScriptParser("A strip peeled off its base", output="output/peeling", n=2)
    length = number(above=0, below=9)
    positive = number(above=0)
    parser.add_argument("--peel", type=length, default=6.0, help="so much")
    parser.add_argument("--step", type=positive, default=0.1, help="longest, of arc length")
    return parser.parse(argv)


def strip(comm, n):
    """The problem, its load, and the force of the machine, a spring less what gamma^2 stores."""
    corners = [[0.0, 0.0], [LENGTH, 1.0]]
    cells = [int(n * LENGTH), max(n // 2, 1)]
    domain = mesh.create_rectangle(comm, corners, cells, mesh.CellType.quadrilateral)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    gamma = fem.Constant(domain, 0.0)

    def facets(where):
        return np.sort(mesh.locate_entities_boundary(domain, 1, where))

    drawn = facets(lambda x: np.isclose(x[0], 0))
    end = mesh.meshtags(domain, 1, drawn, 1)
    ds = ufl.Measure("ds", domain, subdomain_data=end)(1)

    stiffness = 4 * E * INERTIA / ROOT**4
    law = RCCM(stiffness, stiffness, WORK)
    base = HalfSpace((0, 0), (0, 1))
    bonded = facets(lambda x: np.isclose(x[1], 0) & (x[0] > CRACK - 1e-9))
    bond = ContactSurface(u, bonded, obstacle=base, law=law)

    far = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[0], LENGTH))
    clamped = fem.dirichletbc(np.zeros(2), far, V)
    elastic = LinearElastic.from_young(E, 0.0)
    spring = MACHINE * (u[1] ** 2 / 2 - gamma * u[1]) * ds
    energy = elastic.energy(u) * ufl.dx + spring
    problem = ContactProblem(energy, u, [bond], bcs=[clamped])
    force = fem.form(MACHINE * (gamma - u[1]) * ds)
    return ParametricContact(problem, gamma), force


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    system, force = strip(comm, args.n)
    most = 1.3 * (OPENING * CRACK**2 + FORCE / CRACK / MACHINE)
    pulls = []

    def peeled(step):
        bond = step.result.tables["contact"]
        return float(np.dot(1 - bond.beta, bond.area))

    def stop(step):
        return "so much is peeled" if peeled(step) > args.peel else ""

    def seen(step):
        pull = comm.allreduce(fem.assemble_scalar(force))
        pulls.append(pull)
        series(step)

    path = ArcLength(system)
    control = StepControl(maximum=args.step)
    with io.EvolutionSeries(folder, system.problem, every=20) as series:
        there = path.run(gamma_range=(0.0, most), control=control, observer=seen, stop=stop)
    back = path.run(gamma_range=(1e-3 * most, most), control=control, direction="back")

    gamma = np.array([s.gamma for s in there.steps])
    area = np.array([peeled(s) for s in there.steps])
    kinds = np.array([s.event for s in there.steps])
    P = np.array(pulls)
    D = gamma - P / MACHINE
    a = np.sqrt(D / OPENING)

    # The smooth folds that are far from the end of the first crack.
    is_late = (kinds == "smooth fold") & (area > ROOT)
    late = np.flatnonzero(is_late)
    turn = OPENING * LONGEST**2 + FORCE / LONGEST / MACHINE
    constant = P**2 * D / (FORCE**2 * OPENING)
    folds = []
    for step in there.folds:
        row = step.row()
        fold = {name: row[name] for name in ("gamma", "event", "before", "after")}
        folds.append(fold)
    last_area = float(area[-1])
    found = {
        "folds": folds,
        "turn": gamma[late].min() / turn,
        "constant": constant[late].tolist(),
        "crack_over_peeled": np.ptp(a[late]) / np.ptp(area[late]),
        "peeled": last_area,
        "work_over_peeled": back.energies.external / (WORK * last_area),
    }
    for name in ("turn", "crack_over_peeled", "peeled", "work_over_peeled"):
        say(f"{name}: {found[name]}")

    if comm.rank == 0:
        b = np.linspace(CRACK, a[-1], 100)
        beam = (OPENING * b**2 + FORCE / b / MACHINE, FORCE / b)
        marks = {}
        for kind in set(kinds):
            if "fold" in kind:
                marks[f"{kind}s"] = (gamma[kinds == kind], P[kinds == kind])
        curves = {"strip": (gamma, P)}
        axes = ("end of the machine", "force")
        picture = folder / "peeling.png"
        plot.draw_curves(picture, curves, marks=marks, dotted={"beam": beam}, labels=axes)
    summary = back.steps[-1].result.summary()
    return io.write_summary(comm, folder, summary | found)


if __name__ == "__main__":
    main()
