# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Nonsmooth points: the pieces that meet there and the one-sided tangents that lead out.

Where points change their status the branch continues in another piece. A piece has an outgoing ray
if its own events at those points grow along its tangent, in one of the two senses. For one point
the status named by its event is tried first; the others are tried if that fails, or if the parity
of the determinants shows that more branches meet. For k points at once the rays of the tangent cone
are computed, or all their statuses are tried (`ray_finder`). A branch that begins at such a point
has no incoming ray: then all rays are looked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact.continuation.borders import again
from dolfinx_contact.continuation.branch import Change, Ray
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.ray_finder import FoundRays, Kink, RayFinder
from dolfinx_contact.continuation.system import Events, Piece

__all__ = ["Crossing", "cross", "finder_at", "kinks_at", "parity", "rays_out", "reach_of_events"]

_MOST_PIECES = 1024  # that are tried
_PROBE = 1e-6  # length at which one-sided derivatives of events are taken


@dataclass(frozen=True)
class Crossing:
    """The outgoing rays of a nonsmooth point.

    Attributes:
        kinks: number of points that are at a border at once.
        onwards: the ray that is followed; None if nothing that was tried leads on.
        changes: what changes on it.
        parity: see the module; 0 if not evaluated.
        others: further rays, the incoming one excluded.
        complete: whether all pieces that meet have been tried.
        method: how the rays were looked for.
    """

    kinks: int
    onwards: Ray | None
    changes: tuple[Change, ...]
    parity: int
    others: tuple[Ray, ...]
    complete: bool
    method: str = ""


def kinks_at(
    corrector: Corrector, y: PETSc.Vec, piece: Piece, tolerance: float
) -> tuple[Kink, ...]:
    """Points of all ranks with an event within ``tolerance``. Collective."""
    b = corrector.bordered
    x, gamma = b.split(y)
    events = b.system.events(x, gamma, piece)
    mine = []
    seen = set()
    for i in np.flatnonzero(np.abs(events.distance) <= tolerance):
        point = int(events.point[i])
        if point not in seen:
            seen.add(point)
            statuses = tuple(int(s) for s in b.system.statuses(point))
            code = int(piece.codes[point])
            target = int(events.target[i])
            mine.append(Kink(b.comm.rank, point, code, target, statuses))
    return tuple(k for part in b.comm.allgather(mine) for k in part)


def reach_of_events(corrector: Corrector, y: PETSc.Vec, piece: Piece, t: PETSc.Vec) -> float:
    """The largest distance of an event, here or as far as ``t`` leads. Collective.

    At a start without load all distances vanish, and their size is that of what they become.
    """
    b = corrector.bordered
    here, slope = _slopes(corrector, y, piece, t)
    return float(b.comm.allreduce(max(_largest(here.distance), _largest(slope)), op=max))


def finder_at(
    corrector: Corrector, y: PETSc.Vec, kinks: tuple[Kink, ...], *, idle: bool = False
) -> RayFinder:
    """Looks for rays of a nonsmooth point, along which events of the kinks there grow.

    Args:
        corrector: on the bordered system that is followed.
        y: the point.
        kinks: points at a border there.
        idle: whether all of these may stay at their borders along a ray.
    """
    inside = partial(_stays_inside, corrector, y, kinks, idle=idle)
    return RayFinder(corrector, y, inside, PETSc.Vec.norm)


def rays_out(
    corrector: Corrector,
    y: PETSc.Vec,
    piece: Piece,
    t: PETSc.Vec,
    kinks: tuple[Kink, ...],
    tolerance: float,
) -> FoundRays:
    """All rays that lead out of the nonsmooth point ``y``, as far as they can be found. Collective.

    Args:
        corrector: on the bordered system that is followed.
        y: the point.
        piece: one of those that meet there.
        t: direction that is tried first.
        kinks: points at a border.
        tolerance: distances that count as zero.
    """
    b = corrector.bordered
    finder = finder_at(corrector, y, kinks, idle=True)
    found = finder.by_tangent_cone(100 * tolerance)
    if found is None or not (found.rays or found.complete):
        found = _of_pieces(finder, corrector, piece, t, kinks)
    if not found.complete:

        def leads(ray: Ray, away: PETSc.Vec) -> bool:
            return b.inner(ray.tangent, away) > 0.9 * np.sqrt(b.inner(away, away))

        led = [
            finder.led_by_H((sense,), leads, tangent_at_point=False)
            for sense in (1.0, -1.0)
            if not any(sense * b.gamma(ray.tangent) > 0 for ray in found.rays)
        ]
        rays = (*found.rays, *(ray for one in led for ray in one.rays))
        method = "; ".join((found.method, *(one.method for one in led[:1])))
        found = FoundRays(rays, False, method)
    return replace(found, rays=tuple(finder.distinct(found.rays)))


def _of_pieces(
    finder: RayFinder, corrector: Corrector, piece: Piece, t: PETSc.Vec, kinks: tuple[Kink, ...]
) -> FoundRays:
    """Rays of all pieces that have tangents at the point. Collective."""
    found = finder.enumerated(piece, kinks, t, most=_MOST_PIECES)
    rough = finder.rough_statuses(piece, kinks) if found.complete else set()
    if not rough:
        return found
    kept = [r for r in found.rays if not any(_code(corrector, r.piece, k) in rough for k in kinks)]
    return FoundRays(tuple(kept), False, f"{found.method}, some of which have no tangent there")


def cross(
    corrector: Corrector, y: PETSc.Vec, piece: Piece, t: PETSc.Vec, tolerance: float
) -> Crossing:
    """Pass the nonsmooth point ``y``, come to by ``piece`` along ``t``. Collective."""
    kinks = kinks_at(corrector, y, piece, tolerance)
    finder = finder_at(corrector, y, kinks)
    if len(kinks) > 1:
        found = finder.by_tangent_cone(100 * tolerance)
        if found is not None:
            return _of_all(finder, corrector, t, kinks, found)
    natural = tuple(k.target for k in kinks)
    rays = _not_back(corrector, piece, t, finder.of_statuses(piece, kinks, natural, t))
    sign = parity(corrector, y, piece, t, rays[0]) if len(rays) == 1 else 0
    found = FoundRays((), False, "")
    if len(kinks) > 1 or len(rays) != 1 or sign <= 0:
        found = finder.enumerated(piece, kinks, t, most=_MOST_PIECES, tried=natural)
        rays += _not_back(corrector, piece, t, found.rays)
    if not rays and not found.complete:
        found = _led_by_H(finder, corrector, piece, t)
        rays = list(found.rays)
    if not rays:
        return Crossing(len(kinks), None, (), sign, (), found.complete)
    onwards, *others = finder.distinct(rays)
    crossing = _crossing(corrector, kinks, onwards, others, sign, found.complete)
    return replace(crossing, method=found.method)


def _led_by_H(finder: RayFinder, corrector: Corrector, incoming: Piece, t: PETSc.Vec) -> FoundRays:
    """The ray on which the corrector for H itself ends; or none. Others are not looked for."""
    b = corrector.bordered
    forwards = 1.0 if b.gamma(t) >= 0 else -1.0

    def leads(ray: Ray, away: PETSc.Vec) -> bool:
        along = b.inner(ray.tangent, away) > 0.9 * np.sqrt(b.inner(away, away))
        return along and bool(_not_back(corrector, incoming, t, [ray]))

    return finder.led_by_H((forwards, -forwards), leads, tangent_at_point=False)


def _of_all(
    finder: RayFinder,
    corrector: Corrector,
    t: PETSc.Vec,
    kinks: tuple[Kink, ...],
    found: FoundRays,
) -> Crossing:
    """The crossing by all rays, without that which leads back; the straightest leads onwards."""
    b = corrector.bordered
    rays = [r for r in finder.distinct(found.rays) if b.inner(r.tangent, t) > -1 + 1e-6]
    if not rays:
        return Crossing(len(kinks), None, (), 0, (), found.complete, found.method)
    onwards, *others = sorted(rays, key=lambda r: -b.inner(r.tangent, t))
    crossing = _crossing(corrector, kinks, onwards, others, 0, found.complete)
    return replace(crossing, method=found.method)


def _crossing(
    corrector: Corrector,
    kinks: tuple[Kink, ...],
    onwards: Ray,
    others: Sequence[Ray],
    sign: int,
    complete: bool,
) -> Crossing:
    after = {k: _code(corrector, onwards.piece, k) for k in kinks}
    changes = tuple(Change(k.rank, k.point, k.code, c) for k, c in after.items() if c != k.code)
    return Crossing(len(kinks), onwards, changes, sign, tuple(others), complete)


def parity(corrector: Corrector, y: PETSc.Vec, piece: Piece, t: PETSc.Vec, ray: Ray) -> int:
    """Sign of det J_1 / det J_0 with J = [grad H; t^T] across the point ``y``. Collective."""
    b = corrector.bordered
    rows = b.vector(), b.vector()
    for row, tangent in zip(rows, (t, ray.tangent), strict=True):
        b.dual(tangent, row)
    sign = b.solver.determinant_quotient(y, (rows[0], piece), (rows[1], ray.piece))
    for row in rows:
        row.destroy()
    return sign


def _code(corrector: Corrector, piece: Piece, kink: Kink) -> int:
    comm = corrector.bordered.comm
    mine = int(piece.codes[kink.point]) if comm.rank == kink.rank else None
    return int(comm.bcast(mine, root=kink.rank))


def _stays_inside(
    corrector: Corrector, y: PETSc.Vec, kinks: tuple[Kink, ...], ray: Ray, *, idle: bool
) -> bool:
    """Whether the events of the kinked points that vanish at ``y`` grow along a ray. Collective."""
    b = corrector.bordered
    points = np.array([k.point for k in kinks if k.rank == b.comm.rank], dtype=np.int32)
    here, slope = _slopes(corrector, y, ray.piece, ray.tangent)
    chosen = np.isin(here.point, points)
    largest = b.comm.allreduce(_largest(slope), op=max)
    furthest = b.comm.allreduce(_largest(here.distance), op=max)
    # An event that is at its border must grow; one that is away from it must be inside. Distances
    # count as zero up to what a hundredth of the probe would change, and round-off.
    border = max(1e-2 * largest * _PROBE, 1e-11 * furthest)
    at_border = np.abs(here.distance) <= border
    bad = chosen & np.where(at_border, slope < -1e-7 * largest, here.distance < 0)
    rests = chosen & at_border & (np.abs(slope) <= 1e-7 * largest)
    inside = not b.comm.allreduce(bool(bad.any()), op=MPI.LOR)
    moves = b.comm.allreduce(bool((chosen & at_border & ~rests).any()), op=MPI.LOR)
    return inside and (moves or idle)


def _slopes(
    corrector: Corrector, y: PETSc.Vec, piece: Piece, t: PETSc.Vec
) -> tuple[Events, npt.NDArray[np.float64]]:
    """The events of a piece at ``y``, and how fast their distances grow along ``t``. Collective."""
    b = corrector.bordered
    x, gamma = b.split(y)
    here = b.system.events(x, gamma, piece)
    probe = y.copy()
    probe.axpy(_PROBE, t)
    x, gamma = b.split(probe)
    there = b.system.events(x, gamma, piece)
    probe.destroy()
    slope = np.asarray((again(here, there) - here.distance) / _PROBE, dtype=np.float64)
    return here, slope


def _not_back(corrector: Corrector, piece: Piece, t: PETSc.Vec, rays: Sequence[Ray]) -> list[Ray]:
    """Rays without the incoming one."""
    kept = []
    for ray in rays:
        same_piece = corrector.bordered.comm.allreduce(
            bool(np.array_equal(ray.piece.codes, piece.codes)), op=MPI.LAND
        )
        if not (same_piece and corrector.bordered.inner(ray.tangent, t) < 0):
            kept.append(ray)
    return kept


def _largest(values: npt.NDArray[Any]) -> float:
    return float(np.max(np.abs(values), initial=0.0))
