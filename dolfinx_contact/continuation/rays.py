# SPDX-License-Identifier: LGPL-3.0-or-later
r"""All ways out of a point at which the pieces of an affine system meet.

The directions (dw, dgamma) that lead out solve a system of cones without load, M dw = dgamma q:
the tangent cone. Its solutions are rays. They are found

- by enumeration of the pieces, where these are few: the set is then complete, and rays with
  dgamma = 0, along which gamma stands still, are among them;
- otherwise by unfolding: with a load e added, M w = gamma q + e, the point falls apart into
  branches without degenerate points, each of which comes in along one ray and goes out along
  another. Following them by pivoting from the rays that are known leads to others, and loads drawn
  anew connect them in other pairs. What that does not reach is not found, and nothing is proved.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact.continuation.affine import TOLERANCE, AffinePiece, AffineSystem, Array, Codes

__all__ = ["AffineRay", "Rays", "neighbours", "outgoing", "same_direction", "step"]

_MOST_PIECES = 1024


@dataclass(frozen=True, eq=False)
class AffineRay:
    """A way out: statuses, dw of shape (m, k), and dgamma: 1, -1 or 0."""

    codes: Codes
    direction: Array
    rate: float


@dataclass(frozen=True)
class Rays:
    """The ways out of a point.

    Attributes:
        rays: in no order.
        complete: whether it is proved that there are no others.
        method: how they were found, for people.
    """

    rays: tuple[AffineRay, ...]
    complete: bool
    method: str


def step(system: AffineSystem, codes: Codes, w: Array, direction: Array) -> float:
    """How far a state can go in a direction before an inequality is violated; maybe infinitely."""
    slack, rate = system.slacks(codes, w), system.slacks(codes, direction)
    falling = np.isfinite(slack) & (rate < -TOLERANCE * np.abs(direction).max(initial=0.0))
    return float(np.min(np.maximum(slack[falling], 0.0) / -rate[falling], initial=np.inf))


def neighbours(
    piece: AffinePiece, w: Array, kinked: int, held: npt.NDArray[np.bool_], tolerance: float
) -> list[tuple[AffinePiece, float]]:
    """Pieces that differ in the status of one point, with the sense in which they lead out of w."""
    found = []
    for code in np.flatnonzero(held):
        if code == piece.codes[kinked]:
            continue
        new = piece.neighbour(np.array([kinked]), np.array([code], dtype=np.int8))
        if new is None:
            continue
        w_1 = new.coefficients[1]
        at_border = np.abs(new.system.slacks(new.codes, w)) <= tolerance
        rate = new.system.slacks(new.codes, w_1)[at_border]
        least = -TOLERANCE * np.abs(w_1).max(initial=0.0)
        found += [(new, sense) for sense in (1.0, -1.0) if (sense * rate >= least).all()]
    return found


def outgoing(
    cone: AffineSystem, known: Sequence[AffineRay] = (), *, tries: int = 8, seed: int = 0
) -> Rays:
    """All rays of a tangent cone, as far as they can be found.

    Args:
        cone: a system without load.
        known: rays that are known already.
        tries: number of unfoldings in a row that may bring nothing new.
        seed: of their loads.
    """
    choices = [np.flatnonzero(a) for a in cone.allowed]
    pieces = float(np.prod([float(len(c)) for c in choices]))
    if pieces <= _MOST_PIECES:
        rays = [r for codes in itertools.product(*choices) for r in _rays_of(cone, codes)]
        return Rays(tuple(_distinct([*known, *rays])), True, f"enumeration of {pieces:.0f} pieces")
    return _unfold(cone, known, choices, tries, seed)


def _rays_of(cone: AffineSystem, statuses: Sequence[Any]) -> list[AffineRay]:
    """Rays of one piece: the kernel of [A, -q] inside its cones."""
    codes = np.array(statuses, dtype=np.int8)
    A = np.column_stack([cone.pieced(codes), -cone.rate])
    _, sizes, V = np.linalg.svd(A)
    if sizes[-1] < TOLERANCE * sizes[0]:
        return []  # a cone of more than one dimension; its edges are rays of other pieces
    z, rate = V[-1, :-1], float(V[-1, -1])
    B = cone.bases[np.arange(cone.points), codes]
    w = np.einsum("mkd,md->mk", B, z.reshape(cone.points, -1))
    largest = float(np.abs(w).max(initial=0.0))
    size = abs(rate) if abs(rate) > 1e-9 * largest else largest
    if size == 0:
        return []
    return [
        AffineRay(codes, sense * w / size, float(np.round(sense * rate / size)))
        for sense in (1.0, -1.0)
        if cone.slacks(codes, sense * w).min(initial=np.inf) >= -TOLERANCE * largest
    ]


def _unfold(
    cone: AffineSystem,
    known: Sequence[AffineRay],
    choices: Sequence[npt.NDArray[np.int64]],
    tries: int,
    seed: int,
) -> Rays:
    rays, idle, count = _distinct([*known, *_by_newton(cone, choices)]), 0, 0
    random, size = np.random.default_rng(seed), float(np.abs(cone.rate).max())
    while idle < tries:
        unfolded = replace(cone, load=size * random.standard_normal(len(cone.load)))
        before, ends = len(rays), list[AffineRay]()
        for ray in rays:
            if not any(same_direction(ray, end) for end in ends):
                ends += [end for end in [_other_end(unfolded, ray)] if end is not None]
        rays = _distinct([*rays, *ends])
        idle, count = (idle + 1 if len(rays) == before else 0), count + 1
    return Rays(tuple(rays), False, f"{count} unfoldings of {len(choices)} points")


def _by_newton(cone: AffineSystem, choices: Sequence[npt.NDArray[np.int64]]) -> Iterator[AffineRay]:
    """Rays found at dgamma = 1 and -1 from uniform statuses."""
    for gamma, code in itertools.product((1.0, -1.0), range(cone.bases.shape[1])):
        start = np.array([code if code in c else c[0] for c in choices], dtype=np.int8)
        codes = cone.solve(gamma, start)
        piece = None if codes is None else cone.piece(codes)
        if piece is not None:
            yield AffineRay(piece.codes, piece.at(gamma), gamma)


def _other_end(unfolded: AffineSystem, ray: AffineRay) -> AffineRay | None:
    """The ray by which the branch goes out that comes in by ``ray``; None if it gets lost."""
    if ray.rate == 0:
        return None
    codes = unfolded.solve(1e6 * ray.rate, ray.codes)  # a border point of the ray falls to a side
    piece = None if codes is None else unfolded.piece(codes)
    if piece is None:
        return None
    gamma, sense = 1e6 * ray.rate, -ray.rate
    for _ in range(50 * unfolded.points):
        direction = sense * piece.coefficients[1]
        length = step(unfolded, piece.codes, piece.at(gamma), direction)
        if not np.isfinite(length):
            return AffineRay(piece.codes, direction, sense)
        gamma += sense * length
        w = piece.at(gamma)
        tolerance = TOLERANCE * np.abs(w).max(initial=0.0)
        held = unfolded.statuses_at(w, tolerance)
        kinked = np.flatnonzero(held.sum(axis=1) > 1)
        if len(kinked) != 1:
            return None
        found = neighbours(piece, w, int(kinked[0]), held[kinked[0]], tolerance)
        if len(found) != 1:
            return None
        piece, sense = found[0]
    return None


def same_direction(a: AffineRay, b: AffineRay) -> bool:
    """Whether two rays are one."""
    unit = np.abs(a.direction).max(initial=1e-300)
    return a.rate == b.rate and bool(np.abs(a.direction - b.direction).max() <= 1e-7 * unit)


def _distinct(rays: Sequence[AffineRay] | list[Any]) -> list[AffineRay]:
    kept: list[AffineRay] = []
    for ray in rays:
        if not any(same_direction(ray, other) for other in kept):
            kept.append(ray)
    return kept
