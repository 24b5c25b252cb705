# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The smallest friction with which a body stays wedged without any load.

With the stiffness S of the contact points a body that was loaded and unloaded may keep forces: it
is *wedged* in a state (u, r) other than 0 with

    S u = r,    un >= 0, rn >= 0, un rn = 0,    |rt| <= F rn,

whatever the direction of rt, which what happened before decides (Kim, Jang and Barber, 2019). The
infimum of F over such states depends on the body and its contact surface alone. Everything is
homogeneous: sum rn = 1. With the flexibility G = S^-1 and the extreme forces of the cones (2D: (F,
1) and (-F, 1)) as rays, a state is given by weights alpha >= 0 of sum 1 with un = G_n r >= 0, and
at every point either alpha = 0 (open) or un = 0 (closed).

For one F this is a search in pairs of statuses. A region of them is empty if

    un_i / U_i + sum of alpha_i <= 1        (U_i: the largest un)

leaves nothing: a linear program, which differs from region to region in bounds alone (`tableau`).
By duality, for any y and lambda,

    sum_i y_i un_i + sum_ik (lambda - (M^T y)_ik) alpha_ik = lambda,    un = M alpha,

and where the least left side over the statuses is above lambda, by more than all round-off, there
is no state, with this F and so with any smaller one. A state that is found lowers F, to the least
of its statuses, where the largest |rt| - F rn can be no less than 0, and the search continues just
below it.

In 3D the disc is between polygons of K sides: with circumscribed ones the F found is a lower bound,
and |rt| / rn of the state an upper one, no more than 1 / cos(pi / K) of it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq, linprog

from dolfinx_contact._mpi import Arguments, collective, on_root
from dolfinx_contact._validate import is_count, is_number
from dolfinx_contact.algorithms.point_problem import PointProblem
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.proofs.check_proof import ReducedProblem, flexibility, gamma
from dolfinx_contact.proofs.tableau import Tableau

__all__ = ["Wedging", "wedging_friction"]

Array = npt.NDArray[np.float64]
Statuses = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_BELOW = 1e-7  # relative distance below a known F at which there is to be no state
_LARGEST = 1e3  # F beyond which none is looked for
_EITHER = 1e-9  # un / U or alpha that is none
_UNDECIDED, _OPEN, _CLOSED = range(3)
_SURE = 1e-10  # of a row that proves a region empty
_TINY = 1e-12
_HOLDS = 1e-8  # of the sizes that add up to it, an un that is none
_EXACT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


@dataclass(frozen=True, eq=False)
class Wedging:
    """The smallest friction with which a body stays wedged.

    Attributes:
        friction: that of `state`; infinite if there is none up to 1000.
        lower: below this there is no such state, proved if `complete`; 0 if not. In 2D it is
            ``friction`` but for 1e-7 of it.
        complete: whether the search came to its end.
        statuses: `o` and `c`, open and closed, of the points in the order of their coordinates.
        state: (ut, un, rt, rn) of the points with sum rn = 1 (m, 2 dim), in the frames of
            `ContactProblem.reduced`.
        regions: sets of statuses that were examined.
        seconds: that the search took.
    """

    friction: float
    lower: float
    complete: bool
    statuses: str
    state: Array
    regions: int
    seconds: float

    def __str__(self) -> str:
        """The coefficient, how it is known, and the statuses."""
        if not np.isfinite(self.friction):
            known = "proved" if self.complete else "not decided"
            if not self.complete:
                return f"no wedged state was found up to a friction of {_LARGEST:g}, {known}"
            return f"no wedged state up to a friction of {_LARGEST:g}, {known}"
        words = f"wedged from a friction of {self.friction:.9g} on, {self.statuses}"
        if not self.complete:
            return f"{words}; smaller ones are not excluded"
        return f"{words}; none below {self.lower:.9g}, proved ({self.regions} regions)"


def _check(a: Arguments) -> None:
    if not isinstance(a.problem, ContactProblem):
        raise ValueError(f"a ContactProblem is needed, got {a.problem!r}")
    if not (is_number(a.seconds) and a.seconds >= 0):
        raise ValueError(f"seconds must be a number from 0 on, got {a.seconds!r}")
    if not (is_count(a.sides) and a.sides >= 4):
        raise ValueError(f"sides must be a whole number from 4 on, got {a.sides!r}")


@collective("wedging_friction", _check)
def wedging_friction(problem: ContactProblem, *, seconds: float = 60.0, sides: int = 16) -> Wedging:
    """The smallest friction with which a body stays wedged after it is unloaded. Collective.

    Loads, gaps and the coefficient of the law do not matter.

    Args:
        problem: of a linear body that Dirichlet data hold, with contact at its nodes.
        seconds: after which the search ends.
        sides: of the polygons about the friction disc in 3D.

    Raises:
        ValueError: on every rank, for a problem that has no contact points of its own
            (`ContactProblem.reduced`), or seconds or sides that are none.
    """
    points = problem.reduced()
    return on_root(problem.comm, lambda: wedging_of(points, seconds=seconds, sides=sides))


def wedging_of(points: PointProblem, *, seconds: float = 60.0, sides: int = 16) -> Wedging:
    """The same of contact points alone, of which the stiffness matters. Not collective."""
    begun = time.monotonic()
    search = _Search(points, begun + seconds, sides)
    search.run()
    state: Array = np.zeros((points.number, 2 * points.dim))
    if search.best is not None:
        shape = points.number, points.dim
        r = (search.best / search.scales).reshape(shape)
        u = (search.scales * (search.G @ search.best)).reshape(shape)
        total = r[:, -1].sum()
        u, r = u / total, r / total
        state = np.asarray(np.hstack([u, r]), dtype=np.float64)
    statuses = "".join("c" if c else "o" for c in search.closed)
    lower = search.tried if search.complete else 0.0
    took = time.monotonic() - begun
    return Wedging(search.friction, lower, search.complete, statuses, state, search.regions, took)


def _scales(S: Array, dim: int) -> Array:
    """Powers of two, one a point, that make the stiffness of the points alike (dim m,).

    With D of them D S D has the same states but for D: cones and gaps of a point have no unit.
    """
    own = np.sqrt(np.diag(S).reshape(-1, dim).max(axis=1))
    return np.repeat(2.0 ** np.round(-np.log2(own)), dim)


class _Rays:
    """Columns M of the flexibility by extreme forces of the cones, and their errors.

    Args:
        G: flexibility, over its unit (dim m, dim m).
        off: by how much entries may be off (dim m, dim m).
        corners: of the polygon about the unit disc (K, dim - 1).
        friction: F.

    Attributes:
        M: un over its largest values by weights of the rays (m, m K).
        off: bounds of the errors of a row, whatever the weights (m,).
        opens: points that may be open at all (m,).
    """

    def __init__(self, G: Array, off: Array, corners: Array, friction: float):
        dim = corners.shape[1] + 1
        m = len(G) // dim
        ray = np.hstack([friction * corners, np.ones((len(corners), 1))])
        rows = G[dim - 1 :: dim].reshape(m, m, dim)
        M = np.einsum("ijc,kc->ijk", rows, ray).reshape(m, -1)
        size = np.einsum("ijc,kc->ijk", np.abs(rows), np.abs(ray)).reshape(m, -1)
        away = np.einsum("ijc,kc->ijk", off[dim - 1 :: dim].reshape(m, m, dim), np.abs(ray))
        largest = M.max(axis=1)
        worst = away.max(axis=(1, 2)) + gamma(16) * size.max(axis=1)
        self.opens = largest + worst > 0
        whole = np.abs(M).max(axis=1)
        unit = np.asarray(np.where(largest > _TINY * whole, largest, whole), dtype=np.float64)
        self.M: Array = M / unit[:, None]
        self.off = worst / unit * (1 + 1e-9) + gamma(4)


class _Program(Tableau):
    """The linear program of a region; numbers: alpha, un, the slack of the hull, of the sum."""

    def __init__(self, rays: _Rays):
        m, n = rays.M.shape
        self.m, self.n, self.sides = m, n, n // m
        own = np.repeat(np.eye(m), self.sides, axis=1)
        rows = np.concatenate([rays.M, -rays.M - own, -np.ones((1, n))])
        start = np.concatenate([np.zeros(m), np.ones(m + 1)])
        up = np.concatenate([np.ones(n), rays.opens.astype(float), np.full(m, 4.0), [0.0]])
        super().__init__(rows, start, n + np.arange(2 * m + 1), n, up, sure=_SURE)
        self._opens = rays.opens
        every = np.arange(m)
        # Points of the variables, m of those that have none.
        self._point = np.concatenate([np.repeat(every, self.sides), every, np.full(m + 1, m)])

    def hold(self, statuses: Statuses, changed: Flags) -> None:
        """Give points that have changed their statuses (m,)."""
        self._up[: self.n] = np.repeat(statuses != _OPEN, self.sides)
        self._up[self.n : self.n + self.m] = (statuses != _CLOSED) & self._opens
        mine = np.flatnonzero(np.append(changed, False)[self._point[self._nonbasic]])
        self._set(mine, np.where(self._costs[mine] < 0, self._up[self._nonbasic[mine]], 0.0))

    def empty(self) -> tuple[Array, float] | None:
        """Multipliers y (m,) and lambda that tell why there is nothing; None if there may be."""
        v = self._repair()
        if v is None:
            return None
        slack = v[self.n + self.m : self.n + 2 * self.m]
        return v[self.n : self.n + self.m] - slack, float(v[-1])

    @property
    def point(self) -> tuple[Array, Array]:
        """Weights (m, K), and un (m,)."""
        x = self._all_values
        return x[: self.n].reshape(self.m, -1), x[self.n : self.n + self.m]


class _Search:
    """Branch and bound on open and closed points, at an F that falls."""

    def __init__(self, points: PointProblem, end: float, sides: int):
        m, dim = points.number, points.dim
        nothing = np.zeros(dim * m)
        #: By which displacements of the points are multiplied, and their forces divided (dim m,).
        self.scales = _scales(points.S, dim)
        both = self.scales[:, None] * self.scales
        unit = float(np.abs(points.A / both).max())
        reduced = ReducedProblem(
            points.S * both * unit,
            nothing,
            np.ones(m),
            None,
            None if points.S_error is None else points.S_error * both * unit,
        )
        G, off = flexibility(reduced)
        self.G = G * unit
        self._G, self._off = G, off
        self.m, self.dim = m, dim
        self._end = end
        angles = 2 * np.pi * np.arange(sides) / sides
        circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        self._facets = np.array([[1.0], [-1.0]]) if dim == 2 else circle
        half = angles + np.pi / sides
        outer = np.stack([np.cos(half), np.sin(half)], axis=1) / np.cos(np.pi / sides)
        self._corners = self._facets if dim == 2 else outer
        self.friction = np.inf
        self._reached = _LARGEST
        self.tried = _LARGEST
        self.best: Array | None = None
        self.closed = np.zeros(m, dtype=bool)
        self.complete = True
        self.regions = 0
        self._doubtful: list[tuple[Statuses, float]] = []

    def run(self) -> None:
        """Until nothing is left, or time is over."""
        self._descend()
        self._begin()
        waiting: list[Statuses] = [np.zeros(self.m, dtype=np.int64)]
        while waiting or self._again():
            # What was in doubt may be sure with less friction.
            statuses = waiting.pop() if waiting else self._doubtful.pop()[0]
            if time.monotonic() > self._end:
                self.complete = False
                return
            self.regions += 1
            waiting += self._treat(statuses)

    def _descend(self) -> None:
        """A small F to begin with: from all points closed, one changed at a time."""
        closed = np.ones(self.m, dtype=bool)
        self._lower(closed)
        improved = self.best is not None
        while improved and time.monotonic() < self._end:
            improved = False
            for i in range(self.m):
                closed = self.closed.copy()
                closed[i] = not closed[i]
                if closed.any() and self._lower(closed):
                    improved = True

    def _again(self) -> bool:
        """Whether a region is in doubt that was examined with more friction."""
        if not self._doubtful:
            return False
        if self._doubtful[-1][1] > self.tried:
            return True
        self.complete = False
        return False

    def _begin(self) -> None:
        """A program just below the F that is known."""
        self.tried = self._reached * (1 - _BELOW)
        self._rays = _Rays(self._G, self._off, self._corners, self.tried)
        self._program = _Program(self._rays)
        self._now: Statuses = np.zeros(self.m, dtype=np.int64)

    def _treat(self, statuses: Statuses) -> list[Statuses]:
        self._program.hold(statuses, statuses != self._now)
        self._now = statuses.copy()
        y = self._program.empty()
        undecided = np.flatnonzero(statuses == _UNDECIDED)
        if y is not None and self._is_empty(statuses, *y):
            return []
        if y is not None or self._program.lost:
            # Round-off is in the way: parts of it may be sure.
            if len(undecided) == 0:
                self._doubtful.insert(0, (statuses, self.tried))
                return []
            size = np.abs(y[0][undecided]) if y is not None else np.ones(len(undecided))
            return self._parts(statuses, int(undecided[np.argmax(size)]), _OPEN)
        weights, un = self._program.point
        pressed = weights.sum(axis=1)
        either = np.where(statuses == _UNDECIDED, np.minimum(un, pressed), -1.0)
        i = int(np.argmax(either))
        if either[i] <= _EITHER:
            if not self._lower(pressed > un):
                self._doubtful.insert(0, (statuses, self.tried))
                return []
            self._begin()
            return [statuses]
        return self._parts(statuses, i, _CLOSED if pressed[i] > un[i] else _OPEN)

    @staticmethod
    def _parts(statuses: Statuses, i: int, first: int) -> list[Statuses]:
        """Both statuses of a point, that to be treated first at the end."""
        parts = []
        for status in (_OPEN + _CLOSED - first, first):
            part = statuses.copy()
            part[i] = status
            parts.append(part)
        return parts

    def _is_empty(self, statuses: Statuses, y: Array, lam: float) -> bool:
        """Whether multipliers prove that there is no state, whatever the round-off."""
        M = self._rays.M
        for sign in (1.0, -1.0):
            z = sign * y
            k = sign * lam
            of_open = np.minimum(z, 0.0) * self._rays.opens
            left = (k - M.T @ z).reshape(self.m, -1)
            of_closed = np.minimum(left.min(axis=1), 0.0)
            least = np.where(statuses == _OPEN, of_open, of_closed)
            least = np.where(statuses == _UNDECIDED, np.minimum(of_open, of_closed), least)
            size = np.abs(z) @ (1 + np.abs(M).max(axis=1)) + (1 + self.m) * abs(k)
            off = np.abs(z) @ self._rays.off + gamma(4 * self.m + 16) * size
            if least.sum() - k > off * (1 + 1e-9):
                return True
        return False

    def _lower(self, closed: Flags) -> bool:
        """Take the least F of some statuses; whether it is below the one that is known."""
        found = self._least_of(closed)
        if found is None or not found[0] < self._reached:
            return False
        rows = self._G[self.dim - 1 :: self.dim]
        un = rows @ found[1]
        size = np.abs(rows) @ np.abs(found[1])
        if (np.where(closed, np.abs(un), -un) > _HOLDS * size).any():
            return False  # what the linear programs found is no state
        self._reached, r = found
        self.best = r
        self.closed = closed | (un <= _EITHER * size)
        pressed = r.reshape(self.m, -1)[:, -1] > _TINY
        shear = np.linalg.norm(r.reshape(self.m, -1)[pressed, :-1], axis=1)
        self.friction = float((shear / r.reshape(self.m, -1)[pressed, -1]).max())
        return True

    def _least_of(self, closed: Flags) -> tuple[float, Array] | None:
        """The least F of a state with some closed points, and its forces (dim m,)."""
        places = np.flatnonzero(closed)
        d, k = self.dim, len(places)
        columns = (d * places[:, None] + np.arange(d)).reshape(-1)
        rows = self._G[d - 1 :: d][:, columns]
        facets = np.kron(np.eye(k), np.hstack([self._facets, np.zeros((len(self._facets), 1))]))
        push = np.hstack([np.zeros((len(self._facets), d - 1)), np.ones((len(self._facets), 1))])
        press = np.kron(np.eye(k), push)
        upper = np.concatenate([facets, -rows[~closed]])
        equal = np.vstack([rows[closed], press[:: len(self._facets)].sum(axis=0)])
        value = np.append(np.zeros(k), 1.0)
        share = np.append(np.ones(len(facets)), np.zeros(int((~closed).sum())))
        bounds = [(0.0, None) if c == d - 1 else (None, None) for _ in places for c in range(d)]
        forces: dict[float, Array] = {}

        def excess(F: float) -> float:
            """The least, over the states, of the largest |rt| - F rn."""
            A = upper.copy()
            A[: len(facets)] -= F * press
            found = linprog(
                np.append(np.zeros(d * k), 1.0),
                A_ub=np.hstack([A, -share[:, None]]),
                b_ub=np.zeros(len(A)),
                A_eq=np.hstack([equal, np.zeros((len(equal), 1))]),
                b_eq=value,
                bounds=[*bounds, (None, None)],
                options=_EXACT,
            )
            if found.status != 0:
                return np.inf
            forces[F] = found.x[:-1]
            return float(found.fun)

        # An F that is no smaller is none.
        if not excess(self._reached * (1 - _BELOW)) <= _TINY:
            return None
        F = 0.0 if excess(0.0) <= 0 else self._root(excess)
        excess(F)
        whole = np.zeros(d * self.m)
        whole[columns] = forces[F]
        return F, whole

    def _root(self, excess: Callable[[float], float]) -> float:
        """Where a falling function is zero, between 0 and the F that is known, from above."""
        top = self._reached
        if excess(top) >= 0:
            return top
        found = float(brentq(excess, 0.0, top, xtol=1e-14, rtol=1e-14))
        return found if excess(found) < np.inf else top
