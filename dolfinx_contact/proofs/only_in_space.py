# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether one solution of a reduced problem in space is the only one.

The certificate of one point over all cells first, then another solution from some starts; where
there is time more of both, and in the end a proof by branch and bound.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact.proofs.check_proof import (
    Certificate,
    InvalidCertificate,
    Proved,
    ReducedProblem,
    SpaceRegion,
    follow_in_space,
    solve_in_space,
    space_differences,
)
from dolfinx_contact.proofs.only_solution import OnlySolution
from dolfinx_contact.proofs.pieces import codes_of, piece_at, solved_piece, unknowns
from dolfinx_contact.proofs.solutions import ProvedSolution, prove_solutions
from dolfinx_contact.proofs.space_weights import find_space_weights
from dolfinx_contact.proofs.starts import many_solutions

__all__ = ["is_only_in_space"]

Array = npt.NDArray[np.float64]

_EFFORT = 40  # of the search for weights by default,
_MORE = 80  # and where there is time
_STARTS, _MANY = 8, 200
_BATCH = 2e5  # entries of the matrices of all starts
_SAME = 1e-6  # relative distance of states that are one


def is_only_in_space(
    problem: ReducedProblem, state: Array, *, proof_seconds: float = 0.0
) -> OnlySolution:
    """Whether a solution is the only one.

    Args:
        problem: the reduced problem, in space.
        state: of the solution (m, 6).
        proof_seconds: for more starts and a proof by branch and bound, if the certificate of one
            point fails.
    """
    certificate = _of_one_point(problem, state, _MORE if proof_seconds > 0 else _EFFORT)
    if certificate is not None:
        return OnlySolution("proved", "the certificate of one point", None, certificate)
    other = _another(problem, state, _MANY if proof_seconds > 0 else _STARTS)
    if other is not None:
        return OnlySolution("others exist", "another solution was found", other)
    if proof_seconds > 0:
        return _by_search(problem, state, proof_seconds)
    return OnlySolution("not proved", "the certificate of one point does not hold")


def _of_one_point(problem: ReducedProblem, state: Array, effort: int) -> Certificate | None:
    """A proof of one step; None if that is none."""
    scaled = problem.scaled
    certificate = Certificate(problem)
    proved = Proved()
    region = SpaceRegion.whole(scaled)
    step: dict[str, Any]
    if not scaled.p.any():
        step = {"do": "rest"}
    else:
        length, force = problem.units
        a = np.asarray(state[:, :3] / length, dtype=np.float64)
        r = np.asarray(state[:, 3:] / force, dtype=np.float64)
        codes = codes_of(scaled, a, r)
        z = solved_piece(scaled, codes, unknowns(scaled, codes, a, r))
        piece = None if z is None else solve_in_space(scaled, codes, z)
        d = None if piece is None else space_differences(piece, region.cells, region.most)
        w = None if d is None else find_space_weights(d, effort=effort)
        if z is None or w is None or not w.proves:
            return None
        weights = w.weights.tolist()
        step = {"do": "only", "codes": codes.tolist(), "z": z.tolist(), "mu": w.mu}
        step["weights"] = weights
    try:
        follow_in_space(certificate, step, region, proved)
    except InvalidCertificate:
        return None
    certificate.steps.append(step)
    return certificate


def _another(
    problem: ReducedProblem, state: Array, number: int
) -> tuple[npt.NDArray[np.int8], Array] | None:
    """Statuses and state of another solution, proved to be one; None if none was found."""
    scaled = problem.scaled
    length, force = problem.units
    unit = np.repeat([length, force], 3)
    number = max(4, min(number, int(_BATCH / len(problem.p) ** 2)))
    for a, r in many_solutions(scaled, number, np.random.default_rng(0)):
        piece = piece_at(scaled, a, r)
        if piece is None or piece.verdict != "inside":
            continue
        found = np.asarray(piece.state * unit, dtype=np.float64)
        if not _is_same(found, state):
            return piece.codes, found
    return None


def _is_same(a: Array, b: Array) -> bool:
    """Whether two states are one, displacements and forces each by their size."""
    for part in (slice(0, 3), slice(3, 6)):
        size = float(np.abs(b[:, part]).max(initial=0.0)) or float(np.abs(a[:, part]).max())
        if np.abs(a[:, part] - b[:, part]).max() > _SAME * size:
            return False
    return True


def _by_search(problem: ReducedProblem, state: Array, proof_seconds: float) -> OnlySolution:
    found = prove_solutions(problem, known=[state], proof_seconds=proof_seconds, progress=False)
    others: list[ProvedSolution] = [s for s in found.solutions if not _is_same(s.state, state)]
    if others:
        return OnlySolution("others exist", found.method, (others[0].codes, others[0].state))
    if found.verdict == "complete":
        return OnlySolution("proved", found.method, None, found.certificate)
    return OnlySolution("not proved", found.method)
