# SPDX-License-Identifier: LGPL-3.0-or-later
r"""All outgoing rays of a point at which the pieces of an affine system meet.

The directions (dw, dgamma) that lead out solve a system of cones without load, M dw = dgamma q:
the tangent cone. Its solutions are rays. They are found

- by enumeration of the pieces, where these are few: the set is then complete, and rays with
  dgamma = 0, along which gamma is constant, are among them;
- otherwise by unfolding: with a load e added, M w = gamma q + e, the point falls apart into
  branches without degenerate points, each of which comes in along one ray and goes out along
  another. They are followed by pivoting from the rays that are known, and from a state drawn at
  random, for which e is made; loads drawn anew connect rays in other pairs. What that does not
  reach is not found, and nothing is proved; but the system may have a proof of its own
  (`System.prove_rays`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact.continuation.affine import (
    TOLERANCE,
    AffinePiece,
    AffineSystem,
    Array,
    Codes,
    largest,
)
from dolfinx_contact.continuation.system import RayProof

__all__ = [
    "MOST_PIECES",
    "AffineRay",
    "Rays",
    "distinct",
    "neighbours",
    "number_of_pieces",
    "outgoing",
    "same_direction",
    "step",
]

Item = TypeVar("Item")
#: Looks for a proof of all rays of a cone, of which some are known.
Prove = Callable[[AffineSystem, Sequence[tuple[Codes, float]]], RayProof | None]

MOST_PIECES = 65536  # that are enumerated
_MOST_IDLE = 6  # unfoldings in a row that bring nothing new
_CHUNK = 4096  # pieces examined together
_SINGULAR = 1e-14  # singular values that are round-off, relative to the largest


@dataclass(frozen=True, eq=False)
class AffineRay:
    """An outgoing ray: statuses, dw of shape (m, k), and dgamma: 1, -1 or 0."""

    codes: Codes
    direction: Array
    rate: float


@dataclass(frozen=True)
class Rays:
    """The outgoing rays of a point.

    Attributes:
        rays: in no order.
        complete: whether it is proved that there are no others.
        method: how they were found, human-readable.
        continua: pieces that hold more than single rays, each with the rays among `rays` that lie
            in it, borders included.
    """

    rays: tuple[AffineRay, ...]
    complete: bool
    method: str
    continua: tuple[tuple[Codes, tuple[AffineRay, ...]], ...] = ()


def step(system: AffineSystem, codes: Codes, w: Array, direction: Array) -> float:
    """How far a state can go in a direction before an inequality is violated; maybe infinitely."""
    slack = system.slacks(codes, w)
    rate = system.slacks(codes, direction)
    falling = np.isfinite(slack) & (rate < -TOLERANCE * largest(direction))
    return float(np.min(np.maximum(slack[falling], 0.0) / -rate[falling], initial=np.inf))


def neighbours(
    piece: AffinePiece, w: Array, kinked: int, held: npt.NDArray[np.bool_], tolerance: float
) -> list[tuple[AffinePiece, float]]:
    """Pieces that differ in the status of one point, with the sense in which they lead out of w.

    No other point of the state is at a border.
    """
    found = []
    for code in np.flatnonzero(held):
        if code == piece.codes[kinked]:
            continue
        new = piece.neighbour(np.array([kinked]), np.array([code], dtype=np.int8))
        if new is None:
            continue
        w_1 = new.coefficients[1]
        C = new.system.inequalities[kinked, code]
        rate = (C @ w_1[kinked])[np.abs(C @ w[kinked]) <= tolerance]
        least = -TOLERANCE * largest(w_1)
        found += [(new, sense) for sense in (1.0, -1.0) if (sense * rate >= least).all()]
    return found


def number_of_pieces(statuses: Iterable[int]) -> int:
    """How many pieces there are if points may take so many statuses each."""
    return math.prod(int(number) for number in statuses)


def outgoing(
    cone: AffineSystem,
    known: Sequence[AffineRay] = (),
    *,
    prove: Prove | None = None,
) -> Rays:
    """All rays of a tangent cone, as far as they can be found.

    Args:
        cone: a system without load.
        known: rays that are known already.
        prove: looks for a proof that there are no others than those that unfolding finds.

    Raises:
        ValueError: if a number of the system is not finite.
    """
    cone.require_finite()
    choices = [np.flatnonzero(a) for a in cone.allowed]
    if not all(len(c) for c in choices):
        return Rays(tuple(known), False, "no enumeration: a point is in no cone, for round-off")
    pieces = number_of_pieces(len(c) for c in choices)
    if pieces <= MOST_PIECES:
        wide: list[Codes] = []
        found = list(known)
        doubt = ""
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                found += _enumerate(cone, choices, wide)
        except FloatingPointError as error:
            doubt = f", {error}"
        rays = distinct(found, same_direction)
        edges = [(codes, _inside_of(cone, codes, rays)) for codes in wide]
        continua = tuple((codes, ends) for codes, ends in edges if len(ends) > 1)
        if continua:
            doubt += ", with continua between these"
        method = f"enumeration of {pieces} pieces{doubt}"
        return Rays(tuple(rays), not doubt, method, continua)
    unfolded = _unfold(cone, known, choices)
    proof = None if prove is None else prove(cone, [(r.codes, r.rate) for r in unfolded.rays])
    return unfolded if proof is None else _with_proof(cone, unfolded, proof)


def _with_proof(cone: AffineSystem, unfolded: Rays, proof: RayProof) -> Rays:
    """What unfolding and a proof found; if that is complete they are all."""
    pieces = [(cone.piece(codes), rate) for codes, rate in proof.rays]
    certain = [AffineRay(p.codes, p.at(rate), rate) for p, rate in pieces if p is not None]
    complete = proof.verdict == "complete" and len(certain) == len(pieces)
    rays = distinct([*unfolded.rays, *certain], same_direction)
    return Rays(tuple(rays), complete, f"{unfolded.method}, {proof.method}")


def _inside_of(
    cone: AffineSystem, codes: Codes, rays: Sequence[AffineRay]
) -> tuple[AffineRay, ...]:
    """Those of the rays that lie in one piece, borders included."""
    points = np.arange(cone.points)
    return tuple(
        r
        for r in rays
        if cone.statuses_at(r.direction, 1e-8 * largest(r.direction))[points, codes].all()
    )


def _enumerate(
    cone: AffineSystem, choices: Sequence[npt.NDArray[np.int64]], wide: list[Codes]
) -> Iterator[AffineRay]:
    """Rays of all pieces; points that keep their status are eliminated first.

    Pieces whose solutions are no single ray are added to ``wide``; the edges of what they hold are
    rays of other pieces.

    Raises:
        FloatingPointError: at the end, if some pieces are undecided for round-off.
    """
    doubt = ""
    m = cone.points
    d = cone.bases.shape[3]
    kinked = np.array([i for i, c in enumerate(choices) if len(c) > 1], dtype=int)
    codes = np.array([c[0] for c in choices], dtype=np.int8)
    N = len(cone.rate)
    held = np.setdiff1d(np.arange(m), kinked)
    fixed: Array = cone.pieced(codes).reshape(N, m, d)[:, held].reshape(N, d * len(held))
    singular = len(held) > 0 and np.linalg.matrix_rank(fixed) < d * len(held)
    if len(kinked) == 0 or singular:
        kinked = np.arange(m)
        held = held[:0]
        fixed = fixed[:, :0]
    width = fixed.shape[1]
    Q = np.linalg.qr(fixed, mode="complete")[0][:, width:]
    M = np.einsum("np,nmk->pmk", Q, cone.matrix[:, kinked])
    q = Q.T @ cone.rate
    # Of every kinked point, in every status: its columns of A.
    columns = np.einsum("pmk,mskd->mspd", M, cone.bases[kinked])
    every = itertools.product(*(choices[i] for i in kinked))
    B = cone.bases[kinked]
    C = cone.inequalities[kinked]
    points = np.arange(len(kinked))
    while chunk := list(itertools.islice(every, _CHUNK)):
        statuses = np.array(chunk, dtype=np.int8).reshape(len(chunk), len(kinked))
        A = columns[points, statuses]  # (pieces, points, p, d)
        A = np.moveaxis(A, 1, 2).reshape(len(chunk), len(q), -1)
        regular, z = _solve_all(A, q)
        w = np.einsum("cmkd,cmd->cmk", B[points, statuses], z.reshape(len(A), -1, d))
        if not np.isfinite(w).all():
            raise FloatingPointError("which overflowed")
        slack = np.einsum("cmek,cmk->cme", C[points, statuses], w)
        tolerance = TOLERANCE * np.abs(w).max(axis=(1, 2), initial=0.0)
        least, most = (f(axis=(1, 2), initial=0.0) for f in (slack.min, slack.max))
        for i in np.flatnonzero(~regular | (least >= -tolerance) | (most <= tolerance)):
            codes[kinked] = statuses[i]
            dimension, found = (1, (z[i], 1.0)) if regular[i] else _kernel(A[i], q)
            if dimension > 1:
                wide.append(codes.copy())
            elif dimension < 0:
                doubt = "some of which are too badly conditioned"
            elif found is not None:
                yield from _inside(cone, codes.copy(), kinked, held, fixed, *found)
    if doubt:
        raise FloatingPointError(doubt)


def _solve_all(A: Array, q: Array) -> tuple[npt.NDArray[np.bool_], Array]:
    """Which of the matrices A_i are regular, and A_i^{-1} q (zeros for the others)."""
    sizes = np.abs(A).max(axis=(1, 2), initial=0.0) * A.shape[1]
    inverse = _inverses(A)
    regular = np.abs(inverse).max(axis=(1, 2), initial=0.0) * sizes < 1e10
    return regular, np.where(regular[:, None], np.where(np.isfinite(inverse), inverse, 0) @ q, 0.0)


def _inverses(A: Array) -> Array:
    """A_i^{-1}; infinite where a pivot vanishes."""
    try:
        return np.asarray(np.linalg.inv(A))
    except np.linalg.LinAlgError:
        if len(A) == 1:
            return np.full_like(A, np.inf)
        half = len(A) // 2
        return np.concatenate([_inverses(A[:half]), _inverses(A[half:])])


def _kernel(A: Array, q: Array) -> tuple[int, tuple[Array, float] | None]:
    """The dimension of the kernel of [A, -q], and its vector (z, rate) if that is 1.

    -1 if A is so badly conditioned that it could as well be regular.
    """
    values = np.linalg.svd(A, compute_uv=False)
    if _SINGULAR * values[0] < values[-1] <= TOLERANCE * values[0]:
        return -1, None
    _, values, V = np.linalg.svd(np.column_stack([A, -q]))
    if values[-1] <= TOLERANCE * values[0]:
        return 1 + int(np.sum(values <= TOLERANCE * values[0])), None
    return 1, (V[-1, :-1], float(V[-1, -1]))


def _inside(
    cone: AffineSystem,
    codes: Codes,
    kinked: npt.NDArray[np.int64],
    held: npt.NDArray[np.int64],
    fixed: Array,
    z: Array,
    rate: float,
) -> Iterator[AffineRay]:
    """The ray of a kernel vector, in the senses in which it is inside its cones."""
    B = cone.bases[np.arange(cone.points), codes]
    w: Array = np.zeros(cone.matrix.shape[1:])
    w[kinked] = np.einsum("mkd,md->mk", B[kinked], z.reshape(len(kinked), -1))
    quick = cone.slacks(codes, w)[kinked]
    senses = [s for s in (1.0, -1.0) if _inside_for(quick, s) >= -TOLERANCE * largest(w)]
    if not senses:
        return
    if len(held):
        rest = rate * cone.rate - np.einsum("nmk,mk->n", cone.matrix[:, kinked], w[kinked])
        z_held = np.linalg.lstsq(fixed, rest)[0]
        w[held] = np.einsum("mkd,md->mk", B[held], z_held.reshape(len(held), -1))
    scale = largest(w)
    size = abs(rate) if abs(rate) > 1e-9 * scale else scale
    slack = cone.slacks(codes, w)
    for sense in senses if size > 0 else ():
        if _inside_for(slack, sense) >= -TOLERANCE * scale:
            direction: Array = np.asarray(sense * w / size, dtype=np.float64)
            yield AffineRay(codes, direction, float(np.round(sense * rate / size)))


def _inside_for(slack: Array, sense: float) -> float:
    """The least slack of a state that is multiplied by ``sense``."""
    return float(np.min(sense * slack[np.isfinite(slack)], initial=np.inf))


def _unfold(
    cone: AffineSystem, known: Sequence[AffineRay], choices: Sequence[npt.NDArray[np.int64]]
) -> Rays:
    rays = distinct([*known, *_by_newton(cone, choices)], same_direction)
    idle = 0
    count = 0
    random = np.random.default_rng(0)
    while idle < _MOST_IDLE:
        codes, w = _random_state(cone, choices, random)
        unfolded = replace(cone, load=np.einsum("nmk,mk->n", cone.matrix, w))
        before = len(rays)
        ends = list[AffineRay]()
        piece = unfolded.piece(codes)
        if piece is not None:
            found = (_far_end(piece, 0.0, sense) for sense in (1.0, -1.0))
            ends = [end for end in found if end is not None]
        for ray in rays:
            if not any(same_direction(ray, end) for end in ends):
                ends += [end for end in [_other_end(unfolded, ray)] if end is not None]
        rays = distinct([*rays, *ends], same_direction)
        idle = idle + 1 if len(rays) == before else 0
        count = count + 1
    return Rays(tuple(rays), False, f"{count} unfoldings of {len(choices)} points")


def _random_state(
    cone: AffineSystem, choices: Sequence[npt.NDArray[np.int64]], random: np.random.Generator
) -> tuple[Codes, Array]:
    """Random statuses, and a random state inside their cones."""
    codes = np.array([random.choice(c) for c in choices], dtype=np.int8)
    B = cone.bases[np.arange(cone.points), codes]
    w: Array = np.zeros(cone.matrix.shape[1:])
    outside = np.ones(cone.points, dtype=bool)
    for _ in range(100):
        z = random.standard_normal((cone.points, B.shape[2]))
        w = np.where(outside[:, None], np.einsum("mkd,md->mk", B, z), w)
        outside = cone.slacks(codes, w).min(axis=1, initial=np.inf) < 0
        if not outside.any():
            break
    return codes, w


def _by_newton(cone: AffineSystem, choices: Sequence[npt.NDArray[np.int64]]) -> Iterator[AffineRay]:
    """Rays found at dgamma = 1 and -1 from uniform statuses."""
    for gamma, code in itertools.product((1.0, -1.0), range(cone.bases.shape[1])):
        start = np.array([code if code in c else c[0] for c in choices], dtype=np.int8)
        codes = cone.solve(gamma, start)
        piece = None if codes is None else cone.piece(codes)
        if piece is not None:
            yield AffineRay(piece.codes, piece.at(gamma), gamma)


def _other_end(unfolded: AffineSystem, ray: AffineRay) -> AffineRay | None:
    """The outgoing ray of the branch with the incoming ``ray``; None if it gets lost."""
    if ray.rate == 0:
        return None
    codes = unfolded.solve(1e6 * ray.rate, ray.codes)  # a border point of the ray falls to a side
    piece = None if codes is None else unfolded.piece(codes)
    return None if piece is None else _far_end(piece, 1e6 * ray.rate, -ray.rate)


def _far_end(piece: AffinePiece, gamma: float, sense: float) -> AffineRay | None:
    """The ray by which the branch goes out that leaves ``gamma`` in this sense."""
    unfolded = piece.system
    for _ in range(50 * unfolded.points):
        direction = sense * piece.coefficients[1]
        s_0, s_1 = piece.slack_coefficients
        slack = s_0 + gamma * s_1
        rate = sense * s_1
        falling = rate < -TOLERANCE * largest(direction)
        falling &= np.isfinite(slack)
        if not falling.any():
            return AffineRay(piece.codes, direction, sense)
        length = float((np.maximum(slack[falling], 0.0) / -rate[falling]).min())
        gamma += sense * length
        w = piece.at(gamma)
        tolerance = TOLERANCE * largest(w)
        (kinked,) = np.nonzero((np.abs(s_0 + gamma * s_1) <= tolerance).any(axis=1))
        if len(kinked) != 1:
            return None
        held = unfolded.statuses_of(int(kinked[0]), w[kinked[0]], tolerance)
        found = neighbours(piece, w, int(kinked[0]), held, tolerance)
        if len(found) != 1:
            return None
        piece, sense = found[0]
    return None


def same_direction(a: AffineRay, b: AffineRay) -> bool:
    """Whether two rays are one."""
    unit = np.abs(a.direction).max(initial=1e-300)
    return a.rate == b.rate and bool(np.abs(a.direction - b.direction).max() <= 1e-7 * unit)


def distinct(items: Iterable[Item], same: Callable[[Item, Item], bool]) -> list[Item]:
    """Items without those that are the same as one before."""
    kept: list[Item] = []
    for item in items:
        if not any(same(item, other) for other in kept):
            kept.append(item)
    return kept
