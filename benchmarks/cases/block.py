# SPDX-License-Identifier: LGPL-3.0-or-later
"""Blocks on a plane, a tilted plane, a sphere; every cell type, P1 and P2.

Reference: GetFEM: every nodal force. `demos/demo_block.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import CELLS, ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, Sphere, io, plot
from dolfinx_contact.materials import LinearElastic


def arguments(argv=None):
    block = dict(dim=2, n=8, cell=None, degree=1, young=1000.0, poisson=0.3)
    move = dict(friction=0.3, press=0.01, shift=0.004)
    parser = ScriptParser("A block on a foundation", output="output/block", **block, **move)
    parser.add_argument(
        "--method", choices=("nodal", "integral", "mixed"), help="see ContactSurface"
    )
    parser.add_argument("--obstacle", choices=("plane", "tilted", "sphere"), default="plane")
    parser.add_argument("--tilt", type=number(), default=0.02, help="slope of the tilted plane")
    parser.add_argument("--radius", type=number(above=0), default=10.0, help="of the sphere")
    return parser.parse(argv)


def foundation(args):
    up = np.eye(args.dim)[-1]
    if args.obstacle == "plane":
        return HalfSpace(np.zeros(args.dim), up)
    if args.obstacle == "tilted":
        return HalfSpace(np.zeros(args.dim), up + args.tilt * np.eye(args.dim)[0])
    middle = 0.5 * (1.0 - up)
    return Sphere(middle - args.radius * up, args.radius)


def problem(args, comm):
    n = args.n
    cell = CELLS[args.cell]
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
    moved[0] = args.shift
    moved[-1] = -args.press
    held = fem.dirichletbc(moved, fem.locate_dofs_topological(V, fdim, top), V)

    material = LinearElastic.from_young(args.young, args.poisson)
    surface = ContactSurface(
        u, bottom, obstacle=foundation(args), law=Coulomb(args.friction), method=args.method
    )
    return ContactProblem(material.energy(u) * ufl.dx, u, [surface], bcs=[held])


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    block = problem(args, comm)
    result = block.solve()
    say.result(result)
    plot.picture_of_contact(folder / "contact.png", block)
    io.write_contact_table(comm, folder, result.tables.values())
    summary = result.summary(block.uniqueness())
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
