# SPDX-License-Identifier: LGPL-3.0-or-later
"""The rocker on an elastic base.

Reference: the limit of a rigid base.

The rocker is that of `dragged_body.py`, whose floor is now a block of elastic material, held
below. Its top is moved down and sideways as a rigid plate. The base gives way to both: where the
floor would let the edges of the contact slip, a part of the base is drawn along. `--base` is its
modulus; the stiffer it is, the nearer the forces are to those on the floor, `--rigid`. Between
bodies sliding and turning are small; here the faces turn by some degrees, of which a warning
tells.
"""

from mpi4py import MPI

import gmsh
import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    io,
    plot,
)
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import mesh_from_gmsh

RADIUS = 1.0  # of the rocker
HALF_LENGTH = 0.8
HEIGHT = 0.8
WIDTH = 1.0
BASE_LENGTH = 1.3  # half of it
DEPTH = 0.6  # of the base


def arguments(argv=None):
    given = dict(friction=0.4, press=0.14, shift=0.1, young=10.0, poisson=0.4)
    parser = ScriptParser("A rocker on an elastic base", output="output/elastic_base", **given)
    add = parser.add_argument
    add("--size", type=number(least=0.02, most=0.5), default=0.12, help="of cells at the contact")
    add("--base", type=number(above=0), default=8.0, help="Young's modulus of the base")
    add("--rigid", action="store_true", help="a rigid floor instead of the base")
    return parser.parse(argv)


# The mesh.
#
# The rocker is a section, an arc and three straight lines, that is extruded; the base is a box
# below, as wide as this, and shares no node with it. Cells are small where both touch.


def add_rocker(size):
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


def add_base():
    occ = gmsh.model.occ
    base = occ.addBox(-BASE_LENGTH, 0, -DEPTH, 2 * BASE_LENGTH, WIDTH, DEPTH)
    occ.synchronize()
    gmsh.model.addPhysicalGroup(3, [base], name="base")
    faces = {-DEPTH: "bottom", 0.0: "face"}
    for _, face in gmsh.model.getBoundary([(3, base)], oriented=False):
        z = round(occ.getCenterOfMass(2, face)[2], 6)
        if z in faces:
            gmsh.model.addPhysicalGroup(2, [face], name=faces[z])


def draw(size, with_base):
    add_rocker(size)
    if with_base:
        add_base()
    field = gmsh.model.mesh.field.add("MathEval")
    gmsh.model.mesh.field.setString(field, "F", f"{size} * (1 + 2 * Sqrt(x^2 + z^2))")
    gmsh.model.mesh.field.setAsBackgroundMesh(field)
    for option in ("MeshSizeFromPoints", "MeshSizeFromCurvature", "MeshSizeExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)
    gmsh.model.mesh.generate(3)


# The problem.
#
# One material serves both bodies, its modulus being constant in each. The contact looks downwards.


def problem(args, comm):
    body = mesh_from_gmsh(comm, lambda: draw(args.size, not args.rigid))
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (3,)))
    u = fem.Function(V, name="displacement")
    young = fem.Function(fem.functionspace(body.mesh, ("DG", 0)))
    bcs = [fem.dirichletbc(np.array([args.shift, 0.0, -args.press]), body.dofs(V, "top"), V)]
    young.x.array[:] = args.young
    law = Coulomb(args.friction)
    if args.rigid:
        floor = HalfSpace((0, 0, body.bounds("contact")[0, 2]), (0, 0, 1))
        contact = ContactSurface(u, body, tag="contact", obstacle=floor, law=law)
    else:
        young.x.array[body.cell_tags.find(body.tag("base"))] = args.base
        bcs.append(fem.dirichletbc(np.zeros(3), body.dofs(V, "bottom"), V))
        contact = ContactPair(u, body, slave="contact", master="face", normal=(0, 0, -1), law=law)
    mu = young / (2 * (1 + args.poisson))
    material = LinearElastic(2 * mu * args.poisson / (1 - 2 * args.poisson), mu)
    bulk = ContactProblem(material.energy(u) * ufl.dx, u, [contact], bcs=bcs)
    return bulk, material.full_stress(u)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    both, stress = problem(args, comm)
    result = both.solve(monitor=say.newton)
    say.result(result)
    files = io.write_fields(folder, both, stress=stress)
    title = "A rocker pressed into an elastic base and dragged"
    plot.picture_of_body(folder / "body.png", both, stress=stress, title=title)
    title = f"Contact face, friction coefficient {args.friction:g}"
    plot.picture_of_contact(folder / "contact.png", both, title=title)
    files += [folder / "body.png", folder / "contact.png"]
    io.write_contact_table(comm, folder, result.tables.values())
    say.files(files)
    return io.write_summary(comm, folder, result.summary())


if __name__ == "__main__":
    main()
