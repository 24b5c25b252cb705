# SPDX-License-Identifier: LGPL-3.0-or-later
"""Condensation of a contact problem onto its contact points, on which algorithms operate."""

from dolfinx_contact.reduced.point_problem import PointProblem
from dolfinx_contact.reduced.reduction import Reduction

__all__ = ["PointProblem", "Reduction"]
