# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two spheres on matching and other meshes.

Reference: SSNV104, Hertz.

The equators of spheres of radius 50 mm approach each other by 4 mm. That is not little (Hertz has
the radius 10 mm and the peak 2798 MPa): he is compared with at the force that comes out.
"""

from _hertz import Hertz
from _round import draw, parser, quarter, study

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, Frictionless
from dolfinx_contact.materials import Axisymmetric, LinearElastic
from dolfinx_contact.meshing import mesh_from_gmsh

RADIUS = 50.0  # mm
APPROACH = 4.0
YOUNG = 20e3  # MPa
POISSON = 0.3
HERTZ = Hertz(3, RADIUS / 2, YOUNG / (2 * (1 - POISSON**2)))
MATERIAL = Axisymmetric(LinearElastic.from_young(YOUNG, POISSON))

# The bodies.
#
# Half of a section is a polygon: sides along the circle, which grow with the distance from the
# contact as the cells between do, the equator and the axis. The first sides may touch. With the
# nodes of both faces at the same places contact is node by node, otherwise by a mortar.


def spheres(size, ratio):
    upper = quarter(size, 1, RADIUS)
    lower = quarter(ratio * size, -1, RADIUS)
    return {"upper": upper, "lower": lower}


# The problem.
#
# The energy has the hoop strain u_r / r. The problem multiplies integrals by 2 pi r: contact forces
# are those of the whole circumference, areas of points are swept areas. On the axis u_r is held.


def problem(size, args, comm):
    bodies = spheres(size, args.ratio)
    body = mesh_from_gmsh(comm, lambda: draw(bodies))
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    energy = MATERIAL.energy(u) * ufl.dx
    along = V.sub(1)
    bcs = []
    for end, value in (("upper end", -APPROACH), ("lower end", 0.0)):
        dofs = body.dofs(along, end)
        bcs.append(fem.dirichletbc(value, dofs, along))
    law = Coulomb(args.friction) if args.friction > 0 else Frictionless()
    faces = dict(slave="upper face", master="lower face", normal=(0, -1))
    pair = ContactPair(u, body, **faces, law=law, axisymmetric=True)
    return ContactProblem(energy, u, [pair], bcs=bcs)


def main(argv=None):
    args = parser("two_spheres", 1.0).parse(argv)
    return study(args, problem, HERTZ)


if __name__ == "__main__":
    main()
