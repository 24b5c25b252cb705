# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The static bound of shakedown: the largest load cycle that a residual slip can bear at rest.

Loads p_k(f) = p_s + f (p_k - p_s) at the corners k of a cycle, f their factor. In a state at rest
some points are closed (un = 0) with slips w that do not change, the others open (no force); then
all displacements and forces are affine in (w, f), and

    |rt| <= F rn + g,  rn >= 0  at closed points,    un >= 0  at open ones,    at every corner k

is a linear program in the plane, for each set of open points. Between corners it holds as well, all
of it being convex; so do the factors of one set, which are an interval, though not always from 0:
points that the steady load opens may be closed at large factors. In space the discs are cones of
second order: tangents of the discs, one more where a force has left a disc, bound f from outside;
polygons inside the discs, with corners where the forces of the extreme states are, from inside.
Points without friction slide freely: what they do is elastic.
"""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog

from dolfinx_contact.algorithms.point_problem import PointProblem

__all__ = ["StaticBound", "StaticState", "largest_factor", "states_at_rest"]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

_SIDES = 8  # of the first polygons in space
_ROUNDS = 60  # of tangents
_OUTSIDE = 1e-9  # of the unit of force, by which a force may leave its disc
_ACTIVE = 1e-7  # of the units, inequalities that hold as equations
_ROUND_OFF = 1e-13  # of the largest load, by which loads differ that are one
_FAR = 1e6  # of the units, a factor where it cannot be told whether anything bounds it
_INSIDE = 1e-3  # of the size of an inequality, by which a ray is inside of it
_BETTER = 1e-9  # relative, by which another set of open points is better
_MEET = 1e-8  # relative and of the units, by which ranges of factors are apart that meet
_FARTHEST = 10.0  # of the length that a load causes, slips of starts
_ALL_SETS = 8  # points up to which all sets of open ones are tried
_EXACT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


@dataclass(frozen=True, eq=False)
class StaticState:
    """The best state at rest with some open points.

    Attributes:
        least: the smallest factor that has such a state; infinite if none has.
        lower: the largest that was found; infinite if all from `least` on have, -inf if none has.
        upper: no larger factor has; lower but for round-off in the plane.
        slip: w of all points (m, dim - 1), those of points without friction or contact 0.
        displacements: at the corners (K, m, dim), at `lower`.
        forces: the same.
    """

    least: float
    lower: float
    upper: float
    slip: Array
    displacements: Array
    forces: Array


@dataclass(frozen=True, eq=False)
class StaticBound:
    """The best state over sets of open points.

    Attributes:
        state: that state.
        ranges: factors that have a state at rest, from and to, by size.
        opened: its open points (m,).
        complete: whether all sets of open points were tried.
        sets: how many were.
    """

    state: StaticState
    ranges: tuple[tuple[float, float], ...]
    opened: Flags
    complete: bool
    sets: int


class _AtRest:
    """Displacements and forces at rest by x = (w, f), over units of length and force.

    Args:
        points: stiffness and laws.
        loads: of the corners (K, dim m), over a unit of force, as their departures.
        steady: the load from which they depart (dim m,).
        departures: p_k - p_s (K, dim m).
        opened: open points (m,).

    Attributes:
        columns: numbers of slips.
        a, r: linear parts (K, dim m, columns + 1).
        a0, r0: constant parts (dim m,).
    """

    def __init__(self, points: PointProblem, steady: Array, departures: Array, opened: Flags):
        m, dim = points.number, points.dim
        grips = _grips(points, opened)
        slips = np.zeros((m, dim), dtype=bool)
        slips[grips, :-1] = True
        held = slips.copy()
        held[~opened, -1] = True
        self.places = np.flatnonzero(slips.reshape(-1))
        self.columns = len(self.places)
        free = ~held.reshape(-1)
        S = points.S
        given = np.zeros((dim * m, self.columns))
        given[self.places, np.arange(self.columns)] = 1.0
        loads = np.vstack([departures, steady]).T
        follow = np.zeros((dim * m, self.columns + loads.shape[1]))
        if free.any():
            right = np.hstack([-S[np.ix_(free, self.places)], loads[free]])
            follow[free] = np.linalg.solve(S[np.ix_(free, free)], right)
        by_slip = given + follow[:, : self.columns]
        by_load = follow[:, self.columns :]
        left = S @ by_load - loads
        left[free] = 0.0
        rubs = S @ by_slip
        rubs[free] = 0.0
        K = len(departures)
        self.a = np.stack([np.column_stack([by_slip, by_load[:, k]]) for k in range(K)])
        self.r = np.stack([np.column_stack([rubs, left[:, k]]) for k in range(K)])
        self.a0, self.r0 = by_load[:, -1], left[:, -1]

    def states(self, x: Array) -> tuple[Array, Array]:
        """Displacements and forces at the corners, (K, dim m) each."""
        return self.a @ x + self.a0, self.r @ x + self.r0


@dataclass(frozen=True, eq=False)
class _Rows:
    """Inequalities rows x <= most."""

    rows: Array
    most: Array

    def __add__(self, other: _Rows) -> _Rows:
        rows = np.vstack([self.rows, other.rows])
        return _Rows(rows, np.concatenate([self.most, other.most]))


class _Program:
    """The programs of one set of open points."""

    def __init__(self, points: PointProblem, steady: Array, departures: Array, opened: Flags):
        self.points = points
        self.opened = opened
        self.rest = _AtRest(points, steady, departures, opened)
        self._shape = len(departures), points.number, points.dim
        self.grips = _grips(points, opened)

    def solve(self) -> StaticState:
        """The smallest and the largest factor, this from both sides."""
        n = self.rest.columns
        if self.points.dim == 2:
            rows = self._signs() + self._tangents(np.array([[1.0], [-1.0]]))
            x, value = _optimum(rows, n)
            upper = np.inf if value >= _FAR else value
            return self._state(x, _optimum(rows, n, sense=-1)[1], value, upper)
        most, upper = self._by_tangents(1)
        upper = np.inf if upper >= _FAR else upper
        if most is None:
            return self._state(None, np.inf, -np.inf, -np.inf)
        first = self._by_tangents(-1)[0]
        extreme = [self._forces(most, ray=upper == np.inf)]
        extreme += [] if first is None else [self._forces(first)]
        inside = self._inside(extreme)
        x, lower = _optimum(inside[0], n, *inside[1:])
        return self._state(x, _optimum(inside[0], n, *inside[1:], sense=-1)[1], lower, upper)

    def _state(self, x: Array | None, least: float, lower: float, upper: float) -> StaticState:
        K, m, dim = self._shape
        least = 0.0 if least <= _BETTER else least
        if x is None or lower == np.inf:
            none = np.zeros((K, m, dim))
            return StaticState(least, lower, upper, none[0, :, :-1], none, none)
        x = x[: self.rest.columns + 1]
        a, r = self.rest.states(x)
        slip = np.zeros(m * dim)
        slip[self.rest.places] = x[:-1]
        tangents: Array = slip.reshape(m, dim)[:, :-1]
        states = a.reshape(K, m, dim), r.reshape(K, m, dim)
        return StaticState(least, lower, upper, tangents, *states)

    def _forces(self, x: Array, *, ray: bool = False) -> Array:
        """At the corners (K, m, dim); of a ray their rates along it."""
        forces = self.rest.r @ x if ray else self.rest.states(x)[1]
        return np.asarray(forces.reshape(self._shape))

    def _parts(self) -> tuple[Array, Array]:
        """Linear parts of forces (K, m, dim, n) and constant ones (m, dim)."""
        K, m, dim = self._shape
        return self.rest.r.reshape(K, m, dim, -1), self.rest.r0.reshape(m, dim)

    def _signs(self) -> _Rows:
        """Of normal forces of closed points, and gaps of open ones: rn >= 0, un >= 0."""
        K, m, dim = self._shape
        r, r0 = self._parts()
        a = self.rest.a.reshape(K, m, dim, -1)[:, self.opened, -1]
        r = r[:, ~self.opened, -1]
        n = r.shape[-1]
        gaps = np.tile(self.rest.a0.reshape(m, dim)[self.opened, -1], K)
        pushes = np.tile(r0[~self.opened, -1], K)
        rows = np.vstack([-r.reshape(-1, n), -a.reshape(-1, n)])
        return _Rows(rows, np.concatenate([pushes, gaps]))

    def _tangents(self, directions: Array) -> _Rows:
        """e.rt <= F rn + g for directions e, at all corners and points."""
        every = [(k, i) for k in range(self._shape[0]) for i in np.flatnonzero(self.grips)]
        return _joined([self._tangent(k, i, e) for k, i in every for e in directions], self.rest)

    def _tangent(self, k: int, i: int, e: Array) -> tuple[Array, float]:
        r, r0 = self._parts()
        F, g = self.points.friction[i], self.points.bound[i]
        row = e @ r[k, i, :-1] - F * r[k, i, -1]
        return row, float(F * r0[i, -1] + g - e @ r0[i, :-1])

    def extreme(self, toward: Array, farthest: float) -> tuple[Array, Array] | None:
        """Displacements and forces (m, dim) at the first corner, slips far in a direction.

        Args:
            toward: direction (dim m,).
            farthest: bound of slips.
        """
        directions = np.array([[1.0], [-1.0]]) if self.points.dim == 2 else _circle(_SIDES)
        rows = self._signs() + self._tangents(directions)
        inside = np.cos(np.pi / _SIDES) if self.points.dim == 3 else 1.0
        n = self.rest.columns
        # Inside of the discs: tangents of discs that are less by that.
        most = np.where(rows.most > 0, inside * rows.most, rows.most)
        cost = np.append(-toward[self.rest.places], 0.0)
        bounds = [(-farthest, farthest)] * n + [(0.0, 0.0)]
        found = linprog(cost, rows.rows, most, bounds=bounds, method="highs", options=_EXACT)
        if found.status != 0:
            return None
        a, r = self.rest.states(found.x)
        return a[0].reshape(-1, self.points.dim), r[0].reshape(-1, self.points.dim)

    def _by_tangents(self, sense: int) -> tuple[Array | None, float]:
        """From outside: tangents of the discs where forces have left them, until none has.

        Where nothing bounds the factor the forces are those along the ray, whose discs are F rn.
        """
        rows = self._signs() + self._tangents(_circle(_SIDES))
        for _ in range(_ROUNDS):
            x, value = _optimum(rows, self.rest.columns, sense=sense)
            if x is None:
                return None, value
            outside = self._outside(x, ray=value == np.inf)
            if not outside:
                break
            rows = rows + _joined([self._tangent(*place) for place in outside], self.rest)
        return x, value

    def _outside(self, x: Array, *, ray: bool) -> list[tuple[int, int, Array]]:
        r = self._forces(x, ray=ray)
        size = np.linalg.norm(r[:, :, :-1], axis=2)
        bound = 0.0 if ray else self.points.bound
        over = size - self.points.friction * r[:, :, -1] - bound
        largest = float(np.abs(r).max())
        least = _OUTSIDE * (largest if ray else max(1.0, largest))
        far = np.argwhere((over > least) & self.grips)
        return [(int(k), int(i), r[k, i, :-1] / size[k, i]) for k, i in far]

    def _inside(self, extreme: list[Array]) -> tuple[_Rows, Array, Array]:
        """Forces inside polygons: inequalities, then the matrix and the values of equations.

        Args:
            extreme: forces (K, m, dim), in whose directions the polygons have corners.
        """
        n = self.rest.columns + 1
        r, r0 = self._parts()
        cells = [(k, i) for k in range(self._shape[0]) for i in np.flatnonzero(self.grips)]
        sides = _SIDES + len(extreme)
        equal = np.zeros((2 * len(cells), n + sides * len(cells)))
        value = np.zeros(2 * len(cells))
        most = np.zeros((len(cells), equal.shape[1]))
        limit = np.zeros(len(cells))
        for c, (k, i) in enumerate(cells):
            own = n + sides * c + np.arange(sides)
            corners = np.vstack([_circle(_SIDES), *(_unit(there[k, i, :-1]) for there in extreme)])
            equal[2 * c : 2 * c + 2, :n] = r[k, i, :-1]
            equal[2 * c : 2 * c + 2, own] = -corners.T
            value[2 * c : 2 * c + 2] = -r0[i, :-1]
            most[c, own] = 1.0
            most[c, :n] = -self.points.friction[i] * r[k, i, -1]
            limit[c] = self.points.friction[i] * r0[i, -1] + self.points.bound[i]
        signs = self._signs()
        padded = np.hstack([signs.rows, np.zeros((len(signs.rows), sides * len(cells)))])
        rows = _Rows(np.vstack([padded, most]), np.concatenate([signs.most, limit]))
        return rows, equal, value


def _grips(points: PointProblem, opened: Flags) -> Flags:
    """Points whose slips friction can hold."""
    return np.asarray((~opened & (points.friction > 0)) | (points.bound > 0))


def _joined(pairs: list[tuple[Array, float]], rest: _AtRest) -> _Rows:
    if not pairs:
        return _Rows(np.zeros((0, rest.columns + 1)), np.zeros(0))
    rows, most = zip(*pairs, strict=True)
    return _Rows(np.array(rows), np.array(most))


def _circle(sides: int) -> Array:
    angles = 2 * np.pi * np.arange(sides) / sides
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _unit(v: Array) -> Array:
    size = float(np.linalg.norm(v))
    unit = v / size if size > 0 else np.eye(len(v))[0]
    return np.asarray(unit, dtype=np.float64)


def _optimum(
    rows: _Rows,
    factor: int,
    equal: Array | None = None,
    value: Array | None = None,
    *,
    sense: int = 1,
) -> tuple[Array | None, float]:
    """The point at which the unknown ``factor`` is largest, or smallest (-1), and its value.

    A ray and inf where nothing bounds it; None where there is no point, and -inf or inf.
    Unknowns before it are free, it and those behind it are not negative.
    """
    n = rows.rows.shape[1]
    cost = np.zeros(n)
    cost[factor] = -float(sense)
    free: list[tuple[float | None, float | None]] = [(None, None)] * factor
    bounds = free + [(0.0, None)] * (n - factor)
    size = np.maximum(np.abs(rows.rows).max(axis=1, initial=0.0), 1e-300)
    kept = np.where(size > 1e-14, size, 1.0)
    A, b = rows.rows / kept[:, None], rows.most / kept
    found = linprog(cost, A, b, equal, value, bounds=bounds, method="highs", options=_EXACT)
    if found.status == 0:
        return found.x, max(float(found.x[factor]), 0.0)
    # HiGHS may say of what is unbounded that there is nothing, or cannot say.
    still = linprog(np.zeros(n), A, b, equal, value, bounds=bounds, method="highs", options=_EXACT)
    if still.status == 2:
        return None, -np.inf * sense
    ray = _ray(A, bounds, factor, equal) if still.status == 0 and sense == 1 else None
    if ray is not None:
        return ray, np.inf
    bounds[factor] = (0.0, _FAR)
    found = linprog(cost, A, b, equal, value, bounds=bounds, method="highs", options=_EXACT)
    if found.status == 0:
        return found.x, max(float(found.x[factor]), 0.0)
    raise ArithmeticError(f"the linear program of the static bound: {found.message}")


def _ray(
    A: Array, bounds: list[tuple[float | None, float | None]], factor: int, equal: Array | None
) -> Array | None:
    """A ray along which the factor grows, inside of the inequalities A x <= 0 that allow it."""
    rows, n = A.shape
    cost = np.append(np.zeros(n), -np.ones(rows))
    slack = np.hstack([A, np.eye(rows)])
    fixed = [*bounds[:factor], (1.0, 1.0), *bounds[factor + 1 :], *[(0.0, _INSIDE)] * rows]
    same = None if equal is None else np.hstack([equal, np.zeros((len(equal), rows))])
    none = None if equal is None else np.zeros(len(equal))
    zero = np.zeros(rows)
    found = linprog(cost, slack, zero, same, none, fixed, method="highs", options=_EXACT)
    return found.x[:n] if found.status == 0 else None


def largest_factor(
    points: PointProblem, steady: Array, corners: Array, begin: Flags, end: float
) -> StaticBound:
    """The static bound over sets of open points.

    All of them are tried where there are up to 8 points. Else those near the best: from no open
    point, and from ``begin``, one point is changed at a time while that raises the factor.

    Args:
        points: stiffness and laws; its load does not matter.
        steady: the load from which the corners depart (dim m,).
        corners: loads of the corners (K, dim m).
        begin: open points of a state (m,).
        end: by `time.monotonic` the latest end of the search.
    """
    unit = float(np.diag(points.S).mean())
    apart = corners - steady
    given = max(float(np.abs(steady).max()), float(np.abs(corners).max()))
    force = max(float(np.abs(steady).max()), float(points.bound.max())) or float(
        np.abs(apart).max()
    )
    size = float(np.abs(apart).max())
    if size <= _ROUND_OFF * given:
        raise ValueError("the loads do not differ from the steady one: there is no cycle")
    scaled, load = _scaled(points, steady, unit, force)
    search = _Search(scaled, load, np.asarray(apart / size, dtype=np.float64), end)
    search.run(begin)
    s = search.best
    length, share = force / unit, force / size
    state = StaticState(
        s.least * share,
        s.lower * share,
        s.upper * share,
        s.slip * length,
        s.displacements * length,
        s.forces * force,
    )
    ranges = tuple((a * share, b * share) for a, b in search.ranges())
    return StaticBound(state, ranges, search.opened, search.complete, len(search.known))


def states_at_rest(
    points: PointProblem, load: Array, opened: Flags, number: int
) -> list[tuple[Array, Array]]:
    """States that are at rest under a load, with slips far in random directions.

    Args:
        points: stiffness and laws.
        load: p (dim m,).
        opened: open points (m,).
        number: of directions.

    Returns:
        Displacements and forces, (m, dim) each; fewer where there are none.
    """
    rng = np.random.default_rng(0)
    unit = float(np.diag(points.S).mean())
    force = float(np.abs(load).max()) or 1.0
    scaled, p = _scaled(points, load, unit, force)
    program = _Program(scaled, p, np.zeros((1, len(load))), opened)
    length = float(np.abs(np.linalg.solve(scaled.S, p)).max())
    tried = [program.extreme(rng.normal(size=len(load)), _FARTHEST * length) for _ in range(number)]
    found = [state for state in tried if state is not None]
    length_unit = force / unit
    return [(np.asarray(length_unit * a), np.asarray(force * r)) for a, r in found]


def _scaled(
    points: PointProblem, load: Array, unit: float, force: float
) -> tuple[PointProblem, Array]:
    """Points and a load over units of stiffness and force."""
    S, p, bound = (
        np.asarray(v, dtype=np.float64)
        for v in (points.S / unit, load / force, points.bound / force)
    )
    return PointProblem(S, p, points.friction, bound), p


class _Search:
    """Sets of open points, the best first known."""

    def __init__(self, points: PointProblem, steady: Array, apart: Array, end: float):
        self._given = points, steady, apart
        self._end = end
        self.known: dict[bytes, StaticState] = {}
        self.opened: Flags = np.zeros(points.number, dtype=bool)
        self.best = self._of(self.opened)
        self.complete = False

    def _of(self, opened: Flags) -> StaticState:
        key = opened.tobytes()
        if key not in self.known:
            self.known[key] = _Program(*self._given, opened).solve()
        return self.known[key]

    def _try(self, opened: Flags) -> bool:
        """Whether a set is better; it is then the best."""
        state = self._of(opened)
        least = self.best.lower
        if not state.lower > least + _BETTER * abs(least if np.isfinite(least) else 0.0):
            return False
        self.best, self.opened = state, opened
        return True

    def run(self, begin: Flags) -> None:
        """Until nothing is better, all are tried, or time is over."""
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
                opened = self.opened.copy()
                opened[i] = not opened[i]
                improved |= self._try(opened)

    def ranges(self) -> list[tuple[float, float]]:
        """Factors of all sets that were tried, joined where they meet."""
        joined: list[tuple[float, float]] = []
        for a, b in sorted((s.least, s.lower) for s in self.known.values() if s.least <= s.lower):
            if joined and a <= joined[-1][1] * (1 + _MEET) + _MEET:
                joined[-1] = joined[-1][0], max(b, joined[-1][1])
            else:
                joined.append((a, b))
        return joined
