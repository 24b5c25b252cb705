# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arguments that are to be numbers, or of some other kind."""

from __future__ import annotations

from typing import Any, TypeGuard

import numpy as np

__all__ = ["is_count", "is_number", "require_kind"]


def is_number(value: Any) -> TypeGuard[float]:
    """Whether a value is a real number, NaN and infinities among them, and no truth value."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool | complex)


def is_count(value: Any) -> TypeGuard[int]:
    """Whether a value is a whole number from 1 on."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    return whole and value >= 1


def require_kind(value: Any, kind: type) -> None:
    """Raise ``ValueError`` if a value is not of a kind. Not collective."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIO" else "a"
        raise ValueError(f"{article} {kind.__name__} is needed, got {type(value).__name__}")
