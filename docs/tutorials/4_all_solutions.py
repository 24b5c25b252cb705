# SPDX-License-Identifier: LGPL-3.0-or-later
# # All solutions, with proof and diagram
#
# The static problem with Coulomb's law may have several solutions when friction is large. A solve
# returns one of them. Here we find all of a triangle on a floor, prove that there are no others,
# and draw how they hang together as the load varies. Of {doc}`branches </theory/4_branches>` and
# {doc}`proofs </theory/7_proofs>` there is the theory.

import shutil

from mpi4py import MPI

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    plot,
    records,
)
from dolfinx_contact.continuation import explore, find_solutions
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.proofs import check
from dolfinx_contact.records import BranchRecord, leftmost, total

# ## The triangle
#
# Half of a square in congruent triangles, a mesh made of arrays, since no mesh generator would make
# just this one.


def half_square(n):
    nodes = [(i, j) for j in range(n + 1) for i in range(n + 1 - j)]
    number = {node: k for k, node in enumerate(nodes)}
    lower = [[(i, j), (i + 1, j), (i, j + 1)] for i, j in nodes if i + j < n]
    upper = [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i, j in nodes if i + j < n - 1]
    cells = np.array([[number[node] for node in cell] for cell in lower + upper])
    x = np.array(nodes) / n
    if MPI.COMM_WORLD.rank > 0:  # rank 0 has all of it, DOLFINx distributes it
        cells = cells[:0]
        x = x[:0]
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    return mesh.create_mesh(MPI.COMM_WORLD, cells=cells, x=x, e=ufl.Mesh(element))


# It is held on its slope, and its bottom is on the floor. The parameter $\gamma$ is a
# Constant of the form, the factor of the traction on the vertical side; `ParametricContact` is the
# problem as a system $H(x, \gamma) = 0$, which is piecewise linear here: each set of statuses
# of the contact points is a piece.


def triangle(n, friction):
    domain = half_square(n)
    slope = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0] + x[1], 1))
    side = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0], 0))
    bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    gamma = fem.Constant(domain, 0.0)
    ds = ufl.Measure("ds", domain, subdomain_data=mesh.meshtags(domain, 1, np.sort(side), 1))
    traction = gamma * fem.Constant(domain, (-26.0, -7.5))
    energy = LinearElastic(100.0, 82.0).energy(u) * ufl.dx - ufl.dot(traction, u) * ds(1)
    bcs = [fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, slope), V)]
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(friction))
    return ParametricContact(ContactProblem(energy, u, [surface], bcs=bcs), gamma)


system = triangle(16, friction=2.5)

# ## All solutions at one load
#
# `find_solutions` looks for all of them at $\gamma = 1$. For a linear body in 2D that is a search
# by branch and bound over the statuses, with bounds for all rounding errors; when it ends, it is a
# proof. Letters are the contact points from left to right: `o` open, `k` stick, `-` slip to the
# left, `d` held.

x = system.create_vector()
found = find_solutions(system, [x], 1.0)
for solution in found.found:
    print(system.letters(solution.piece))
print(f"{len(found.found)} solutions, complete: {found.complete}, by {found.method}")
assert found.complete
assert len(found.found) == 3

# The proof can be kept. What has to be trusted is one file that needs numpy alone: `python3
# dolfinx_contact/proofs/check_proof.py proof.npz` checks it without this package.

found.proof.certificate.save("proof.npz")
verdict = check(found.proof.certificate).verdict
print(verdict)
assert verdict == "complete"

# Under the opposite load there is one:

opposite = find_solutions(system, [x], -1.0)
print([system.letters(solution.piece) for solution in opposite.found], opposite.complete)
assert opposite.complete
assert len(opposite.found) == 1

# ## The diagram
#
# `explore` follows branches of solutions from one of them, here from the opposite load, switches
# wherever branches cross, and continues until nothing is left. At $\gamma = 0$ nothing is loaded:
# every contact point is at a kink of the law, and all rays that lead out of this point are found.
#
# A record keeps it all on the disk, with functionals along the branches: the displacement of the
# leftmost point A, its gap, and the normal force on the whole bottom. No record is overwritten:
# that of an earlier run has to be removed.

if MPI.COMM_WORLD.rank == 0:
    shutil.rmtree("triangle", ignore_errors=True)
seen = {"ut": leftmost("ut"), "un": leftmost("un"), "force": total("rn")}
system.set_parameter(-1.0)
system.problem.solve()
system.problem.write(x)
with BranchRecord("triangle", system, seen, surface_displacement=True) as record:
    diagram = explore(system, [(x, -1.0)], gamma_range=(-1.0, 1.0), record=record)
print(diagram.reason)
print(f"{len(diagram.edges)} branches, {len(diagram.nodes)} bifurcation")
ends = [b.points[i] for b in diagram.branches for i in (0, -1) if abs(b.points[i].gamma) == 1]
print(sorted((p.gamma, system.letters(p.piece)) for p in ends))

# As many branches end at $\gamma = 1$ as there are solutions, so that nothing is missing:

assert sum(p.gamma == 1 for p in ends) == len(found.found)

# The diagram is drawn from the record. So is a page for the browser, by `python3 -m dolfinx_contact
# explore triangle -o triangle.html`: a click on any point of the diagram shows the deformed body
# and what every contact point does there.

labels = {"ut": "$u_t$ of A", "un": "gap of A", "force": "normal force"}
journal = records.read_journal("triangle")
plot.draw_diagram("diagram.png", journal, labels, strips=0)

# The four states at the ends, with displacements twice as large as they are:

ends.sort(key=lambda p: p.gamma)
titles = [f"gamma = {p.gamma:g}: {system.letters(p.piece)}" for p in ends]
plot.picture_of_states("states.png", system, ends, titles=titles, scale=2.0)

# `find_solutions` finds solutions that hang together with the others or not; `explore` says *how*
# they hang together. In large problems, or in 3D, where no proof is known, the diagram is what
# there is.
