# SPDX-License-Identifier: LGPL-3.0-or-later
"""A cylinder on a block (`--case cb1`), two spheres (`--case spheres`).

Reference: NAFEMS CB-1, SSNV104. `demos/demo_two_cylinders.py` explains the problem.
"""

import numpy as np
from _hertz import Hertz
from _round import draw, parser, quarter, study

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, Frictionless
from dolfinx_contact.materials import Axisymmetric, LinearElastic
from dolfinx_contact.meshing import mesh_from_gmsh

RADIUS = 50.0  # mm
HEIGHT = 200.0
LOAD = 35e3  # N/mm
STEEL_YOUNG = 210e3  # MPa
ALUMINIUM_YOUNG = 70e3
SPHERES_YOUNG = 20e3
POISSON = 0.3
STEEL = LinearElastic.from_young(STEEL_YOUNG, POISSON)
ALUMINIUM = LinearElastic.from_young(ALUMINIUM_YOUNG, POISSON)
COMPLIANCE = (1 - POISSON**2) * (1 / STEEL_YOUNG + 1 / ALUMINIUM_YOUNG)
HERTZ = Hertz(2, RADIUS, 1 / COMPLIANCE, parts=2)
SPHERES = Hertz(3, RADIUS / 2, SPHERES_YOUNG / (2 * (1 - POISSON**2)))


def block(size):
    face, corners = quarter(size, -1, RADIUS)
    top = [(x, 0.0) for x, _ in corners[: face + 1]]
    outer = [(HEIGHT, 0.0), (HEIGHT, -HEIGHT), (0.0, -HEIGHT)]
    return face, top + outer


def problem(size, args, comm):
    cylinder = quarter(size, 1, RADIUS)
    bodies = {"upper": cylinder, "lower": block(args.ratio * size)}
    body = mesh_from_gmsh(comm, lambda: draw(bodies))
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")

    dx = ufl.Measure("dx", body.mesh, subdomain_data=body.cell_tags)
    steel = STEEL.energy(u) * dx(body.tag("upper"))
    aluminium = ALUMINIUM.energy(u) * dx(body.tag("lower"))
    pressure = fem.Constant(body.mesh, LOAD / (2 * RADIUS))
    energy = steel + aluminium + pressure * u[1] * body.ds("upper end")

    across = V.sub(0)
    foot = body.dofs(V, "lower end")
    bcs = [fem.dirichletbc(np.zeros(2), foot, V)]
    for axis in ("upper axis", "lower axis"):
        dofs = body.dofs(across, axis)
        bcs.append(fem.dirichletbc(0.0, dofs, across))

    law = Coulomb(args.friction) if args.friction > 0 else Frictionless()
    faces = dict(slave="upper face", master="lower face", normal=(0, -1))
    pair = ContactPair(u, body, law=law, **faces)
    return ContactProblem(energy, u, [pair], bcs=bcs)


def spheres(size, args, comm):
    bodies = {"upper": quarter(size, 1, RADIUS), "lower": quarter(args.ratio * size, -1, RADIUS)}
    body = mesh_from_gmsh(comm, lambda: draw(bodies))
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    material = Axisymmetric(LinearElastic.from_young(SPHERES_YOUNG, POISSON))
    energy = material.energy(u) * ufl.dx
    along = V.sub(1)
    bcs = []
    for end, value in (("upper end", -4.0), ("lower end", 0.0)):
        dofs = body.dofs(along, end)
        bcs.append(fem.dirichletbc(value, dofs, along))
    law = Coulomb(args.friction) if args.friction > 0 else Frictionless()
    faces = dict(slave="upper face", master="lower face", normal=(0, -1))
    pair = ContactPair(u, body, law=law, axisymmetric=True, **faces)
    return ContactProblem(energy, u, [pair], bcs=bcs)


def main(argv=None):
    words = parser("two_cylinders", None)
    words.add_argument("--case", choices=("cb1", "spheres"), default="cb1", help="of both demos")
    args = words.parse(argv)
    if args.case == "spheres":
        args.ratio = args.ratio or 1.0
        return study(args, spheres, SPHERES)
    args.ratio = args.ratio or 0.8
    return study(args, problem, HERTZ)


if __name__ == "__main__":
    main()
