# SPDX-License-Identifier: LGPL-3.0-or-later
"""Answers to questions about the uniqueness of solutions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real
from typing import Literal

from mpi4py import MPI

from dolfinx_contact._mpi import Arguments, collective
from dolfinx_contact.equations.state import State

__all__ = ["Theory", "Uniqueness", "check_seconds", "checked_seconds"]


@dataclass(frozen=True)
class Uniqueness:
    """Whether a solution is the only one.

    Attributes:
        verdict: ``"proved"`` to be the only one, ``"not proved"``, or ``"others exist"``.
        reason: certificate or theorem of the proof, or the reason why there is none.
        other: another solution, for `ContactProblem.restore`; None if none is known.
    """

    verdict: Literal["proved", "not proved", "others exist"]
    reason: str
    other: State | None = None

    def __str__(self) -> str:
        words = {
            "proved": "the only solution, proved",
            "not proved": "not decided whether it is the only solution",
            "others exist": "not the only solution",
        }
        return f"{words[self.verdict]}: {self.reason}"


def check_seconds(a: Arguments) -> None:
    """Raise ``ValueError`` unless ``proof_seconds`` is a number that is not negative."""
    seconds = a.proof_seconds
    number = isinstance(seconds, Real) and not isinstance(seconds, bool)
    if not number or math.isnan(seconds) or seconds < 0:
        raise ValueError(f"seconds for a proof must not be negative, got {seconds!r}")
    a.proof_seconds = float(seconds)


@collective("seconds", check_seconds)
def checked_seconds(comm: MPI.Comm, proof_seconds: float) -> float:
    """The seconds for a proof as a number, or ``ValueError`` on every rank. Collective."""
    return proof_seconds


@dataclass(frozen=True)
class Theory:
    """Statements of theorems on the solutions of a discrete contact problem under any load.

    Attributes:
        exists: whether there certainly is a solution; False leaves it open.
        unique: whether there certainly is no more than one; False leaves it open.
        reason: the theorem, or why none that can be checked applies, human-readable.
    """

    exists: bool
    unique: bool
    reason: str
