# SPDX-License-Identifier: LGPL-3.0-or-later
"""A cube thrown at a wall or at another cube.

Reference: balances of momentum. `demos/demo_thrown_body.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    io,
    plot,
)
from dolfinx_contact.continuation import Observers
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import NeoHookean, lame
from dolfinx_contact.meshing import join

DENSITY = 1.0
GAP = 0.05


def arguments(argv=None):
    given = dict(n=3, friction=0.3, young=1000.0, poisson=0.3)
    parser = ScriptParser("A thrown body", output="output/thrown_body", **given)
    parser.add_argument("--two", action="store_true", help="throw it at another body")
    parser.add_argument("--tilt", type=number(), default=-20.0, help="of one cube alone, degrees")
    speed = dict(type=number(), nargs=3, default=[2.0, 0.5, -3.0])
    parser.add_argument("--speed", help="of it; the wall is below", **speed)
    parser.add_argument("--dt", type=number(above=0), default=0.002, help="length of a step")
    parser.add_argument("--end", type=number(above=0), default=0.2, help="of the time")
    return parser.parse(argv)


def bodies(args, comm):
    """The problem, the velocity at the start, and dx of each body."""
    corners = [[[0, 0, GAP], [1, 1, 1 + GAP]]]
    if args.two:
        corners.append([[0, 0, -1], [1, 1, 0]])
    n = 3 * [args.n]
    box = mesh.CellType.hexahedron
    cubes = [mesh.create_box(comm, ends, n, box) for ends in corners]
    both = join(cubes)
    domain = both.mesh
    dx = ufl.Measure("dx", domain, subdomain_data=both.cell_tags)
    parts = [dx(i + 1) for i in range(len(cubes))]
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V, name="displacement")
    velocity = fem.Function(V, name="velocity")
    velocity.interpolate(lambda x: np.outer(args.speed, x[2] > GAP / 2))

    low = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], GAP))
    top = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0))
    law = Coulomb(args.friction)
    if args.two:
        contact = ContactPair(u, low, master_facets=top, law=law)
    else:
        tilted(domain, np.deg2rad(args.tilt))
        wall = HalfSpace((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        contact = ContactSurface(u, low, obstacle=wall, law=law)
    material = NeoHookean(*lame(args.young, args.poisson))
    problem = ContactProblem(material.energy(u) * ufl.dx, u, [contact])
    return problem, velocity, parts


def tilted(domain, turn):
    """Turn the cube about the y axis, and put its lowest edge at the gap above the wall."""
    c = np.cos(turn)
    s = np.sin(turn)
    rotation = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    x = domain.geometry.x
    x[:] = x @ rotation
    mine = x[:, 2].min(initial=np.inf)
    lowest = domain.comm.allreduce(mine, op=MPI.MIN)
    x[:, 2] += GAP - lowest


def meter(problem, velocity, parts):
    """The function that measures the bodies in their state."""
    domain = problem.V.mesh
    place = ufl.SpatialCoordinate(domain) + problem.u
    moment = ufl.cross(place, velocity)
    fields = [vector[i] for vector in (velocity, moment, place) for i in range(3)]
    forms = []
    for dx in parts:
        forms.append([fem.form(DENSITY * f * dx) for f in fields])

    def measured():
        """Momentum, angular momentum about the origin, and centre of mass; (bodies, 3, 3)."""
        mine = np.array([[fem.assemble_scalar(f) for f in body] for body in forms])
        return domain.comm.allreduce(mine).reshape(-1, 3, 3)

    return measured


def draw(folder, history, spins):
    """The spin of each body in time."""
    times = np.array([0.0, *(s.time for s in history.steps)])
    curves = {}
    for i in range(spins.shape[1]):
        curves[f"body {i + 1}"] = (times, spins[:, i, 1])
    labels = ("time", "angular momentum about the centre, y")
    plot.draw_curves(folder / "spin.png", curves, labels=labels)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    problem, velocity, parts = bodies(args, comm)
    measured = meter(problem, velocity, parts)

    rows = [measured()]
    given = np.zeros((2, 3))  # impulse of the forces, and of their moments
    how = dict(level="velocity", mass="consistent")
    motion = NSCD(problem, DENSITY, dt=args.dt, velocity=velocity, **how)
    with io.EvolutionSeries(folder, problem, every=5) as series:

        def watch(step):
            table = step.result.tables["contact"]
            h = step.time - step.start
            sides = (table.x + table.ut)[:, :2]
            points = np.column_stack([sides, table.un])
            moments = np.cross(points, table.force)
            given[0] += h * table.force.sum(0)
            given[1] += h * moments.sum(0)
            rows.append(measured())

        history = motion.run([0.0, args.end], observer=Observers(series, watch))

    found = np.array(rows)
    momenta = found[:, :, 0]
    angular = found[:, :, 1]
    centres = found[:, :, 2]
    spins = angular - np.cross(centres, momenta)  # the mass is 1
    change = found[-1, 0, :2] - found[0, 0, :2]
    if args.two:
        other = found[0, 1, :2] - found[-1, 1, :2]
        off = change - other
    else:
        off = change - given
    account = history.energies
    summary = {
        "momenta": momenta[-1],
        "spins": spins[-1],
        "impulse": given[0],
        "momentum_error": np.abs(off[0]).max() / np.abs(change[0]).max(),
        "moment_error": np.abs(off[1]).max() / np.abs(change[1]).max(),
        "energy_error": abs(account.residue) / account.at_start,
    }
    summary.update(account.row())
    for key, value in summary.items():
        say(f"{key}: {value}")

    if comm.rank == 0:
        draw(folder, history, spins)
    plot.picture_of_body(folder / "body.png", problem)
    last = history.steps[-1].result.summary()
    return io.write_summary(comm, folder, last | summary)


if __name__ == "__main__":
    main()
