# SPDX-License-Identifier: LGPL-3.0-or-later
"""Why a solve failed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dolfinx_contact.solvers.history import Attempt

__all__ = ["ConvergenceError", "FloatingBodyError", "LinearSolverError"]


class ConvergenceError(RuntimeError):
    """No strategy solved the problem; the caller's Functions are as they were.

    Attributes:
        attempts: what was tried, with the history of each.
    """

    def __init__(self, message: str, attempts: Sequence[Attempt] = ()):
        super().__init__(message)
        self.attempts = list(attempts)


class FloatingBodyError(ConvergenceError):
    """A rigid motion of the body is held neither by Dirichlet data nor by contact."""


class LinearSolverError(ArithmeticError):
    """The linear system of a Newton step could not be solved; the message has the reason."""
