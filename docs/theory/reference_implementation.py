# SPDX-License-Identifier: LGPL-3.0-or-later
# # Reference implementation
#
# This page solves frictional contact of a linear elastic body with a rigid obstacle in plain numpy.
# It is serial, uses linear elements and one surface, and contains the residual $H$, its generalised
# Jacobian $J$, the statuses, one static solve and one incremental step. The package computes the
# same numbers to round-off; `tests/project/test_reference_implementation.py` compares them in 2D
# and 3D.
# Symbols and signs follow {doc}`the notation <notation>`.
#
# DOLFINx assembles the stiffness matrix and the loads, and measures the nodal areas. Everything
# else is written out below. The following features of the package are missing here: other laws and
# discretisations, two bodies, large sliding, bodies that are not linear, scaling of rows and
# unknowns, parallel assembly, and strategies for the case that Newton's method does not converge.

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

import ufl
from dolfinx import fem, mesh

# ## The discrete problem
#
# The displacement $u$ has one value per degree of freedom. There are $m$ contact points, the nodes
# on the contact surface, each with an area $W$, a unit normal $n$ from the body into the obstacle,
# and an initial gap $g$. A node held by a support is not a contact point, because the support
# carries its reaction. The operator $B$ selects the displacements of the contact points, so that
# $j = B u$ are the jumps. The multipliers are the tractions $t$ on the body, thus $E = I$ in
# {eq}`eq-operators`.
#
# The area of a node is the integral of its basis function over the contact facets. In the class
# below, `load` contains the nodal forces of the body's loads, so that the residual of the body is
# $R(u) = K u - \text{load}$.


@dataclass(frozen=True)
class Problem:
    K: sparse.csr_matrix  # stiffness (N, N)
    load: np.ndarray  # nodal forces (N,)
    held: np.ndarray  # True at degrees of freedom with Dirichlet data (N,)
    values: np.ndarray  # Dirichlet values, 0 elsewhere (N,)
    nodes: np.ndarray  # contact nodes (m,)
    B: sparse.csr_matrix  # displacements to jumps (m dim, N)
    W: np.ndarray  # nodal areas (m,)
    n: np.ndarray  # normals from the body into the obstacle (m, dim)
    g: np.ndarray  # initial gaps (m,)
    F: float  # coefficient of friction, positive
    r: float  # augmentation parameter, a stiffness per area


def discretise(energy, u, bcs, facets, obstacle, F, r):
    """The discrete problem of a quadratic energy of the Function ``u`` with its present data."""
    V = u.function_space
    domain = V.mesh
    dim = domain.geometry.dim
    fdim = domain.topology.dim - 1
    v = ufl.TestFunction(V)

    # stiffness and loads: derivatives of the energy at u = 0
    u.x.array[:] = 0.0
    first = ufl.derivative(energy, u, v)
    K = fem.assemble_matrix(fem.form(ufl.derivative(first, u))).to_scipy().tocsr()
    load = -fem.assemble_vector(fem.form(first)).array

    # Dirichlet data: a value that is not overwritten belongs to a free degree of freedom
    values = np.full(len(load), np.nan)
    for bc in bcs:
        bc.set(values)
    held = np.isfinite(values)

    # contact points: nodes of the facets without those held by a support
    nodes = fem.locate_dofs_topological(V, fdim, facets)
    supported = held.reshape(-1, dim)[nodes]
    assert np.array_equal(supported.all(axis=1), supported.any(axis=1))
    nodes = nodes[~supported.any(axis=1)]
    tags = mesh.meshtags(domain, fdim, np.sort(facets), 1)
    ds = ufl.Measure("ds", domain, subdomain_data=tags)
    areas = fem.assemble_vector(fem.form(v[0] * ds(1))).array.reshape(-1, dim)[:, 0]
    g, n = obstacle(V.tabulate_dof_coordinates()[nodes, :dim])

    # B has one entry in each row
    columns = (dim * nodes[:, None] + np.arange(dim)).ravel()
    rows = np.arange(len(columns))
    B = sparse.csr_matrix((np.ones(len(rows)), (rows, columns)), (len(rows), len(load)))
    values = np.where(held, values, 0.0)
    return Problem(K, load, held, values, nodes, B, areas[nodes], n, g, F, r)


# An obstacle is a function of the positions of the contact points. It returns their initial gaps
# and normals. Here is a plane through a point, with the normal $\nu$ towards the body:


def plane(point, normal):
    nu = np.asarray(normal) / np.linalg.norm(normal)

    def obstacle(x):
        return (x - point) @ nu, np.broadcast_to(-nu, x.shape)

    return obstacle


# ## The law at the contact points
#
# The augmented pressure and the augmented shear of {eq}`eq-augmented` are
#
# $$p = -(t_n - r\,u_n), \qquad s = t_t - r\,u_t, \qquad u_n = j\cdot n - g .$$
#
# They determine the status of a point and the traction $\tau$ that the law requires:
#
# | status | condition | $\tau$ |
# |---|---|---|
# | open | $p \le 0$ | $0$ |
# | stick | $p > 0$, $\lvert s\rvert \le F p$ | $-p\,n + s$ |
# | slip | $p > 0$, $\lvert s\rvert > F p$ | $-p\,n + F p\,e$ with $e = s/\lvert s\rvert$ |
#
# This is the projection {eq}`eq-projection`. In 2D a slip has a sense: along the tangent
# $\mathbf t = (-n_y, n_x)$ it is `PLUS` if $s\cdot\mathbf t < 0$ and `MINUS` otherwise. In 3D every
# slip has the number of `PLUS`.
#
# Jump and traction enter only by $t - r\,j$, and $\partial p/\partial t = -n$,
# $\partial s/\partial t = I - n n^T$. Hence $D_j = -r D_t$, and $D_t$ is $0$ at open points, $I$ at
# stuck ones, and
#
# $$D_t = n n^T - F\,e\,n^T + \frac{F p}{\lvert s\rvert}\,\bigl(I - n n^T - e e^T\bigr)$$
#
# at slipping ones. In 2D the last bracket vanishes.

OPEN, STICK, PLUS, MINUS = range(4)


def dot(a, b):
    return np.sum(a * b, axis=1)


def outer(a, b):
    return a[:, :, None] * b[:, None, :]


def law(problem, j, t):
    """Statuses (m,), tractions tau (m, dim) and derivatives D_t (m, dim, dim) at the points."""
    n, F, r = problem.n, problem.F, problem.r
    m, dim = n.shape
    u_n = dot(j, n) - problem.g
    u_t = j - dot(j, n)[:, None] * n
    t_n = dot(t, n)
    t_t = t - t_n[:, None] * n
    p = -(t_n - r * u_n)
    s = t_t - r * u_t
    size = np.linalg.norm(s, axis=1)

    closed = p > 0
    sticks = closed & (size <= F * p)
    slips = closed & ~sticks
    back = slips & (dot(s, tangents(n)) > 0) if dim == 2 else np.zeros(m, dtype=bool)
    statuses = np.select([~closed, sticks, back], [OPEN, STICK, MINUS], PLUS).astype(np.int8)

    bound = F * p
    e = s / np.where(slips, size, 1.0)[:, None]
    ratio = np.where(slips, bound, 0.0) / np.where(slips, size, 1.0)
    slip = -p[:, None] * n + bound[:, None] * e
    tau = np.where(sticks[:, None], -p[:, None] * n + s, np.where(slips[:, None], slip, 0.0))

    identity = np.eye(dim)[None]
    nn = outer(n, n)
    D_slip = nn - F * outer(e, n) + ratio[:, None, None] * (identity - nn - outer(e, e))
    D_t = np.where(sticks[:, None, None], identity, np.where(slips[:, None, None], D_slip, 0.0))
    return statuses, tau, D_t


def tangents(n):
    return np.column_stack([-n[:, 1], n[:, 0]])


# ## The residual and its Jacobian
#
# The unknowns are $u$ and $t$. The equations {eq}`eq-H` and their derivative {eq}`eq-J` are
#
# $$H_u = K u - \text{load} - B^T W t, \qquad H_t = W\,\bigl(t - \tau(j, t)\bigr),$$
#
# $$J = \begin{pmatrix} K & -B^T W \\ r W D_t B & W (I - D_t) \end{pmatrix}.$$
#
# $J$ is an element of the generalised Jacobian of $H$: it is the derivative of the smooth piece
# given by the statuses. Rows of held degrees of freedom are $u$ less its Dirichlet value.
#
# **Memory.** The static law sees the total jump $j = B u$. In a step of a history, friction opposes
# the increment since the accepted state, whose jump $j_0$ is the memory: the law sees
# $j = B u - (I - n n^T)\,j_0$. The normal part remains the total one. This is the implicit Euler
# step of Coulomb's law for the slip rate ({doc}`5_evolution`).


def evaluate(problem, u, t, memory=None):
    """H, J and the statuses at displacements (N,) and tractions (m, dim)."""
    m, dim = problem.n.shape
    j = (problem.B @ u).reshape(m, dim)
    if memory is not None:
        j = j - (memory - dot(memory, problem.n)[:, None] * problem.n)
    statuses, tau, D_t = law(problem, j, t)

    W = sparse.diags(np.repeat(problem.W, dim))
    D = sparse.block_diag(D_t)
    free = sparse.diags((~problem.held).astype(float))
    held = sparse.diags(problem.held.astype(float))

    forces = problem.K @ u - problem.load - problem.B.T @ (W @ t.ravel())
    H_u = np.where(problem.held, u - problem.values, forces)
    H_t = W @ (t - tau).ravel()
    J = sparse.bmat(
        [
            [free @ problem.K + held, -free @ problem.B.T @ W],
            [problem.r * W @ D @ problem.B, W @ (sparse.eye(m * dim) - D)],
        ]
    )
    return np.concatenate([H_u, H_t]), J.tocsc(), statuses


# ## Newton's method
#
# One step solves $J d = -H$, see {eq}`eq-newton`. As soon as the statuses agree with the solution,
# the iteration is Newton's method on a smooth piece. In 2D the piece is affine, so that the next
# step is exact. The iteration ends when the residual is at the level of round-off of its own terms.
# Without the strategies of the package it may cycle between statuses; then it raises an error.


def solve(problem, u, t, memory=None):
    """Displacements, tractions and statuses of a solution, from a starting point."""
    size = np.abs(problem.load).max()
    for _ in range(50):
        H, J, statuses = evaluate(problem, u, t, memory)
        size = max(size, (abs(problem.K) @ np.abs(u)).max())
        if np.abs(H).max() <= 1e-14 * size:
            return u, t, statuses
        d = spsolve(J, -H)
        u = u + d[: len(u)]
        t = t + d[len(u) :].reshape(t.shape)
    raise RuntimeError("Newton's method has not converged in 50 steps")


# ## A static solve
#
# A square block of edge 1 is pressed down by 0.01 and moved to the right by 0.004 at its top. Its
# bottom lies on a plane. Any $r > 0$ gives the same solution; Young's modulus over the size of the
# body converges well.

domain = mesh.create_unit_square(MPI.COMM_SELF, 8, 8)
V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
u = fem.Function(V)
top = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 1.0))
bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
moved = fem.Constant(domain, (0.004, -0.01))
bcs = [fem.dirichletbc(moved, fem.locate_dofs_topological(V, 1, top), V)]
E, nu = 1000.0, 0.3
lam, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
eps = ufl.sym(ufl.grad(u))
energy = (lam / 2 * ufl.tr(eps) ** 2 + mu * ufl.inner(eps, eps)) * ufl.dx
given = energy, u, bcs, bottom, plane((0.0, 0.0), (0.0, 1.0))
problem = discretise(*given, F=0.3, r=E)

u_0, t_0, statuses = solve(problem, np.zeros(len(problem.load)), np.zeros((9, 2)))
order = np.argsort(V.tabulate_dof_coordinates()[problem.nodes, 0])
print("static solve:", "".join("ok+-"[k] for k in statuses[order]))

# The solution satisfies {eq}`eq-signorini-coulomb`:

n, W = problem.n, problem.W
j_0 = (problem.B @ u_0).reshape(n.shape)
pressure, gap = -dot(t_0, n), problem.g - dot(j_0, n)
assert pressure.min() >= 0
assert gap.min() >= -1e-14
assert np.abs(pressure * gap).max() < 1e-14 * pressure.max()
shear, slip = dot(t_0, tangents(n)), dot(j_0, tangents(n))
assert np.all(np.abs(shear) <= 0.3 * pressure * (1 + 1e-12))
moves = np.abs(slip) > 1e-12
assert np.allclose(shear[moves], -0.3 * (pressure * np.sign(slip))[moves])

# ## An incremental step
#
# Now the top moves back by half of its way. The static law opposes the total slip. In the
# incremental step, friction opposes the slip since the accepted state, as in the problem that
# `ContactProblem.step_from` makes from a state. The shear forces on the body differ.

moved.value[0] = 0.002
problem = discretise(*given, F=0.3, r=E)
u_1, t_1, statuses = solve(problem, u_0, t_0, memory=j_0)
print("incremental step:", "".join("ok+-"[k] for k in statuses[order]))
_, t_s, statuses = solve(problem, u_0, t_0)
print("static solve:    ", "".join("ok+-"[k] for k in statuses[order]))
for name, t in (("accepted state", t_0), ("incremental step", t_1), ("static solve", t_s)):
    print(f"shear force on the body, {name}: {np.sum(W * t[:, 0]):+.4f}")
