# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solvers of the contact problem."""

from dolfinx_contact.solvers.errors import ConvergenceError
from dolfinx_contact.solvers.ladder import solve
from dolfinx_contact.solvers.nested import prolong, solve_nested

__all__ = ["ConvergenceError", "prolong", "solve", "solve_nested"]
