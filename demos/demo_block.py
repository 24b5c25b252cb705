# SPDX-License-Identifier: LGPL-3.0-or-later
# # A block pressed and sheared on a rigid foundation
#
# This demo illustrates how to:
#
# - state a static problem with Coulomb friction on a built-in mesh, in 2D or 3D, with triangles,
#   quadrilaterals, tetrahedra or hexahedra of degree 1 or 2;
# - put the body on a plane, a tilted plane or a sphere (a disc in 2D);
# - solve it, read the contact points, and write `contact.csv` and `summary.json`.
#
# The unit square or cube is held on its whole top face, which is pressed down and pushed sideways.
# On a plane the edges slip first while the middle sticks; on a tilted plane or a sphere only a
# part of the face touches.

import argparse

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    Sphere,
    parse_arguments,
)
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.output import output_folder, write_contact_table, write_summary

CELLS = {
    "tri": mesh.CellType.triangle,
    "quad": mesh.CellType.quadrilateral,
    "tet": mesh.CellType.tetrahedron,
    "hex": mesh.CellType.hexahedron,
}


def arguments(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dim", type=int, choices=(2, 3), default=2)
    parser.add_argument("--n", type=int, default=8, help="cells along an edge")
    parser.add_argument("--cell", choices=CELLS, help="default: quad in 2D, hex in 3D")
    parser.add_argument("--friction", type=float, default=0.3)
    parser.add_argument(
        "--press", type=float, default=0.01, help="downward displacement of the top"
    )
    parser.add_argument("--shift", type=float, default=0.004, help="sideways displacement of it")
    parser.add_argument("--young", type=float, default=1000.0)
    parser.add_argument("--poisson", type=float, default=0.3)
    parser.add_argument("--degree", type=int, choices=(1, 2), default=1)
    parser.add_argument(
        "--method", choices=("nodal", "integral", "mixed"), help="see ContactSurface"
    )
    parser.add_argument("--obstacle", choices=("plane", "tilted", "sphere"), default="plane")
    parser.add_argument("--tilt", type=float, default=0.02, help="slope of the tilted plane")
    parser.add_argument("--radius", type=float, default=10.0, help="radius of the sphere")
    parser.add_argument("--r", type=float, help="force the augmentation parameter")
    parser.add_argument("--output", default="output/block")
    args = parse_arguments(parser, argv)
    args.cell = args.cell or ("quad" if args.dim == 2 else "hex")
    if (args.dim == 2) != (args.cell in ("tri", "quad")):
        parser.error(f"--cell {args.cell} does not fit --dim {args.dim}")
    if args.n < 1:
        parser.error("--n must be at least 1")
    return args


# ## The foundation
#
# All three touch the undeformed block: the plane everywhere, the tilted plane along its left edge,
# the sphere in the middle.


def foundation(args):
    up = np.eye(args.dim)[-1]
    if args.obstacle == "plane":
        return HalfSpace(np.zeros(args.dim), up)
    if args.obstacle == "tilted":
        return HalfSpace(np.zeros(args.dim), up + args.tilt * np.eye(args.dim)[0])
    middle = 0.5 * (1.0 - up)
    return Sphere(middle - args.radius * up, args.radius)


# ## The problem
#
# The body is any UFL energy or residual; here isotropic linear elasticity (plane strain in 2D).


def problem(args, comm):
    n, cell = args.n, CELLS[args.cell]
    if args.dim == 2:
        domain = mesh.create_unit_square(comm, n, n, cell)
    else:
        domain = mesh.create_unit_cube(comm, n, n, n, cell)
    fdim = args.dim - 1
    bottom = mesh.locate_entities_boundary(domain, fdim, lambda x: np.isclose(x[fdim], 0.0))
    top = mesh.locate_entities_boundary(domain, fdim, lambda x: np.isclose(x[fdim], 1.0))

    V = fem.functionspace(domain, ("Lagrange", args.degree, (args.dim,)))
    u = fem.Function(V, name="displacement")
    moved = np.zeros(args.dim)
    moved[0], moved[-1] = args.shift, -args.press
    held = fem.dirichletbc(moved, fem.locate_dofs_topological(V, fdim, top), V)

    material = LinearElastic.from_young(args.young, args.poisson)
    surface = ContactSurface(
        u, bottom, obstacle=foundation(args), law=Coulomb(args.friction), method=args.method
    )
    return ContactProblem(material.energy(u) * ufl.dx, u, [surface], bcs=[held], r=args.r)


# ## Solve and write
#
# `solve` starts from zero and returns what it found: the contact points with their status, the
# resultants, the history of Newton's method and the worst violation of the contact law.


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = output_folder(comm, args.output)
    result = problem(args, comm).solve()
    table = result.tables["contact"]
    write_contact_table(comm, folder, [table])
    summary = write_summary(comm, folder, result.summary())
    if comm.rank == 0:
        print(f"{result.reason}: {result.iterations} Newton iterations, {result.dofs} unknowns")
        print("points:", ", ".join(f"{v} {k}" for k, v in result.counts.items() if v))
        print(f"force on the body: {result.resultants['contact']}, KKT {result.kkt_violation:.1e}")
    return summary


if __name__ == "__main__":
    main()
