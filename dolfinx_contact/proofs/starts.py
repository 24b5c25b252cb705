# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Solutions of a reduced problem in 3D by Newton's method from many starts simultaneously.

With the displacements a = S^-1 (r + p), a damped semismooth Newton method solves r = P(r - rho a)
for the forces r. S is the stiffness matrix, p the load, rho a factor from displacements to forces,
and P the projection onto the admissible forces (`laws.coulomb`; Alart and Curnier, CMAME 92, 1991).
Nothing is proved here.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dolfinx_contact._arrays import Array, Ints, Mask
from dolfinx_contact.laws import coulomb
from dolfinx_contact.proofs.check_proof import (
    IN_OPEN,
    IN_SLIP,
    Cells,
    ReducedProblem,
    directions,
)

__all__ = ["forces_within", "many_solutions"]


_ITERATIONS = 60
_RESIDUAL = 1e-11
_VIOLATION = 1e-8
_SAME = 1e-6


class _Batch:
    """Newton equations r = P(r - rho a) (see the module) for k starts; each start is a vector r."""

    def __init__(self, problem: ReducedProblem, rho: Array):
        self.problem = problem
        self.inverse = np.linalg.inv(problem.S)
        self.rho = rho
        self.friction = problem.friction
        self.bound = problem.g

    def pulled(self, r: Array, rho: Array) -> Array:
        """Return the argument r - rho a of the projection for k starts, shape (k, m, 3)."""
        a = (r + self.problem.p) @ self.inverse.T
        return (r - rho[:, None] * a).reshape(len(r), -1, 3)

    def _flat(self, z: Array) -> tuple[Array, Array, Array]:
        k = len(z)
        return z.reshape(-1, 3), np.tile(self.friction, k), np.tile(self.bound, k)

    def residual(self, r: Array, rho: Array) -> Array:
        """Return the residual r - P(r - rho a) of k starts, shape (k, 3 m)."""
        z = self.pulled(r, rho)
        return r - coulomb.allowed(*self._flat(z)).reshape(r.shape)

    def steps(self, r: Array, rho: Array, left: Array) -> Array:
        """Return the Newton steps of k starts, shape (k, 3 m) for m points.

        Args:
            r: forces, shape (k, 3 m).
            rho: factor from displacements to forces of each start, shape (k,).
            left: residuals, shape (k, 3 m).
        """
        k, n = r.shape
        D = coulomb.derivative(*self._flat(self.pulled(r, rho))).reshape(k, n // 3, 3, 3)
        T = np.eye(n) - rho[:, None, None] * self.inverse
        A = np.eye(n) - (D @ T.reshape(k, n // 3, 3, n)).reshape(k, n, n)
        try:
            d = np.linalg.solve(A, -left[:, :, None])[:, :, 0]
        except np.linalg.LinAlgError:
            d = np.linalg.solve(A + 1e-9 * np.eye(n), -left[:, :, None])[:, :, 0]
        return np.where(np.isfinite(d).all(axis=1)[:, None], d, 0.0)


def _newton(batch: _Batch, r: Array) -> tuple[Array, Mask]:
    """Iterate from the forces ``r``; return the final forces and a mask of the converged starts."""
    r = r.copy()
    small = _RESIDUAL * (1 + float(np.abs(batch.problem.p).max()))
    live = np.arange(len(r))
    for _ in range(_ITERATIONS):
        left = batch.residual(r[live], batch.rho[live])
        size = np.linalg.norm(left, axis=1)
        go = size >= small
        live, left, size = live[go], left[go], size[go]
        if len(live) == 0:
            break
        here, rho = r[live], batch.rho[live]
        step = batch.steps(here, rho, left)
        new = here + step
        now = np.linalg.norm(batch.residual(new, rho), axis=1)
        part = np.ones(len(live))
        for _ in range(6):
            bad = ~(now < (1 - 1e-4) * size)
            if not bad.any():
                break
            part[bad] /= 2
            new[bad] = here[bad] + part[bad, None] * step[bad]
            now[bad] = np.linalg.norm(batch.residual(new[bad], rho[bad]), axis=1)
        r[live] = new
    left = np.linalg.norm(batch.residual(r, batch.rho), axis=1)
    return r, left < 100 * small


def _random_forces(problem: ReducedProblem, number: int, random: np.random.Generator) -> Array:
    """Return random initial forces of open, sticking or slipping points, shape (number, 3 m).

    Tangential forces of a start have random directions, or one direction for all points.
    """
    m = problem.points
    scale = max(1.0, float(np.abs(problem.p).max())) * 10 ** random.uniform(-1, 1, (number, 1))
    closed = random.random((number, m)) < random.random((number, 1))
    r = np.zeros((number, m, 3))
    r[:, :, 2] = np.abs(random.normal(size=(number, m))) * scale * closed
    each = random.uniform(0, 2 * np.pi, (number, m))
    one = random.uniform(0, 2 * np.pi, (number, 1))
    angle = np.where(random.random((number, 1)) < 0.5, each, one)
    part = np.where(random.random((number, m)) < 0.5, 1.0, random.random((number, m)))
    shear = (problem.friction * r[:, :, 2] + problem.g) * part
    r[:, :, 0] = shear * np.cos(angle)
    r[:, :, 1] = shear * np.sin(angle)
    return r.reshape(number, -1)


def forces_within(
    problem: ReducedProblem, regions: Sequence[Cells], number: int, random: np.random.Generator
) -> Array:
    """Return random forces of m points in several regions in turn, shape (number, 3 m).

    The forces of a start lie within the cells of one region.
    """
    m = problem.points
    scale = max(1.0, float(np.abs(problem.p).max())) * 10 ** random.uniform(-1, 1, (number, 1))
    order = random.permutation(len(regions))
    kind = np.zeros((number, m), dtype=np.int64)
    e = np.zeros((number, m, 2))
    for k in range(number):
        cells = regions[order[k % len(order)]]
        at = _drawn(cells, random)
        kind[k] = cells.kind[at]
        e[k] = directions(random.uniform(*cells.ends[at].T))
    slips = kind == IN_SLIP
    e[slips] *= -1
    e[~slips] = directions(random.uniform(0, 4, int((~slips).sum())))
    part = np.where(slips, 1.0, random.random((number, m)))
    r = np.zeros((number, m, 3))
    r[:, :, 2] = np.abs(random.normal(size=(number, m))) * scale * (kind != IN_OPEN)
    shear = (problem.friction * r[:, :, 2] + problem.g) * part
    r[:, :, :2] = shear[:, :, None] * e
    return r.reshape(number, -1)


def _drawn(cells: Cells, random: np.random.Generator) -> Ints:
    """Draw one cell for each of m points at random, and return the indices, shape (m,).

    All kinds of cells at a point are equally likely.
    """
    kinds = 4 * cells.node + cells.kind
    # For uniform u, the largest u^(1/w) selects an item with probability proportional to w.
    key = random.random(len(cells)) ** np.bincount(kinds)[kinds]
    order = np.lexsort((key, cells.node))
    return np.asarray(order[np.append(cells.first[1:], len(cells)) - 1])


def many_solutions(
    problem: ReducedProblem,
    number: int,
    random: np.random.Generator,
    regions: Sequence[Cells] = (),
) -> list[tuple[Array, Array]]:
    """Return distinct solutions: displacements and forces of m points, shape (m, 3) each.

    Args:
        problem: reduced problem, scaled by `ReducedProblem.scaled`.
        number: number of starts.
        random: generator of the starts.
        regions: regions providing the starts in turn; by default no restriction.
    """
    batch = _Batch(problem, 10 ** random.uniform(-1, 1, number))
    if regions:
        start = forces_within(problem, regions, number, random)
    else:
        start = _random_forces(problem, number, random)
    r, solved = _newton(batch, start)
    found: list[tuple[Array, Array]] = []
    for k in np.flatnonzero(solved):
        force = r[k].reshape(-1, 3)
        a = (batch.inverse @ (r[k] + problem.p)).reshape(-1, 3)
        if _violation(problem, a, force) > _VIOLATION * (1 + float(np.abs(force).max())):
            continue
        size = _SAME * (1 + float(np.abs(force).max()))
        if all(np.abs(a - b).max() + np.abs(force - s).max() > size for b, s in found):
            found.append((a, force))
    return found


def _violation(problem: ReducedProblem, a: Array, r: Array) -> float:
    """Return the largest violation of the contact law by displacements a and forces r."""
    size = np.hypot(a[:, 0], a[:, 1])
    limit = problem.friction * r[:, 2] + problem.g
    along = np.where(size > 1e-9, 1.0, 0.0) / np.maximum(size, 1e-300)
    off = r[:, :2] + limit[:, None] * a[:, :2] * along[:, None]
    parts = [
        -a[:, 2],
        -r[:, 2],
        np.minimum(np.abs(a[:, 2]), np.abs(r[:, 2])),
        np.hypot(r[:, 0], r[:, 1]) - limit,
        np.hypot(off[:, 0], off[:, 1]) * (size > 1e-9),
    ]
    return float(max(v.max() for v in parts))
