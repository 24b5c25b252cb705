# SPDX-License-Identifier: LGPL-3.0-or-later
# # A closed crack that slips
#
# This demo illustrates how to:
#
# - draw a plane crack inside a body in gmsh, and double its nodes there (`meshing.crack`);
# - let its sides press and slip on each other, with friction, in 3D or 2D;
# - compare the slip with closed forms, mesh by mesh.
#
# A block with a crack of radius 1, which dips, is compressed and sheared by displacements of its
# boundary, as for a uniform stress, with the pressure p and the shear t > F p on the plane of the
# crack. A small crack, a disc or in 2D (plane strain) a strip, slips from side to side by
#
#     16 (1 - nu^2) / (pi (2 - nu) E) (t - F p) sqrt(1 - r^2), or
#      4 (1 - nu^2) / E (t - F p) sqrt(1 - r^2)
#
# (Segedin, Proc. Camb. Phil. Soc. 47, 1951; Tada, Paris and Irwin, Handbook, 2000). Such a root at
# the front costs an error of the order of the cells: two meshes together are nearer than either.

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import crack, mesh_from_gmsh


def arguments(argv=None):
    given = dict(dim=3, degree=1, friction=0.3, young=1000.0, poisson=0.3)
    parser = ScriptParser("A crack", output="output/crack", **given)
    add, positive = parser.add_argument, number(above=0)
    add("--levels", type=positive, nargs="+", help="cell sizes at the front")
    add("--dip", type=number(least=0, below=90), default=35.0, help="of the crack, degrees")
    add("--press", type=positive, default=1.0, help="vertical pressure")
    add("--shear", type=number(), default=0.3, help="horizontal shear stress")
    add("--size", type=number(least=2), help="half of an edge of the block (default: 6, in 2D 20)")
    args = parser.parse(argv)
    args.levels = args.levels or ([0.2, 0.14, 0.1] if args.dim == 3 else [0.1, 0.05, 0.025])
    args.size, dip = args.size or (6.0 if args.dim == 3 else 20.0), np.radians(args.dip)
    n, args.stress = np.zeros(args.dim), np.zeros((args.dim, args.dim))
    n[[0, -1]] = np.sin(dip), np.cos(dip)
    args.stress[[0, -1, -1], [-1, 0, -1]] = args.shear, args.shear, -args.press
    args.p = -n @ args.stress @ n
    args.excess = np.linalg.norm(args.stress @ n + args.p * n) - args.friction * args.p
    if min(args.p, args.excess) <= 0 or len(args.levels) < 2:
        parser.error("two meshes are needed, and a crack that is pressed and slips")
    return args


# ## The block, with facets that become a crack, from the front of which cells grow


def draw(h, args):
    occ, field, dim, L = gmsh.model.occ, gmsh.model.mesh.field, args.dim, args.size
    dip = np.radians(args.dip)
    if dim == 3:
        block, disc = occ.addBox(-L, -L, -L, 2 * L, 2 * L, 2 * L), occ.addDisk(0, 0, 0, 1, 1)
        occ.rotate([(2, disc)], 0, 0, 0, 0, 1, 0, dip)
    else:
        ends = [occ.addPoint(s * np.cos(dip), -s * np.sin(dip), 0) for s in (-1, 1)]
        block, disc = occ.addRectangle(-L, -L, 0, 2 * L, 2 * L), occ.addLine(*ends)
    parts = occ.fragment([(dim, block)], [(dim - 1, disc)])[1]
    occ.synchronize()
    for name, (d, tag) in {"block": parts[0][0], "fault": parts[1][0]}.items():
        gmsh.model.addPhysicalGroup(d, [tag], name=name)
    front = [abs(tag) for _, tag in gmsh.model.getBoundary(parts[1])]
    away, size = field.add("Distance"), field.add("MathEval")
    field.setNumbers(away, "CurvesList" if dim == 3 else "PointsList", front)
    field.setNumber(away, "Sampling", 200)
    field.setString(size, "F", f"{h} * (1 + 3 * F{away})")
    field.setAsBackgroundMesh(size)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.model.mesh.generate(dim)


def problem(h, args, comm):
    body = crack(mesh_from_gmsh(comm, lambda: draw(h, args)), ["fault"])
    V, nu = fem.functionspace(body.mesh, ("Lagrange", args.degree, (args.dim,))), args.poisson
    u, far = fem.Function(V, name="displacement"), fem.Function(V)
    across = nu * np.trace(args.stress) * (1 if args.dim == 3 else 1 + nu) * np.eye(args.dim)
    strain = ((1 + nu) * args.stress - across) / args.young
    far.interpolate(lambda x: strain @ x[: args.dim])
    sides = fem.locate_dofs_geometrical(V, lambda x: np.isclose(abs(x).max(axis=0), args.size))
    fault = ContactPair(u, body, slave="fault", master="fault_opposite", law=Coulomb(args.friction))
    energy = LinearElastic.from_young(args.young, nu).energy(u) * ufl.dx
    return ContactProblem(energy, u, [fault], bcs=[fem.dirichletbc(far, sides)])


def main(argv=None):
    args, comm, levels = arguments(argv), MPI.COMM_WORLD, []
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    largest = 4 if args.dim == 2 else 16 / (np.pi * (2 - args.poisson))
    largest *= (1 - args.poisson**2) / args.young * args.excess
    for h in args.levels:
        result = (block := problem(h, args, comm)).solve()
        table = result.tables["contact"]
        r, slip = np.linalg.norm(table.x, axis=1), np.linalg.norm(table.ut, axis=1)
        exact = table.area @ (largest * np.sqrt(np.maximum(1 - r**2, 0)))
        inner = np.where(r < 0.7, table.area, 0) / table.area[r < 0.7].sum()
        level = {"size": h, "dofs": result.dofs, "peak": slip.max(), "peak_closed_form": largest}
        level |= {"error": table.area @ slip / exact - 1, "pressure": inner @ table.pressure}
        levels.append(level | {"pressure_closed_form": args.p})
        say(", ".join(f"{k} {v:.6g}" for k, v in levels[-1].items()))
    (a, e), (b, f) = ((level["size"], level["error"]) for level in levels[-2:])
    summary = result.summary() | levels[-1] | {"extrapolated_error": (a * f - b * e) / (a - b)}
    say(f"error of the mean slip by the last two: {summary['extrapolated_error']:.2g}")
    say.result(result)
    output.picture_of_contact(folder / "crack.png", block)
    output.write_rows(comm, folder / "convergence.csv", levels)
    return output.write_summary(comm, folder, summary | {"levels": levels})


if __name__ == "__main__":
    main()
