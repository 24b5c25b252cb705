# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a certificate proves: all that has to be trusted is here and in what is imported here.

The search (`branching.py`) proposes steps, by optimisers and linear programs that may be wrong;
this module follows them, with error bounds, and takes nothing from them but numbers. A step that
does not prove what it says makes the whole certificate worthless. numpy alone is needed.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from dolfinx_contact.analysis.certificate import Certificate
from dolfinx_contact.analysis.differences import differences
from dolfinx_contact.analysis.duality import Dual
from dolfinx_contact.analysis.energy import bounded, restricted
from dolfinx_contact.analysis.pieces import Piece, solve_piece
from dolfinx_contact.analysis.reduced_problem import Masks, ReducedProblem, has_status

__all__ = ["MOST_PIECES", "InvalidCertificate", "Proved", "Region", "Verdict", "check", "follow"]

Array = npt.NDArray[np.float64]
Verdict = Literal["complete", "degenerate", "open"]

MOST_PIECES = 256


class InvalidCertificate(ValueError):
    """A step of a certificate does not prove what it says."""


@dataclass(eq=False)
class Proved:
    """What is known of the solutions.

    Attributes:
        inside: pieces that hold one solution each, inside their borders.
        border: pieces whose solution is at a border: one within their errors, or none.
        singular: pieces that may hold one solution, none or a continuum.
        at_rest: without load nothing but a = 0 is a solution.
        open_regions: sets of statuses about which nothing is proved.
    """

    inside: list[Piece] = field(default_factory=list)
    border: list[Piece] = field(default_factory=list)
    singular: list[npt.NDArray[np.int8]] = field(default_factory=list)
    open_regions: list[Masks] = field(default_factory=list)
    at_rest: bool = False

    @property
    def verdict(self) -> Verdict:
        """Whether `inside`, or the state of rest, is all there is."""
        if self.open_regions:
            return "open"
        return "degenerate" if self.border or self.singular else "complete"

    def add(self, piece: Piece) -> None:
        """Take the solution of a piece, whose errors decide whether it is one."""
        kind = piece.verdict
        known = self.inside if kind == "inside" else self.border
        if kind != "outside" and not any(np.array_equal(q.codes, piece.codes) for q in known):
            known.append(piece)


@dataclass(eq=False)
class Region:
    """Sets of statuses, and bounds of the slots of the solutions with such statuses.

    Attributes:
        problem: scaled.
        allowed: masks (m,).
        ub: (6, m).
    """

    problem: ReducedProblem
    allowed: Masks
    ub: Array

    @classmethod
    def whole(cls, problem: ReducedProblem) -> Region:
        """All statuses, with the bounds by energy."""
        return cls(problem, problem.statuses.copy(), bounded(problem))

    def part(self, point: int, mask: int) -> Region:
        """The statuses ``mask`` at one point."""
        new = Region(self.problem, self.allowed.copy(), self.ub)
        new.allowed[point] = mask
        new.ub = restricted(self.problem, new.allowed, self.ub)
        return new

    @property
    def choices(self) -> list[list[int]]:
        """Statuses that are left, point by point."""
        return [[int(s) for s in np.flatnonzero(has)] for has in has_status(self.allowed)]

    @property
    def pieces(self) -> float:
        """Their number."""
        return float(np.prod([float(len(c)) for c in self.choices]))

    def excluded(self, y: Array, *, margin: float = 1.0) -> npt.NDArray[np.bool_]:
        """Statuses that the vector ``y`` excludes (m, 7)."""
        return Dual(self.problem, y).impossible(self.allowed, self.ub, margin)

    def exclude(self, point: int, status: int) -> None:
        """Take a status out."""
        self.allowed[point] &= ~(1 << status)
        self.ub = restricted(self.problem, self.allowed, self.ub)

    def most(self, y: Array, slot: int, point: int) -> float:
        """The bound of a slot by the vector ``y``."""
        return Dual(self.problem, y).most(self.allowed, self.ub, slot, point)


def check(certificate: Certificate) -> Proved:
    """Follow a certificate.

    Raises:
        InvalidCertificate: if a step does not prove what it says, or steps are missing.
    """
    proved = Proved()
    problem = certificate.problem.scaled
    waiting = [Region.whole(problem)]
    try:
        for step in certificate.steps:
            if not waiting:
                raise InvalidCertificate("there are steps after the last leaf")
            waiting += follow(certificate, step, waiting.pop(), proved)
    except (KeyError, IndexError, TypeError) as error:
        raise InvalidCertificate(f"a step cannot be read: {error}") from error
    if waiting:
        raise InvalidCertificate("steps are missing")
    return proved


def follow(
    certificate: Certificate, step: dict[str, Any], region: Region, proved: Proved
) -> list[Region]:
    """Take one step.

    Args:
        certificate: that the step is of.
        step: see `certificate.py`.
        region: changed.
        proved: receives what the step proves.

    Returns:
        What is left of the region, last part first.

    Raises:
        InvalidCertificate: if the step does not prove what it says.
    """
    kind = step["do"]
    if kind == "branch":
        point, parts = _index(step["point"], len(region.allowed)), step["parts"]
        whole = int(region.allowed[point])
        if int(np.bitwise_or.reduce([0, *parts])) & whole != whole:
            raise InvalidCertificate("a branch leaves statuses out")
        return [region.part(point, mask & whole) for mask in reversed(parts)]
    if kind == "open":
        proved.open_regions.append(region.allowed)
        return []
    if kind == "rest":
        # a.S a <= p.a, with no load and no error of it.
        if region.problem.p.any() or region.problem.dp.any():
            raise InvalidCertificate("there is a load")
        proved.at_rest = True
        return []
    if kind == "pieces":
        _all_pieces(certificate, step["singular"], region, proved)
        return []
    if kind == "only":
        piece = _piece(region.problem, step["codes"])
        found = None if piece is None else differences(piece, region.allowed, region.ub)
        weights, theta = (np.array(step[k], dtype=float) for k in ("weights", "theta"))
        if found is None or not found.prove(weights, theta, float(step["mu"])):
            raise InvalidCertificate("a uniqueness is not proved")
        assert piece is not None
        proved.add(piece)
        return []
    y = certificate.vectors[_index(step["y"], len(certificate.vectors))]
    if y.shape != region.problem.p.shape or not np.isfinite(y).all():
        raise InvalidCertificate("a vector of multipliers does not fit")
    if kind == "bound":
        slot, point = _index(step["slot"], 6), _index(step["point"], len(region.allowed))
        if not region.most(y, slot, point) <= step["value"]:
            raise InvalidCertificate("a bound is not proved")
        region.ub = region.ub.copy()
        region.ub[slot, point] = max(min(region.ub[slot, point], step["value"]), 0.0)
        return [region]
    excluded = region.excluded(y)
    if kind == "empty":
        if not (excluded == has_status(region.allowed)).all(axis=1).any():
            raise InvalidCertificate("a region is not proved empty")
        return []
    if kind != "exclude":
        raise InvalidCertificate(f"there is no step {kind!r}")
    for point, status in step["what"]:
        if not excluded[_index(point, len(excluded)), _index(status, 7)]:
            raise InvalidCertificate("an exclusion is not proved")
    for point, status in step["what"]:
        region.exclude(point, status)
    return [region]


def _all_pieces(
    certificate: Certificate, singular: list[Any], region: Region, proved: Proved
) -> None:
    if region.pieces > MOST_PIECES:
        raise InvalidCertificate("a leaf has too many pieces")
    known = {tuple(codes): number for codes, number in singular}
    for codes in itertools.product(*region.choices):
        piece = solve_piece(region.problem, np.array(codes, dtype=np.int8))
        if piece is not None:
            proved.add(piece)
        elif not _holds_nothing(certificate, known.get(codes), region, codes):
            proved.singular.append(np.array(codes, dtype=np.int8))


def _holds_nothing(
    certificate: Certificate, number: int | None, region: Region, codes: tuple[int, ...]
) -> bool:
    """Whether a vector proves that a singular piece holds no solution."""
    if number is None:
        return False
    held = Region(region.problem, np.array([1 << s for s in codes], dtype=np.int64), region.ub)
    held.ub = restricted(region.problem, held.allowed, region.ub)
    y = certificate.vectors[_index(number, len(certificate.vectors))]
    return bool(held.excluded(y).any())


def _piece(problem: ReducedProblem, codes: list[int]) -> Piece | None:
    if len(codes) != problem.points or not all(0 <= s < 7 for s in codes):
        raise InvalidCertificate("statuses do not fit")
    allowed = problem.statuses
    if not all(int(allowed[i]) >> s & 1 for i, s in enumerate(codes)):
        raise InvalidCertificate("a point cannot have this status")
    return solve_piece(problem, np.array(codes, dtype=np.int8))


def _index(value: Any, size: int) -> int:
    if not isinstance(value, int) or not 0 <= value < size:
        raise InvalidCertificate(f"there is no number {value!r}")
    return value
