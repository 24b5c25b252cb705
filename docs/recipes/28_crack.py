# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I model a crack with friction?
#
# Draw the crack as facets inside the body with a group of their own, divide the mesh along it by
# `meshing.crack`, and use both sides as a pair. Where the crack ends inside the body, both sides
# keep their common nodes. A frictional fault is modelled in the same way. `demo_crack.py` compares
# with closed forms.

import numpy as np
from common import MPI, draw_cracked

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, meshing
from dolfinx_contact.materials import LinearElastic

body = meshing.mesh_from_gmsh(MPI.COMM_WORLD, draw_cracked)  # groups base, top and fault
body = meshing.crack(body, ["fault"])
V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
u = fem.Function(V)
held = {"base": np.zeros(2), "top": np.array([0.02, -0.01])}
bcs = [fem.dirichletbc(value, body.dofs(V, name), V) for name, value in held.items()]
fault = ContactPair(u, body, slave="fault", master="fault_opposite", law=Coulomb(0.3))
energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
result = ContactProblem(energy, u, [fault], bcs=bcs).solve()
print(result.counts, result.tables["contact"].ut.max())
assert result.counts["slip"] > 0
assert result.imbalance < 1e-9
