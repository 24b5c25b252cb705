# SPDX-License-Identifier: LGPL-3.0-or-later
"""A bond opened, viscous or with a spring.

Reference: closed form. `demos/demo_adhesion.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number
from _triangle import linear_triangle

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace, io, plot
from dolfinx_contact.evolution import ArcLength, QuasiStatic
from dolfinx_contact.materials import LinearElastic

C = 100.0
WORK = 1.0
U0 = 0.1
YOUNG = 1e4


def arguments(argv=None):
    parser = ScriptParser("A bond that is pulled apart", output="output/adhesion")
    add = parser.add_argument
    add("--viscosity", type=number(least=0), default=0.0, help="b V/(u0 w)")
    add("--steps", type=number(int, above=0), default=20, help="for each u0 / 2")
    add("--order", type=int, choices=[1, 2], default=1, help="in time")
    add("--spring", type=number(above=0, below=3), help="stiffness in series, of C")
    return parser.parse(argv)


def glued(comm, law):
    """A block glued to a floor, and the Constant that lifts its top; its faces stay plane."""
    domain = mesh.create_unit_square(comm, 2, 2)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    lift = fem.Constant(domain, (0.0, 0.0))
    top = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 1))
    lifted = fem.dirichletbc(lift, top, V)
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(u, below, obstacle=floor, law=law)
    material = LinearElastic.from_young(YOUNG, 0.0)
    problem = ContactProblem(material.energy(u) * ufl.dx, u, [contact], bcs=[lifted])
    return problem, lift


def intensities(args, times):
    """beta at these times of a bond that opens at the speed u0, by the implicit steps."""
    b = args.viscosity * WORK
    dt = 6.0 / (len(times) - 1)
    beta = [1.0]
    for t in times[1:]:
        start = beta[-1]
        h = dt
        if args.order == 2 and t > times[1]:  # BDF2
            third = 1 / 3
            start += third * (beta[-1] - beta[-2])
            h = dt * (1 - third)
        drive = C * (U0 * t) ** 2
        found = (b * start + h * WORK) / (b + h * drive)
        beta.append(min(beta[-1], found))
    return beta


def opened(args, comm, folder):
    """Open at the speed u0: the top goes ahead by the pull over the stiffness of the block."""
    problem, lift = glued(comm, RCCM(C, C, WORK, viscosity=args.viscosity * WORK, order=args.order))
    times = np.linspace(0.0, 6.0, 12 * args.steps + 1)
    beta = intensities(args, times)

    def load(t):
        ahead = np.interp(t, times, beta) ** 2 * C / YOUNG
        lift.value[1] = U0 * t * (1 + ahead)

    with io.EvolutionSeries(folder, problem, every=args.steps) as series:
        history = QuasiStatic(problem, load).run(times, observer=series)

    tables = [s.result.tables["contact"] for s in history.steps]
    u = np.array([t.un.mean() for t in tables]) / U0
    pull = np.array([-t.pressure.mean() for t in tables]) / np.sqrt(WORK * C)
    if comm.rank == 0:
        curves = {"bond": (u, pull)}
        dotted = {"no viscosity": (u, np.minimum(u, u**-3.0))}
        names = ("u / u0", "pull")
        plot.draw_curves(folder / "pull.png", curves, dotted=dotted, labels=names)

    last = history.steps[-1]
    top = int(np.argmax(pull))
    spent = last.energies.damage + last.energies.stored - last.result.energies["bulk"]
    beta_at = {}
    for opening in ("1.5", "2", "3", "6"):
        step = int(2 * float(opening)) * args.steps
        beta_at[opening] = float(tables[step - 1].beta.mean())
    summary = last.result.summary()
    summary["beta_at"] = beta_at
    summary["peak"] = float(pull[top])
    summary["peak_at"] = float(u[top])
    summary["work"] = spent / WORK
    return summary


def snapped(K):
    """Folds of a node of one element, whose stiffness is K times that of its bond."""

    def node(stiffness, gamma):
        law = RCCM(stiffness, 0.0, WORK)
        system = linear_triangle(
            1, None, (0.0, -1.0), (1.0, 1.0), law=lambda _: law, comm=MPI.COMM_SELF
        )
        system.set_parameter(gamma)
        table = system.problem.solve().tables["contact"]
        return system, float(table.un.max())

    _, free = node(0.0, 1e-3)
    _, held = node(1.0, 1e-3)
    stiffness = held / (free - held) / K
    system, _ = node(stiffness, 0.0)
    u0 = np.sqrt(WORK / stiffness)
    scale = 1e-3 / free
    way = ArcLength(system).run(gamma_range=(0.0, 8 * u0 * scale))
    folds = []
    for step in way.folds:
        table = step.result.tables["contact"]
        u_tot = float(step.gamma / scale / u0)
        u = float(table.un.max() / u0)
        kind = step.event.split()[0]
        folds.append({"u_tot": u_tot, "u": u, "kind": kind})
    return folds


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    summary = opened(args, comm, folder)
    if args.spring:
        summary["folds"] = snapped(args.spring)
    for name in ("beta_at", "peak", "peak_at", "work", "folds"):
        say(f"{name}: {summary.get(name)}")
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
