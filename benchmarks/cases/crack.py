# SPDX-License-Identifier: LGPL-3.0-or-later
"""A closed crack, 2D and 3D.

Reference: closed form. `demos/demo_crack.py` explains the problem.
"""

from mpi4py import MPI

import gmsh
import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, io, plot
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import crack, mesh_from_gmsh


def arguments(argv=None):
    given = dict(dim=3, degree=1, friction=0.3, young=1000.0, poisson=0.3)
    parser = ScriptParser("A crack", output="output/crack", **given)
    add = parser.add_argument
    positive = number(above=0)
    angle = number(least=0, below=90)
    edge = number(least=2)
    add("--levels", type=positive, nargs="+", help="cell sizes at the front")
    add("--dip", type=angle, default=35.0, help="of the crack, degrees")
    add("--press", type=positive, default=1.0, help="vertical pressure")
    add("--shear", type=number(), default=0.3, help="horizontal shear stress")
    add("--size", type=edge, help="half of an edge of the block (default: 6, in 2D 20)")
    args = parser.parse(argv)
    if args.dim == 3:
        levels = [0.2, 0.14, 0.1]
        size = 6.0
    else:
        levels = [0.1, 0.05, 0.025]
        size = 20.0
    args.levels = args.levels or levels
    args.size = args.size or size

    # The stress far away, and what it is on the plane of the crack with the normal n.
    stress = np.zeros((args.dim, args.dim))
    stress[0, -1] = args.shear
    stress[-1, 0] = args.shear
    stress[-1, -1] = -args.press
    dip = np.radians(args.dip)
    n = np.zeros(args.dim)
    n[0] = np.sin(dip)
    n[-1] = np.cos(dip)
    traction = stress @ n
    args.stress = stress
    args.p = -n @ stress @ n
    args.excess = np.linalg.norm(traction + args.p * n) - args.friction * args.p
    if min(args.p, args.excess) <= 0 or len(args.levels) < 2:
        parser.error("two meshes are needed, and a crack that is pressed and slips")
    return args


def draw(h, args):
    occ = gmsh.model.occ
    field = gmsh.model.mesh.field
    dim = args.dim
    L = args.size
    dip = np.radians(args.dip)
    if dim == 3:
        block = occ.addBox(-L, -L, -L, 2 * L, 2 * L, 2 * L)
        disc = occ.addDisk(0, 0, 0, 1, 1)
        occ.rotate([(2, disc)], 0, 0, 0, 0, 1, 0, dip)
    else:
        x = np.cos(dip)
        y = np.sin(dip)
        left = occ.addPoint(-x, y, 0)
        right = occ.addPoint(x, -y, 0)
        block = occ.addRectangle(-L, -L, 0, 2 * L, 2 * L)
        disc = occ.addLine(left, right)
    _, parts = occ.fragment([(dim, block)], [(dim - 1, disc)])
    occ.synchronize()
    body = parts[0][0]
    fault = parts[1][0]
    for name, (d, tag) in (("block", body), ("fault", fault)):
        gmsh.model.addPhysicalGroup(d, [tag], name=name)

    front = [abs(tag) for _, tag in gmsh.model.getBoundary(parts[1])]
    away = field.add("Distance")
    size = field.add("MathEval")
    field.setNumbers(away, "CurvesList" if dim == 3 else "PointsList", front)
    field.setNumber(away, "Sampling", 200)
    field.setString(size, "F", f"{h} * (1 + 3 * F{away})")
    field.setAsBackgroundMesh(size)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.model.mesh.generate(dim)


def problem(h, args, comm):
    body = mesh_from_gmsh(comm, lambda: draw(h, args))
    body = crack(body, ["fault"])
    V = fem.functionspace(body.mesh, ("Lagrange", args.degree, (args.dim,)))
    u = fem.Function(V, name="displacement")
    nu = args.poisson

    # The strain of the stress far away; in 2D it is a plane one.
    plane = 1 if args.dim == 3 else 1 + nu
    across = nu * np.trace(args.stress) * plane * np.eye(args.dim)
    strain = ((1 + nu) * args.stress - across) / args.young
    far = fem.Function(V)
    far.interpolate(lambda x: strain @ x[: args.dim])
    sides = fem.locate_dofs_geometrical(V, lambda x: np.isclose(abs(x).max(axis=0), args.size))
    held = fem.dirichletbc(far, sides)

    law = Coulomb(args.friction)
    fault = ContactPair(u, body, slave="fault", master="fault_opposite", law=law)
    elastic = LinearElastic.from_young(args.young, nu)
    energy = elastic.energy(u) * ufl.dx
    return ContactProblem(energy, u, [fault], bcs=[held])


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    shape = 4 if args.dim == 2 else 16 / (np.pi * (2 - args.poisson))
    compliance = (1 - args.poisson**2) / args.young
    largest = shape * (compliance * args.excess)
    levels = []
    for h in args.levels:
        block = problem(h, args, comm)
        result = block.solve()
        table = result.tables["contact"]
        r = np.linalg.norm(table.x, axis=1)
        slip = np.linalg.norm(table.ut, axis=1)
        root = np.sqrt(np.maximum(1 - r**2, 0))
        exact = table.area @ (largest * root)
        inner = np.where(r < 0.7, table.area, 0)
        weights = inner / table.area[r < 0.7].sum()
        level = {
            "size": h,
            "dofs": result.dofs,
            "peak": slip.max(),
            "peak_closed_form": largest,
            "error": table.area @ slip / exact - 1,
            "pressure": weights @ table.pressure,
            "pressure_closed_form": args.p,
        }
        levels.append(level)
        say(", ".join(f"{name} {value:.6g}" for name, value in level.items()))

    # The error is of the order of the cells: a line through the last two, at cells of no size.
    coarse = levels[-2]
    fine = levels[-1]
    numerator = coarse["size"] * fine["error"] - fine["size"] * coarse["error"]
    extrapolated = numerator / (coarse["size"] - fine["size"])
    say(f"error of the mean slip by the last two: {extrapolated:.2g}")
    say.result(result)
    plot.picture_of_contact(folder / "crack.png", block)
    io.write_rows(comm, folder / "convergence.csv", levels)
    summary = result.summary() | fine
    summary["extrapolated_error"] = extrapolated
    summary["levels"] = levels
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
