# SPDX-License-Identifier: LGPL-3.0-or-later
# # A block that slides until friction has stopped it
#
# This demo illustrates how to:
#
# - begin a motion with a static solution: an elastic block on a floor, under its weight;
# - follow it with friction to its rest, and see where its energy goes.
#
# The block is pushed off with the speed v0. A point mass stops at v0/(mu g), after v0^2/(2 mu g).
# So does the middle of an elastic block while all of its face slips: its pressure sways with the
# shear that friction causes, its sum is the weight. A block higher than W/mu would tip over. The
# stop is when 2 % of the speed are left, over 0.98: at the end the block sways, sticks and slips.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    output,
)
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic

DENSITY, WEIGHT, SPEED, LEFT = 1.0, 10.0, 1.0, 0.02


def arguments(argv=None):
    given = dict(friction=0.3, young=1e6, poisson=0.3)
    parser = ScriptParser("A sliding block", output="output/sliding_block", **given)
    part, levels = number(least=0, most=1), ("position", "velocity")
    masses = ("redistributed", "lumped", "consistent")
    schemes = ("theta", "theta-euler", "modified-theta")
    parser.add_argument("--elements", type=number(int, above=0), default=8, help="over the height")
    parser.add_argument("--width", type=number(above=0), default=2.0, help="of the block")
    parser.add_argument("--height", type=number(above=0), default=1.0, help="of the block")
    parser.add_argument("--scheme", choices=schemes, default="theta", help="of steps")
    parser.add_argument("--level", choices=levels, default="position", help="of the law")
    parser.add_argument("--theta", type=part, default=0.5, help="weight of a step's end")
    parser.add_argument("--dt", type=number(above=0), help="of a step (default: 1/200 of the stop)")
    parser.add_argument("--mass", choices=masses, default="redistributed", help="matrix")
    parser.add_argument("--restitution", type=part, default=0.0, help="at the velocity level")
    parser.add_argument("--damping", type=number(least=0), default=0.0, help="of K, a time")
    args = parser.parse(argv)
    if not 0 < args.friction * args.height < args.width:
        parser.error("the block needs friction, and mu H < W, or it tips over")
    args.dt = args.dt or SPEED / (args.friction * WEIGHT) / 200
    return args


def block(args, comm, law, held=False):
    """A block on a floor, under its weight; if it is held, a corner does not move sideways."""
    across = max(round(args.elements * args.width / args.height), 1)
    corners, square = [[0.0, 0.0], [args.width, args.height]], mesh.CellType.quadrilateral
    domain = mesh.create_rectangle(comm, corners, [across, args.elements], square)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    surface = ContactSurface(u, below, obstacle=HalfSpace((0, 0), (0, 1)), law=law)
    load = DENSITY * fem.Constant(domain, WEIGHT) * u[1] * ufl.dx
    energy = LinearElastic.from_young(args.young, args.poisson).energy(u) * ufl.dx + load
    W, none, low = V.sub(0), fem.Function(V.sub(0).collapse()[0]), 1e-9 - args.height
    corner = fem.locate_dofs_geometrical((W, none.function_space), lambda x: x[0] - x[1] < low)
    bcs = [fem.dirichletbc(none, corner, W)] if held else []
    return ContactProblem(energy, u, [surface], bcs=bcs)


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    problem = block(args, comm, Coulomb(args.friction))
    rest = block(args, comm, Frictionless(), held=True)
    say(f"at rest: {rest.solve().counts}")
    problem.u.x.array[:] = rest.u.x.array
    velocity, mass = fem.Function(problem.V), DENSITY * args.width * args.height
    velocity.interpolate(lambda x: np.array([SPEED + 0 * x[0], 0 * x[0]]))
    stop = SPEED / (args.friction * WEIGHT)
    how = {k: getattr(args, k) for k in ("scheme", "level", "theta", "mass", "restitution")}
    how["damping"] = (0.0, args.damping) if args.damping else None
    motion = NSCD(problem, DENSITY, dt=args.dt, velocity=velocity, **how)
    history = motion.run([0.0, 1.2 * stop])
    times = np.array([0.0, *(s.time for s in history.steps)])
    force = np.array([s.result.resultants["contact"][0] for s in history.steps])
    speed = SPEED + np.append(0.0, np.cumsum(force * np.diff(times))) / mass
    slow = int(np.argmax(speed <= LEFT * SPEED)) or len(speed) - 1
    known = np.interp(-LEFT * SPEED, -speed[slow - 1 : slow + 1], times[slow - 1 : slow + 1])
    energies, start = [s.energies for s in history.steps], mass * SPEED**2 / 2
    distance = np.append(0.0, np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(times)))
    summary = {
        "stop_time": known / (1 - LEFT),
        "stop_time_closed_form": stop,
        "distance": distance.max(),
        "distance_closed_form": SPEED * stop / 2,
        "dissipated": energies[-1].dissipated / start,
        "energy_residue": max(abs(e.residue) for e in energies) / start,
    }
    say("\n".join(f"{key}: {value}" for key, value in summary.items()))
    output.write_rows(comm, folder / "steps.csv", history.rows())
    if comm.rank == 0:
        exact = {"point mass": (times, SPEED * np.maximum(1 - times / stop, 0))}
        axes = "time", "mean velocity"
        output.draw_curves(folder / "speed.png", {"": (times, speed)}, dotted=exact, labels=axes)
        kinds = ("kinetic", "stored", "dissipated", "contact")
        curves = {k: (times[1:], [getattr(e, k) / start for e in energies]) for k in kinds}
        labels = "time", "energy over that of the start"
        output.draw_curves(folder / "energy.png", curves, labels=labels)
    return output.write_summary(comm, folder, history.steps[-1].result.summary() | summary)


if __name__ == "__main__":
    main()
