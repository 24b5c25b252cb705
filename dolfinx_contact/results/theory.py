# SPDX-License-Identifier: LGPL-3.0-or-later
"""What theorems say of a contact problem: what was found."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Theory"]


@dataclass(frozen=True)
class Theory:
    """What theorems say of the solutions of a discrete contact problem, whatever its loads.

    Attributes:
        exists: whether there certainly is a solution; False leaves it open.
        unique: whether there certainly is no more than one; False leaves it open.
        reason: the theorem, or why none that can be checked applies, human-readable.
    """

    exists: bool
    unique: bool
    reason: str
