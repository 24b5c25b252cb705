# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Lemke's method, with a proof that it solves Coulomb friction (`complementarity`).

The reduced problem has S a = r + p with the positive definite stiffness S of the contact points,
a = (ut, un) and the forces r = (rt, rn) on the body. With A = S^{-1}, c = A p and
rt = rt+ - rt-, Signorini's and Coulomb's conditions are the linear complementarity problem
0 <= w = q + M z, z >= 0, w.z = 0 for z = (rn, rt+, rt-, l),

    un           = A_nn rn + A_nt (rt+ - rt-)       + c_n   against rn,
    l + ut       = A_tn rn + A_tt (rt+ - rt-) + l   + c_t   against rt+,
    l - ut       = -A_tn rn - A_tt (rt+ - rt-) + l  - c_t   against rt-,
    F rn - rt+ - rt-                                        against l = |ut| of a slip.

**Lemke's method ends in a solution for every F >= 0.** z^T M z = r^T A r + F l.rn, since the terms
with rt+ and rt- times l cancel, so M is copositive. Let z >= 0 with M z >= 0 and z^T M z = 0; then
r = 0 because A is positive definite, so rn = 0, and the last rows of M z >= 0 leave
rt+ + rt- <= F rn = 0; what remains is z = (0, 0, 0, l), and q^T z = 0 because q vanishes in those
rows. For a copositive M with q^T z >= 0 on that cone the method does not end in a ray (Cottle, Pang
and Stone, The Linear Complementarity Problem, theorem 4.4.13), and with the lexicographic rule it
does not cycle (section 4.9 there). So a solution exists, and failing to find it is a fault of the
program or of round-off. A bound g >= 0 given in advance (Tresca) enters q alone.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.linalg.blas import dger

__all__ = [
    "Compliant",
    "RayTermination",
    "copositive_forces",
    "copositive_form",
    "lemke",
    "parts_of",
    "tangents",
]

Array = npt.NDArray[np.float64]

_TIE = 1e-11  # difference of equal ratios, relative to the largest unknown
_NOTHING = 1e-9  # value of z_0 that counts as zero, relative to the largest unknown
_PIVOT = 1e-11  # entry that counts as zero, relative to the largest of its column


class RayTermination(ArithmeticError):
    """Lemke's method ended in a ray, exceeded the pivots, or failed because of round-off."""


def lemke(
    M: Array,
    q: Array,
    *,
    max_pivots: int | None = None,
    path: list[tuple[float, Array]] | None = None,
) -> tuple[Array, int]:
    """Solve 0 <= q + M z against z >= 0 by Lemke's method with the lexicographic rule.

    Args:
        M: square matrix, shape (n, n).
        q: right-hand side, shape (n,).
        max_pivots: maximum number of pivots; by default 50 n + 100.
        path: list to which (z_0, z) of every vertex of the path is appended. Here z solves the
            problem with q + z_0 (1, ..., 1) in place of q.

    Returns:
        Solution z, shape (n,), and the number of pivots.

    Raises:
        RayTermination: if the method ends in a ray or takes more pivots.
    """
    n = len(q)
    if (q >= -_TIE * np.abs(q).max(initial=0.0)).all():
        return np.zeros(n), 0
    table = _Tableau(M, q)
    leaving = table.first()
    if path is not None:
        path.append(table.corner())
    for pivots in range(1, (50 * n + 100 if max_pivots is None else max_pivots) + 1):
        if leaving == table.artificial:
            return table.solution(), pivots
        entering = leaving + n if leaving < n else leaving - n
        try:
            leaving = table.enter(entering)
        except RayTermination:
            if table.covers():
                raise
            return table.solution(), pivots
        if path is not None:
            path.append(table.corner())
    raise RayTermination(f"Lemke's method took more than {pivots} pivots")


class _Tableau:
    """Tableau of w - M z - d z_0 = q, solved for the basic variables.

    Variables are numbered w from 0, z from n, and z_0 is 2 n.
    """

    def __init__(self, M: Array, q: Array):
        self.n = len(q)
        self.artificial = 2 * len(q)
        self._M = M
        self._q = q
        self._d = np.ones(len(q))
        #: In Fortran order, so that BLAS updates it in place.
        self.table: Array = np.asfortranarray(np.column_stack([-M, -self._d]))
        self.values = q.copy()
        self.basic = np.arange(self.n)
        self.nonbasic = np.arange(self.n, 2 * self.n + 1)
        self._since = 0  # pivots since the table was made from the data

    def first(self) -> int:
        """Let z_0 enter the basis and return the variable that leaves it."""
        least = self.values.min()
        tied = np.flatnonzero(self.values <= least + _TIE * np.abs(self._q).max())
        return self._pivot(int(tied[-1]), self.n)  # the lexicographically least of them

    def enter(self, variable: int) -> int:
        """Let a variable enter the basis and return the variable that leaves it."""
        column = int(np.flatnonzero(self.nonbasic == variable)[0])
        return self._pivot(self._row(column), column)

    def covers(self) -> bool:
        """Return True if z_0 exceeds round-off, so that the basis is not a solution.

        In a tie, round-off may keep z_0 in the basis although its value is zero.
        """
        self._refresh()
        known = np.abs(self.values).max(initial=np.abs(self._q).max())
        held = self.values[self.basic == self.artificial]
        return bool((held > _NOTHING * known).any())

    def _row(self, column: int) -> int:
        """Return the pivot row by the lexicographic ratio test."""
        entries = self.table[:, column]
        rising = np.flatnonzero(entries > _PIVOT * np.abs(entries).max(initial=1.0))
        if len(rising) == 0:
            raise RayTermination("Lemke's method ended in a ray")
        ratios = np.maximum(self.values[rising], 0.0) / entries[rising]
        scale = _TIE * max(float(np.abs(self.values).max()), 1e-300)
        tied = rising[ratios <= ratios.min() + scale / entries[rising]]
        if len(tied) > 1:
            ends = tied[self.basic[tied] == self.artificial]
            if len(ends):
                return int(ends[0])
            for w in range(self.n):
                keys = self._inverse(tied, w) / entries[tied]
                size = float(np.abs(keys).max())
                tied = tied[keys <= keys.min() + _TIE * size]
                if len(tied) == 1:
                    break
        return int(tied[0])

    def _inverse(self, rows: npt.NDArray[np.int64], w: int) -> Array:
        """Return entries of the inverse basis in the column of the variable ``w``."""
        places = np.flatnonzero(self.nonbasic == w)
        if len(places):
            return np.asarray(self.table[rows, places[0]])
        return (self.basic[rows] == w).astype(float)

    def _pivot(self, row: int, column: int) -> int:
        """Exchange a basic and a nonbasic variable; return the one that leaves the basis."""
        T = self.table
        element = float(self.table[row, column])
        across = T[row] / element
        down = T[:, column].copy()
        value = float(self.values[row]) / element
        self.table = T = dger(-1.0, down, across, a=T, overwrite_a=True)
        T[row] = across
        T[:, column] = -down / element
        T[row, column] = 1.0 / element
        self.values -= down * value
        self.values[row] = value
        leaving = int(self.basic[row])
        self.basic[row] = self.nonbasic[column]
        self.nonbasic[column] = leaving
        self._since += 1
        if self._since >= max(100, self.n):
            self._refresh()
        return leaving

    def _columns(self, variables: npt.NDArray[np.int64]) -> Array:
        """Return the columns of [I, -M, -d] for some variables."""
        found = np.zeros((self.n, len(variables)))
        w = np.flatnonzero(variables < self.n)
        z = np.flatnonzero(variables >= self.n)
        found[variables[w], w] = 1.0
        everything = np.column_stack([-self._M, -self._d])
        found[:, z] = everything[:, variables[z] - self.n]
        return found

    def _refresh(self) -> None:
        """Recompute the tableau from M and q to remove the round-off of the pivots."""
        right = np.column_stack([self._columns(self.nonbasic), self._q])
        solved = np.linalg.solve(self._columns(self.basic), right)
        self.table = np.asfortranarray(solved[:, :-1], dtype=np.float64)
        self.values = np.asarray(solved[:, -1], dtype=np.float64).copy()
        self._since = 0

    def corner(self) -> tuple[float, Array]:
        """Return z_0 and z at the current basis."""
        values = np.zeros(2 * self.n + 1)
        values[self.basic] = self.values
        return float(values[self.artificial]), values[self.n : self.artificial]

    def solution(self) -> Array:
        """Return z at the current basis, computed from M and q."""
        values = np.linalg.solve(self._columns(self.basic), self._q)
        z = np.zeros(self.n)
        inside = (self.basic >= self.n) & (self.basic < 2 * self.n)
        z[self.basic[inside] - self.n] = np.maximum(values[inside], 0.0)
        return z


class Compliant(Protocol):
    """A contact problem with a compliance: a `PointProblem` or a `LocalProblem`."""

    @property
    def number(self) -> int: ...

    @property
    def dim(self) -> int: ...

    @property
    def A(self) -> Array: ...

    @property
    def free(self) -> Array: ...

    @property
    def friction(self) -> Array: ...

    @property
    def bound(self) -> Array: ...


def tangents(dim: int, facets: int) -> Array:
    """Return the unit directions of friction, shape (k, dim - 1)."""
    if dim == 2:
        return np.array([[1.0], [-1.0]])
    angles = 2 * np.pi * np.arange(facets) / facets
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def parts_of(contact: Compliant) -> tuple[Array, Array, Array, Array]:
    """Return A (m, dim, m, dim), normal and tangential parts of c, and diagonal matrix F."""
    m = contact.number
    d = contact.dim
    free = contact.free
    return contact.A.reshape(m, d, m, d), free[:, -1], free[:, :-1], np.diag(contact.friction)


def copositive_form(contact: Compliant, directions: Array) -> tuple[Array, Array]:
    """Return M and q of the copositive form, with z = (rn, b of point 1, b of point 2, ..., l)."""
    m = contact.number
    k = len(directions)
    A, cn, ct, F = parts_of(contact)
    ant = np.einsum("iap,jp->iaj", A[:, -1, :, :-1], directions).reshape(m, m * k)
    att = np.einsum("jp,ipaq,lq->ijal", directions, A[:, :-1, :, :-1], directions)
    ones = np.kron(np.eye(m), np.ones((k, 1)))
    none = np.zeros((m, m))
    M = np.block(
        [
            [A[:, -1, :, -1], ant, none],
            [ant.T, att.reshape(m * k, m * k), ones],
            [F, -ones.T, none],
        ]
    )
    return M, np.concatenate([cn, (ct @ directions.T).reshape(-1), contact.bound])


def copositive_forces(z: Array, directions: Array) -> Array:
    """Return the contact forces (m, dim) for unknowns z of the copositive form."""
    m = len(z) // (2 + len(directions))
    return np.column_stack([z[m:-m].reshape(m, -1) @ directions, z[:m]])
