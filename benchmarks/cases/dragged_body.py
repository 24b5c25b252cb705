# SPDX-License-Identifier: LGPL-3.0-or-later
"""A rocker dragged over a floor, from a file or meshed.

Reference: balance of forces. `demos/demo_dragged_body.py` explains the problem.
"""

from mpi4py import MPI

import gmsh
import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, io, plot
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import mesh_from_gmsh, read_mesh

RADIUS = 1.0
HALF_LENGTH = 0.8
HEIGHT = 0.8
WIDTH = 1.0


def arguments(argv=None):
    given = dict(mesh=None, degree=1, friction=0.4, press=0.12, shift=0.08, young=10.0, poisson=0.4)
    parser = ScriptParser("A rubber rocker, dragged", output="output/dragged_body", **given)
    parser.add_argument("--size", type=number(least=0.01, most=0.5), help="of cells at the floor")
    args = parser.parse(argv)
    if args.size is None:
        args.size = 0.05 if args.degree == 1 else 0.1
    return args


def draw_rocker(size):
    occ = gmsh.model.occ
    rise = RADIUS - np.sqrt(RADIUS**2 - HALF_LENGTH**2)
    left = occ.addPoint(-HALF_LENGTH, 0, rise)
    right = occ.addPoint(HALF_LENGTH, 0, rise)
    top_right = occ.addPoint(HALF_LENGTH, 0, HEIGHT)
    top_left = occ.addPoint(-HALF_LENGTH, 0, HEIGHT)
    lowest = occ.addPoint(0, 0, 0)
    arc = occ.addCircleArc(left, lowest, right, center=False)
    occ.remove([(0, lowest)])
    up = occ.addLine(right, top_right)
    back = occ.addLine(top_right, top_left)
    down = occ.addLine(top_left, left)
    outline = occ.addCurveLoop([arc, up, back, down])
    section = occ.addPlaneSurface([outline])
    layers = round(WIDTH / (1.4 * size))
    # The faces come in the order of the curves, after the opposite section and the volume.
    _, block, contact, _, top, _ = occ.extrude([(2, section)], 0, WIDTH, 0, numElements=[layers])
    occ.synchronize()
    groups = {"rocker": block, "contact": contact, "top": top}
    for name, (dim, tag) in groups.items():
        gmsh.model.addPhysicalGroup(dim, [tag], name=name)

    field = gmsh.model.mesh.field.add("MathEval")
    gmsh.model.mesh.field.setString(field, "F", f"{size} * (1 + 2 * Sqrt(x^2 + z^2))")
    gmsh.model.mesh.field.setAsBackgroundMesh(field)
    for option in ("MeshSizeFromPoints", "MeshSizeFromCurvature", "MeshSizeExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)
    gmsh.model.mesh.generate(3)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    if args.mesh:
        say(f"reading {args.mesh}")
        body = read_mesh(comm, args.mesh, dim=3, groups=("contact", "top"))
    else:
        say(f"meshing, cell size {args.size:g}")
        body = mesh_from_gmsh(comm, lambda: draw_rocker(args.size))
    V = fem.functionspace(body.mesh, ("Lagrange", args.degree, (3,)))
    u = fem.Function(V, name="displacement")
    motion = np.array([args.shift, 0.0, -args.press])
    held = fem.dirichletbc(motion, body.dofs(V, "top"), V)
    lowest = body.bounds("contact")[0, 2]
    floor = HalfSpace([0.0, 0.0, lowest], [0.0, 0.0, 1.0])
    law = Coulomb(args.friction)
    surface = ContactSurface(u, body, tag="contact", obstacle=floor, law=law)
    material = LinearElastic.from_young(args.young, args.poisson)
    energy = material.energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [surface], bcs=[held])
    cells = body.mesh.topology.index_map(3).size_global
    say(f"solving: {cells} cells of degree {args.degree}, {comm.size} rank(s)")
    result = problem.solve(monitor=say.newton)
    say.result(result)

    say("writing")
    stress = material.full_stress(u)
    title = f"Contact face, friction {args.friction:g}"
    files = io.write_fields(folder, problem, stress=stress)  # and a script for ParaView
    above = body.bounds("top").mean(axis=0) + np.array([0.0, 0.0, 0.25 * HEIGHT])
    arrows = {"press and drag": (above, motion)}
    plot.picture_of_body(folder / "body.png", problem, stress=stress, arrows=arrows)
    plot.picture_of_contact(folder / "contact.png", problem, title=title)
    io.write_contact_table(comm, folder, result.tables.values())
    summary = io.write_summary(comm, folder, result.summary())
    others = ("body.png", "contact.png", "paraview.py", "contact.csv", "summary.json")
    files += [folder / name for name in others]
    say("files: " + ", ".join(map(str, files)))
    return summary


if __name__ == "__main__":
    main()
