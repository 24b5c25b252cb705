# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reduction of the contact problem to its contact points."""

from dolfinx_contact.reduced.point_problem import PointProblem
from dolfinx_contact.reduced.reduction import Reduction

__all__ = ["PointProblem", "Reduction"]
