# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results of the analysis of existence and uniqueness of solutions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from mpi4py import MPI

from dolfinx_contact._mpi import Arguments, collective
from dolfinx_contact._validate import nonnegative
from dolfinx_contact.equations.state import State

__all__ = ["Theory", "Uniqueness", "check_seconds", "checked_seconds"]


@dataclass(frozen=True)
class Uniqueness:
    """Result of an analysis of uniqueness of a solution.

    Attributes:
        verdict: ``"proved"`` if the solution is proved to be the only one, ``"others exist"`` if
            another solution is known, otherwise ``"not proved"``.
        reason: certificate or theorem that proves uniqueness, or reason why nothing is proved.
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
    """Validate the time limit ``proof_seconds`` in seconds: non-negative, possibly infinite."""
    a.proof_seconds = nonnegative(a.proof_seconds, "proof_seconds", infinite=True)


@collective("seconds", check_seconds)
def checked_seconds(comm: MPI.Comm, proof_seconds: float) -> float:
    """Return a validated time limit; raise ``ValueError`` on every rank if invalid. Collective."""
    return proof_seconds


@dataclass(frozen=True)
class Theory:
    """Theorems on existence and uniqueness for a discrete contact problem under any load.

    Attributes:
        exists: whether a theorem guarantees a solution; False if no theorem applies.
        unique: whether a theorem guarantees at most one solution; False if no theorem applies.
        reason: description of the theorem, or the reason why no theorem applies.
    """

    exists: bool
    unique: bool
    reason: str
