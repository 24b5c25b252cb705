# SPDX-License-Identifier: LGPL-3.0-or-later
# # One solution, or three: all solutions of a triangle
#
# This demo illustrates how to:
#
# - find all connected branches of solutions of a contact problem as its load varies (`explore`);
# - pass a load at which *every* contact node changes its status at once;
# - prove that no solution is missing (`prove_counts`).
#
# The triangle with corners $A = (0, 0)$, $B = (1, 0)$ and $C = (0, 1)$ is clamped on $BC$ and may
# touch a rigid floor along $AB$. The traction $-\gamma\,(26, 7.5)$ acts on $AC$ (Ligursky and
# Renard). Without load the body grazes the floor: all nodes of $AB$ are open, stuck and slipping at
# the same time, and $4^n$ pieces of the nonsmooth problem meet. For $\gamma < 0$ there is one
# solution; for $\gamma > 0$ and a large friction coefficient there are three.
#
# The published load is large: a warning (`pressure`) says that the contact pressure is not small
# compared with the stiffness of the linear body. A smaller load divides all displacements and
# forces by the same factor.

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
from dolfinx_contact.analysis import prove_counts
from dolfinx_contact.continuation import Branch, explore
from dolfinx_contact.laws.status import NAMES
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import name_groups
from dolfinx_contact.records import leftmost, total

comm = MPI.COMM_WORLD
n = 64  # cells along an edge, and contact nodes
friction = 1.7
lame = (100.0, 82.0)
load = (26.0, 7.5)

# ## The mesh
#
# The triangle is half of a square that is cut along its diagonals.

square = mesh.create_unit_square(comm, n, n, diagonal=mesh.DiagonalType.left)
half = mesh.locate_entities(square, 2, lambda x: x[0] + x[1] < 1 + 1e-9)
sides = {
    "slope": lambda x: np.isclose(x[0] + x[1], 1),
    "side": lambda x: np.isclose(x[0], 0),
    "bottom": lambda x: np.isclose(x[1], 0),
}
body = name_groups(mesh.create_submesh(square, 2, half)[0], sides)
domain = body.mesh

# ## A problem with a parameter
#
# The parameter is a Constant of the energy. `ParametricContact` makes it the unknown of the
# continuation.

V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
u = fem.Function(V, name="displacement")
gamma = fem.Constant(domain, -1.0)
traction = -gamma * fem.Constant(domain, load)
energy = LinearElastic(*lame).energy(u) * ufl.dx - ufl.dot(traction, u) * body.ds("side")
clamped = fem.dirichletbc(np.zeros(2), body.dofs(V, "slope"), V)
floor = HalfSpace((0, 0), (0, 1))
surface = ContactSurface(u, body, tag="bottom", obstacle=floor, law=Coulomb(friction))
problem = ContactProblem(energy, u, [surface], bcs=[clamped])
system = ParametricContact(problem, gamma)

# ## All branches
#
# An ordinary solve gives the solution at $\gamma = -1$. From there `explore` follows the branch to
# $\gamma = 0$, finds every ray that leaves this point, and follows each of them.

problem.solve()
x = system.create_vector()
problem.write(x)
diagram = explore(system, [(x, -1.0)], gamma_range=(-1.0, 1.0))
say = io.Report(comm)
say(f"{len(diagram.branches)} branches")

# ## The proof
#
# The solutions at $\gamma = -1$ and 1 are the ends of the branches. A branch-and-bound search over
# all combinations of statuses, with bounds for all round-off errors, proves that there are no
# others.

counts = prove_counts(system, diagram, gammas=(-1.0, 1.0))
proofs = [count.solutions for count in counts]
numbers = [len(proof.found) for proof in proofs]
complete = all(proof.complete for proof in proofs)
say(f"solutions at gamma = -1 and 1: {numbers}, {'proved' if complete else 'not proved'}")

# ## The solutions
#
# The displacement of the corner $A$ and the total forces distinguish them. An independent code
# gives the same values: for instance, $u_t(A) = -0.0397846$ where $A$ slips.

ends = [
    point
    for branch in diagram.branches
    for point in (branch.points[0], branch.points[-1])
    if abs(point.gamma) == 1
]
ends.sort(key=lambda point: (point.gamma, system.letters(point.piece)))
outputs = {
    "ut_A": leftmost("ut"),
    "un_A": leftmost("un"),
    "sum_rt": total("rt"),
    "sum_rn": total("rn"),
}
solutions = records.journal_of(system, [Branch(ends)], outputs).rows()
titles = [f"gamma = {row['gamma']:g}, A: {NAMES[row['status'][0]]}" for row in solutions]
for title, row in zip(titles, solutions, strict=True):
    values = ", ".join(f"{name} = {row[name]:.7f}" for name in outputs)
    say(f"{title}; {values}")

# ## The pictures
#
# `states.png` shows the deformed body in each solution; displacements are magnified. For
# $\gamma = -1$ the traction acts to the right and upwards, and $A$ opens. For $\gamma = 1$ it acts
# to the left and downwards, and $A$ opens, sticks or slips. `diagram.png` shows three quantities
# over $\gamma$: the four branches meet in the bifurcation at $\gamma = 0$. The labels at the top
# are the proved numbers of solutions.

folder = io.output_folder(comm, "output/linear_triangle")
scale = 0.15 / max(abs(row["ut_A"]) for row in solutions)
plot.picture_of_states(folder / "states.png", system, ends, titles=titles, scale=scale)
journal = records.journal_of(system, diagram.branches, outputs)
if comm.rank == 0:
    labels = {"ut_A": "$u_t$ of A", "un_A": "gap of A", "sum_rn": "normal force"}
    plot.draw_diagram(folder / "diagram.png", journal, labels, strips=0, proved=proofs)
