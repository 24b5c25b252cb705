# SPDX-License-Identifier: LGPL-3.0-or-later
# # Six branches of a hyperelastic block
#
# This demo illustrates how to:
#
# - find all branches of a *large deformation* problem that leave a degenerate point (`explore`);
# - draw diagrams with the statuses along each branch.
#
# A block of 40 x 80 mm hangs from its top just above a rigid floor, with friction on all of its
# bottom. The dead traction $-\gamma\,(2,\ 0.12\,(20 - x))$ MPa acts on both sides (Ligursky and
# Renard). The material is that of Ciarlet and Geymonat with $\lambda = 4000$ and $\mu = 120$ MPa.
#
# At $\gamma = 0$ the undeformed block grazes the floor and all contact nodes are at a kink. Three
# branches lead from there to $\gamma = 1$, and their mirror images to $\gamma = -1$. The search
# over all combinations of statuses proves that no other branch leaves this point.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    io,
    plot,
    records,
)
from dolfinx_contact.continuation import Branch, explore
from dolfinx_contact.materials import CiarletGeymonat
from dolfinx_contact.records import leftmost, rightmost, total

comm = MPI.COMM_WORLD
nx, ny = 10, 20  # cells; the publication has 20 x 40
width, height = 40.0, 80.0  # mm
friction = 1.0

# ## The problem

corners = [[0.0, 0.0], [width, height]]
domain = mesh.create_rectangle(comm, corners, [nx, ny], mesh.CellType.quadrilateral)


def edge(axis, place):
    return mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[axis], place))


V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
u = fem.Function(V, name="displacement")
gamma = fem.Constant(domain, 1.0)
sides = np.sort(np.concatenate([edge(0, 0.0), edge(0, width)]))
tags = mesh.meshtags(domain, 1, sides, np.ones(len(sides), dtype=np.int32))
ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
x = ufl.SpatialCoordinate(domain)
traction = ufl.as_vector([2.0 + 0 * x[0], 0.12 * (20.0 - x[0])])
material = CiarletGeymonat(4000.0, 120.0, 30.0)
energy = material.energy(u) * ufl.dx(metadata={"quadrature_degree": 4})
energy += gamma * ufl.dot(traction, u) * ds
held = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, edge(1, height)), V)
floor = HalfSpace((0, 0), (0, 1))
surface = ContactSurface(u, edge(1, 0.0), obstacle=floor, law=Coulomb(friction))
problem = ContactProblem(energy, u, [surface], bcs=[held])
system = ParametricContact(problem, gamma)

# ## The branches
#
# The first branch is followed from $\gamma = 1$ to the degenerate point, the others from there.

problem.solve()
start = system.create_vector()
problem.write(start)
diagram = explore(system, [(start, 1.0)], gamma_range=(-1.0, 1.0))
say = io.Report(comm)
say(f"rays out of the degenerate point: {', '.join(diagram.summary()['methods'])}")

# The far end of a branch is its first point if it was followed towards the degenerate point.

far = [e.branch.points[0 if e.start is None else -1] for e in diagram.edges]
far.sort(key=lambda point: (-point.gamma, system.letters(point.piece)))
outputs = {
    "ut_left": leftmost("ut"),
    "ut_right": rightmost("ut"),
    "sum_rt": total("rt"),
    "sum_rn": total("rn"),
}
rows = records.journal_of(system, [Branch(far)], outputs).rows()
for row in rows:
    values = ", ".join(f"{name} = {row[name]:.6f}" for name in outputs)
    say(f"gamma = {row['gamma']:g}, {row['status']}: {values}")

# ## Comparison
#
# The branches are mirror images in pairs: the slip of the left corner on one branch is opposite to
# that of the right corner on the other.

half = len(rows) // 2
left = np.sort([row["ut_left"] for row in rows[:half]])
right = np.sort([-row["ut_right"] for row in rows[half:]])
asymmetry = float(np.abs(left - right).max())
say(f"{len(rows)} branches, mirror images up to {asymmetry:.1e} mm")

folder = io.output_folder(comm, "output/ciarlet_geymonat")
plot.picture_of_states(folder / "states.png", system, far)
journal = records.journal_of(system, diagram.branches, outputs)
if comm.rank == 0:
    labels = {"ut_left": "$u_t$ of the left corner", "sum_rn": "normal force"}
    plot.draw_diagram(folder / "diagram.png", journal, labels, strips=6)
