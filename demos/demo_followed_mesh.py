# SPDX-License-Identifier: LGPL-3.0-or-later
# # Following the solutions of any meshed body through every fold
#
# This demo illustrates how to:
#
# - follow the branch of solutions of a body meshed by gmsh as its load, or the displacement of its
#   support, grows, and read off where contact points open, stick and slip and the branch turns;
# - keep it on the disk (`--record DIR`), from where a killed run goes on (`--resume`);
# - list all solutions of the branch at one load (`--solutions-at GAMMA`).
#
# The mesh needs the physical groups `dirichlet` (held) and `contact`; the rigid floor touches the
# lowest point of `contact`. Without a mesh the demo makes a V-shaped body: one arm is vertical, the
# other inclined, both are clamped at their far ends, and the tip rests on the floor. gamma goes
# from 0 to 1: the body force is (1 - gamma) (FX, FY) + gamma (GX, GY), or the highest part of
# `dirichlet` is displaced by gamma (DX, DY).

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.continuation import Branch, points_at
from dolfinx_contact.meshing import draw_polygon, mesh_from_gmsh, read_mesh
from dolfinx_contact.output import leftmost, total
from dolfinx_contact.parametric import ParametricContact

LAWS = {
    "linear": materials.LinearElastic,
    "neo-hookean": materials.NeoHookean,
    "ciarlet-geymonat": lambda lmbda, mu: materials.CiarletGeymonat(lmbda, mu, mu / 4),
}
VEE = [(0, 0), (0.35, 0), (1.1, 1), (0.85, 1), (0.25, 0.25), (0.25, 1), (0, 1)]
SIDES = {"contact": [0], "dirichlet": [2, 5]}
#: What is looked at.
SEEN = dict(ut_left=leftmost("ut"), un_left=leftmost("un"), sum_rt=total("rt"), sum_rn=total("rn"))


def arguments(argv=None):
    body = dict(mesh=None, size=0.06, length=1.0, lame=(100.0, 82.0), friction=1.5)
    how = dict(solutions_at=None, route="auto", max_steps=2000)
    parser = ScriptParser("A meshed body", output="output/followed_mesh", **body, **how)
    parser.add_argument("--law", choices=LAWS, default="linear", help="of the body")
    drive = parser.add_mutually_exclusive_group()
    force = dict(default=(0.0, -6.0, -14.0, -6.0), metavar=("FX", "FY", "GX", "GY"))
    drive.add_argument("--body-force", type=number(), nargs=4, **force)
    drive.add_argument("--drive-top", type=number(), nargs=2, metavar=("DX", "DY"))
    parser.add_argument("--record", metavar="DIR", help="keep journal and fields of the branch")
    parser.add_argument("--resume", action="store_true", help="go on with the record")
    return parser.parse(argv)


# ## The problem with its parameter
#
# gamma is a Constant of the energy (body force) or drives the Dirichlet data (displaced support).


def system(args, comm):
    groups = dict(dim=2, groups=("dirichlet", "contact"))
    if args.mesh:
        body = read_mesh(comm, args.mesh, **groups)
    else:
        body = mesh_from_gmsh(comm, lambda: draw_polygon(VEE, args.size, SIDES), **groups)
    domain, held, driven = body.mesh, body.facets("dirichlet"), []
    domain.geometry.x[:] *= args.length
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, moved = fem.Function(V, name="displacement"), fem.Function(V)
    gamma = fem.Constant(domain, 0.0)
    energy, top = LAWS[args.law](*args.lame).energy(u) * ufl.dx, held
    if args.drive_top is None:
        first, last = (fem.Constant(domain, f) for f in np.reshape(args.body_force, (2, 2)))
        energy -= ufl.dot((1 - gamma) * first + gamma * last, u) * ufl.dx
    else:  # the highest facets of the support move, the others stay where they are
        (_, highest, _), size = body.bounds("dirichlet")[1], np.ptp(body.bounds("dirichlet"))
        above = mesh.locate_entities_boundary(domain, 1, lambda x: x[1] > highest - 1e-6 * size)
        top, driven = np.intersect1d(held, above), [(moved, gamma * ufl.as_vector(args.drive_top))]
    at_top, rest = (fem.locate_dofs_topological(V, 1, f) for f in (top, np.setdiff1d(held, top)))
    bcs = [fem.dirichletbc(moved, at_top), fem.dirichletbc(np.zeros(2), rest, V)]
    floor = HalfSpace((0.0, body.bounds("contact")[0, 1]), (0.0, 1.0))
    surface = ContactSurface(u, body, tag="contact", obstacle=floor, law=Coulomb(args.friction))
    return ParametricContact(ContactProblem(energy, u, [surface], bcs=bcs), gamma, driven=driven)


# ## Follow it
#
# The undeformed body that only grazes the floor has every contact point at a kink: when its support
# is driven, the branch is entered a little beyond.


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = output.output_folder(comm, args.output)
    body, first = system(args, comm), 0.0 if args.drive_top is None else 1e-3
    x = body.create_vector()
    body.set_parameter(first)
    body.problem.solve()
    body.problem.write(x)
    way = dict(gamma_range=(0.0, 1.0), route=args.route)
    kept = dict(record=args.record, resume=args.resume, series=folder if args.record else None)
    kept |= dict(max_steps=args.max_steps, observer=output.Progress(comm))
    branch, journal = output.follow_with_journal(body, x, first, SEEN, **way, **kept)
    summary = branch.summary() | journal.summary() | {"dofs": x.getSize()}
    summary["augmentation"] = body.problem.surfaces[0].mean_augmentation
    output.Report(comm).branch(journal)
    if args.solutions_at is not None:
        there = points_at(body, branch, args.solutions_at, **way)
        found = output.journal_of(body, [Branch(there)], SEEN).rows()
        summary["solutions_at"] = {"gamma": args.solutions_at, "solutions": found}
    if comm.rank == 0:
        seen = {"ut_left": "$u_t$ of the leftmost contact point"}
        output.draw_diagram(folder / "branch.png", journal, seen)
    return output.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
