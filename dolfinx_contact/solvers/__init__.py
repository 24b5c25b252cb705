# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear and linear solvers of the contact problem, and strategies for solves that fail."""

from dolfinx_contact.solvers.attempts import ConvergenceError
from dolfinx_contact.solvers.strategies import solve

__all__ = ["ConvergenceError", "solve"]
