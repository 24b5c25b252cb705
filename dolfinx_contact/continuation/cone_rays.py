# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rays of the tangent cone at a point where pieces of an affine system meet.

A ray is a change (dw, dgamma) of variables and parameter with which a solution leaves the point: M
dw = dgamma q, with coefficients M and load q of the system, and dw in the cones of the points. Two
methods compute the rays:

- *Enumeration* of all pieces (combinations of statuses), up to `MOST_PIECES`. The set is complete
  and includes rays with dgamma = 0, along which gamma is constant.
- *Unfolding* otherwise. With an additional load e, the system M w = gamma q + e has branches
  without degenerate points, each of which arrives along one ray and leaves along another. The
  branches are traced by pivoting, from the rays found so far and from a random state, which defines
  e. Different loads e connect different pairs of rays. Unfolding does not prove completeness; the
  system may provide a proof (`System.prove_rays`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from dolfinx_contact._arrays import Array, Codes, Ints, Mask
from dolfinx_contact.continuation.affine import (
    TOLERANCE,
    AffinePiece,
    AffineSystem,
    largest,
)
from dolfinx_contact.continuation.branch import FoundRays
from dolfinx_contact.continuation.system import RayProof

__all__ = [
    "MOST_PIECES",
    "AffineRay",
    "Rays",
    "distinct",
    "neighbours",
    "outgoing",
    "same_direction",
]

Item = TypeVar("Item")
Choices = Sequence[Ints]
#: Search for a proof that a cone has no rays other than the ones passed.
Prove = Callable[[AffineSystem, Sequence[tuple[Codes, float]]], RayProof | None]

MOST_PIECES = 65536  # largest number of pieces to enumerate
_MOST_IDLE = 6  # consecutive unfoldings without a new ray
_CHUNK = 4096  # pieces solved together
_SINGULAR = 1e-14  # singular values that are round-off, relative to the largest


@dataclass(frozen=True, eq=False)
class AffineRay:
    """Direction in which a solution of an affine system with m points can continue.

    Attributes:
        codes: statuses of the points along the ray, shape (m,).
        direction: direction dw of the variables, shape (m, k).
        rate: rate dgamma of the parameter: 1, -1 or 0.
    """

    codes: Codes
    direction: Array
    rate: float


@dataclass(frozen=True)
class Rays(FoundRays[AffineRay]):
    """Outgoing rays of a tangent cone.

    Attributes:
        continua: pieces that contain a continuum of rays. Each entry consists of the statuses of
            the piece and those members of `rays` that lie in the piece or on its border.
    """

    continua: tuple[tuple[Codes, tuple[AffineRay, ...]], ...] = ()


def neighbours(
    piece: AffinePiece, w: Array, kinked: int, possible: Mask, tolerance: float
) -> list[tuple[AffinePiece, float]]:
    """Return the systems on which a branch can continue after a single point changes status.

    Args:
        piece: affine system with the statuses with which the branch arrives.
        w: state at which it arrives, shape (m, k).
        kinked: index of the only point whose status can change.
        possible: mask of the statuses whose closed cones contain the variables of this point, shape
            (statuses,).
        tolerance: value of a cone inequality that counts as zero.

    Returns:
        Affine systems, each with the direction of gamma, 1 or -1, in which the branch continues.
    """
    pieces = []
    for code in np.flatnonzero(possible):
        if code == piece.codes[kinked]:
            continue
        new = piece.neighbour(kinked, int(code))
        if new is None:
            continue
        w_1 = new.coefficients[1]
        C = new.system.inequalities[kinked, code]
        rate = (C @ w_1[kinked])[np.abs(C @ w[kinked]) <= tolerance]
        least = -TOLERANCE * largest(w_1)
        pieces += [(new, sense) for sense in (1.0, -1.0) if (sense * rate >= least).all()]
    return pieces


def outgoing(
    cone: AffineSystem, known: Sequence[AffineRay] = (), *, prove: Prove | None = None
) -> Rays:
    """Find the rays of a tangent cone: directions in which solutions can continue.

    Args:
        cone: tangent cone, an affine system without constant load.
        known: rays that have already been computed; default: none.
        prove: function that searches for a proof that unfolding has found all rays; default: no
            proof.

    Raises:
        ValueError: if the system contains a number that is not finite.
    """
    cone.require_finite()
    choices = [np.flatnonzero(a) for a in cone.allowed]
    if not all(len(c) for c in choices):
        reason = "no enumeration: a point is in no cone, due to round-off"
        return Rays(tuple(known), False, reason)
    pieces = math.prod(len(c) for c in choices)
    if pieces > MOST_PIECES:
        unfolded = _unfold(cone, known, choices)
        proof = None if prove is None else prove(cone, [(r.codes, r.rate) for r in unfolded.rays])
        return unfolded if proof is None else _with_proof(cone, unfolded, proof)
    with np.errstate(over="ignore", invalid="ignore"):
        enumerated, wide, gap = _enumerate(cone, choices)
    rays = distinct([*known, *enumerated], same_direction)
    edges = [(codes, _rays_in(cone, codes, rays)) for codes in wide]
    continua = tuple((codes, ends) for codes, ends in edges if len(ends) > 1)
    if continua:
        gap += ", with continua between these"
    return Rays(tuple(rays), not gap, f"enumeration of {pieces} pieces{gap}", continua)


def _with_proof(cone: AffineSystem, unfolded: Rays, proof: RayProof) -> Rays:
    """Add the rays of a proof to the rays found by unfolding.

    The result is complete if the proof is complete and the matrices of all its rays are regular.
    """
    pieces = [(cone.piece(codes), rate) for codes, rate in proof.rays]
    certain = [AffineRay(p.codes, p.at(rate), rate) for p, rate in pieces if p is not None]
    complete = proof.verdict == "complete" and len(certain) == len(pieces)
    rays = distinct([*unfolded.rays, *certain], same_direction)
    return Rays(tuple(rays), complete, f"{unfolded.method}, {proof.method}")


def _rays_in(cone: AffineSystem, codes: Codes, rays: Sequence[AffineRay]) -> tuple[AffineRay, ...]:
    """Return the rays whose directions lie in the closed cones of the statuses ``codes``."""
    points = np.arange(cone.points)
    return tuple(
        r
        for r in rays
        if cone.statuses_at(r.direction, 1e-8 * largest(r.direction))[points, codes].all()
    )


# -- enumeration -----------------------------------------------------------------------------------


def _enumerate(cone: AffineSystem, choices: Choices) -> tuple[list[AffineRay], list[Codes], str]:
    """Find the rays for all combinations of statuses.

    Returns:
        Rays; combinations of statuses with infinitely many rays, of which only the extreme ones,
        found with other statuses, are returned; and the reason why rays may be missing, "" if the
        rays are complete.
    """
    m, d, N = cone.points, cone.bases.shape[3], len(cone.rate)
    kinked = np.array([i for i, c in enumerate(choices) if len(c) > 1], dtype=int)
    codes = np.array([c[0] for c in choices], dtype=np.int8)
    # eliminate the points with one status, unless their columns are dependent
    smooth = np.setdiff1d(np.arange(m), kinked)
    fixed: Array = cone.pieced(codes).reshape(N, m, d)[:, smooth].reshape(N, d * len(smooth))
    singular = len(smooth) > 0 and np.linalg.matrix_rank(fixed) < d * len(smooth)
    if len(kinked) == 0 or singular:
        kinked = np.arange(m)
        smooth = smooth[:0]
        fixed = fixed[:, :0]
    Q = np.linalg.qr(fixed, mode="complete")[0][:, fixed.shape[1] :]
    M = np.einsum("np,nmk->pmk", Q, cone.matrix[:, kinked])
    q = Q.T @ cone.rate
    B = cone.bases[kinked]
    C = cone.inequalities[kinked]
    columns = np.einsum("pmk,mskd->mspd", M, B)  # of A, for every point and status
    points = np.arange(len(kinked))
    rays: list[AffineRay] = []
    wide: list[Codes] = []
    gap = ""
    every = itertools.product(*(choices[i] for i in kinked))
    while chunk := list(itertools.islice(every, _CHUNK)):
        # solve A z = q for a chunk of pieces
        statuses = np.array(chunk, dtype=np.int8).reshape(len(chunk), len(kinked))
        A = np.moveaxis(columns[points, statuses], 1, 2).reshape(len(chunk), len(q), -1)
        regular, z = _solve_all(A, q)
        w = np.einsum("cmkd,cmd->cmk", B[points, statuses], z.reshape(len(A), -1, d))
        if not np.isfinite(w).all():
            return rays, wide, ", which overflowed"
        # keep the pieces containing the solution or its reverse, and examine the singular ones
        slack = np.einsum("cmek,cmk->cme", C[points, statuses], w)
        tolerance = TOLERANCE * np.abs(w).max(axis=(1, 2), initial=0.0)
        least, most = (f(axis=(1, 2), initial=0.0) for f in (slack.min, slack.max))
        for i in np.flatnonzero(~regular | (least >= -tolerance) | (most <= tolerance)):
            codes[kinked] = statuses[i]
            dimension, vector = (1, (z[i], 1.0)) if regular[i] else _kernel(A[i], q)
            if dimension > 1:
                wide.append(codes.copy())
            elif dimension < 0:
                gap = ", some of which are too badly conditioned"
            elif vector is not None:
                rays += _senses(cone, codes.copy(), kinked, smooth, fixed, *vector)
    return rays, wide, gap


def _solve_all(A: Array, q: Array) -> tuple[Mask, Array]:
    """Solve A_i z_i = q; return a mask of the regular A_i, and z_i, 0 for singular A_i."""
    sizes = np.abs(A).max(axis=(1, 2), initial=0.0) * A.shape[1]
    inverse = _inverses(A)
    regular = np.abs(inverse).max(axis=(1, 2), initial=0.0) * sizes < 1e10
    return regular, np.where(regular[:, None], np.where(np.isfinite(inverse), inverse, 0) @ q, 0.0)


def _inverses(A: Array) -> Array:
    """Return the inverses of a stack of matrices, with infinite entries for singular ones."""
    try:
        return np.asarray(np.linalg.inv(A))
    except np.linalg.LinAlgError:
        if len(A) == 1:
            return np.full_like(A, np.inf)
        half = len(A) // 2
        return np.concatenate([_inverses(A[:half]), _inverses(A[half:])])


def _kernel(A: Array, q: Array) -> tuple[int, tuple[Array, float] | None]:
    """Return the dimension of the kernel of [A, -q]; for dimension 1 also its vector (z, dgamma).

    The dimension is -1 if round-off prevents the decision whether A is regular.
    """
    values = np.linalg.svd(A, compute_uv=False)
    if _SINGULAR * values[0] < values[-1] <= TOLERANCE * values[0]:
        return -1, None
    _, values, V = np.linalg.svd(np.column_stack([A, -q]))
    if values[-1] <= TOLERANCE * values[0]:
        return 1 + int(np.sum(values <= TOLERANCE * values[0])), None
    return 1, (V[-1, :-1], float(V[-1, -1]))


def _senses(
    cone: AffineSystem,
    codes: Codes,
    kinked: Ints,
    smooth: Ints,
    fixed: Array,
    z: Array,
    rate: float,
) -> Iterator[AffineRay]:
    """Yield a kernel vector and its reverse as rays, if they lie inside the cones.

    Args:
        cone: tangent cone.
        codes: statuses of the points.
        kinked: indices of the points that may take several statuses (kinked points).
        smooth: indices of the eliminated points, which may take one status only.
        fixed: columns of M B (`AffineSystem.pieced`) of the eliminated points.
        z: coordinates of the kinked points in the bases of their cones.
        rate: component dgamma of the kernel vector.
    """
    B = cone.of_codes(cone.bases, codes)
    w: Array = np.zeros(cone.matrix.shape[1:])
    w[kinked] = np.einsum("mkd,md->mk", B[kinked], z.reshape(len(kinked), -1))
    # the kinked points alone exclude most pieces without a solve for the others
    slack = cone.slacks(codes, w)[kinked]
    senses = [s for s in (1.0, -1.0) if _least(s * slack) >= -TOLERANCE * largest(w)]
    if not senses:
        return
    if len(smooth):
        rest = rate * cone.rate - np.einsum("nmk,mk->n", cone.matrix[:, kinked], w[kinked])
        z_smooth = np.linalg.lstsq(fixed, rest)[0]
        w[smooth] = np.einsum("mkd,md->mk", B[smooth], z_smooth.reshape(len(smooth), -1))
    scale = largest(w)
    size = abs(rate) if abs(rate) > 1e-9 * scale else scale
    slack = cone.slacks(codes, w)
    for sense in senses if size > 0 else ():
        if _least(sense * slack) >= -TOLERANCE * scale:
            direction: Array = np.asarray(sense * w / size, dtype=np.float64)
            yield AffineRay(codes, direction, float(np.round(sense * rate / size)))


def _least(slack: Array) -> float:
    """Return the smallest finite value of the cone inequalities; inf if there is none."""
    return float(np.min(slack[np.isfinite(slack)], initial=np.inf))


# -- unfolding -------------------------------------------------------------------------------------


def _unfold(cone: AffineSystem, known: Sequence[AffineRay], choices: Choices) -> Rays:
    rays = distinct([*known, *_by_newton(cone, choices)], same_direction)
    idle = 0
    count = 0
    random = np.random.default_rng(0)
    while idle < _MOST_IDLE:
        codes, w = _random_state(cone, choices, random)
        unfolded = replace(cone, load=np.einsum("nmk,mk->n", cone.matrix, w))
        before = len(rays)
        ends: list[AffineRay] = []
        piece = unfolded.piece(codes)
        if piece is not None:
            far = (_far_end(piece, 0.0, sense) for sense in (1.0, -1.0))
            ends += [end for end in far if end is not None]
        for ray in rays:
            if not any(same_direction(ray, end) for end in ends):
                end = _other_end(unfolded, ray)
                ends += [] if end is None else [end]
        rays = distinct([*rays, *ends], same_direction)
        idle = idle + 1 if len(rays) == before else 0
        count += 1
    return Rays(tuple(rays), False, f"{count} unfoldings of {len(choices)} points")


def _random_state(
    cone: AffineSystem, choices: Choices, random: np.random.Generator
) -> tuple[Codes, Array]:
    """Return random statuses and a random state, inside their cones if found in 100 trials."""
    codes = np.array([random.choice(c) for c in choices], dtype=np.int8)
    B = cone.of_codes(cone.bases, codes)
    w: Array = np.zeros(cone.matrix.shape[1:])
    outside = np.ones(cone.points, dtype=bool)
    for _ in range(100):
        z = random.standard_normal((cone.points, B.shape[2]))
        w = np.where(outside[:, None], np.einsum("mkd,md->mk", B, z), w)
        outside = cone.slacks(codes, w).min(axis=1, initial=np.inf) < 0
        if not outside.any():
            break
    return codes, w


def _by_newton(cone: AffineSystem, choices: Choices) -> Iterator[AffineRay]:
    """Yield rays with dgamma = 1 and -1 that Newton's method finds from uniform statuses."""
    for gamma, code in itertools.product((1.0, -1.0), range(cone.bases.shape[1])):
        start = np.array([code if code in c else c[0] for c in choices], dtype=np.int8)
        codes = cone.solve(gamma, start)
        piece = None if codes is None else cone.piece(codes)
        if piece is not None:
            yield AffineRay(piece.codes, piece.at(gamma), gamma)


def _other_end(unfolded: AffineSystem, ray: AffineRay) -> AffineRay | None:
    """Return the ray along which the unfolded branch arriving along ``ray`` leaves.

    The result is None if gamma is constant along ``ray`` or the branch cannot be traced.
    """
    if ray.rate == 0:
        return None
    codes = unfolded.solve(1e6 * ray.rate, ray.codes)  # moves points of the ray off borders
    piece = None if codes is None else unfolded.piece(codes)
    return None if piece is None else _far_end(piece, 1e6 * ray.rate, -ray.rate)


def _far_end(piece: AffinePiece, gamma: float, sense: float) -> AffineRay | None:
    """Trace a branch to infinity; return the ray along which it ends, None on failure.

    Args:
        piece: affine system with the statuses at the start.
        gamma: parameter at the start.
        sense: direction of gamma at the start, 1 or -1.
    """
    unfolded = piece.system
    for _ in range(50 * unfolded.points):
        direction = sense * piece.coefficients[1]
        length = unfolded.step(piece.codes, piece.at(gamma), direction)
        if not np.isfinite(length):
            return AffineRay(piece.codes, direction, sense)
        gamma += sense * length
        w = piece.at(gamma)
        tolerance = TOLERANCE * largest(w)
        at_border = np.abs(unfolded.slacks(piece.codes, w)) <= tolerance
        kinked = np.flatnonzero(at_border.any(axis=1))
        if len(kinked) != 1:
            return None
        i = int(kinked[0])
        beyond = neighbours(piece, w, i, unfolded.statuses_at(w, tolerance)[i], tolerance)
        if len(beyond) != 1:
            return None
        piece, sense = beyond[0]
    return None


def same_direction(a: AffineRay, b: AffineRay) -> bool:
    """Return True if two rays have the same direction, including the rate of gamma."""
    unit = np.abs(a.direction).max(initial=1e-300)
    return a.rate == b.rate and bool(np.abs(a.direction - b.direction).max() <= 1e-7 * unit)


def distinct(items: Iterable[Item], same: Callable[[Item, Item], bool]) -> list[Item]:
    """Return the items without duplicates, in the given order.

    Args:
        items: sequence that may contain duplicates.
        same: function returning whether two items are equal.
    """
    kept: list[Item] = []
    for item in items:
        if not any(same(item, other) for other in kept):
            kept.append(item)
    return kept
