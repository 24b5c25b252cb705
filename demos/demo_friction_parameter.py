# SPDX-License-Identifier: LGPL-3.0-or-later
# # The friction coefficient as the parameter
#
# This demo illustrates how to:
#
# - follow solutions as the *friction coefficient* varies while the load is fixed;
# - locate the coefficients at which solutions appear in pairs and vanish in pairs;
# - count the solutions between them, with a proof.
#
# One expects friction to multiply solutions. P. Hild (2002) noted that their number may also
# *decrease* when the coefficient grows. Two elements with two contact nodes show it: the triangles
# $ABC$ and $BDC$ with $A = (0, 0)$ and $B = (1, 0)$ on the floor, and the displaced nodes
# $C = (1/2, 1/2)$ and $D = (3/2, 3/2)$. With growing friction there is one solution, then there are
# three, and finally one again.

from itertools import pairwise

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
    io,
    plot,
    records,
)
from dolfinx_contact.continuation import find_solutions, follow
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.records import leftmost

comm = MPI.COMM_SELF  # two elements: every rank solves them alone
low, high = 0.5, 12.0  # friction coefficients
displaced = {(0.5, 0.5): (-0.02, 0.0), (1.5, 1.5): (0.01, -0.01)}

# ## The body


def body(friction):
    corners = np.array([(0.0, 0.0), (1.0, 0.0), *displaced])
    cells = np.array([[0, 1, 2], [1, 3, 2]])
    triangle = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    domain = mesh.create_mesh(comm, cells=cells, x=corners, e=triangle)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    bcs = []
    for (x0, y0), value in displaced.items():
        dofs = fem.locate_dofs_geometrical(
            V, lambda x, x0=x0, y0=y0: np.isclose(x[0], x0) & np.isclose(x[1], y0)
        )
        bcs.append(fem.dirichletbc(np.array(value), dofs, V))
    bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(friction))
    energy = LinearElastic.from_young(1.0, 0.3).energy(u) * ufl.dx
    return ContactProblem(energy, u, [surface], bcs=bcs)


# ## The branch
#
# `Coulomb` turns a number into a Constant, which serves as the parameter of the continuation. At
# weak friction $A$ is open and $B$ slips to the left. The branch turns back where $A$ touches the
# floor, and forward again where $A$ sticks. Beyond, $B$ slips however strong friction is.

problem = body(low)
problem.solve()
system = ParametricContact(problem, problem.surfaces[0].law.friction)
x = system.create_vector()
problem.write(x)
branch = follow(system, x, low, gamma_range=(low, high))
folds = sorted(special.gamma for special in branch.folds)
say = io.Report(MPI.COMM_WORLD)
say(f"folds at F = {', '.join(f'{fold:.10f}' for fold in folds)}")

# ## The number of solutions
#
# Two points have 16 combinations of statuses; all are examined. Between two folds the number does
# not change, so that one coefficient in each interval suffices.

solutions = []
for a, b in pairwise([low, *folds, high]):
    at_middle = body((a + b) / 2)
    fixed = ParametricContact(at_middle)  # without a parameter
    found = find_solutions(fixed, [fixed.create_vector()], 0.0)
    statuses = sorted(fixed.letters(solution.piece) for solution in found.found)
    solutions.append(statuses)
    proved = "proved" if found.complete else "not proved"
    say(f"F = {(a + b) / 2:.4f}: {len(statuses)} solutions ({', '.join(statuses)}), {proved}")

# ## The picture

folder = io.output_folder(MPI.COMM_WORLD, "output/friction_parameter")
if MPI.COMM_WORLD.rank == 0:
    journal = records.journal_of(system, [branch], {"ut_A": leftmost("ut")})
    title = "One solution, three, and one again"
    words = dict(title=title, parameter="friction coefficient F")
    plot.draw_diagram(folder / "branch.png", journal, {"ut_A": "$u_t$ of A"}, **words)
