# SPDX-License-Identifier: LGPL-3.0-or-later
"""A block that slides to rest.

Reference: a point mass.

The block is pushed off with the speed v0. A point mass stops at v0/(mu g), after v0^2/(2 mu g).
So does the middle of an elastic block while all of its face slips: its pressure sways with the
shear that friction causes, its sum is the weight. A block higher than W/mu would tip over. The
stop is when 2 % of the speed are left, over 0.98: at the end the block sways, sticks and slips.
"""

from mpi4py import MPI

import numpy as np
from _case import MOTION, ScriptParser, motion_of, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    io,
    plot,
)
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic

DENSITY = 1.0
WEIGHT = 10.0
SPEED = 1.0
LEFT = 0.02


def arguments(argv=None):
    given = dict(friction=0.3, young=1e6, poisson=0.3, **MOTION)
    parser = ScriptParser("A sliding block", output="output/sliding_block", **given)
    add = parser.add_argument
    positive = number(above=0)
    count = number(int, above=0)
    add("--elements", type=count, default=8, help="over the height")
    add("--width", type=positive, default=2.0, help="of the block")
    add("--height", type=positive, default=1.0, help="of the block")
    add("--dt", type=positive, help="of a step (default: 1/200 of the stop)")
    add("--damping", type=number(least=0), default=0.0, help="of K, a time")
    args = parser.parse(argv)
    if not 0 < args.friction * args.height < args.width:
        parser.error("the block needs friction, and mu H < W, or it tips over")
    args.dt = args.dt or SPEED / (args.friction * WEIGHT) / 200
    return args


def block(args, comm, law, held=False):
    """A block on a floor, under its weight; if it is held, a corner does not move sideways."""
    across = max(round(args.elements * args.width / args.height), 1)
    corners = [[0.0, 0.0], [args.width, args.height]]
    square = mesh.CellType.quadrilateral
    domain = mesh.create_rectangle(comm, corners, [across, args.elements], square)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, below, obstacle=floor, law=law)
    elastic = LinearElastic.from_young(args.young, args.poisson)
    load = DENSITY * fem.Constant(domain, WEIGHT) * u[1] * ufl.dx
    energy = elastic.energy(u) * ufl.dx + load
    bcs = []
    if held:
        W = V.sub(0)
        sideways, _ = W.collapse()
        low = 1e-9 - args.height
        corner = fem.locate_dofs_geometrical((W, sideways), lambda x: x[0] - x[1] < low)
        bcs.append(fem.dirichletbc(fem.Function(sideways), corner, W))
    return ContactProblem(energy, u, [surface], bcs=bcs)


def stop_of(times, speed):
    """When LEFT of the speed is left, over 1 - LEFT."""
    slow = int(np.argmax(speed <= LEFT * SPEED)) or len(speed) - 1
    around = slice(slow - 1, slow + 1)
    # Speeds fall; np.interp needs numbers that increase.
    known = np.interp(-LEFT * SPEED, -speed[around], times[around])
    return known / (1 - LEFT)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    problem = block(args, comm, Coulomb(args.friction))

    # The block begins in its shape at rest, and with one velocity.
    rest = block(args, comm, Frictionless(), held=True)
    at_rest = rest.solve()
    say(f"at rest: {at_rest.counts}")
    problem.u.x.array[:] = rest.u.x.array
    velocity = fem.Function(problem.V)
    velocity.interpolate(lambda x: np.array([SPEED + 0 * x[0], 0 * x[0]]))

    stop = SPEED / (args.friction * WEIGHT)
    damping = (0.0, args.damping) if args.damping else None
    motion = NSCD(
        problem,
        DENSITY,
        dt=args.dt,
        velocity=velocity,
        **motion_of(args),
        damping=damping,
    )
    history = motion.run([0.0, 1.2 * stop])

    ends = np.array([s.time for s in history.steps])
    times = np.append(0.0, ends)
    dt = np.diff(times)
    force = np.array([s.result.resultants["contact"][0] for s in history.steps])
    energies = [s.energies for s in history.steps]
    mass = DENSITY * args.width * args.height
    given = np.append(0.0, np.cumsum(force * dt))
    speed = SPEED + given / mass
    means = (speed[1:] + speed[:-1]) / 2
    distance = np.append(0.0, np.cumsum(means * dt))
    start = mass * SPEED**2 / 2
    summary = {
        "stop_time": stop_of(times, speed),
        "stop_time_closed_form": stop,
        "distance": distance.max(),
        "distance_closed_form": SPEED * stop / 2,
        "dissipated": energies[-1].dissipated / start,
        "energy_residue": max(abs(e.residue) for e in energies) / start,
    }
    say("\n".join(f"{key}: {value}" for key, value in summary.items()))
    io.write_rows(comm, folder / "steps.csv", history.rows())

    if comm.rank == 0:
        computed = {"elastic block": (times, speed)}
        point_mass = SPEED * np.maximum(1 - times / stop, 0)
        exact = {"point mass": (times, point_mass)}
        axes = ("time", "mean velocity")
        plot.draw_curves(folder / "speed.png", computed, dotted=exact, labels=axes)
        curves = {}
        for kind in ("kinetic", "stored", "dissipated", "contact"):
            parts = [getattr(e, kind) / start for e in energies]
            curves[kind] = (ends, parts)
        axes = ("time", "energy over that of the start")
        plot.draw_curves(folder / "energy.png", curves, labels=axes)
    last = history.steps[-1].result.summary()
    return io.write_summary(comm, folder, last | summary)


if __name__ == "__main__":
    main()
