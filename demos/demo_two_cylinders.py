# SPDX-License-Identifier: LGPL-3.0-or-later
# # A steel cylinder on an aluminium block
#
# This demo illustrates how to:
#
# - mesh two bodies in gmsh, each as it likes, and let them touch (`ContactPair`), by a mortar or,
#   with `--ratio 1`, node by node;
# - press by a force: nothing but contact holds the cylinder;
# - compare with Hertz, mesh by mesh: the benchmark CB-1 of NAFEMS (Code_Aster's SSNP154).
#
# The cylinder has the radius 50 mm, the block is 200 mm high, 400 mm wide; plane strain. 35 kN per
# mm are spread over the flat top of the lower half of the cylinder. By symmetry half is meshed. The
# cells grow with the distance from the contact. Hertz's half-spaces have the contact radius 6.21 mm
# and the peak 3585.37 MPa; with friction that holds approximately.
#
# `--case spheres` is the demo of two spheres, in which the bodies are drawn.

import numpy as np
from demo_two_spheres import RADIUS, draw, parser, quarter, study

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, Frictionless, output
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import mesh_from_gmsh

HEIGHT, LOAD = 200.0, 35e3  # mm, N/mm
STEEL, ALUMINIUM = (LinearElastic.from_young(young, 0.3) for young in (210e3, 70e3))
HERTZ = output.Hertz(2, RADIUS, 1 / ((1 - 0.3**2) * (1 / 210e3 + 1 / 70e3)), parts=2)


# ## The bodies
#
# The quarter of a disc, and half of the block, whose nodes are below those of a disc with cells of
# its size: so they are below those of the other where the sizes are the same. All nodes that may
# touch are opposite to the other face along the vertical, which is the normal of the contact.


def block(size):
    face, corners = quarter(size, -1)
    outer = [(HEIGHT, 0.0), (HEIGHT, -HEIGHT), (0.0, -HEIGHT)]
    return face, [*((x, 0.0) for x, _ in corners[: face + 1]), *outer]


def problem(size, args, comm):
    bodies = {"upper": quarter(size, 1), "lower": block(args.ratio * size)}
    body = mesh_from_gmsh(comm, lambda: draw(bodies))
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    dx = ufl.Measure("dx", body.mesh, subdomain_data=body.cell_tags)
    energy = STEEL.energy(u) * dx(body.tag("upper")) + ALUMINIUM.energy(u) * dx(body.tag("lower"))
    energy += fem.Constant(body.mesh, LOAD / (2 * RADIUS)) * u[1] * body.ds("upper end")
    bcs = [fem.dirichletbc(np.zeros(2), body.dofs(V, "lower end"), V)]
    for axis in ("upper axis", "lower axis"):
        bcs.append(fem.dirichletbc(0.0, body.dofs(V.sub(0), axis), V.sub(0)))
    law = Coulomb(args.friction) if args.friction > 0 else Frictionless()
    pair = ContactPair(u, body, slave="upper face", master="lower face", normal=(0, -1), law=law)
    return ContactProblem(energy, u, [pair], bcs=bcs)


def main(argv=None):
    words = parser("two_cylinders", None)
    words.add_argument("--case", choices=("cb1", "spheres"), default="cb1", help="of both demos")
    args = words.parse(argv)
    args.ratio = args.ratio or {"cb1": 0.8, "spheres": 1.0}[args.case]
    return study(args) if args.case == "spheres" else study(args, problem, HERTZ)


if __name__ == "__main__":
    main()
