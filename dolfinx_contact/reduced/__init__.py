# SPDX-License-Identifier: LGPL-3.0-or-later
"""The contact problem reduced to its contact points."""

from dolfinx_contact.reduced.point_problem import PointProblem
from dolfinx_contact.reduced.reduction import Reduction

__all__ = ["PointProblem", "Reduction"]
