# SPDX-License-Identifier: LGPL-3.0-or-later
"""A bouncing bar, all schemes.

Reference: Doyen, Ern and Piperno. `demos/demo_bouncing_bar.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import MOTION, ScriptParser, motion_of, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, io, plot
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic

YOUNG = 900.0
DENSITY = 1.0
LENGTH = 10.0
WEIGHT = 10.0
HEIGHT = 5.0
SPEED = 30.0
PERIOD = 16 / 3
ENERGY = 500.0
IMPULSE = 1600 / 3
BRIDGED = 0.05  # gaps in time within an impact
WINDOW = 0.02  # of means
NOTHING = 1e-9  # of the largest force


def arguments(argv=None):
    parser = ScriptParser("A bar that bounces", output="output/bouncing_bar", **MOTION)
    add = parser.add_argument
    positive = number(above=0)
    count = number(int, above=1)
    add("--elements", type=count, default=50, help="along the bar")
    add("--dt", type=positive, help="length of a step (default: h/c)")
    add("--end", type=positive, default=PERIOD, help="of the time")
    args = parser.parse(argv)
    args.dt = args.dt or LENGTH / args.elements / SPEED
    return args


def bar(n, comm, *, weight=WEIGHT, height=HEIGHT, obstacle=None):
    """A bar of n cells over a floor, whose sections move up and down only."""
    ends = [[0.0, 0.0], [1.0, LENGTH]]
    square = mesh.CellType.quadrilateral
    domain = mesh.create_rectangle(comm, ends, [1, n], square)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    W = V.sub(0)
    sideways, _ = W.collapse()
    everywhere = fem.locate_dofs_geometrical((W, sideways), lambda x: x[0] < 2)
    straight = fem.dirichletbc(fem.Function(sideways), everywhere, W)
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    floor = obstacle(domain) if obstacle else HalfSpace((0.0, -height), (0.0, 1.0))
    surface = ContactSurface(u, below, obstacle=floor, law=Frictionless())
    elastic = LinearElastic.from_young(YOUNG, 0.0)
    load = DENSITY * fem.Constant(domain, float(weight)) * u[1] * ufl.dx
    energy = elastic.energy(u) * ufl.dx + load
    return ContactProblem(energy, u, [surface], bcs=[straight])


def impulse(t):
    """Return the exact impulse of the floor up to a time, at most 16/3."""
    a = np.clip(t, 1, 5 / 3) - 1
    b = np.clip(t, 11 / 3, 13 / 3) - 11 / 3
    return 300 * a + 150 * a**2 + 500 * b - 150 * b**2


def impacts_of(times, force):
    """Start, end and impulse of every impact."""
    dt = np.diff(times)
    impacts = []
    for k in np.flatnonzero(force > NOTHING * force.max()):
        if not impacts or times[k] - impacts[-1][1] >= BRIDGED:
            impacts.append([times[k], 0.0, 0.0])
        impact = impacts[-1]
        impact[1] = times[k + 1]
        impact[2] += force[k] * dt[k]
    return impacts


def compared(times, force):
    """Impacts, and errors of forces, which are means over the steps between times."""
    dt = np.diff(times)
    largest = force.max()
    on = np.flatnonzero(force > NOTHING * largest)
    exact = np.diff(impulse(times)) / dt
    raw = np.abs(force - exact)

    # Means over windows are differences of the impulse at their ends.
    given = np.append(0.0, np.cumsum(force * dt))
    half = WINDOW / 2
    t = np.linspace(half, times[-1] - half, 20001)
    before = np.interp(t - half, times, given) - impulse(t - half)
    after = np.interp(t + half, times, given) - impulse(t + half)
    averaged = np.mean(np.abs(after - before)) / WINDOW
    variation = np.abs(np.diff(force[on])).sum()
    return {
        "impacts": impacts_of(times, force),
        "force_error": raw @ dt / IMPULSE,
        "force_error_averaged": averaged * np.ptp(t) / IMPULSE,
        "force_error_largest": raw.max() / 500,
        "oscillation": variation / max(largest, NOTHING),
    }


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    problem = bar(args.elements, comm)
    motion = NSCD(problem, DENSITY, dt=args.dt, **motion_of(args))
    history = motion.run([0.0, args.end])

    ends = np.array([s.time for s in history.steps])
    times = np.append(0.0, ends)
    tables = [s.result.tables["contact"] for s in history.steps]
    force = np.array([table.rn.sum() for table in tables])
    energies = [s.energies for s in history.steps]
    energy = [1.0]
    for e in energies:
        change = e.kinetic + e.stored - e.external
        energy.append(1 + change / ENERGY)
    summary = compared(times, force)
    summary["energy_end"] = energy[-1]
    summary["steps"] = len(force)
    summary["energy_residue"] = max(abs(e.residue) for e in energies) / ENERGY
    say("\n".join(f"{key}: {value}" for key, value in summary.items()))
    rows = [{"t": t, "force": f} for t, f in zip(ends, force, strict=True)]
    io.write_rows(comm, folder / "contact_force.csv", rows)
    io.write_rows(comm, folder / "steps.csv", history.rows())

    if comm.rank == 0:
        means = np.diff(impulse(times)) / np.diff(times)
        curves = {"mean over a step": (ends, force)}
        exact = {"exact": (ends, means)}
        axes = ("time", "contact force")
        plot.draw_curves(folder / "force.png", curves, dotted=exact, labels=axes)
        curves = {"computed": (times, energy)}
        exact = {"exact": (times, np.ones_like(times))}
        axes = ("time", "energy over that of the start")
        plot.draw_curves(folder / "energy.png", curves, dotted=exact, labels=axes)
    last = history.steps[-1].result.summary()
    return io.write_summary(comm, folder, last | summary)


if __name__ == "__main__":
    main()
