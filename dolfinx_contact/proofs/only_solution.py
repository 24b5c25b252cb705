# SPDX-License-Identifier: LGPL-3.0-or-later
"""Decision whether a solution of a reduced problem is unique.

The *certificate of one point* compares all solutions with the given one by quadratic inequalities
(`check_proof.Differences`), for the whole problem at once. It is tried first; in 2D it needs a few
eigenvalue problems of the size of the reduced problem. If it fails, Newton's method searches for a
second solution from several starts. Then, in 2D, the certificate is tried with more iterations for
its weights. With a positive time limit, both searches use more effort, and branch and bound
follows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from dolfinx_contact._arrays import Array, Codes
from dolfinx_contact.proofs.candidates import candidates
from dolfinx_contact.proofs.check_proof import (
    Certificate,
    PieceSolution,
    ReducedProblem,
    SpacePiece,
    solve_piece,
    whole_region,
)
from dolfinx_contact.proofs.pieces import piece_at
from dolfinx_contact.proofs.plane import PlaneSearch
from dolfinx_contact.proofs.solutions import prove_solutions
from dolfinx_contact.proofs.space import SpaceSearch
from dolfinx_contact.proofs.starts import many_solutions

__all__ = ["OnlySolution", "is_only"]


_FIRST = 2  # first effort of the search for weights in 2D
_POINTS = 128  # points in 2D beyond which starts and effort decrease (cubic cost)
_BATCH = 2e5  # total number of matrix entries of all starts in 3D
_SEARCH = "; proof_seconds=60 searches for a proof"
_SAME = 1e-6  # relative distance below which two states count as the same


@dataclass(frozen=True, eq=False)
class OnlySolution:
    """Result of the decision whether a solution is unique.

    Attributes:
        verdict: verdict as in `results.uniqueness.Uniqueness`.
        reason: reason for the verdict, human-readable.
        other: statuses of the m contact points, shape (m,), and their displacements and forces,
            shape (m, 2 dim), in a second solution; None if none is known.
        certificate: proof of uniqueness; None without a proof.
    """

    verdict: Literal["proved", "not proved", "others exist"]
    reason: str
    other: tuple[Codes, Array] | None = None
    certificate: Certificate | None = None


def is_only(
    problem: ReducedProblem, solution: Codes | Array, *, proof_seconds: float = 0.0
) -> OnlySolution:
    """Decide whether a solution is unique.

    Args:
        problem: reduced problem with m contact points.
        solution: statuses, shape (m,), in 2D; displacements and forces, shape (m, 6), in 3D.
        proof_seconds: time limit of branch and bound if the certificate of one point (see the
            module) fails; by default 0. If positive, the other methods use more starts and
            iterations.
    """
    more = proof_seconds > 0
    plane = problem.dim == 2
    scaled = problem.scaled
    length, force = problem.units
    units = np.repeat([length, force], problem.dim)
    piece: PieceSolution | SpacePiece | None
    if plane:
        piece = solve_piece(scaled, np.asarray(solution, dtype=np.int8))
        share = min(1.0, (_POINTS / problem.points) ** 3)
        efforts = [_FIRST, max(8, int(share * (80 if more else 15)))]
        starts = max(2, int(share * (16 if more else 4)))
    else:
        a, r = np.split(np.asarray(solution / units, dtype=np.float64), 2, axis=1)
        piece = piece_at(scaled, a, r)
        efforts = [80 if more else 40]
        starts = max(4, min(200 if more else 8, int(_BATCH / len(problem.p) ** 2)))
    at_border = piece is None or piece.verdict != "inside"
    if plane and piece is not None and piece.verdict == "outside":
        piece = None
    certificate = _of_one_point(problem, piece, efforts[0])
    other = None if certificate else _another(scaled, solution, starts, units)
    if certificate is None and other is None and plane:
        certificate = _of_one_point(problem, piece, efforts[1])
    if certificate is not None:
        return OnlySolution("proved", "the certificate of one point", None, certificate)
    if other is not None:
        state = np.asarray(other.state * units, dtype=np.float64)
        return OnlySolution("others exist", "another solution was found", (other.codes, state))
    if more:
        return _by_search(problem, solution, proof_seconds)
    if plane and at_border:
        return OnlySolution("not proved", f"the solution is at a border of its statuses{_SEARCH}")
    return OnlySolution("not proved", f"the certificate of one point does not hold{_SEARCH}")


def _of_one_point(
    problem: ReducedProblem, piece: PieceSolution | SpacePiece | None, effort: int
) -> Certificate | None:
    """Return a proof of uniqueness by one step, ``rest`` or ``only``; None if it fails."""
    search: Any = (PlaneSearch if problem.dim == 2 else SpaceSearch)(problem, np.inf)
    region = whole_region(search.problem)
    if search.step(region, do="rest") is not None:
        return search.certificate
    if piece is not None and search.only(region, piece, effort)[0]:
        return search.certificate
    return None


def _another(
    problem: ReducedProblem, solution: Any, starts: int, units: Array
) -> PieceSolution | SpacePiece | None:
    """Search for another solution that provably and strictly satisfies the contact law.

    None if none is found.
    """
    random = np.random.default_rng(0)
    pieces: Any
    if problem.dim == 2:
        tried = candidates(problem, problem.statuses, [], random, starts)
        pieces = (solve_piece(problem, codes) for codes in tried)
    else:
        pieces = (piece_at(problem, *state) for state in many_solutions(problem, starts, random))
    for piece in pieces:
        if piece is None or piece.verdict != "inside":
            continue
        if not _is_same(problem.dim, piece.codes, piece.state * units, solution):
            return piece
    return None


def _is_same(dim: int, codes: Codes, state: Array, solution: Any) -> bool:
    """Return whether the statuses (in 2D) or displacements and forces (in 3D) agree."""
    if dim == 2:
        return np.array_equal(codes, solution)
    for part in (slice(0, 3), slice(3, 6)):
        a, b = state[:, part], solution[:, part]
        size = float(np.abs(b).max(initial=0.0)) or float(np.abs(a).max())
        if np.abs(a - b).max() > _SAME * size:
            return False
    return True


def _by_search(problem: ReducedProblem, solution: Any, proof_seconds: float) -> OnlySolution:
    found = prove_solutions(problem, known=[solution], proof_seconds=proof_seconds, progress=False)
    for s in found.solutions:
        if not _is_same(problem.dim, s.codes, s.state, solution):
            return OnlySolution("others exist", found.method, (s.codes, s.state))
    if found.verdict == "complete":
        return OnlySolution("proved", found.method, None, found.certificate)
    return OnlySolution("not proved", found.method)
