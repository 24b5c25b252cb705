# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether a solution is the only one: what was found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from petsc4py import PETSc

__all__ = ["Uniqueness"]


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
