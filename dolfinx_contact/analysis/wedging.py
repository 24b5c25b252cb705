# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Smallest friction with which a body stays wedged without any load.

A body that was loaded and unloaded may keep contact forces. With the stiffness S of the contact
points it is *wedged* in a state (u, r) other than 0 with

    S u = r,    un >= 0, rn >= 0, un rn = 0,    |rt| <= F rn,

for any direction of rt, which depends on the history (Kim, Jang and Barber, 2019). The infimum of F
over such states depends on the body and its contact surface only. The problem is homogeneous, so
that sum rn = 1. With the flexibility G = S^-1 and the extreme forces of the cones (2D: (F, 1) and
(-F, 1)) as rays, a state is given by weights alpha >= 0 of sum 1 with un = G_n r >= 0, and at every
point either alpha = 0 (open) or un = 0 (closed).

For one F this is a search in pairs of statuses. A region of them is empty if

    un_i / U_i + sum of alpha_i <= 1        (U_i: the largest un)

has no solution. This is a linear program, which differs from region to region in bounds only, so
that the dual simplex method continues from the last tableau (`tableau`). HiGHS without warm starts
needed 1.7 times the time for 9 nodes (71 regions, here 73), and left a program of 17 nodes without
an answer.

By duality, for any y and lambda,

    sum_i y_i un_i + sum_ik (lambda - (M^T y)_ik) alpha_ik = lambda,    un = M alpha.

If the least left side over the statuses exceeds lambda by more than all round-off, there is no
state with this F, and so with any smaller one. A state that is found lowers F to the least F of its
statuses, at which the largest |rt| - F rn cannot be less than 0, and the search continues just
below it.

In 3D the disc lies between polygons of K sides. With circumscribed ones the F found is a lower
bound, and |rt| / rn of the state an upper bound, larger by a factor of at most 1 / cos(pi / K).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, linprog

from dolfinx_contact._arrays import Array, Ints, Mask
from dolfinx_contact._mpi import Arguments, collective, on_root
from dolfinx_contact._validate import count, instance, nonnegative
from dolfinx_contact.algorithms.lemke import tangents
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.proofs.check_proof import ReducedProblem, flexibility, gamma
from dolfinx_contact.proofs.tableau import Tableau
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["Wedging", "wedging_friction"]


_BELOW = 1e-7  # relative distance below a known F at which no state is to exist
_LARGEST = 1e3  # largest F of the search
_EITHER = 1e-9  # un / U or alpha that counts as zero
_UNDECIDED, _OPEN, _CLOSED = range(3)
_SURE = 1e-10  # amount by which a row must fail to prove a region empty
_TINY = 1e-12
_HOLDS = 1e-8  # un that counts as zero, relative to the sizes of its terms
_EXACT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


@dataclass(frozen=True, eq=False)
class Wedging:
    """Smallest friction with which a body stays wedged.

    Attributes:
        friction: friction of `state`; infinite if no state was found up to 1000.
        lower: friction below which no such state exists, proved if `complete`; 0 otherwise. In 2D
            it equals ``friction`` up to 1e-7.
        complete: whether the search came to its end.
        statuses: letters `o` (open) and `c` (closed) of the points, ordered by coordinates.
        state: (ut, un, rt, rn) of the points with sum rn = 1 (m, 2 dim), in the frames of
            `ContactProblem.reduced`.
        regions: number of examined sets of statuses.
        seconds: computing time.
    """

    friction: float
    lower: float
    complete: bool
    statuses: str
    state: Array
    regions: int
    seconds: float

    def __str__(self) -> str:
        """Return the coefficient, the status of the proof, and the statuses."""
        if not np.isfinite(self.friction):
            if not self.complete:
                return f"no wedged state was found up to a friction of {_LARGEST:g}, not decided"
            return f"no wedged state up to a friction of {_LARGEST:g}, proved"
        words = f"wedged from a friction of {self.friction:.9g} on, {self.statuses}"
        if not self.complete:
            return f"{words}; smaller ones are not excluded"
        return f"{words}; none below {self.lower:.9g}, proved ({self.regions} regions)"


def _check(a: Arguments) -> None:
    instance(a.problem, "problem", ContactProblem)
    nonnegative(a.seconds, "seconds")
    count(a.sides, "sides", least=4)


@collective("wedging_friction", _check)
def wedging_friction(problem: ContactProblem, *, seconds: float = 60.0, sides: int = 16) -> Wedging:
    """Find the smallest friction with which a body stays wedged after unloading. Collective.

    Loads, gaps and the coefficient of the law do not matter.

    Args:
        problem: contact problem of a linear body held by Dirichlet data, with contact at its nodes.
        seconds: time of the search.
        sides: number of sides of the polygons about the friction disc in 3D.

    Raises:
        ValueError: on every rank, if the problem cannot be reduced to its contact points
            (`ContactProblem.reduced`), or ``seconds`` or ``sides`` is not valid.
    """
    points = problem.reduced()
    return on_root(problem.comm, lambda: wedging_of(points, seconds=seconds, sides=sides))


def wedging_of(points: PointProblem, *, seconds: float = 60.0, sides: int = 16) -> Wedging:
    """Return the result for contact points, using only their stiffness. Not collective."""
    begun = time.monotonic()
    search = _Search(points, begun + seconds, sides)
    search.run()
    state: Array = np.zeros((points.number, 2 * points.dim))
    if search.best is not None:
        shape = points.number, points.dim
        r = (search.best / search.scales).reshape(shape)
        u = (search.scales * (search.G @ search.best)).reshape(shape)
        state = np.asarray(np.hstack([u, r]) / r[:, -1].sum(), dtype=np.float64)
    return Wedging(
        friction=search.friction,
        lower=search.tried if search.complete else 0.0,
        complete=search.complete,
        statuses="".join("c" if c else "o" for c in search.closed),
        state=state,
        regions=search.regions,
        seconds=time.monotonic() - begun,
    )


def _scales(S: Array, dim: int) -> Array:
    """Return powers of two, one per point, that give all points a similar stiffness (dim m,).

    With the diagonal matrix D of them, D S D has the same states up to D: cones and gaps of a point
    have no unit.
    """
    own = np.sqrt(np.diag(S).reshape(-1, dim).max(axis=1))
    return np.repeat(2.0 ** np.round(-np.log2(own)), dim)


class _Rays(NamedTuple):
    """Flexibility for the extreme forces of the friction cones.

    Attributes:
        M: un over its largest values by weights of the rays (m, m K).
        off: error bounds of the rows for any weights (m,).
        opens: points that can be open (m,).
    """

    M: Array
    off: Array
    opens: Mask

    @classmethod
    def of(cls, G: Array, off: Array, corners: Array, friction: float) -> _Rays:
        """Return the columns of the flexibility.

        Args:
            G: flexibility over its unit (dim m, dim m).
            off: error bounds of its entries (dim m, dim m).
            corners: corners of the polygon about the unit disc (K, dim - 1).
            friction: coefficient F.
        """
        dim = corners.shape[1] + 1
        m = len(G) // dim
        ray = np.hstack([friction * corners, np.ones((len(corners), 1))])

        def along(rows: Array, ray: Array) -> Array:
            return np.einsum("ijc,kc->ijk", rows[dim - 1 :: dim].reshape(m, m, dim), ray).reshape(
                m, -1
            )

        M = along(G, ray)
        size, away = (along(np.abs(v), np.abs(ray)).max(axis=1) for v in (G, off))
        worst = away + gamma(16) * size
        largest, whole = M.max(axis=1), np.abs(M).max(axis=1)
        unit = np.asarray(np.where(largest > _TINY * whole, largest, whole), dtype=np.float64)
        return cls(M / unit[:, None], worst / unit * (1 + 1e-9) + gamma(4), largest + worst > 0)


class _Program(Tableau):
    """Linear program of a region; variables: alpha, un, the slacks of the hull, of the sum."""

    def __init__(self, rays: _Rays):
        m, n = rays.M.shape
        self.m, self.n, self.sides = m, n, n // m
        own = np.repeat(np.eye(m), self.sides, axis=1)
        rows = np.concatenate([rays.M, -rays.M - own, -np.ones((1, n))])
        start = np.concatenate([np.zeros(m), np.ones(m + 1)])
        up = np.concatenate([np.ones(n), rays.opens.astype(float), np.full(m, 4.0), [0.0]])
        super().__init__(rows, start, n + np.arange(2 * m + 1), n, up, sure=_SURE)
        self._opens = rays.opens

    def hold(self, statuses: Ints) -> None:
        """Bound the variables by the statuses (m,) of a region."""
        self._up[: self.n] = np.repeat(statuses != _OPEN, self.sides)
        self._up[self.n : self.n + self.m] = (statuses != _CLOSED) & self._opens
        every = np.arange(self.n)
        self._set(every, np.where(self._costs < 0, self._up[self._nonbasic], 0.0))

    def empty(self) -> tuple[Array, float] | None:
        """Return multipliers y (m,) and lambda of an infeasible program, else None."""
        v = self._repair()
        if v is None:
            return None
        slack = v[self.n + self.m : self.n + 2 * self.m]
        return v[self.n : self.n + self.m] - slack, float(v[-1])

    @property
    def point(self) -> tuple[Array, Array]:
        """Sums of the weights (m,), and un (m,), at the vertex."""
        x = self._all_values
        return x[: self.n].reshape(self.m, -1).sum(axis=1), x[self.n : self.n + self.m]


class _Search:
    """Branch and bound on open and closed points, at a decreasing F.

    Attributes:
        scales: factors of the displacements of the points; forces are divided by them (dim m,).
        G: flexibility of the scaled points (dim m, dim m).
        friction: smallest friction found.
        tried: friction at which regions are proved empty.
        best: forces of the best state (dim m,), or None.
        closed: closed points of this state (m,).
        complete: whether the search came to its end.
        regions: number of examined regions.
    """

    def __init__(self, points: PointProblem, end: float, sides: int):
        m, dim = points.number, points.dim
        self.scales = _scales(points.S, dim)
        both = self.scales[:, None] * self.scales
        unit = float(np.abs(points.A / both).max())
        error = None if points.S_error is None else points.S_error * both * unit
        nothing = np.zeros(dim * m)
        reduced = ReducedProblem(points.S * both * unit, nothing, np.ones(m), None, error)
        self._G, self._off = flexibility(reduced)
        self.G = self._G * unit
        self.m, self.dim = m, dim
        self._end = end
        self._facets = tangents(dim, sides)
        farthest = 1.0 if dim == 2 else 1.0 / np.cos(np.pi / sides)
        self._corners = farthest * tangents(dim, sides, np.pi / sides)
        self.friction = np.inf
        self._reached = _LARGEST
        self.tried = _LARGEST
        self.best: Array | None = None
        self.closed = np.zeros(m, dtype=bool)
        self.complete = False
        self.regions = 0
        #: Regions that round-off leaves undecided at the present friction.
        self._doubtful: list[Ints] = []

    def run(self) -> None:
        """Search until nothing is left, or time is over."""
        self._descend()
        self._begin()
        waiting: list[Ints] = [np.zeros(self.m, dtype=np.int64)]
        while waiting and time.monotonic() <= self._end:
            self.regions += 1
            waiting += self._treat(waiting.pop())
        self.complete = not waiting and not self._doubtful

    def _descend(self) -> None:
        """Find a small initial F by changing one point at a time, from all points closed."""
        self._lower(np.ones(self.m, dtype=bool))
        improved = self.best is not None
        while improved and time.monotonic() < self._end:
            improved = False
            for i in range(self.m):
                closed = self.closed.copy()
                closed[i] = not closed[i]
                if closed.any() and self._lower(closed):
                    improved = True

    def _begin(self) -> None:
        """Create the program just below the known F."""
        self.tried = self._reached * (1 - _BELOW)
        self._rays = _Rays.of(self._G, self._off, self._corners, self.tried)
        self._program = _Program(self._rays)

    def _treat(self, statuses: Ints) -> list[Ints]:
        """Close a region, or return its parts; the last is treated first."""
        self._program.hold(statuses)
        y = self._program.empty()
        undecided = np.flatnonzero(statuses == _UNDECIDED)
        if y is not None and self._is_empty(statuses, *y):
            return []
        if y is not None or self._program.lost:
            # Round-off prevents a decision: parts may be decided.
            if len(undecided) == 0:
                self._doubtful.append(statuses)
                return []
            size = np.abs(y[0][undecided]) if y is not None else np.ones(len(undecided))
            i, first = int(undecided[np.argmax(size)]), _OPEN
        else:
            pressed, un = self._program.point
            either = np.where(statuses == _UNDECIDED, np.minimum(un, pressed), -1.0)
            i = int(np.argmax(either))
            if either[i] <= _EITHER:
                if not self._lower(pressed > un):
                    self._doubtful.append(statuses)
                    return []
                self._begin()
                # Doubtful regions may be decided at the smaller friction.
                doubtful, self._doubtful = self._doubtful, []
                return [*doubtful, statuses]
            first = _CLOSED if pressed[i] > un[i] else _OPEN
        parts = [statuses.copy(), statuses.copy()]
        parts[0][i], parts[1][i] = _OPEN + _CLOSED - first, first
        return parts

    def _is_empty(self, statuses: Ints, y: Array, lam: float) -> bool:
        """Return whether multipliers prove that a region has no state, round-off included."""
        M, off, opens = self._rays
        for z, k in ((y, lam), (-y, -lam)):
            of_open = np.minimum(z, 0.0) * opens
            left = (k - M.T @ z).reshape(self.m, -1)
            of_closed = np.minimum(left.min(axis=1), 0.0)
            choices = [np.minimum(of_open, of_closed), of_open, of_closed]
            least = np.choose(statuses, choices).sum()
            size = np.abs(z) @ (1 + np.abs(M).max(axis=1)) + (1 + self.m) * abs(k)
            error = np.abs(z) @ off + gamma(4 * self.m + 16) * size
            if least - k > error * (1 + 1e-9):
                return True
        return False

    def _lower(self, closed: Mask) -> bool:
        """Compute the least F for some closed points; return whether it is the smallest so far."""
        least = self._least_of(closed)
        if least is None or not least[0] < self._reached:
            return False
        F, r = least
        rows = self._G[self.dim - 1 :: self.dim]
        un = rows @ r
        size = np.abs(rows) @ np.abs(r)
        if (np.where(closed, np.abs(un), -un) > _HOLDS * size).any():
            return False  # the solution of the linear programs is not a state
        self._reached, self.best = F, r
        self.closed = closed | (un <= _EITHER * size)
        forces = r.reshape(self.m, -1)
        pressed = forces[:, -1] > _TINY
        ratios = np.linalg.norm(forces[pressed, :-1], axis=1) / forces[pressed, -1]
        self.friction = float(ratios.max())
        return True

    def _least_of(self, closed: Mask) -> tuple[float, Array] | None:
        """Return the least F of a state with some closed points, and its forces (dim m,)."""
        places = np.flatnonzero(closed)
        d, k, sides = self.dim, len(places), len(self._facets)
        columns = (d * places[:, None] + np.arange(d)).reshape(-1)
        rows = self._G[d - 1 :: d][:, columns]
        facets = np.kron(np.eye(k), np.hstack([self._facets, np.zeros((sides, 1))]))
        press = np.kron(np.eye(k), np.eye(d)[[-1] * sides])
        upper = np.concatenate([facets, -rows[~closed]])
        share = np.append(np.ones(len(facets)), np.zeros(int((~closed).sum())))
        equal = np.vstack([rows[closed], press[::sides].sum(axis=0)])
        forces: dict[float, Array] = {}

        def excess(F: float) -> float:
            """Return the least, over the states, of the largest |rt| - F rn."""
            A = upper.copy()
            A[: len(facets)] -= F * press
            found = linprog(
                np.append(np.zeros(d * k), 1.0),
                A_ub=np.hstack([A, -share[:, None]]),
                b_ub=np.zeros(len(A)),
                A_eq=np.hstack([equal, np.zeros((len(equal), 1))]),
                b_eq=np.append(np.zeros(k), 1.0),
                bounds=[*([(None, None)] * (d - 1) + [(0.0, None)]) * k, (None, None)],
                options=_EXACT,
            )
            if found.status != 0:
                return np.inf
            forces[F] = found.x[:-1]
            return float(found.fun)

        if not excess(self._reached * (1 - _BELOW)) <= _TINY:
            return None  # not smaller than the known one
        F = 0.0 if excess(0.0) <= 0 else self._root(excess)
        excess(F)
        whole = np.zeros(d * self.m)
        whole[columns] = forces[F]
        return F, whole

    def _root(self, excess: Callable[[float], float]) -> float:
        """Return the zero of a decreasing function between 0 and the known F, from above."""
        top = self._reached
        if excess(top) >= 0:
            return top
        root = float(brentq(excess, 0.0, top, xtol=1e-14, rtol=1e-14))
        return root if excess(root) < np.inf else top
