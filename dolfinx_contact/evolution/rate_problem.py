# SPDX-License-Identifier: LGPL-3.0-or-later
"""The rate problem: directions in which an evolution can continue from an accepted state.

**On a path** (`RateProblem`). Let H(x, gamma) = 0 be the equations of the contact problem under the
load gamma, with fixed memory. At a state y = (x, gamma) whose memory has just been accepted, every
slipping point is at the border of stick, and every breaking bond is at the border of the intact
status. H has one linearisation J for each piece, that is, for each choice of statuses of the points
at a border. A direction t solves the rate problem if, for one of these pieces,

    J t = 0,        d'(t) >= 0 for all distances d to borders of the piece with d(y) = 0.

Solutions are searched for in this order:

1. The statuses and the tangent of the last step.
2. Newton's method for the rate problem: points whose distance to a border decreases take the status
   beyond it, all simultaneously. If this cycles, only the point whose distance decreases at the
   highest rate does so. The direction is oriented such that det [J; t^T] keeps its sign, which it
   does along a path unless another path crosses. This distinguishes snap-back from unloading.
3. All pieces meeting at the state, if they are at most 256. The result is complete and may
   contain several directions or none.
4. H itself, with recomputed statuses, close to the state.

One solution leads back: it unloads, without slip or damage. It reverses the incoming direction and
is not counted.

**In time** (`rays_of_step`). The data of a step change from its start (gamma = 0) to its end
(gamma = 1) along a straight line, with the memory m_n of the start:

    H(x, gamma; m_n) = 0,        0 <= gamma <= 1.

The rate problem at gamma = 0 is a problem of polyhedral cones (`continuation.cone_rays`). Several
rays with growing gamma may exist: with large friction a point can stick or slip under the same rate
of the load (Klarbring, Ing.-Arch. 60, 1990). If all pieces were tried and no such ray exists, the
state jumps (`jumps`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array, Codes, Indices
from dolfinx_contact._mpi import any_rank, maximum
from dolfinx_contact.continuation.branch import FoundRays, Ray
from dolfinx_contact.continuation.cone_rays import outgoing
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.ray_finder import Kink, RayFinder, parity
from dolfinx_contact.continuation.system import Events, Piece, matched_distances
from dolfinx_contact.equations.evaluation import Statuses
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.reduced.reduction import Reduction
from dolfinx_contact.reduced.scope import can_condense
from dolfinx_contact.solvers.load_following import Loaded

__all__ = ["RateProblem", "loaded", "rays_of_step"]

_PROBE = 1e-4  # arc length of central differences
_AT_BORDER = 1e-8  # fraction of the largest distance to a border that counts as zero, in time
_IDLE = 1e-10  # fraction of the largest rate that counts as zero
_ROUNDS = 40  # largest number of iterations of Newton's method
_MOST_PIECES = 256  # largest number of pieces that are enumerated
_ALIKE = 1e-6  # relative difference of equal rates
_DIGITS = 6  # digits of cosines that distinguish directions

_LAST_STATUSES = "the statuses of the last step"
_NEWTON = "Newton's method for the rate problem"
_ALL = "all statuses that meet"
_SOME = "some of the statuses that meet"


@dataclass(frozen=True)
class _Falling:
    """Changes of status that occur along a direction, in ascending order of their rates.

    Each array has one entry per change on this rank.

    Attributes:
        points: local numbers of the points.
        targets: new statuses.
        rates: rates at which the distances to the changes decrease.
    """

    points: Indices
    targets: Codes
    rates: Array


class RateProblem:
    """Search for the directions out of a state, with the memory of the system. Collective.

    Args:
        corrector: corrector of the bordered system.
        y: state (x, gamma).
        at_border: largest distance at which a point counts as at a border (change of status).
        beyond: distance by which a point must have passed a border to count as beyond it.
    """

    def __init__(self, corrector: Corrector, y: PETSc.Vec, at_border: float, beyond: float):
        self._corrector = corrector
        self._bordered = corrector.bordered
        self._comm = corrector.bordered.comm
        self._y = y
        self._at_border = at_border
        self._beyond = beyond
        self._finder = RayFinder(corrector, y, self._leads_out)

    def onwards(self, piece: Piece, t: PETSc.Vec, *, every: bool) -> FoundRays[Ray]:
        """Return the directions in which a path that arrived at the state can continue.

        Args:
            piece: statuses of the last step.
            t: direction of the last step at the state.
            every: whether to try all combinations of statuses, even if Newton's method finds a
                direction; not done if a direction exists with the statuses of the last step.

        Returns:
            Outgoing directions, without the direction that leads back; the path continues along the
            first.
        """
        incoming = Ray(piece, t)
        if self._leads_out(incoming):
            return FoundRays((incoming,), False, _LAST_STATUSES)
        newton = self._by_newton(piece, t)
        if newton and not every:
            return FoundRays(newton, False, _NEWTON)
        enumerated = self._enumerated(piece, t)
        rays = self._without_back((*newton, *enumerated.rays) or self._next_to_state(t), incoming)
        if not newton:
            # the straightest direction first; equal ones keep their order
            rays.sort(key=lambda r: -round(self._bordered.inner(r.tangent, t), _DIGITS))
        method = _ALL if enumerated.complete else _SOME
        return FoundRays(tuple(rays), enumerated.complete, method)

    def back(self, piece: Piece, t: PETSc.Vec) -> FoundRays[Ray]:
        """Return the unloading direction of a path that arrived along ``t``."""
        reverse = t.copy()
        reverse.scale(-1.0)
        return FoundRays(self._by_newton(piece, reverse), False, _NEWTON)

    def from_start(self, piece: Piece, towards: PETSc.Vec) -> FoundRays[Ray]:
        """Return a direction in which a path leaves its start.

        Args:
            piece: statuses with which the search begins.
            towards: vector that encloses an angle of at most 90 degrees with the direction.
        """
        newton = self._by_newton(piece, towards, oriented=False)
        return FoundRays(newton or self._next_to_state(towards), False, _NEWTON)

    # -- one piece -------------------------------------------------------------------------------

    def _leads_out(self, ray: Ray) -> bool:
        """Return whether the statuses of a direction remain correct along this direction."""
        return not any_rank(self._comm, len(self._falling(ray).points) > 0)

    def _falling(self, ray: Ray) -> _Falling:
        """Return the changes of status that occur when a state moves along a direction."""
        present = self._events(ray, 0.0)
        slopes = _slopes(present, self._events(ray, _PROBE), self._events(ray, -_PROBE))
        largest = self._bordered.largest(slopes)
        at_border = np.abs(present.distance) <= self._at_border
        crosses = at_border & (slopes < -_IDLE * largest) | (present.distance < -self._beyond)
        falling = np.flatnonzero(crosses)
        falling = falling[np.argsort(-slopes[falling], kind="stable")]
        return _Falling(present.point[falling], present.target[falling], -slopes[falling])

    def _events(self, ray: Ray, shift: float) -> Events:
        """Return the distances to changes of status next to the state, along a direction.

        Args:
            ray: direction with its statuses.
            shift: arc length from the state at which the distances are evaluated.
        """
        y = self._bordered.moved(self._y, shift, ray.tangent)
        return self._bordered.events(y, ray.piece)

    def _by_newton(self, piece: Piece, t: PETSc.Vec, *, oriented: bool = True) -> tuple[Ray, ...]:
        """Find a direction along which no status changes, using Newton's method.

        Args:
            piece: initial statuses.
            t: direction with the initial statuses if ``oriented``; otherwise a vector that encloses
                an angle of at most 90 degrees with the result.
            oriented: whether the result is oriented such that the determinant of the Jacobian with
                the direction as last row keeps its sign.
        """
        for one_by_one in (False, True):
            ray = self._iterate(piece, t, oriented, one_by_one=one_by_one)
            if ray is not None:
                return (ray,)
        return ()

    def _iterate(
        self, first: Piece, t: PETSc.Vec, oriented: bool, *, one_by_one: bool
    ) -> Ray | None:
        """Return the ray found by Newton's method; None if the method cycles or finds no tangent.

        Args:
            first: initial statuses.
            t: see `_by_newton`.
            oriented: see `_by_newton`.
            one_by_one: whether only one point changes its status in an iteration.
        """
        tried: set[bytes] = set()
        piece = first
        for _ in range(_ROUNDS):
            codes = b"".join(self._comm.allgather(piece.codes.tobytes()))
            if codes in tried:
                return None
            tried.add(codes)
            tangent = self._corrector.tangent(self._y, t, piece)
            if tangent is None:
                return None
            ray = Ray(piece, tangent)
            changed = oriented and piece is not first
            if changed and parity(self._corrector, self._y, first, t, ray) < 0:
                tangent.scale(-1.0)
            falling = self._falling(ray)
            if not any_rank(self._comm, len(falling.points) > 0):
                return ray
            if one_by_one:
                falling = self._steepest(falling)
            piece = piece.with_codes(falling.points, falling.targets)
        return None

    def _steepest(self, falling: _Falling) -> _Falling:
        """Return only the change of status with the highest rate on any rank. Collective.

        If rates are equal, it is the change of the first point in `System.order`.
        """
        rates = falling.rates
        steepest = maximum(self._comm, rates, -np.inf)
        order = self._bordered.system.order()[falling.points]
        candidates = [
            (int(order[k]), int(falling.targets[k]), self._comm.rank, int(k))
            for k in np.flatnonzero(rates >= steepest - _ALIKE * abs(steepest))
        ]
        _, _, rank, k = min(c for part in self._comm.allgather(candidates) for c in part)
        chosen = slice(k, k + 1) if self._comm.rank == rank else slice(0)
        return _Falling(falling.points[chosen], falling.targets[chosen], rates[chosen])

    # -- several pieces --------------------------------------------------------------------------

    def _enumerated(self, piece: Piece, t: PETSc.Vec) -> FoundRays[Ray]:
        """Try all statuses of the points at a border, up to a limit, from the direction ``t``."""
        system = self._bordered.system
        order = system.order()
        events = self._bordered.events(self._y, piece)
        at_border = np.abs(events.distance) <= self._at_border
        placed = []
        for i in np.unique(events.point[at_border]):
            code = int(piece.codes[i])
            targets = events.target[at_border & (events.point == i)].tolist()
            statuses = tuple(sorted({code, *targets}))
            kink = Kink(self._comm.rank, int(i), code, targets[0], statuses)
            placed.append((int(order[i]), kink))
        every = [pair for part in self._comm.allgather(placed) for pair in part]
        kinks = [kink for _, kink in sorted(every, key=lambda pair: pair[0])]
        return self._finder.enumerated(piece, kinks, t, most=_MOST_PIECES)

    def _next_to_state(self, t: PETSc.Vec) -> tuple[Ray, ...]:
        """Search for a solution of H close to the state; return the direction towards it."""
        sense = 1.0 if self._bordered.gamma(t) >= 0 else -1.0
        led = self._finder.led_by_H(
            (sense,), lambda ray, _away: self._leads_out(ray), tangent_at_point=True
        )
        return () if led is None else (led,)

    def _without_back(self, rays: Sequence[Ray], incoming: Ray) -> list[Ray]:
        """Return directions without duplicates and without the direction that leads back."""
        back = self.back(incoming.piece, incoming.tangent).rays
        onwards = [r for r in rays if not any(self._finder.same(r, b) for b in back)]
        return self._finder.distinct(onwards)


def _slopes(present: Events, ahead: Events, behind: Events) -> Array:
    """Return derivatives of distances to changes of status along a direction.

    They are central differences. If a change is possible on one side only, such as the breaking of
    an intact bond, the difference is one-sided; if on neither side, the result is 0.

    Args:
        present: distances at the state.
        ahead: distances at the arc length `_PROBE` along the direction.
        behind: distances at the same arc length in the opposite direction.
    """
    missing = np.full_like(present.distance, np.nan)
    after, before = (matched_distances(present, events, missing) for events in (ahead, behind))
    sides = np.isfinite(after).astype(float) + np.isfinite(before)
    after = np.where(np.isfinite(after), after, present.distance)
    before = np.where(np.isfinite(before), before, present.distance)
    return np.asarray((after - before) / (np.maximum(sides, 1.0) * _PROBE))


# -- in time ---------------------------------------------------------------------------------------


def rays_of_step(problem: ContactProblem) -> FoundRays[Statuses] | None:
    """Return the statuses with which a state can continue in a step. Collective.

    Args:
        problem: problem of the step (`ContactProblem.step_from`), with the start of the step in its
            Functions and the data of the end of the step.

    Returns:
        Statuses of each solution of the rate problem with growing load, surface by surface on this
        rank. None if the states with fixed statuses do not form polyhedral cones (`reduced.scope`),
        data of the surfaces change in the step, or the stiffness of the body is singular even with
        fixed contact points.
    """
    with loaded(problem) as (system, x):
        if not can_condense(system) or not system.leaves_surfaces_alone():
            return None
        try:
            condensed = Reduction(system, x, 0.0, exact=False)
        except RuntimeError:
            return None
        try:
            w = condensed.contract(x)
            cone = condensed.system.tangent_cone(w, _AT_BORDER * float(np.abs(w).max()))
            found = outgoing(cone)
            pieces = [condensed.piece(ray.codes) for ray in found.rays if ray.rate > 0]
        finally:
            condensed.destroy()
        statuses = [system.statuses_of(piece) for piece in pieces]
        rays = tuple(s for s in statuses if s is not None)
        return FoundRays(rays, found.complete, found.method)


@contextmanager
def loaded(problem: ContactProblem) -> Iterator[tuple[Loaded, PETSc.Vec]]:
    """Context with the system H(x, gamma) of a step (gamma 0 to 1) and its initial unknowns.

    Collective.
    """
    equations = problem.equations
    x = problem.create_vector()
    problem.write(x)
    try:
        with equations.ramped(x) as ramp:
            system = Loaded(equations, lambda: problem.linear_solver, ramp)
            try:
                yield system, x
            finally:
                system.destroy()
    finally:
        x.destroy()
