# SPDX-License-Identifier: LGPL-3.0-or-later
# # Hild's triangle: one element, all solutions, and the algorithms that find them
#
# This demo illustrates how to:
#
# - find **all** solutions of a problem with few contact points (`find_solutions`);
# - follow a branch of solutions through two folds, located to round-off (`follow`);
# - see in which of several solutions each classical algorithm ends (`algorithms`).
#
# The body is one linear triangle with corners $A = (0, 0)$, $B = (1, 0)$ and $C = (0, 1)$. It is
# clamped on $BC$ and may touch the floor on $AB$; a traction $(F_1, F_2)$ acts on $AC$ (P. Hild,
# *Int. J. Appl. Math. Comput. Sci.* 12, 2002). Only $A$ moves. Its stiffness matrix and load are
#
# $$S = \begin{pmatrix} k_t & k \\ k & k_t \end{pmatrix},\qquad
# k_t = \frac{\lambda + 3\mu}{2},\quad k = \frac{\lambda + \mu}{2},\qquad
# p = \frac12 (F_1, F_2).$$
#
# Below the critical friction coefficient $k_t/k$ the solution is unique. Above it, three solutions
# exist for some loads: $A$ opens, sticks, or slips to the left.

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
    algorithms,
    io,
    plot,
    records,
)
from dolfinx_contact.continuation import find_solutions, follow
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import name_groups
from dolfinx_contact.records import leftmost

lame = (1.0, 1.0)
friction = 3.0
kt = (lame[0] + 3 * lame[1]) / 2
k = (lame[0] + lame[1]) / 2

# ## The element
#
# The problem is so small that every MPI rank solves it alone. The traction is
# $f_0 + \gamma f_1$ with the parameter $\gamma$.


def element(friction, first, second):
    square = mesh.create_unit_square(MPI.COMM_SELF, 1, 1, diagonal=mesh.DiagonalType.left)
    half = mesh.locate_entities(square, 2, lambda x: x[0] + x[1] < 1 + 1e-9)
    sides = {
        "slope": lambda x: np.isclose(x[0] + x[1], 1),
        "side": lambda x: np.isclose(x[0], 0),
        "bottom": lambda x: np.isclose(x[1], 0),
    }
    body = name_groups(mesh.create_submesh(square, 2, half)[0], sides)
    domain = body.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    gamma = fem.Constant(domain, 0.0)
    traction = fem.Constant(domain, first) + gamma * fem.Constant(domain, second)
    energy = LinearElastic(*lame).energy(u) * ufl.dx - ufl.dot(traction, u) * body.ds("side")
    clamped = fem.dirichletbc(np.zeros(2), body.dofs(V, "slope"), V)
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, body, tag="bottom", obstacle=floor, law=Coulomb(friction))
    problem = ContactProblem(energy, u, [surface], bcs=[clamped])
    return ParametricContact(problem, gamma)


# ## All solutions at one load
#
# One point has four possible statuses; all are examined, so that no solution can be missing. In
# closed form, the open solution has $u(A) = S^{-1} p$, sticking has $r = -p$, and slip to the left
# has $u_t = (p_t - F p_n)/(k_t - F k)$.

say = io.Report(MPI.COMM_WORLD)
loaded = element(friction, (0.0, 0.0), (-2.4, -1.0))
found = find_solutions(loaded, [loaded.create_vector()], 1.0)
say(f"{found}")
p = np.array([-1.2, -0.5])
closed_form = {
    "o": np.linalg.solve([[kt, k], [k, kt]], p)[0],
    "k": 0.0,
    "-": (p[0] - friction * p[1]) / (kt - friction * k),
}
points = found.points(loaded)
slips = {}
for point in points:
    table = loaded.result_at(point).tables["contact"]
    status = table.letters[0]
    slips[status] = float(table.along(table.ut)[0])
    say(f"A {status}: slip {slips[status]:.10f}, closed form {closed_form[status]:.10f}")

# ## A branch with two folds
#
# The vertical traction is fixed and the horizontal one grows to the left. $A$ sticks until the
# shear reaches its bound at $\gamma = F/4$. There the branch turns back: $A$ slips while the load
# decreases. Where the pressure vanishes, at $\gamma = k_t/(4k)$, $A$ opens and the load grows
# again.

pulled = element(friction, (0.0, -1.0), (-4.0, 0.0))
pulled.set_parameter(0.0)
pulled.problem.solve()
x = pulled.create_vector()
pulled.problem.write(x)
branch = follow(pulled, x, 0.0, gamma_range=(-0.1, 1.0))
folds = [special.gamma for special in branch.folds]
for fold, exact in zip(folds, [friction / 4, kt / k / 4], strict=True):
    say(f"fold at gamma = {fold:.12f}, closed form {exact:.12f}")

# ## Which solution does an algorithm find?
#
# `reduced` condenses the problem onto the contact points, as numpy arrays. From zero contact
# forces, every algorithm ends in one of the three solutions; which one is not decided by theory.

loaded.constant.value = 1.0
contact = loaded.problem.reduced()
names = {
    "semismooth Newton": algorithms.SemismoothNewton(),
    "Tresca fixed point": algorithms.TrescaFixedPoint(max_iterations=50),
    "Uzawa": algorithms.Uzawa(max_iterations=1000),
    "penalty": algorithms.Penalty(),
    "Gauss-Seidel": algorithms.GaussSeidel(max_iterations=200),
    "Lemke": algorithms.Lemke(),
    "interior point": algorithms.InteriorPoint(max_iterations=60),
}
words = {"o": "opens", "k": "sticks", "-": "slips to the left"}
for name, algorithm in names.items():
    outcome = algorithm.run(contact)
    slip, gap = outcome.a[0]
    end = "opens" if gap > 1e-6 else "sticks" if abs(slip) < 1e-6 else "slips to the left"
    say(f"{name}: A {end}" if outcome.converged else f"{name}: {outcome.reason}")

# ## The pictures
#
# The element in its three solutions, and the slip of $A$ along the branch.

folder = io.output_folder(MPI.COMM_WORLD, "output/hild_triangle")
if MPI.COMM_WORLD.rank == 0:
    plot.picture_of_states(folder / "states.png", loaded, points)
    journal = records.journal_of(pulled, [branch], {"ut_A": leftmost("ut")})
    plot.draw_diagram(folder / "branch.png", journal, {"ut_A": "$u_t$ of A"})
