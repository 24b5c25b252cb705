# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether one solution of a reduced problem is the only one.

The certificate of one point (`check_proof.py`) over all statuses costs some eigenvalue problems of
the size of the reduced problem, most often few. Where these bring no proof another solution is
looked for, from uniform statuses, then more weights. If there is time for it more starts and more
effort follow, and in the end a proof by branch and bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from dolfinx_contact.proofs.candidates import candidates
from dolfinx_contact.proofs.check_proof import (
    Certificate,
    PieceSolution,
    ReducedProblem,
    StatusRegion,
    differences,
    solve_piece,
)
from dolfinx_contact.proofs.plane_weights import find_weights
from dolfinx_contact.proofs.solutions import prove_solutions

__all__ = ["OnlySolution", "is_only"]

Codes = npt.NDArray[np.int8]
Array = npt.NDArray[np.float64]

_UNIFORM = 4  # starts of the search for another solution, with less time
_TRIES = 16  # and with more
_FIRST = 2  # effort of the search for weights at first,
_QUICK = 15  # then by default,
_EFFORT = 80  # and where there is time,
_POINTS = 128  # up to so many points; then less, as eigenvalues cost the cube


@dataclass(frozen=True, eq=False)
class OnlySolution:
    """Whether a solution is the only one.

    Attributes:
        verdict: as in `results.uniqueness.Uniqueness`.
        reason: human-readable.
        other: statuses (m,) and state (m, 4) of another solution.
        certificate: the proof, if there is one.
    """

    verdict: Literal["proved", "not proved", "others exist"]
    reason: str
    other: tuple[Codes, Array] | None = None
    certificate: Certificate | None = None


def is_only(problem: ReducedProblem, codes: Codes, *, proof_seconds: float = 0.0) -> OnlySolution:
    """Whether the solution with some statuses is the only one.

    Args:
        problem: the reduced problem.
        codes: statuses of the solution (m,).
        proof_seconds: for more effort and a proof by branch and bound, if the certificate of one
            point fails.
    """
    scaled = problem.scaled
    piece = solve_piece(scaled, codes)
    inside = piece if piece is not None and piece.verdict != "outside" else None
    share = min(1.0, (_POINTS / problem.points) ** 3)
    tries, effort = (_TRIES, _EFFORT) if proof_seconds > 0 else (_UNIFORM, _QUICK)
    certificate = _of_one_point(problem, inside, _FIRST)
    other = None
    if certificate is None:
        other = _another(scaled, codes, max(2, int(share * tries)))
    if certificate is None and other is None:
        certificate = _of_one_point(problem, inside, max(8, int(share * effort)))
    if certificate is not None:
        return OnlySolution("proved", "the certificate of one point", None, certificate)
    if other is not None:
        length, force = problem.units
        state = other.state * np.array([length, length, force, force])
        return OnlySolution("others exist", "another solution was found", (other.codes, state))
    if proof_seconds > 0:
        return _by_search(problem, codes, proof_seconds)
    if piece is None or piece.verdict != "inside":
        return OnlySolution("not proved", "the solution is at a border of its statuses")
    return OnlySolution("not proved", "the certificate of one point does not hold")


def _of_one_point(
    problem: ReducedProblem, piece: PieceSolution | None, effort: int
) -> Certificate | None:
    if piece is None:
        return None
    certificate = Certificate(problem)
    region = StatusRegion.whole(problem.scaled)
    d = differences(piece, region.allowed, region.ub)
    w = None if d is None else find_weights(d, effort=effort)
    if w is None or not w.proves:
        return None
    certificate.steps.append(
        {
            "do": "only",
            "codes": piece.codes.tolist(),
            "weights": w.weights.tolist(),
            "theta": w.theta.tolist(),
            "mu": w.mu,
        }
    )
    return certificate


def _another(problem: ReducedProblem, codes: Codes, tries: int) -> PieceSolution | None:
    """Another solution, inside its borders; None if none was found."""
    random = np.random.default_rng(0)
    for found in candidates(problem, problem.statuses, [], random, tries):
        if not np.array_equal(found, codes):
            piece = solve_piece(problem, found)
            if piece is not None and piece.verdict == "inside":
                return piece
    return None


def _by_search(problem: ReducedProblem, codes: Codes, proof_seconds: float) -> OnlySolution:
    found = prove_solutions(problem, known=[codes], proof_seconds=proof_seconds, progress=False)
    others = [s for s in found.solutions if not np.array_equal(s.codes, codes)]
    if others:
        return OnlySolution("others exist", found.method, (others[0].codes, others[0].state))
    if found.verdict == "complete":
        return OnlySolution("proved", found.method, None, found.certificate)
    return OnlySolution("not proved", found.method)
