# SPDX-License-Identifier: LGPL-3.0-or-later
"""The branch of any 2D gmsh mesh, with records.

Reference: other steps and numberings. `demos/demo_followed_mesh.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    io,
    materials,
    plot,
    records,
)
from dolfinx_contact.continuation import Branch, follow, points_at
from dolfinx_contact.meshing import draw_polygon, mesh_from_gmsh, read_mesh
from dolfinx_contact.records import leftmost, total


def ciarlet_geymonat(lmbda, mu):
    return materials.CiarletGeymonat(lmbda, mu, mu / 4)


LAWS = {
    "linear": materials.LinearElastic,
    "neo-hookean": materials.NeoHookean,
    "ciarlet-geymonat": ciarlet_geymonat,
}
VEE = [(0, 0), (0.35, 0), (1.1, 1), (0.85, 1), (0.25, 0.25), (0.25, 1), (0, 1)]
SIDES = {"contact": [0], "dirichlet": [2, 5]}
#: Outputs.
FUNCTIONALS = dict(
    ut_left=leftmost("ut"), un_left=leftmost("un"), sum_rt=total("rt"), sum_rn=total("rn")
)


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
    parser.add_argument("--resume", action="store_true", help="continue the record")
    args = parser.parse(argv)
    if args.resume and not args.record:
        parser.error("a branch is resumed from a record: --record DIR --resume")
    return args


def system(args, comm):
    groups = dict(dim=2, groups=("dirichlet", "contact"))
    if args.mesh:
        body = read_mesh(comm, args.mesh, **groups)
    else:
        body = mesh_from_gmsh(comm, lambda: draw_polygon(VEE, args.size, SIDES), **groups)
    domain = body.mesh
    domain.geometry.x[:] *= args.length
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    moved = fem.Function(V)
    gamma = fem.Constant(domain, 0.0)
    material = LAWS[args.law](*args.lame)
    energy = material.energy(u) * ufl.dx
    held = body.facets("dirichlet")
    if args.drive_top is None:
        first = fem.Constant(domain, np.array(args.body_force[:2]))
        last = fem.Constant(domain, np.array(args.body_force[2:]))
        force = (1 - gamma) * first + gamma * last
        energy -= ufl.dot(force, u) * ufl.dx
        top = held
        driven = []
    else:  # the highest facets of the support move, the others stay where they are
        bounds = body.bounds("dirichlet")
        limit = bounds[1, 1] - 1e-6 * np.ptp(bounds)
        above = mesh.locate_entities_boundary(domain, 1, lambda x: x[1] > limit)
        top = np.intersect1d(held, above)
        motion = gamma * ufl.as_vector(args.drive_top)
        driven = [(moved, motion)]
    at_top = fem.locate_dofs_topological(V, 1, top)
    rest = fem.locate_dofs_topological(V, 1, np.setdiff1d(held, top))
    bcs = [fem.dirichletbc(moved, at_top), fem.dirichletbc(np.zeros(2), rest, V)]
    lowest = body.bounds("contact")[0, 1]
    floor = HalfSpace((0.0, lowest), (0.0, 1.0))
    law = Coulomb(args.friction)
    surface = ContactSurface(u, body, tag="contact", obstacle=floor, law=law)
    problem = ContactProblem(energy, u, [surface], bcs=bcs)
    return ParametricContact(problem, gamma, driven=driven)


def followed(args, folder, body, x, first, way):
    """The branch of a body and its journal; with a record every point is on the disk at once."""
    steps = dict(max_steps=args.max_steps, progress=True)
    if not args.record:
        branch = follow(body, x, first, **way, **steps)
        return branch, records.journal_of(body, [branch], FUNCTIONALS)
    with records.BranchRecord(
        args.record, body, FUNCTIONALS, every=1, resume=args.resume
    ) as record:
        if record.journal.branches:
            branch = record.go_on(**steps)
        else:
            branch = follow(body, x, first, record=record, **way, **steps)
        branch.points = record.points()
        records.write_series(folder, record)
    return branch, record.journal


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    body = system(args, comm)
    first = 0.0 if args.drive_top is None else 1e-3
    x = body.create_vector()
    body.set_parameter(first)
    body.problem.solve()
    body.problem.write(x)
    way = dict(gamma_range=(0.0, 1.0), route=args.route)
    branch, journal = followed(args, folder, body, x, first, way)
    summary = branch.summary() | journal.summary()
    summary["dofs"] = x.getSize()
    summary["augmentation"] = body.problem.surfaces[0].points.mean_augmentation
    io.Report(comm)(f"{len(branch.points)} points: {branch.reason}")
    if args.solutions_at is not None:
        there = points_at(body, branch, args.solutions_at, **way)
        found = records.journal_of(body, [Branch(there)], FUNCTIONALS).rows()
        summary["solutions_at"] = {"gamma": args.solutions_at, "solutions": found}
    if comm.rank == 0:
        seen = {"ut_left": "$u_t$ of the leftmost contact point"}
        plot.draw_diagram(folder / "branch.png", journal, seen)
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
