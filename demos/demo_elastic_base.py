# SPDX-License-Identifier: LGPL-3.0-or-later
# # A rubber rocker pressed into an elastic base and dragged
#
# This demo illustrates how to:
#
# - mesh two bodies in 3D in one gmsh model, without a node in common;
# - give each its material, and let them touch (`ContactPair`): a mortar couples the faces;
# - write and draw both bodies, what they carry and where they stick and slip.
#
# The rocker is that of `demo_dragged_body.py`, whose floor is now a block of elastic material, held
# below. Its top is moved down and sideways as a rigid plate. The base gives way to both: where the
# floor would let the edges of the contact slip, a part of the base is drawn along. `--base` is its
# modulus; the stiffer it is, the nearer the forces are to those on the floor, `--rigid`. Between
# bodies sliding and turning are small; here the faces turn by some degrees, of which a warning
# tells.

from mpi4py import MPI

import gmsh
import numpy as np
from _case import ScriptParser, number
from demo_dragged_body import WIDTH, draw_rocker

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

LENGTH = 1.3  # half of the base's
DEPTH = 0.6  # its height


def arguments(argv=None):
    given = dict(friction=0.4, press=0.14, shift=0.1, young=10.0, poisson=0.4)
    parser = ScriptParser("A rocker on an elastic base", output="output/elastic_base", **given)
    add = parser.add_argument
    add("--size", type=number(least=0.02, most=0.5), default=0.12, help="of cells at the contact")
    add("--base", type=number(above=0), default=8.0, help="Young's modulus of the base")
    add("--rigid", action="store_true", help="a rigid floor instead of the base")
    return parser.parse(argv)


# ## The mesh
#
# The base is a box below the rocker, as wide as this. It is drawn beside what the other demo
# draws, and both are meshed anew with the sizes of cells that this has set.


def draw(size):
    draw_rocker(size)
    occ = gmsh.model.occ
    base = occ.addBox(-LENGTH, 0, -DEPTH, 2 * LENGTH, WIDTH, DEPTH)
    occ.synchronize()
    gmsh.model.addPhysicalGroup(3, [base], name="base")
    faces = {-DEPTH: "bottom", 0.0: "face"}
    for _, face in gmsh.model.getBoundary([(3, base)], oriented=False):
        z = round(occ.getCenterOfMass(2, face)[2], 6)
        if z in faces:
            gmsh.model.addPhysicalGroup(2, [face], name=faces[z])
    gmsh.model.mesh.clear()
    gmsh.model.mesh.generate(3)


# ## The problem
#
# One material serves both bodies, its modulus being constant in each. The contact looks downwards.


def problem(args, comm):
    body = mesh_from_gmsh(comm, lambda: draw_rocker(args.size) if args.rigid else draw(args.size))
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
    files.append(plot.picture_of_body(folder / "body.png", both, stress=stress, title=title))
    title = f"Contact face, friction coefficient {args.friction:g}"
    files.append(plot.picture_of_contact(folder / "contact.png", both, title=title))
    io.write_contact_table(comm, folder, result.tables.values())
    say.files(files)
    return io.write_summary(comm, folder, result.summary())


if __name__ == "__main__":
    main()
