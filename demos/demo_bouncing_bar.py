# SPDX-License-Identifier: LGPL-3.0-or-later
# # A bar that falls on a floor and bounces
#
# This demo illustrates how to:
#
# - set a body with mass in motion (`NSCD`), by the scheme, level and mass that the options tell;
# - compare contact force and energy with an exact solution, over every impact.
#
# An elastic bar falls under its weight. When it hits, a wave runs up, is reflected at the free end,
# and lifts the bar off; it swings, and the second impact takes the swinging away: at 16/3 it rests
# where it was. The floor pushes with 300 + 300 (t - 1) for 1 < t < 5/3, with 500 - 300 (t - 11/3)
# for 11/3 < t < 13/3; the energy, 500, stays (Doyen, Ern and Piperno, SIAM J. Sci. Comput. 2011).
#
# Steps are h/c by default, a cell's way of the wave. With other masses the force alternates.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic

YOUNG, DENSITY, LENGTH, WEIGHT, HEIGHT = 900.0, 1.0, 10.0, 10.0, 5.0
SPEED, PERIOD, ENERGY, IMPULSE = 30.0, 16 / 3, 500.0, 1600 / 3
BRIDGED, WINDOW, NOTHING = 0.05, 0.02, 1e-9  # gaps of an impact, of means, of the largest force


def arguments(argv=None):
    parser = ScriptParser("A bar that bounces", output="output/bouncing_bar")
    part, levels = number(least=0, most=1), ("position", "velocity")
    masses = ("redistributed", "lumped", "consistent")
    schemes = ("theta", "theta-euler", "modified-theta")
    parser.add_argument("--elements", type=number(int, above=1), default=50, help="along the bar")
    parser.add_argument("--scheme", choices=schemes, default="theta", help="of steps")
    parser.add_argument("--level", choices=levels, default="position", help="of the law")
    parser.add_argument("--theta", type=part, default=0.5, help="weight of a step's end")
    parser.add_argument("--dt", type=number(above=0), help="length of a step (default: h/c)")
    parser.add_argument("--mass", choices=masses, default="redistributed", help="matrix")
    parser.add_argument("--restitution", type=part, default=0.0, help="at the velocity level")
    parser.add_argument("--end", type=number(above=0), default=PERIOD, help="of the time")
    args = parser.parse(argv)
    args.dt = args.dt or LENGTH / args.elements / SPEED
    return args


def bar(n, comm, *, weight=WEIGHT, height=HEIGHT, obstacle=None):
    """A bar of n cells over a floor, whose sections move up and down only."""
    ends, square = [[0.0, 0.0], [1.0, LENGTH]], mesh.CellType.quadrilateral
    domain = mesh.create_rectangle(comm, ends, [1, n], square)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    W, u = V.sub(0), fem.Function(V, name="displacement")
    everywhere = fem.locate_dofs_geometrical((W, W.collapse()[0]), lambda x: x[0] < 2)
    straight = fem.dirichletbc(fem.Function(W.collapse()[0]), everywhere, W)
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    floor = obstacle(domain) if obstacle else HalfSpace((0.0, -height), (0.0, 1.0))
    surface = ContactSurface(u, below, obstacle=floor, law=Frictionless())
    load = DENSITY * fem.Constant(domain, float(weight)) * u[1] * ufl.dx
    energy = LinearElastic.from_young(YOUNG, 0.0).energy(u) * ufl.dx + load
    return ContactProblem(energy, u, [surface], bcs=[straight])


def impulse(t):
    """What the floor has given the bar, exactly, up to 16/3."""
    a, b = np.clip(t, 1, 5 / 3) - 1, np.clip(t, 11 / 3, 13 / 3) - 11 / 3
    return 300 * a + 150 * a**2 + 500 * b - 150 * b**2


def compared(times, force):
    """Impacts, and errors of forces, which are means over the steps between times."""
    dt, on, impacts = np.diff(times), np.flatnonzero(force > NOTHING * force.max()), []
    for k in on:
        if not impacts or times[k] - impacts[-1][1] >= BRIDGED:
            impacts.append([times[k], 0.0, 0.0])
        impacts[-1][1:] = times[k + 1], impacts[-1][2] + force[k] * dt[k]
    given = np.append(0.0, np.cumsum(force * dt))
    t = np.linspace(WINDOW / 2, times[-1] - WINDOW / 2, 20001)
    off = [np.interp(t + s, times, given) - impulse(t + s) for s in (-WINDOW / 2, WINDOW / 2)]
    raw = np.abs(force - np.diff(impulse(times)) / dt)
    return {
        "impacts": impacts,
        "force_error": raw @ dt / IMPULSE,
        "force_error_averaged": np.mean(np.abs(off[1] - off[0])) / WINDOW * np.ptp(t) / IMPULSE,
        "force_error_largest": raw.max() / 500,
        "oscillation": np.abs(np.diff(force[on])).sum() / max(force.max(), NOTHING),
    }


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    problem = bar(args.elements, comm)
    how = {k: getattr(args, k) for k in ("scheme", "level", "theta", "mass", "restitution")}
    history = NSCD(problem, DENSITY, dt=args.dt, **how).run([0.0, args.end])
    times = np.array([0.0, *(s.time for s in history.steps)])
    force = np.array([s.result.tables["contact"].rn.sum() for s in history.steps])
    energies = [s.energies for s in history.steps]
    energy = [1.0, *(1 + (e.kinetic + e.stored - e.external) / ENERGY for e in energies)]
    summary = compared(times, force) | {"energy_end": energy[-1], "steps": len(force)}
    summary["energy_residue"] = max(abs(e.residue) for e in energies) / ENERGY
    say("\n".join(f"{key}: {value}" for key, value in summary.items()))
    rows = [dict(t=t, force=f) for t, f in zip(times[1:], force, strict=True)]
    output.write_rows(comm, folder / "contact_force.csv", rows)
    output.write_rows(comm, folder / "steps.csv", history.rows())
    if comm.rank == 0:
        exact = {"exact": (times[1:], np.diff(impulse(times)) / np.diff(times))}
        curves, axes = {"mean over a step": (times[1:], force)}, ("time", "contact force")
        output.draw_curves(folder / "force.png", curves, dotted=exact, labels=axes)
        curves, exact = {"computed": (times, energy)}, {"exact": (times, 0 * times + 1)}
        axes = "time", "energy over that of the start"
        output.draw_curves(folder / "energy.png", curves, dotted=exact, labels=axes)
    return output.write_summary(comm, folder, history.steps[-1].result.summary() | summary)


if __name__ == "__main__":
    main()
