# SPDX-License-Identifier: LGPL-3.0-or-later
# # A body that is thrown at a wall, and comes back with spin
#
# This demo illustrates how to:
#
# - set a hyperelastic body in motion, whose rotations may be large, and animate it in ParaView;
# - measure momentum, angular momentum and energy of an impact, and see what forces did to them;
# - let two bodies hit each other instead (`--two`).
#
# A cube flies obliquely at a rough wall and hits it with an edge. It comes back with a spin. Forces
# at the contact points tell what momentum it gets, their moments what angular momentum; these are
# measured on the body, as integrals of density times velocity, and compared. With `--two` the wall
# is another cube at rest, hit face to face. Pairs are of small sliding: forces stay at points that
# were opposite at first, and both together gain some angular momentum that they should not.
# Impacts are at the level of velocities, where all nodes have mass, and their velocities meaning.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, ContactSurface, Coulomb, HalfSpace, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import NeoHookean, lame
from dolfinx_contact.meshing import join

DENSITY, GAP = 1.0, 0.05


def arguments(argv=None):
    given = dict(n=3, friction=0.3, young=1000.0, poisson=0.3)
    parser = ScriptParser("A thrown body", output="output/thrown_body", **given)
    parser.add_argument("--two", action="store_true", help="throw it at another body")
    parser.add_argument("--tilt", type=number(), default=-20.0, help="of the cube, degrees")
    speed = dict(type=number(), nargs=3, default=[2.0, 0.5, -3.0])
    parser.add_argument("--speed", help="of it; the wall is below", **speed)
    parser.add_argument("--dt", type=number(above=0), default=0.002, help="length of a step")
    parser.add_argument("--end", type=number(above=0), default=0.2, help="of the time")
    return parser.parse(argv)


def bodies(args, comm):
    """The problem, the velocity at the start, and dx of each body."""
    corners = [[[0, 0, GAP], [1, 1, 1 + GAP]], [[0, 0, -1], [1, 1, 0]]][: 1 + args.two]
    n, box = 3 * [args.n], mesh.CellType.hexahedron
    both = join([mesh.create_box(comm, ends, n, box) for ends in corners])
    domain, dx = both.mesh, ufl.Measure("dx", both.mesh, subdomain_data=both.cell_tags)
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u, velocity = fem.Function(V, name="displacement"), fem.Function(V, name="velocity")
    velocity.interpolate(lambda x: np.outer(args.speed, x[2] > GAP / 2))
    low = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], GAP))
    top = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0))
    law, turn = Coulomb(args.friction), np.deg2rad(args.tilt)
    if args.two:
        contact = ContactPair(u, low, master_facets=top, law=law)
    else:
        x, (c, s) = domain.geometry.x, (np.cos(turn), np.sin(turn))
        x[:] = x @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        x[:, 2] += GAP - comm.allreduce(x[:, 2].min(initial=np.inf), op=MPI.MIN)
        wall = HalfSpace((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        contact = ContactSurface(u, low, obstacle=wall, law=law)
    energy = NeoHookean(*lame(args.young, args.poisson)).energy(u) * ufl.dx
    return ContactProblem(energy, u, [contact]), velocity, [dx(i + 1) for i in range(len(corners))]


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    problem, velocity, parts = bodies(args, comm)
    place = ufl.SpatialCoordinate(problem.V.mesh) + problem.u
    fields = [velocity[i] for i in range(3)]
    fields += [ufl.cross(place, velocity)[i] for i in range(3)] + [place[i] for i in range(3)]
    forms = [[fem.form(DENSITY * f * dx) for f in fields] for dx in parts]

    def measured():
        """Momentum, angular momentum about the origin, and centre of mass; (bodies, 3, 3)."""
        mine = np.array([[fem.assemble_scalar(f) for f in body] for body in forms])
        return comm.allreduce(mine).reshape(-1, 3, 3)

    rows, given, how = [measured()], np.zeros((2, 3)), dict(level="velocity", mass="consistent")
    motion = NSCD(problem, DENSITY, dt=args.dt, velocity=velocity, **how)
    with output.EvolutionSeries(folder, problem, every=5) as series:

        def watch(step):
            series(step)
            table, h = step.result.tables["contact"], step.time - step.start
            points = np.column_stack([(table.x + table.ut)[:, :2], table.un])
            given[:] += h * np.array([table.force.sum(0), np.cross(points, table.force).sum(0)])
            rows.append(measured())

        history = motion.run([0.0, args.end], observer=watch)
    found, account = np.array(rows), history.energies
    spins = found[:, :, 1] - np.cross(found[:, :, 2], found[:, :, 0])  # the mass is 1
    change = found[-1, 0, :2] - found[0, 0, :2]
    off = change - ((found[0] - found[-1])[1, :2] if args.two else given)
    summary = {
        "momenta": found[-1, :, 0],
        "spins": spins[-1],
        "impulse": given[0],
        "momentum_error": np.abs(off[0]).max() / np.abs(change[0]).max(),
        "moment_error": np.abs(off[1]).max() / np.abs(change[1]).max(),
        "energy_error": abs(account.residue) / account.at_start,
    }
    summary |= account.row()
    say("\n".join(f"{key}: {value}" for key, value in summary.items()))
    if comm.rank == 0:
        times = np.array([0.0, *(s.time for s in history.steps)])
        curves = {f"body {i + 1}": (times, spins[:, i, 1]) for i in range(len(parts))}
        labels = "time", "angular momentum about the centre, y"
        output.draw_curves(folder / "spin.png", curves, labels=labels)
    output.picture_of_body(folder / "body.png", problem)
    return output.write_summary(comm, folder, history.steps[-1].result.summary() | summary)


if __name__ == "__main__":
    main()
