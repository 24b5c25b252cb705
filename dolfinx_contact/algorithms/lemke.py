# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Lemke's method for Coulomb friction as a linear complementarity problem.

The reduced problem is S a = r + p with a positive definite stiffness S, the load p, displacements
a = (ut, un) of the contact points and forces r = (rt, rn) on the body. With the compliance
A = S^{-1}, c = A p, and the friction bound F rn + g (coefficients F, prescribed bounds g), friction
acts in directions d_1..d_k of the tangent plane: exactly +-t in 2D, and k equally spaced directions
in 3D, where the friction disc is replaced by an inscribed regular polygon with k corners. The
polygon reduces the friction bound by up to O(1/k^2); slip directions have an error of up to pi/k,
and so do the forces. With rt = sum_j b_j d_j and z = (rn, b_1..b_k, l), where l is the magnitude of
the slip, the conditions of Signorini and Coulomb are 0 <= w = q + M z complementary to z >= 0,

    un = A_nn rn + A_nt sum_j b_j d_j + c_n    complementary to rn,
    l + d_j.ut                                 complementary to b_j,
    F rn + g - sum_j b_j                       complementary to l.

**Lemke's method ends in a solution for every F >= 0.** z^T M z = r^T A r + F l.rn, since the
products of b and l cancel, so M is copositive. Let z >= 0 with M z >= 0 and z^T M z = 0. Then r = 0
because A is positive definite, so rn = 0, and the last rows of M z >= 0 give sum_j b_j <= F rn = 0.
Hence z = (0, 0, l), and q^T z = g.l >= 0. For a copositive M with q^T z >= 0 on that cone the
method does not end in a ray (Cottle, Pang and Stone, The Linear Complementarity Problem, theorem
4.4.13), and with the lexicographic rule it does not cycle (section 4.9 there). So a solution
exists; a failure indicates a programming error or round-off, which occurs for condition numbers of
S above about 1e8.

The method (Lemke, Management Science 11, 1965; for contact Klarbring, CMAME 58, 1986) stops when
its artificial variable z_0 leaves the basis. In 2D, Newton steps with the resulting statuses remove
the round-off of the pivots, and the result counts as converged if the relative residual of the law
is below the tolerance. In 3D the residual is evaluated with the disc. Hence only solutions with
forces at corners of the polygon count as converged; otherwise, the reason contains the residual.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.linalg.blas import dger

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._validate import count
from dolfinx_contact.algorithms.iteration import Algorithm, Iteration
from dolfinx_contact.algorithms.semismooth import newton_step
from dolfinx_contact.laws.coulomb import violation
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = [
    "Lemke",
    "RayTermination",
    "copositive_form",
    "coulomb_by_lemke",
    "forces_by_lemke",
    "lemke",
    "tangents",
]


_TIE = 1e-11  # difference of equal ratios, relative to the largest unknown
_NOTHING = 1e-9  # value of z_0 that counts as zero, relative to the largest unknown
_PIVOT = 1e-11  # entry that counts as zero, relative to the largest of its column
_POLISH = 6  # largest number of Newton steps after Lemke's method
_POLISHED = 1e-3  # target measure of these steps, relative to the tolerance
_ROUND_OFF = 1e-12  # relative violation of the law that needs no Newton step
_LARGEST_VIOLATION = 1e-7  # relative violation above which an answer is rejected


class RayTermination(ArithmeticError):
    """Error raised if Lemke's method ends in a ray, after too many pivots, or by round-off."""


@dataclass(frozen=True)
class Lemke(Algorithm):
    """Lemke's method; it counts as one iteration, and the number of pivots is reported.

    Attributes:
        max_iterations: largest number of pivots, divided by the number of unknowns of the
            complementarity problem.
        facets: number of corners of the polygon that replaces the friction disc in 3D.
    """

    name: ClassVar[str] = "lemke"
    max_iterations: int = 50
    facets: int = 8

    def __post_init__(self) -> None:
        super().__post_init__()
        count(self.facets, "facets", least=3)

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        iteration.stops(contact.displacements(r), r, pivots=0)
        try:
            r, pivots = _by_lemke(contact, self.facets, self.max_iterations)
        except RayTermination as error:
            iteration.fails(str(error))
            return
        a = contact.displacements(r)
        if contact.dim == 2:
            enough = _POLISHED * iteration.tolerance
            a, r = _polished(contact, r, lambda a, r: iteration.measure(a, r).worst, enough)
        iteration.stops(a, r, pivots=pivots)
        if iteration.outcome.converged:
            return
        worst = f"{iteration.outcome.measures[-1].worst:.1e}"
        if contact.dim == 2:
            iteration.fails(f"round-off: the law is violated by {worst}")
        else:
            iteration.fails(
                f"the solution of a polygon of {self.facets} facets: off the disc by {worst}"
            )


def coulomb_by_lemke(
    S: Array, p: Array, friction: Array, *, bound: Array | None = None
) -> tuple[Array, int]:
    """Return a solution of S a = r + p with Coulomb friction in 2D.

    Displacements a = (ut, un) and forces r = (rt, rn) exist for every friction coefficient; the
    module contains a proof.

    Args:
        S: positive definite reduced stiffness, ordered (ut, un) point by point, shape (2 m, 2 m).
        p: reduced load, shape (2 m,).
        friction: friction coefficients F >= 0, shape (m,).
        bound: prescribed friction bounds g >= 0, forces that are added to F rn, shape (m,);
            default zero.

    Returns:
        State (ut, un, rt, rn) of every point, shape (m, 4), and the number of pivots.

    Raises:
        ValueError: for invalid arguments of `PointProblem`, and for a problem in 3D.
        RayTermination: if round-off spoils the result, which occurs for condition numbers of S
            above about 1e8.
    """
    given = PointProblem(S, p, friction, bound)  # type: ignore[arg-type]
    if given.dim != 2:
        raise ValueError("friction in 3D is a complementarity problem only with a friction polygon")
    contact, stiffness, length = given.scaled()
    r, pivots = _by_lemke(contact, 2)

    def measure(a: Array, r: Array) -> float:
        ut, un = a.T
        rt, rn = r.T
        return violation(ut, un, rt, rn, contact.friction, contact.bound)

    a, r = _polished(contact, r, measure, _ROUND_OFF)
    worst = measure(a, r)
    if not worst < _LARGEST_VIOLATION:
        raise RayTermination(f"round-off: the law is violated by {worst:.1e} of the load")
    return np.column_stack([a * length, r * stiffness * length]), pivots


def _polished(
    contact: PointProblem, r: Array, measure: Callable[[Array, Array], float], enough: float
) -> tuple[Array, Array]:
    """Remove the round-off of Lemke's pivots from contact forces by Newton steps.

    Displacements and forces computed from the compliance and the tableau have errors of round-off
    times their condition number, but their statuses are correct. Newton's method solves equilibrium
    again with these statuses, using the stiffness itself.

    Args:
        contact: reduced problem in 2D.
        r: contact forces from Lemke's method, shape (m, 2).
        measure: function of displacements and forces returning the violation of the laws.
        enough: violation at which no further step is taken.

    Returns:
        Displacements and forces with the smallest violation, shape (m, 2) each.
    """
    a = contact.displacements(r)
    best = (a, r)
    least = measure(a, r)
    for _ in range(_POLISH):
        if least <= enough:
            break
        try:
            a, r = newton_step(contact, a, r)
        except np.linalg.LinAlgError:  # the statuses do not determine the state
            break
        worst = measure(a, r)
        if worst < least:
            best = (a, r)
            least = worst
    return best


def _by_lemke(contact: PointProblem, facets: int, most: int | None = None) -> tuple[Array, int]:
    """Solve a reduced problem by Lemke's method, in 3D with a friction polygon.

    Args:
        contact: reduced problem.
        facets: number of directions of friction in 3D.
        most: largest number of pivots, divided by the number of unknowns; by default as in `lemke`.

    Returns:
        Contact forces, shape (m, dim), and the number of pivots.
    """
    problem, stiffness, length = contact.scaled()
    data = problem.A, problem.free, problem.friction, problem.bound
    r, pivots = forces_by_lemke(*data, tangents(problem.dim, facets), most)
    return r * stiffness * length, pivots


def forces_by_lemke(
    A: Array, free: Array, friction: Array, bound: Array, directions: Array, most: int | None = None
) -> tuple[Array, int]:
    """Solve a reduced contact problem by Lemke's method; return its forces.

    Args:
        A: compliance, shape (dim m, dim m).
        free: displacements without contact forces, shape (m, dim).
        friction: friction coefficients, shape (m,).
        bound: prescribed friction bounds, shape (m,).
        directions: unit directions of friction, shape (k, dim - 1).
        most: largest number of pivots, divided by the number of unknowns; by default as in `lemke`.

    Returns:
        Contact forces, shape (m, dim), and the number of pivots.
    """
    M, q = copositive_form(A, free, friction, bound, directions)
    z, pivots = lemke(M, q, max_pivots=None if most is None else most * len(q))
    m = len(free)
    return np.column_stack([z[m:-m].reshape(m, -1) @ directions, z[:m]]), pivots


def lemke(M: Array, q: Array, *, max_pivots: int | None = None) -> tuple[Array, int]:
    """Solve z >= 0, q + M z >= 0, z.(q + M z) = 0 by Lemke's lexicographic method.

    Args:
        M: square matrix, shape (n, n).
        q: right-hand side, shape (n,).
        max_pivots: maximum number of pivots; by default 50 n + 100.

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
    raise RayTermination(f"Lemke's method took more than {pivots} pivots")


class _Tableau:
    """Lemke's tableau of w - M z - z_0 (1, ..., 1) = q, solved for the basic variables.

    The n variables w have the numbers 0 to n - 1, the n variables z the numbers n to 2 n - 1, and
    the artificial variable z_0 has the number 2 n.
    """

    def __init__(self, M: Array, q: Array):
        self.n = len(q)
        self.artificial = 2 * len(q)
        self._q = q
        #: Columns of all variables, [I, -M, -d] with d = 1.
        self._columns = np.hstack([np.eye(self.n), -M, -np.ones((self.n, 1))])
        #: In Fortran order, so that BLAS updates it in place.
        self.table: Array = np.asfortranarray(self._columns[:, self.n :])
        self.values = q.copy()
        self.basic = np.arange(self.n)
        self.nonbasic = np.arange(self.n, 2 * self.n + 1)
        self._since = 0  # pivots since the table was made from the data

    def first(self) -> int:
        """Let the artificial variable enter the basis and return the variable leaving it."""
        least = self.values.min()
        tied = np.flatnonzero(self.values <= least + _TIE * np.abs(self._q).max())
        return self._pivot(int(tied[-1]), self.n)  # the lexicographically least of them

    def enter(self, variable: int) -> int:
        """Let a variable enter the basis and return the variable leaving it."""
        column = int(np.flatnonzero(self.nonbasic == variable)[0])
        return self._pivot(self._row(column), column)

    def covers(self) -> bool:
        """Return True if the artificial variable z_0 is positive beyond round-off.

        The basis is then not a solution. In a tie, round-off may keep a zero z_0 in the basis.
        """
        self._refresh()
        known = np.abs(self.values).max(initial=np.abs(self._q).max())
        held = self.values[self.basic == self.artificial]
        return bool((held > _NOTHING * known).any())

    def _row(self, column: int) -> int:
        """Return the pivot row of an entering column by the lexicographic ratio test."""
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

    def _inverse(self, rows: Ints, w: int) -> Array:
        """Return entries of the inverse basis matrix in the column of the variable ``w``."""
        places = np.flatnonzero(self.nonbasic == w)
        if len(places):
            return np.asarray(self.table[rows, places[0]])
        return (self.basic[rows] == w).astype(float)

    def _pivot(self, row: int, column: int) -> int:
        """Exchange a basic and a nonbasic variable; return the variable leaving the basis."""
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

    def _refresh(self) -> None:
        """Recompute the tableau from the original data to remove the round-off of the pivots."""
        right = np.column_stack([self._columns[:, self.nonbasic], self._q])
        solved = np.linalg.solve(self._columns[:, self.basic], right)
        self.table = np.asfortranarray(solved[:, :-1], dtype=np.float64)
        self.values = np.asarray(solved[:, -1], dtype=np.float64).copy()
        self._since = 0

    def solution(self) -> Array:
        """Return the unknowns z at the current basis, computed from the original data."""
        values = np.linalg.solve(self._columns[:, self.basic], self._q)
        z = np.zeros(self.n)
        inside = (self.basic >= self.n) & (self.basic < 2 * self.n)
        z[self.basic[inside] - self.n] = np.maximum(values[inside], 0.0)
        return z


def tangents(dim: int, facets: int, turn: float = 0.0) -> Array:
    """Return unit directions of friction: +-1 in 2D, ``facets`` equally spaced ones in 3D.

    Args:
        dim: 2 or 3.
        facets: number k of directions in 3D.
        turn: angle of the first direction in 3D, radians; default 0.

    Returns:
        Directions, shape (k, dim - 1).
    """
    if dim == 2:
        return np.array([[1.0], [-1.0]])
    angles = 2 * np.pi * np.arange(facets) / facets + turn
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def copositive_form(
    A: Array, free: Array, friction: Array, bound: Array, directions: Array
) -> tuple[Array, Array]:
    """Return M and q of the complementarity problem 0 <= z, 0 <= q + M z of the module.

    The unknowns z are normal forces, friction forces in the k directions point by point, and
    magnitudes of slips.

    Args:
        A: compliance, shape (dim m, dim m).
        free: displacements without contact forces, shape (m, dim).
        friction: friction coefficients, shape (m,).
        bound: prescribed friction bounds, shape (m,).
        directions: unit directions of friction, shape (k, dim - 1).
    """
    m, d = free.shape
    k = len(directions)
    A = A.reshape(m, d, m, d)
    ant = np.einsum("iap,jp->iaj", A[:, -1, :, :-1], directions).reshape(m, m * k)
    att = np.einsum("jp,ipaq,lq->ijal", directions, A[:, :-1, :, :-1], directions)
    ones = np.kron(np.eye(m), np.ones((k, 1)))
    none = np.zeros((m, m))
    M = np.block(
        [
            [A[:, -1, :, -1], ant, none],
            [ant.T, att.reshape(m * k, m * k), ones],
            [np.diag(friction), -ones.T, none],
        ]
    )
    return M, np.concatenate([free[:, -1], (free[:, :-1] @ directions.T).reshape(-1), bound])
