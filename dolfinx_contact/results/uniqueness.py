# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether a solution is the only one, and what theorems prove: what was found."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real
from typing import Literal

from mpi4py import MPI
from petsc4py import PETSc

from dolfinx_contact._collective import Arguments, collective

__all__ = ["OTHER_DATA", "Theory", "Uniqueness", "checked_seconds"]

#: Why nothing is stated of a problem with data of which the solution is none.
OTHER_DATA = "the data have changed since the problem was solved"


@dataclass(frozen=True)
class Uniqueness:
    """Whether a solution is the only one.

    Attributes:
        verdict: ``"proved"`` to be the only one, ``"not proved"``, or ``"others exist"``.
        reason: how, or why not, human-readable.
        other: the unknowns of another solution, which `ContactProblem.read` puts into the
            Functions; None if there is none that is known.
    """

    verdict: Literal["proved", "not proved", "others exist"]
    reason: str
    other: PETSc.Vec | None = None

    def __str__(self) -> str:
        words = {
            "proved": "the only solution, proved",
            "not proved": "not decided whether it is the only solution",
            "others exist": "not the only solution",
        }
        return f"{words[self.verdict]}: {self.reason}"


def _check_seconds(a: Arguments) -> None:
    seconds = a.proof_seconds
    number = isinstance(seconds, Real) and not isinstance(seconds, bool)
    if not number or math.isnan(seconds) or seconds < 0:
        raise ValueError(f"seconds for a proof must not be negative, got {seconds!r}")
    a.proof_seconds = float(seconds)


@collective("seconds", _check_seconds)
def checked_seconds(comm: MPI.Comm, proof_seconds: float) -> float:
    """The seconds for a proof as a number, or ``ValueError`` on every rank. Collective."""
    return proof_seconds


@dataclass(frozen=True)
class Theory:
    """What theorems prove of the solutions of a discrete contact problem, whatever its loads.

    Attributes:
        exists: whether there certainly is a solution; False leaves it open.
        unique: whether there certainly is no more than one; False leaves it open.
        reason: the theorem, or why none that can be checked applies, human-readable.
    """

    exists: bool
    unique: bool
    reason: str
