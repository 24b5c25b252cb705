# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Static bound of shakedown: the largest load cycle with a state at rest.

The loads are p_k(f) = p_s + f (p_k - p_s) at the corners k of a cycle, with the load factor f. In a
state at rest some points are closed (un = 0) with constant slips w, and the remaining points are
open (no force). Closed points have the friction coefficient F and the bound g. All displacements
and forces are affine in x = (w, f), and

    |rt| <= F rn + g,  rn >= 0  at closed points,    un >= 0  at open ones,    at every corner k

is a linear program in the plane, for each set of open points. By convexity the inequalities also
hold between the corners. The factors of one set form an interval, which need not begin at 0: points
opened by the steady load may be closed at large factors.

In space the friction discs are second-order cones. Tangents of the discs bound f from above; a
tangent is added where a force lies outside its disc. Polygons inside the discs, with corners at the
forces of the extreme states, bound f from below. Points without friction slide freely; their motion
is elastic. The programs of different sets of open points have different matrices, so that warm
starts would not help; HiGHS solves each program from scratch.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag
from scipy.optimize import OptimizeResult, linprog

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact.algorithms.lemke import tangents
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["Ranges", "StaticState", "largest_factor", "states_at_rest"]

#: Intervals (from, to) of factors with a state at rest.
Ranges = tuple[tuple[float, float], ...]
#: Inequalities A x <= b, or equations A x = b.
Rows = tuple[Array, Array]
#: Lower and upper bound of each unknown; None if it is unbounded.
_Bounds = Sequence[tuple[float | None, float | None]]

_SIDES = 8  # number of sides of the first polygons in space
_ROUNDS = 60  # rounds of tangents
_OUTSIDE = 1e-9  # distance of a force from its disc that counts as outside, in units of force
_ROUND_OFF = 1e-13  # relative difference of equal loads
_FAR = 1e6  # factor that counts as unbounded
_INSIDE = 1e-3  # distance of a ray from an inequality, relative to its size
_BETTER = 1e-9  # relative gain of a better set of open points
_MEET = 1e-8  # relative distance of ranges of factors that meet
_FARTHEST = 10.0  # largest slip of a start, relative to the displacement caused by the load
_ALL_SETS = 8  # points up to which all sets of open points are tried
_EXACT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


@dataclass(frozen=True, eq=False)
class StaticState:
    """State at rest for one set of open points at the largest load factor.

    Attributes:
        least: smallest load factor with a state at rest; infinite if none exists.
        lower: largest load factor found with a state at rest; infinite if all factors above `least`
            have one, -inf if no factor has one.
        upper: upper bound of these factors; equal to `lower` in the plane, up to round-off.
        slip: constant slips of all points, shape (m, dim - 1); 0 at open points and at points
            without friction.
        displacements: displacements at the K corners with the factor `lower`, shape (K, m, dim).
        forces: forces at the K corners with the factor `lower`, shape (K, m, dim).
        opened: mask of the open points, shape (m,).
    """

    least: float
    lower: float
    upper: float
    slip: Array
    displacements: Array
    forces: Array
    opened: Mask


class _Program:
    """Linear programs of one set of open points, in units of length and force.

    Args:
        points: contact points with their stiffness and laws.
        steady: steady load, shape (dim m,).
        departures: departures p_k - p_s of the K corners of the load cycle, shape (K, dim m).
        opened: mask of the open points, shape (m,).

    Attributes:
        a, r: derivatives of displacements and forces at the K corners of the cycle with respect to
            x, the vector of the n slips and the load factor, shape (K, m, dim, n + 1).
        a0, r0: displacements and forces at x = 0, shape (m, dim).
        n: number of slips.
        around: directions in which the shear is initially bounded by F rn + g, exact in the plane
            and tangents of the discs in space.
    """

    def __init__(self, points: PointProblem, steady: Array, departures: Array, opened: Mask):
        m, dim, S = points.number, points.dim, points.S
        self.points = points
        self.opened = opened
        self.around = tangents(dim, _SIDES)
        #: Points whose slips friction can hold.
        self.grips = np.asarray((~opened & (points.friction > 0)) | (points.bound > 0))
        slips = np.zeros((m, dim), dtype=bool)
        slips[self.grips, :-1] = True
        held = slips.copy()
        held[~opened, -1] = True
        free = ~held.reshape(-1)
        self.places = np.flatnonzero(slips.reshape(-1))
        self.n = n = len(self.places)
        # Responses of the free components to unit slips and to the loads.
        loads = np.vstack([departures, steady]).T
        a = np.zeros((dim * m, n + loads.shape[1]))
        a[self.places, np.arange(n)] = 1.0
        if free.any():
            right = np.hstack([-S[np.ix_(free, self.places)], loads[free]])
            a[free] = np.linalg.solve(S[np.ix_(free, free)], right)
        r = S @ a
        r[:, n:] -= loads
        r[free] = 0.0
        corners = [[*range(n), n + k] for k in range(len(departures))]
        self.a, self.r = (
            np.stack([v[:, columns] for columns in corners]).reshape(-1, m, dim, n + 1)
            for v in (a, r)
        )
        self.a0, self.r0 = (v[:, -1].reshape(m, dim) for v in (a, r))

    def solve(self) -> StaticState:
        """Compute the smallest load factor with a state at rest, and bounds of the largest one."""
        if self.points.dim == 2 or not self.grips.any():
            rows = self._first_rows()
            x, lower = _optimum(rows, self.n)
            least = _optimum(rows, self.n, sense=-1)[1]
            upper = lower
        else:
            most, upper = self._by_tangents(1)
            if most is None:
                return self._state(None, np.inf, -np.inf, -np.inf)
            first, _ = self._by_tangents(-1)
            extreme = [self._forces(most, ray=upper == np.inf)]
            extreme += [] if first is None else [self._forces(first)]
            inside = self._inside(extreme)
            x, lower = _optimum(inside[0], self.n, inside[1])
            least = _optimum(inside[0], self.n, inside[1], sense=-1)[1]
        return self._state(x, least, lower, np.inf if upper >= _FAR else upper)

    def _state(self, x: Array | None, least: float, lower: float, upper: float) -> StaticState:
        least = 0.0 if least <= _BETTER else least
        slip = np.zeros_like(self.a0)
        displacements, forces = np.zeros((2, *self.a.shape[:3]))
        if x is not None and lower < np.inf:
            x = x[: self.n + 1]
            slip.reshape(-1)[self.places] = x[:-1]
            displacements, forces = self.a @ x + self.a0, self._forces(x)
        return StaticState(least, lower, upper, slip[:, :-1], displacements, forces, self.opened)

    def _forces(self, x: Array, *, ray: bool = False) -> Array:
        """Return the forces at the K corners, shape (K, m, dim); their rates if x is a ray."""
        return np.asarray(self.r @ x + (0.0 if ray else self.r0))

    def extreme(self, toward: Array, farthest: float) -> tuple[Array, Array] | None:
        """Return the state at rest with the largest slips, at the first corner of the load cycle.

        Args:
            toward: direction in which the slips are largest, shape (dim m,).
            farthest: upper bound of each slip.

        Returns:
            Displacements and forces, shape (m, dim) each; None if no state was found.
        """
        rows, most = self._first_rows()
        # In space, tangents of smaller discs bound polygons inside the discs.
        share = 1.0 if self.points.dim == 2 else np.cos(np.pi / _SIDES)
        most = np.where(most > 0, share * most, most)
        cost = np.append(-toward[self.places], 0.0)
        bounds: _Bounds = [(-farthest, farthest)] * self.n + [(0.0, 0.0)]
        found = _solved(cost, (rows, most), bounds)
        if found.status != 0:
            return None
        return self.a[0] @ found.x + self.a0, self.r[0] @ found.x + self.r0

    # -- inequalities -----------------------------------------------------------------------------

    def _signs(self) -> Rows:
        """Return the inequalities rn >= 0 at closed points and un >= 0 at open ones."""
        opened, K = self.opened, len(self.a)
        normal = np.concatenate([self.r[:, ~opened, -1], self.a[:, opened, -1]], axis=1)
        least = np.concatenate([self.r0[~opened, -1], self.a0[opened, -1]])
        return -normal.reshape(-1, self.n + 1), np.tile(least, K)

    def _tangents(self, k: npt.NDArray[np.intp], i: npt.NDArray[np.intp], e: Array) -> Rows:
        """Return inequalities that bound the shear in given directions by the friction bound.

        Args:
            k: index of the corner of the load cycle for each inequality, shape (number,).
            i: index of the point, shape (number,).
            e: direction in which the shear is bounded, shape (number, dim - 1).
        """
        F, g = self.points.friction[i], self.points.bound[i]
        r, r0 = self.r[k, i], self.r0[i]
        rows = np.einsum("jc,jcn->jn", e, r[:, :-1]) - F[:, None] * r[:, -1]
        return rows, F * r0[:, -1] + g - np.sum(e * r0[:, :-1], axis=1)

    def _cells(self) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """Return all pairs of a corner of the load cycle and a point with friction, as indices."""
        k, i = np.nonzero(np.broadcast_to(self.grips, self.a.shape[:2]))
        return k, i

    def _first_rows(self) -> Rows:
        k, i = (np.repeat(v, len(self.around)) for v in self._cells())
        e = np.tile(self.around, (len(k) // len(self.around), 1))
        return _joined(self._signs(), self._tangents(k, i, e))

    def _by_tangents(self, sense: int) -> tuple[Array | None, float]:
        """Bound the load factor by tangents of the friction discs, which are added iteratively.

        If it is unbounded, the rates of the forces must lie in discs without the prescribed bound.

        Args:
            sense: 1 for an upper bound of the largest factor, -1 for a lower bound of the smallest.

        Returns:
            Slips and load factor, None if no state exists, and the bound.
        """
        rows = self._first_rows()
        for _ in range(_ROUNDS):
            x, value = _optimum(rows, self.n, sense=sense)
            if x is None:
                return None, value
            ray = value == np.inf
            r = self._forces(x, ray=ray)
            size = np.linalg.norm(r[:, :, :-1], axis=2)
            over = size - self.points.friction * r[:, :, -1] - (0.0 if ray else self.points.bound)
            largest = float(np.abs(r).max())
            least = _OUTSIDE * (largest if ray else max(1.0, largest))
            k, i = np.nonzero((over > least) & self.grips)
            if not len(k):
                break
            rows = _joined(rows, self._tangents(k, i, r[k, i, :-1] / size[k, i, None]))
        return x, value

    def _inside(self, extreme: list[Array]) -> tuple[Rows, Rows]:
        """Return inequalities and equations for forces in polygons inside the friction discs.

        A shear is a combination of the corners of its polygon with weights whose sum is at most the
        friction bound. The weights are additional unknowns after the slips and the load factor.

        Args:
            extreme: forces whose directions become additional corners of the polygons, shape
                (K, m, dim) each.
        """
        k, i = self._cells()
        number, sides = len(k), _SIDES + len(extreme)
        corners = np.empty((number, sides, 2))
        corners[:, :_SIDES] = self.around
        for j, forces in enumerate(extreme, _SIDES):
            rt = forces[k, i, :-1]
            size = np.linalg.norm(rt, axis=1)[:, None]
            corners[:, j] = np.where(size > 0, rt / np.where(size > 0, size, 1.0), [1, 0])
        r, r0, F = self.r[k, i], self.r0[i], self.points.friction[i]
        equal = np.hstack(
            [r[:, :-1].reshape(2 * number, -1), -block_diag(*corners.transpose(0, 2, 1))]
        )
        sums = np.kron(np.eye(number), np.ones(sides))
        discs = np.hstack([-F[:, None] * r[:, -1], sums]), F * r0[:, -1] + self.points.bound[i]
        signs, least = self._signs()
        signs = np.pad(signs, ((0, 0), (0, number * sides)))
        return _joined((signs, least), discs), (equal, -r0[:, :-1].reshape(-1))


def _joined(a: Rows, b: Rows) -> Rows:
    return np.vstack([a[0], b[0]]), np.concatenate([a[1], b[1]])


# -- linear programs -------------------------------------------------------------------------------


def _solved(cost: Array, rows: Rows, bounds: _Bounds, equal: Rows | None = None) -> OptimizeResult:
    same = (None, None) if equal is None else equal
    return linprog(cost, *rows, *same, bounds, method="highs", options=_EXACT)


def _optimum(
    rows: Rows, factor: int, equal: Rows | None = None, *, sense: int = 1
) -> tuple[Array | None, float]:
    """Maximise (sense 1) or minimise (-1) the unknown with the index ``factor``.

    The unknowns before it are free; it and all following unknowns are nonnegative. It is bounded by
    1e6, because HiGHS may report an unbounded program as infeasible.

    Returns:
        Optimum and its value; a ray and inf if the factor is unbounded; None and -inf (maximum) or
        inf (minimum) if the inequalities have no solution.
    """
    n = rows[0].shape[1]
    size = np.maximum(np.abs(rows[0]).max(axis=1, initial=0.0), 1e-300)
    kept = np.where(size > 1e-14, size, 1.0)
    scaled = rows[0] / kept[:, None], rows[1] / kept
    free: _Bounds = [(None, None)] * factor
    after: _Bounds = [(0.0, None)] * (n - factor - 1)
    cost = -sense * np.eye(n)[factor]
    found = _solved(cost, scaled, [*free, (0.0, _FAR), *after], equal)
    if found.status == 2:
        return None, -np.inf * sense
    if found.status != 0:
        raise ArithmeticError(
            f"the linear program of the static bound was not solved: {found.message}"
        )
    value = max(float(found.x[factor]), 0.0)
    if value < _FAR:
        return found.x, value
    # A ray along which the factor grows, within A x <= 0 where possible.
    number = len(scaled[0])
    slack = np.hstack([scaled[0], np.eye(number)]), np.zeros(number)
    if equal is not None:
        equal = np.pad(equal[0], ((0, 0), (0, number))), np.zeros(len(equal[1]))
    inside: _Bounds = [(0.0, _INSIDE)] * number
    cost = np.append(np.zeros(n), -np.ones(number))
    ray = _solved(cost, slack, [*free, (1.0, 1.0), *after, *inside], equal)
    return (ray.x[:n], np.inf) if ray.status == 0 else (found.x, value)


# -- sets of open points ---------------------------------------------------------------------------


def largest_factor(
    points: PointProblem, steady: Array, corners: Array, begin: Mask, end: float
) -> tuple[StaticState, Ranges, bool]:
    """Return the static bound over all sets of open points.

    With up to 8 points all sets are tried. Otherwise the search starts from the empty set and from
    ``begin``, and changes one point at a time as long as the factor increases.

    Args:
        points: contact points with their stiffness and laws; the load is not used.
        steady: steady load, shape (dim m,).
        corners: loads at the K corners of the load cycle, shape (K, dim m).
        begin: open points of an initial state, shape (m,).
        end: value of `time.monotonic` at which the search ends.

    Returns:
        State with the largest factor, ranges of factors with a state at rest in increasing order,
        and whether all sets of open points were tried.

    Raises:
        ValueError: if all loads are equal to the steady load.
    """
    apart = corners - steady
    size = float(np.abs(apart).max())
    largest = float(np.abs(steady).max())
    if size <= _ROUND_OFF * max(largest, float(np.abs(corners).max())):
        raise ValueError("the loads do not differ from the steady one: there is no cycle")
    force = max(largest, float(points.bound.max())) or size
    scaled, length = _scaled(points, steady, force)
    search = _Search(scaled, np.asarray(apart / size, dtype=np.float64), end)
    search.run(begin)
    s = search.best
    share = force / size
    state = replace(
        s,
        least=s.least * share,
        lower=s.lower * share,
        upper=s.upper * share,
        slip=s.slip * length,
        displacements=s.displacements * length,
        forces=s.forces * force,
    )
    ranges = tuple((a * share, b * share) for a, b in search.ranges())
    return state, ranges, search.complete


def states_at_rest(
    points: PointProblem, load: Array, opened: Mask, number: int
) -> list[tuple[Array, Array]]:
    """Return states at rest under a load, with the largest slips in random directions.

    Args:
        points: contact points with their stiffness and laws.
        load: load p, shape (dim m,).
        opened: open points, shape (m,).
        number: number of directions.

    Returns:
        Displacements and forces, shape (m, dim) each; directions without a state are skipped.
    """
    rng = np.random.default_rng(0)
    force = float(np.abs(load).max()) or 1.0
    scaled, length = _scaled(points, load, force)
    program = _Program(scaled, scaled.p, np.zeros((1, len(load))), opened)
    far = _FARTHEST * float(np.abs(np.linalg.solve(scaled.S, scaled.p)).max())
    states = (program.extreme(rng.normal(size=len(load)), far) for _ in range(number))
    return [(length * a, force * r) for a, r in filter(None, states)]


def _scaled(points: PointProblem, load: Array, force: float) -> tuple[PointProblem, float]:
    """Scale points and load to unit force and mean stiffness; also return the unit of length."""
    unit = float(np.diag(points.S).mean())
    S, p, bound = (
        np.asarray(v, np.float64) for v in (points.S / unit, load / force, points.bound / force)
    )
    return PointProblem(S, p, points.friction, bound), force / unit


class _Search:
    """Search for the set of open points with the largest factor."""

    def __init__(self, points: PointProblem, apart: Array, end: float):
        self._points = points
        self._apart = apart
        self._end = end
        self._known: dict[bytes, StaticState] = {}
        self.best = self._of(np.zeros(points.number, dtype=bool))
        self.complete = False

    def _of(self, opened: Mask) -> StaticState:
        key = opened.tobytes()
        if key not in self._known:
            program = _Program(self._points, self._points.p, self._apart, opened)
            self._known[key] = program.solve()
        return self._known[key]

    def _try(self, opened: Mask) -> bool:
        """Compute the load factor of a set of open points; return whether it is a new maximum."""
        state = self._of(opened)
        least = self.best.lower
        if not state.lower > least + _BETTER * abs(least if np.isfinite(least) else 0.0):
            return False
        self.best = state
        return True

    def run(self, begin: Mask) -> None:
        """Search until no change increases the factor, all sets are tried, or the time is over."""
        self._try(begin)
        m = len(begin)
        if m <= _ALL_SETS:
            for flags in itertools.product([False, True], repeat=m):
                if time.monotonic() > self._end:
                    return
                self._try(np.array(flags))
            self.complete = True
            return
        improved = True
        while improved and self.best.lower < np.inf:
            improved = False
            for i in range(m):
                if time.monotonic() > self._end:
                    return
                improved |= self._try(self.best.opened ^ (np.arange(m) == i))

    def ranges(self) -> list[tuple[float, float]]:
        """Return the intervals of load factors with a state at rest that were found, merged."""
        joined: list[tuple[float, float]] = []
        for a, b in sorted((s.least, s.lower) for s in self._known.values() if s.least <= s.lower):
            if joined and a <= joined[-1][1] * (1 + _MEET) + _MEET:
                joined[-1] = joined[-1][0], max(b, joined[-1][1])
            else:
                joined.append((a, b))
        return joined
