# SPDX-License-Identifier: LGPL-3.0-or-later
# # All solutions, with proof and diagram
#
# With a large friction coefficient, the static problem with Coulomb's law may have several
# solutions. A solve returns one of them. This tutorial finds all solutions of a triangle on a
# floor, proves that none is missing, and draws how they are connected as the load varies. The
# theory is in {doc}`branches </theory/4_branches>` and {doc}`proofs </theory/7_proofs>`.

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
from dolfinx_contact.explorer import explorer
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import name_groups
from dolfinx_contact.proofs import check
from dolfinx_contact.records import BranchRecord, leftmost, total

# ## The triangle
#
# The body is half of a square, divided into congruent triangles. The mesh is built from arrays.


def half_square(n):
    nodes = [(i, j) for j in range(n + 1) for i in range(n + 1 - j)]
    number = {node: k for k, node in enumerate(nodes)}
    lower = [[(i, j), (i + 1, j), (i, j + 1)] for i, j in nodes if i + j < n]
    upper = [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i, j in nodes if i + j < n - 1]
    cells = np.array([[number[node] for node in cell] for cell in lower + upper])
    x = np.array(nodes) / n
    if MPI.COMM_WORLD.rank > 0:  # rank 0 lists all cells, DOLFINx distributes them
        cells = cells[:0]
        x = x[:0]
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    return mesh.create_mesh(MPI.COMM_WORLD, cells=cells, x=x, e=ufl.Mesh(element))


# The slope is clamped and the bottom lies on the floor. The parameter $\gamma$ is a Constant of the
# energy, the factor of the traction on the vertical side. `ParametricContact` represents the
# problem as a system $H(x, \gamma) = 0$. The system is piecewise linear here: each combination of
# statuses of the contact points defines a linear piece.


def triangle(n, friction):
    sides = {
        "slope": lambda x: np.isclose(x[0] + x[1], 1),
        "side": lambda x: np.isclose(x[0], 0),
        "bottom": lambda x: np.isclose(x[1], 0),
    }
    body = name_groups(half_square(n), sides)
    domain = body.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    gamma = fem.Constant(domain, 0.0)
    traction = gamma * fem.Constant(domain, (-26.0, -7.5))
    energy = LinearElastic(100.0, 82.0).energy(u) * ufl.dx - ufl.dot(traction, u) * body.ds("side")
    bcs = [fem.dirichletbc(np.zeros(2), body.dofs(V, "slope"), V)]
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    surface = ContactSurface(u, body, tag="bottom", obstacle=floor, law=Coulomb(friction))
    return ParametricContact(ContactProblem(energy, u, [surface], bcs=bcs), gamma)


system = triangle(16, friction=2.5)

# ## All solutions at one load
#
# `find_solutions` searches all solutions at $\gamma = 1$. For a linear body in 2D it uses branch
# and bound over the statuses with bounds for all rounding errors; a completed search is a proof.
# The letters stand for the contact points from left to right: `o` open, `k` stick, `-` slip to the
# left, `d` clamped.

x = system.create_vector()
found = find_solutions(system, [x], 1.0)
for solution in found.found:
    print(system.letters(solution.piece))
print(f"{len(found.found)} solutions, complete: {found.complete}, by {found.method}")
assert found.complete
assert len(found.found) == 3

# The proof can be saved. Its checker is a single file that needs numpy only: `python3
# dolfinx_contact/proofs/check_proof.py proof.npz` checks it without this package. On a mesh with
# few contact points, all pieces are enumerated instead, and `found.proof` is None.

if found.proof:
    found.proof.certificate.save("proof.npz")
    verdict = check(found.proof.certificate).verdict
    print(verdict)
    assert verdict == "complete"

# Under the opposite load the solution is unique:

opposite = find_solutions(system, [x], -1.0)
print([system.letters(solution.piece) for solution in opposite.found], opposite.complete)
assert opposite.complete
assert len(opposite.found) == 1

# ## The diagram
#
# `explore` follows a branch from one solution, here under the opposite load, switches to other
# branches wherever they cross, and continues until all connected branches are traced. At
# $\gamma = 0$ the body is not loaded: every contact point is at a kink of the law, and all rays
# that lead out of this point are found.
#
# A record stores the branches on disk, with functionals along them: the displacement of the
# leftmost point A, its gap, and the normal force on the whole bottom. Records are not overwritten;
# the record of an earlier run has to be removed.

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

# The number of branches that end at $\gamma = 1$ equals the number of solutions, so that no branch
# is missing:

assert sum(p.gamma == 1 for p in ends) == len(found.found)

# The diagram is drawn from the record, and so is an interactive page for the browser (also by
# `python3 -m dolfinx_contact explore triangle -o triangle.html`). A click on a point of the diagram
# shows the deformed body and the contact points. `counts` adds the numbers of solutions at both
# loads, with their proofs.

labels = {"ut": "$u_t$ of A", "un": "gap of A", "force": "normal force"}
journal = records.read_journal("triangle")
plot.draw_diagram("diagram.png", journal, labels, strips=0)
counts = [found, opposite]
explorer("explorer.html", "triangle", counts=counts, labels=labels, title="A triangle on a floor")

# The four states at the ends, with displacements magnified by two:

ends.sort(key=lambda p: p.gamma)
titles = [f"gamma = {p.gamma:g}: {system.letters(p.piece)}" for p in ends]
plot.picture_of_states("states.png", system, ends, titles=titles, scale=2.0)

# `find_solutions` also finds solutions that are not connected with the others; `explore` shows
# *how* solutions are connected. In large problems without a proof only the diagram is available.
