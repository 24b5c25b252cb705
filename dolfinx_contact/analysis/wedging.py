# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Smallest friction coefficient with which a body stays wedged without any load.

A body may keep contact forces after loading and unloading. With the stiffness S of the contact
points, the body is *wedged* in a nonzero state of displacements u = (ut, un) and forces
r = (rt, rn) if

    S u = r,    un >= 0, rn >= 0, un rn = 0,    |rt| <= F rn,

for any direction of rt, which depends on the history (Kim, Jang and Barber, 2019). The infimum of
the coefficient F over these states depends only on the body and its contact surface. The problem is
homogeneous and is scaled to sum rn = 1. With the flexibility G = S^-1 and the extreme forces of the
friction cones as rays ((F, 1) and (-F, 1) in 2D), a state is given by weights alpha >= 0 with sum 1
and un = G_n r >= 0. At every point either alpha = 0 (open) or un = 0 (closed).

For one F, branch and bound searches over the statuses. A region of statuses is empty if

    un_i / U_i + sum of alpha_i <= 1        (U_i: the largest un)

has no solution. This is a linear program. Only its bounds differ between regions, so that the dual
simplex method continues from the last tableau (`tableau`). HiGHS without warm starts took 1.7 times
as long for 9 nodes (71 regions instead of 73), and failed on a program of 17 nodes.

By duality, for any multipliers y and lambda,

    sum_i y_i un_i + sum_ik (lambda - (M^T y)_ik) alpha_ik = lambda,    un = M alpha,

where the matrix M maps the weights alpha_ik of the rays k at the points i to un. If the smallest
left-hand side over the statuses exceeds lambda by more than all round-off errors, no state exists
for this F or any smaller F. If a state is found, F is reduced to the smallest F for the statuses of
this state, at which the minimum over states of max(|rt| - F rn) vanishes. The search continues just
below this F.

In 3D the friction disc lies between polygons with K sides. With circumscribed polygons the computed
F is a lower bound. The largest |rt| / rn of the state is an upper bound, larger by a factor of at
most 1 / cos(pi / K).
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
    """Smallest friction coefficient with which a body stays wedged.

    Attributes:
        friction: friction coefficient of `state`; infinite if no state was found up to 1000.
        lower: friction below which provably no wedged state exists; 0 if the search is incomplete.
            In 2D it equals `friction` up to 1e-7.
        complete: whether the search was completed.
        statuses: letters `o` (open) and `c` (closed) of the points, ordered by coordinates.
        state: wedged state (ut, un, rt, rn) of the points, scaled to sum rn = 1, shape (m, 2 dim),
            in the frames of `ContactProblem.reduced`.
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

    The result does not depend on loads, gaps or the friction coefficient of the law.

    Args:
        problem: contact problem of a linear body held by Dirichlet data, with contact at its nodes.
        seconds: time limit of the search in seconds. Default 60.
        sides: number of sides of the polygons around the friction disc in 3D. Default 16.

    Raises:
        ValueError: on every rank, if the problem cannot be reduced to its contact points
            (`ContactProblem.reduced`), or ``seconds`` or ``sides`` is not valid.
    """
    points = problem.reduced()
    return on_root(problem.comm, lambda: wedging_of(points, seconds=seconds, sides=sides))


def wedging_of(points: PointProblem, *, seconds: float = 60.0, sides: int = 16) -> Wedging:
    """Return the result of `wedging_friction` for contact points. Not collective.

    Only their stiffness is used.
    """
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
    """Return powers of two by which the stiffness of all points becomes similar, shape (dim m,).

    Let D be the diagonal matrix of these factors, with one factor per point. With the stiffness S,
    the matrix D S D has the same wedged states up to the scaling by D, which leaves the cones and
    the signs of the gaps unchanged.
    """
    own = np.sqrt(np.diag(S).reshape(-1, dim).max(axis=1))
    return np.repeat(2.0 ** np.round(-np.log2(own)), dim)


class _Rays(NamedTuple):
    """Normal displacements caused by the extreme forces of the friction cones.

    Attributes:
        M: matrix that maps the weights of K extreme forces per point to normal displacements, with
            each row scaled to a maximum of 1, shape (m, m K).
        off: error bounds of these displacements for all weights with sum 1, shape (m,).
        opens: mask of the points that can be open, shape (m,).
    """

    M: Array
    off: Array
    opens: Mask

    @classmethod
    def of(cls, G: Array, off: Array, corners: Array, friction: float) -> _Rays:
        """Compute the normal displacements for all rays.

        Args:
            G: flexibility divided by its unit, shape (dim m, dim m).
            off: error bounds of the entries of ``G``, shape (dim m, dim m).
            corners: corners of the polygon around the unit disc, shape (K, dim - 1).
            friction: friction coefficient F.
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
    """Linear program of a region of statuses.

    The variables are the weights of the rays, the normal displacements, the slacks of the
    inequalities in the module, and the slack of the sum of weights.
    """

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
        """Set the bounds of the variables from the statuses of a region, shape (m,)."""
        self._up[: self.n] = np.repeat(statuses != _OPEN, self.sides)
        self._up[self.n : self.n + self.m] = (statuses != _CLOSED) & self._opens
        every = np.arange(self.n)
        self._set(every, np.where(self._costs < 0, self._up[self._nonbasic], 0.0))

    def empty(self) -> tuple[Array, float] | None:
        """Return multipliers y, shape (m,), and lambda if the program is infeasible, or None."""
        v = self._repair()
        if v is None:
            return None
        slack = v[self.n + self.m : self.n + 2 * self.m]
        return v[self.n : self.n + self.m] - slack, float(v[-1])

    @property
    def point(self) -> tuple[Array, Array]:
        """Sum of weights and normal displacement of each point at the vertex, shape (m,) each."""
        x = self._all_values
        return x[: self.n].reshape(self.m, -1).sum(axis=1), x[self.n : self.n + self.m]


class _Search:
    """Branch and bound over open and closed points, with decreasing friction coefficient F.

    Attributes:
        scales: factors that multiply displacements and divide forces of the points, shape (dim m,).
        G: flexibility of the scaled points, shape (dim m, dim m).
        friction: smallest friction coefficient of a state so far; infinite if there is none.
        tried: friction coefficient F, just below the smallest one found, at which regions are
            examined.
        best: forces of the state with the smallest F so far, shape (dim m,); None if there is none.
        closed: mask of the closed points in this state, shape (m,).
        complete: whether the search was completed.
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
        """Search until no region is left or the time limit is reached."""
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
        """Create the linear program for a friction coefficient just below the smallest F so far."""
        self.tried = self._reached * (1 - _BELOW)
        self._rays = _Rays.of(self._G, self._off, self._corners, self.tried)
        self._program = _Program(self._rays)

    def _treat(self, statuses: Ints) -> list[Ints]:
        """Examine a region; return the regions still to be examined, the next one last.

        The list is empty if the region contains no state, or if round-off prevents a decision.
        """
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
        """Return whether the multipliers y, shape (m,), and lambda prove that a region is empty."""
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
        """Compute the smallest F for a set of closed points; return whether F is a new minimum."""
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
        """Return the smallest F of a state with given closed points, and the forces in the state.

        The forces have shape (dim m,). None if this F is not below the smallest F so far.
        """
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
            """Return the minimum over states of the largest |rt| - F rn; inf without a state."""
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
        """Return the root of a decreasing function between 0 and the smallest F so far."""
        top = self._reached
        if excess(top) >= 0:
            return top
        root = float(brentq(excess, 0.0, top, xtol=1e-14, rtol=1e-14))
        return root if excess(root) < np.inf else top
