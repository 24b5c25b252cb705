# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solvers of the contact problem."""

from dolfinx_contact.solvers.attempts import ConvergenceError
from dolfinx_contact.solvers.strategies import solve

__all__ = ["ConvergenceError", "solve"]
