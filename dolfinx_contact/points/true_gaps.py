# SPDX-License-Identifier: LGPL-3.0-or-later
"""How far contact points are from an obstacle where they are now, whatever a law has been told."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem

from dolfinx_contact.obstacles import Obstacle, gap_at
from dolfinx_contact.points.contact_points import ContactPoints, Evaluator
from dolfinx_contact.points.rigid_body import RigidBody

__all__ = ["TrueGaps"]


class TrueGaps:
    """Distances of displaced contact points, compiled when first asked for.

    Args:
        u: displacement of the body.
        points: of a surface.
        obstacle: that it may touch.
    """

    def __init__(self, u: fem.Function, points: ContactPoints, obstacle: Obstacle):
        self._u = u
        self._points = points
        self._obstacle = obstacle
        self._evaluate: Evaluator | None = None

    def __call__(self) -> npt.NDArray[np.float64] | None:
        """Distances of the points of this rank (n,), negative inside. Collective.

        None if the obstacle does not say (`obstacles.gap_at`).
        """
        body = self._obstacle if isinstance(self._obstacle, RigidBody) else None
        if self._evaluate is None:
            domain = self._u.function_space.mesh
            x = ufl.SpatialCoordinate(domain) + self._u
            at = gap_at(self._obstacle, domain, x) if body is None else body.gap_of(domain, x)
            if at is None:
                return None
            self._evaluate = self._points.evaluator({"gap": at})
        if body is not None:
            body.place()
        return self._evaluate()["gap"][: self._points.number]
