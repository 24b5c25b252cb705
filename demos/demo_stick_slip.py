# SPDX-License-Identifier: LGPL-3.0-or-later
# # A block on a belt: it sticks, and slips
#
# This demo illustrates how to:
#
# - move the floor under a body with mass: a `RigidBody` whose motion is given in time;
# - find begin and end of sticking in a history, and compare with the oscillator of one degree.
#
# A block with springs to its surroundings, of the frequency w, stands on a belt that begins to run
# with the speed V. The belt drags it along with the force mu g per mass: it slips, from rest, about
# u = mu g/w^2, u (1 - cos w t), until it is as fast as the belt, at w t = arcsin(V/(u w)). There it
# sticks, and rides on, until its springs pull with mu g. Then it slips and swings about u with the
# amplitude V/w, in each period of 2 pi/w it is once as fast as the belt, and slips again at once.
#
# So it goes on: with a friction coefficient that is the same at rest and in motion it sticks once.
# Where sticking returns in every period friction falls with the speed, or with the way slipped.
# Some damping calms the rattle of the stiff block on its corners.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, RigidBody, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic

WIDTH, HEIGHT, DENSITY, WEIGHT, FREQUENCY = 2.0, 1.0, 1.0, 10.0, 2 * np.pi


def arguments(argv=None):
    given = dict(n=2, friction=0.3, young=1e6, poisson=0.3)
    parser = ScriptParser("A block on a belt", output="output/stick_slip", **given)
    parser.add_argument("--belt", type=number(above=0), default=0.1, help="speed of the belt")
    parser.add_argument("--dt", type=number(above=0), default=0.005, help="length of a step")
    parser.add_argument("--damping", type=number(least=0), default=1e-4, help="of K, a time")
    parser.add_argument("--end", type=number(above=0), default=3.0, help="of the time, in periods")
    args = parser.parse(argv)
    if not args.belt * FREQUENCY < args.friction * WEIGHT:
        parser.error("so fast a belt is never reached: w V must be less than mu g")
    return args


def block_on_belt(args, comm):
    """The block at rest, and the way of the belt."""
    corners, cells = [[0.0, 0.0], [WIDTH, HEIGHT]], [2 * args.n, args.n]
    domain = mesh.create_rectangle(comm, corners, cells, mesh.CellType.quadrilateral)
    V, way = fem.functionspace(domain, ("Lagrange", 1, (2,))), fem.Constant(domain, 0.0)
    u, floor = fem.Function(V, name="displacement"), HalfSpace((0.0, 0.0), (0.0, 1.0))
    belt = RigidBody(floor, about=(0, 0), motion={"x": way}, held=("y", "rz"), name="belt")
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    surface = ContactSurface(u, below, obstacle=belt, law=Coulomb(args.friction))
    stored = LinearElastic.from_young(args.young, args.poisson).energy(u)
    springs = fem.Constant(domain, FREQUENCY**2) * u[0] ** 2 / 2
    per_mass = springs + fem.Constant(domain, WEIGHT) * u[1]
    problem = ContactProblem((stored + DENSITY * per_mass) * ufl.dx, u, [surface])
    problem.solve()
    return problem, way


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    problem, way = block_on_belt(args, comm)
    size = WIDTH * HEIGHT
    middle, places = fem.form(problem.u[0] / size * ufl.dx), [0.0]

    def load(t):
        way.value = args.belt * t

    def watch(_):
        places.append(comm.allreduce(fem.assemble_scalar(middle)))

    motion = NSCD(problem, DENSITY, dt=args.dt, load=load, damping=(0.0, args.damping))
    history = motion.run([0.0, 2 * np.pi / FREQUENCY * args.end], observer=watch)
    times, u = np.array([0.0, *(s.time for s in history.steps)]), np.array(places)
    stuck = ["k" in s.status for s in history.steps]
    runs = np.flatnonzero(np.diff([False, *stuck, False])).reshape(-1, 2)
    first, last = runs[np.argmax(np.diff(runs)[:, 0])] if len(runs) else (0, 0)
    mean = args.friction * WEIGHT / FREQUENCY**2
    caught = np.arcsin(args.belt / (mean * FREQUENCY)) / FREQUENCY
    let_go = caught + mean * np.cos(FREQUENCY * caught) / args.belt
    later = times > let_go + 0.05
    swing = np.where(later, u - mean, 0.0)
    up = np.flatnonzero((swing[:-1] < 0) & (swing[1:] >= 0) & later[:-1])
    through = times[up] - swing[up] * np.diff(times)[up] / np.diff(swing)[up]
    account = history.energies
    summary = {
        "stick": [times[first], times[last]],
        "stick_closed_form": [caught, let_go],
        "amplitude": np.ptp(u[later]) / 2,
        "amplitude_closed_form": args.belt / FREQUENCY,
        "period": np.diff(through).mean() if len(through) > 1 else None,
        "period_closed_form": 2 * np.pi / FREQUENCY,
        "work_of_the_belt": account.external,
        "energy_residue": max(abs(s.energies.residue) for s in history.steps) / account.external,
    }
    say("\n".join(f"{key}: {value}" for key, value in summary.items()))
    output.write_rows(comm, folder / "steps.csv", history.rows())
    if comm.rank == 0:
        w, t = FREQUENCY, times
        ride = mean * (1 - np.cos(w * caught)) + args.belt * (t - caught)
        slips = mean * (1 - np.cos(w * t)), mean + args.belt / w * np.sin(w * (t - let_go))
        exact = np.select([t < caught, t < let_go], [slips[0], ride], slips[1])
        curves, dotted = {"block": (times, u)}, {"one degree": (times, exact)}
        output.draw_curves(folder / "way.png", curves, dotted=dotted, labels=("time", "way"))
    return output.write_summary(comm, folder, history.steps[-1].result.summary() | summary)


if __name__ == "__main__":
    main()
