# SPDX-License-Identifier: LGPL-3.0-or-later
"""Search for all solutions of a reduced problem, with a proof of completeness."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from time import perf_counter
from typing import Any

from mpi4py import MPI

import numpy as np

from dolfinx_contact._arrays import Array, Codes
from dolfinx_contact._progress import PROGRESS, Progress
from dolfinx_contact._validate import instance, nonnegative, one_of
from dolfinx_contact.laws.status import MINUS, OPEN, STICK, WHERE_OPEN
from dolfinx_contact.proofs.check_proof import (
    Certificate,
    Masks,
    OpenCells,
    PieceSolution,
    Proved,
    ReducedProblem,
    SpacePiece,
    Verdict,
    in_words,
)
from dolfinx_contact.proofs.plane import PlaneSearch
from dolfinx_contact.proofs.space import SpaceSearch

__all__ = ["ProvedSolution", "ProvedSolutions", "prove_solutions"]


@dataclass(frozen=True, eq=False)
class ProvedSolution:
    """Solution with error bounds.

    Attributes:
        codes: statuses of the m contact points, shape (m,).
        state: displacements (ut, un) and forces (rt, rn) of the points, shape (m, 2 dim).
        away: error bounds of the state, shape (m, 2 dim).
    """

    codes: Codes
    state: Array
    away: Array


@dataclass(frozen=True, eq=False)
class ProvedSolutions:
    """Solutions of a reduced problem, and the result of the proof of completeness.

    Attributes:
        verdict: ``"complete"``: ``solutions`` are all solutions. ``"degenerate"``: other solutions
            are possible only at the states ``border`` and with the statuses ``singular``, where
            they may be continua. ``"open"``: further solutions, in 3D also continua, may exist in
            ``open_regions``.
        solutions: proved solutions. Solutions that Newton's method finds in open regions after the
            time limit are included, but are not part of the certificate.
        border: states satisfying an inequality of the law only within error bounds; each may or may
            not be a solution.
        singular: statuses of the m points, shape (m,) each, with one solution, none or a continuum.
        open_regions: undecided sets of statuses as bit masks, shape (m,); in 3D undecided cells
            with the reason.
        certificate: proof, which can be saved (`Certificate.save`) and checked again (`check`).
        seconds: duration of the search; by default 0.
    """

    verdict: Verdict
    solutions: tuple[ProvedSolution, ...]
    border: tuple[ProvedSolution, ...]
    singular: tuple[Codes, ...]
    open_regions: tuple[Masks | OpenCells, ...]
    certificate: Certificate
    seconds: float = 0.0

    def __str__(self) -> str:
        """Return the number of solutions, the undecided cases and the method."""
        counts = map(len, (self.solutions, self.border, self.singular, self.open_regions))
        return f"{in_words(*counts)} ({self.method}, {self.seconds:.2g} s)"

    @property
    def method(self) -> str:
        """Description of the method of the proof, human-readable."""
        steps = len(self.certificate.steps)
        if self.verdict == "complete":
            return f"a proof of {steps} {'step' if steps == 1 else 'steps'}"
        if not self.open_regions:
            return f"a proof was tried, {self.verdict}"
        reasons = sorted({r.why for r in self.open_regions if isinstance(r, OpenCells)})
        why = f" ({'; '.join(reasons)})" if reasons else ""
        return f"a proof was tried, {len(self.open_regions)} regions left{why}"


def prove_solutions(
    reduced: ReducedProblem,
    *,
    known: Iterable[Codes | Array] = (),
    proof_seconds: float = 60.0,
    progress: bool | None = None,
) -> ProvedSolutions:
    """Find all solutions of a reduced problem and prove completeness.

    Args:
        reduced: reduced problem of m contact points, with error bounds.
        known: known solutions, which shorten the search; by default none. In 2D each consists of
            the statuses, shape (m,), in 3D of the displacements and forces, shape (m, 6).
        proof_seconds: time limit in seconds, by default 60. Remaining regions are left open and
            searched by Newton's method, which may take a few more seconds.
        progress: whether to show the progress on the standard error stream; by default if the
            search takes more than a few seconds.

    Raises:
        ValueError: if the shape of a known solution does not match the number of points.
    """
    instance(reduced, "the reduced problem", ReducedProblem)
    if not isinstance(known, Iterable) or isinstance(known, str):
        raise ValueError(f"known must be a list of statuses, got {known!r}")
    nonnegative(proof_seconds, "proof_seconds", infinite=True)
    one_of(progress, "progress", PROGRESS)
    starts = _checked(reduced, known)
    shown = Progress(MPI.COMM_SELF, progress)

    def show(text: str) -> None:
        if shown.due:
            shown.update(f"proof of all solutions: {text}, {shown.seconds:.0f} s")

    begin = perf_counter()
    try:
        kind = PlaneSearch if reduced.dim == 2 else SpaceSearch
        search = kind(reduced, proof_seconds, show)
        search.run(starts)
    finally:
        shown.clear()
    return _described(reduced, search.certificate, search.proved, perf_counter() - begin)


def _checked(problem: ReducedProblem, known: Iterable[Codes | Array]) -> list[Any]:
    """Return known solutions as valid arrays: statuses in 2D, displacements and forces in 3D."""
    if problem.dim == 3:
        states = [np.asarray(state, dtype=np.float64) for state in known]
        if any(s.shape != (problem.points, 6) or not np.isfinite(s).all() for s in states):
            raise ValueError(f"known must be states ({problem.points}, 6)")
        return states
    starts = [np.asarray(codes, dtype=np.int8) for codes in known]
    for codes in starts:
        if codes.shape != (problem.points,) or codes.min() < 0 or codes.max() > MINUS + WHERE_OPEN:
            raise ValueError(f"known must be statuses of {problem.points} points")
    return starts


def _described(
    problem: ReducedProblem, certificate: Certificate, proved: Proved, seconds: float
) -> ProvedSolutions:
    length, force = problem.units
    units = np.repeat([length, force], problem.dim)

    def of(piece: PieceSolution | SpacePiece) -> ProvedSolution:
        return ProvedSolution(piece.codes, piece.state * units, piece.away * units)

    solutions = [of(piece) for piece in proved.inside]
    if proved.at_rest:
        nothing = np.zeros((problem.points, 2 * problem.dim))
        codes = np.where(problem.g > 0, STICK, OPEN).astype(np.int8)
        solutions.append(ProvedSolution(codes, nothing, nothing))
    return ProvedSolutions(
        proved.verdict,
        tuple(solutions),
        tuple(of(piece) for piece in proved.border),
        tuple(proved.singular),
        tuple(proved.open_regions),
        certificate,
        seconds,
    )
