# SPDX-License-Identifier: LGPL-3.0-or-later
"""A block on a belt.

Reference: one degree of freedom. `demos/demo_stick_slip.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, RigidBody, io, plot
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic

WIDTH = 2.0
HEIGHT = 1.0
DENSITY = 1.0
WEIGHT = 10.0
FREQUENCY = 2 * np.pi


def arguments(argv=None):
    given = dict(n=2, friction=0.3, young=1e6, poisson=0.3)
    parser = ScriptParser("A block on a belt", output="output/stick_slip", **given)
    parser.add_argument("--belt", type=number(above=0), default=0.1, help="speed of the belt")
    parser.add_argument("--dt", type=number(above=0), default=0.005, help="length of a step")
    parser.add_argument("--damping", type=number(least=0), default=1e-4, help="of K, a time")
    parser.add_argument("--end", type=number(above=0), default=3.0, help="of the time, in periods")
    args = parser.parse(argv)
    reached = args.belt * FREQUENCY < args.friction * WEIGHT
    if not reached:
        parser.error("so fast a belt is never reached: w V must be less than mu g")
    return args


def block_on_belt(args, comm):
    """The block at rest, and the way of the belt."""
    corners = [[0.0, 0.0], [WIDTH, HEIGHT]]
    cells = [2 * args.n, args.n]
    domain = mesh.create_rectangle(comm, corners, cells, mesh.CellType.quadrilateral)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    way = fem.Constant(domain, 0.0)
    u = fem.Function(V, name="displacement")
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    belt = RigidBody(floor, about=(0, 0), motion={"x": way}, held=("y", "rz"), name="belt")
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    law = Coulomb(args.friction)
    surface = ContactSurface(u, below, obstacle=belt, law=law)
    material = LinearElastic.from_young(args.young, args.poisson)
    stored = material.energy(u)
    stiffness = fem.Constant(domain, FREQUENCY**2)
    springs = stiffness * u[0] ** 2 / 2
    weight = fem.Constant(domain, WEIGHT)
    per_mass = springs + weight * u[1]
    energy = (stored + DENSITY * per_mass) * ufl.dx
    problem = ContactProblem(energy, u, [surface])
    problem.solve()
    return problem, way


def one_degree(args):
    """Mean distance of the oscillator; times when the belt catches and releases it."""
    w = FREQUENCY
    mean = args.friction * WEIGHT / w**2
    caught = np.arcsin(args.belt / (mean * w)) / w
    released = caught + mean * np.cos(w * caught) / args.belt
    return mean, caught, released


def way_of_one_degree(args, t):
    mean, caught, released = one_degree(args)
    w = FREQUENCY
    slips = mean * (1 - np.cos(w * t))
    joins = mean * (1 - np.cos(w * caught))
    rides = joins + args.belt * (t - caught)
    swings = mean + args.belt / w * np.sin(w * (t - released))
    return np.select([t < caught, t < released], [slips, rides], swings)


def longest_stick(history):
    """First and last index of the longest time in which a point sticks."""
    stuck = ["k" in step.status for step in history.steps]
    changes = np.diff([False, *stuck, False])
    runs = np.flatnonzero(changes).reshape(-1, 2)
    if len(runs) == 0:
        return 0, 0
    lengths = np.diff(runs)[:, 0]
    return runs[np.argmax(lengths)]


def period_of(swing, times, later):
    """Mean time between passages upwards through zero."""
    rises = (swing[:-1] < 0) & (swing[1:] >= 0)
    up = np.flatnonzero(rises & later[:-1])
    steps = np.diff(times)[up]
    through = times[up] - swing[up] * steps / np.diff(swing)[up]
    if len(through) < 2:
        return None
    return np.diff(through).mean()


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    problem, way = block_on_belt(args, comm)
    size = WIDTH * HEIGHT
    middle = fem.form(problem.u[0] / size * ufl.dx)
    places = [0.0]

    def load(t):
        way.value = args.belt * t

    def watch(_):
        places.append(comm.allreduce(fem.assemble_scalar(middle)))

    damping = (0.0, args.damping)
    motion = NSCD(problem, DENSITY, dt=args.dt, load=load, damping=damping)
    period = 2 * np.pi / FREQUENCY
    history = motion.run([0.0, period * args.end], observer=watch)
    times = np.array([0.0, *(step.time for step in history.steps)])
    u = np.array(places)
    first, last = longest_stick(history)
    mean, caught, released = one_degree(args)
    later = times > released + 0.05
    swing = np.where(later, u - mean, 0.0)
    account = history.energies
    residues = [abs(step.energies.residue) for step in history.steps]
    found = {
        "stick": [times[first], times[last]],
        "stick_closed_form": [caught, released],
        "amplitude": np.ptp(u[later]) / 2,
        "amplitude_closed_form": args.belt / FREQUENCY,
        "period": period_of(swing, times, later),
        "period_closed_form": period,
        "work_of_the_belt": account.external,
        "energy_residue": max(residues) / account.external,
    }
    for key, value in found.items():
        say(f"{key}: {value}")
    io.write_rows(comm, folder / "steps.csv", history.rows())
    if comm.rank == 0:
        exact = way_of_one_degree(args, times)
        curves = {"block": (times, u)}
        dotted = {"one degree": (times, exact)}
        plot.draw_curves(folder / "way.png", curves, dotted=dotted, labels=("time", "way"))
    last_result = history.steps[-1].result
    summary = last_result.summary() | found
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
