# SPDX-License-Identifier: LGPL-3.0-or-later
# # A block pressed and sheared on a rigid floor
#
# This demo illustrates how to:
#
# - state a static contact problem with Coulomb friction;
# - solve it, and read the forces and the status of every contact point;
# - prove that the solution is unique.
#
# An elastic unit square lies on a rigid floor. Its top is displaced by a given vector, downwards
# and to the right. With the gap $u_n \ge 0$, the slip $u_t$, and the nodal forces $r_n \ge 0$ and
# $r_t$ on the body, the contact law is
#
# $$u_n \ge 0,\quad r_n \ge 0,\quad u_n r_n = 0,\qquad
# |r_t| \le F r_n,\quad u_t \ne 0 \Rightarrow r_t = -F r_n \frac{u_t}{|u_t|}.$$
#
# The first part (Signorini) excludes penetration and tension. The second part (Coulomb) bounds the
# shear force by the friction coefficient $F$ times the normal force.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, io, plot
from dolfinx_contact.materials import LinearElastic

n = 8  # cells along an edge
friction = 0.3
young = 1000.0
poisson = 0.3
displacement = (0.004, -0.01)  # of the top

# ## The body
#
# Any mesh, any Lagrange element of degree 1 or 2 and any UFL energy can be used. Replacing the
# first line by `create_unit_cube` and adding a zero to the vectors gives the problem in 3D.

domain = mesh.create_unit_square(MPI.COMM_WORLD, n, n, mesh.CellType.quadrilateral)
bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
top = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 1.0))

V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
u = fem.Function(V, name="displacement")
clamped = fem.locate_dofs_topological(V, 1, top)
moved = fem.dirichletbc(np.array(displacement), clamped, V)

# Isotropic linear elasticity in plane strain has the energy
# $\int \frac{\lambda}{2} (\mathrm{tr}\, \varepsilon)^2 + \mu\, \varepsilon : \varepsilon \, dx$.

material = LinearElastic.from_young(young, poisson)
energy = material.energy(u) * ufl.dx

# ## The contact
#
# The floor is the half-space below the line $y = 0$; its normal $(0, 1)$ points towards the body.

floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(friction))
problem = ContactProblem(energy, u, [surface], bcs=[moved])

# ## The solution
#
# `solve` starts from the values in `u`, here zero, and writes the solution into it. Newton's method
# is applied to displacements and contact forces together, so that the status of every point is
# found during the iteration.

result = problem.solve()
say = io.Report(MPI.COMM_WORLD)
say.result(result)

# The table lists the contact points from left to right. A point is open (`o`), sticks (`k`), or
# slips to the right (`+`) or left (`-`). Here the floor holds the middle of the face, and the two
# corners slip outwards.

table = result.tables["contact"]
say(f"status from left to right: {table.status}")

# An independent code (GetFEM) computes the same nodal forces; their sums agree to all digits.

reference = {"normal": 11.6060252, "shear": -1.0678714}
normal = float(table.rn.sum())
shear = float(table.along(table.rt).sum())
say(f"normal force {normal:.7f}, reference {reference['normal']:.7f}")
say(f"shear force {shear:.7f}, reference {reference['shear']:.7f}")

# For a small friction coefficient a solution is unique. The criterion of Renard proves it for this
# one, using the stiffness that the contact points see.

uniqueness = problem.uniqueness()
say(str(uniqueness))

# ## The picture
#
# It shows pressure, shear and status along the contact face.

folder = io.output_folder(MPI.COMM_WORLD, "output/block")
plot.picture_of_contact(folder / "contact.png", problem)
io.write_contact_table(MPI.COMM_WORLD, folder, [table])
