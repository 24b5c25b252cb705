# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Nonsmooth Gauss-Seidel with over-relaxation and projection (SORP), point by point.

A sweep visits all contact points. The contact problem of each point i is solved exactly for
displacement a_i* and force r_i* while the other points are fixed, and the free components are
over-relaxed by the factor omega,

    a_i <- a_i + omega (a_i* - a_i),   S_ii a_i* = r_i* + p_i - sum_{j != i} S_ij a_j,

with blocks S_ij of the stiffness and the load p_i. Sticking points keep zero slip, and points in
contact remain on the obstacle (Raous, Chabrand and Lebon, J. Mec. Theor. Appl. 7 suppl. 1, 1988;
Jourdan, Alart and Jean, CMAME 155, 1998). Sweeps stop when the relative residual is below the
tolerance. For large friction they may cycle or diverge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact.algorithms.iteration import Algorithm, Iteration, check_between
from dolfinx_contact.algorithms.one_point import OnePoint
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["GaussSeidel"]


@dataclass(frozen=True)
class GaussSeidel(Algorithm):
    """Nonsmooth Gauss-Seidel method; one iteration is one sweep over all points.

    Attributes:
        relaxation: relaxation factor omega, between 0 and 2.
    """

    name: ClassVar[str] = "gauss-seidel"
    max_iterations: int = 20000
    relaxation: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_between(self.relaxation, "relaxation", 2.0)

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        m, d = r.shape
        rows = np.ascontiguousarray(contact.S.reshape(m, d, m * d))
        blocks = contact.blocks
        load = contact.p.reshape(m, d)
        points = [OnePoint(blocks[i], contact.friction[i], contact.bound[i]) for i in range(m)]
        omega = self.relaxation
        a = contact.displacements(r)
        x = a.reshape(-1)
        while not iteration.stops(a, contact.forces(a)):
            x = x.copy()
            for i, point in enumerate(points):
                mine = x[d * i : d * i + d]
                b = load[i] - rows[i] @ x + blocks[i] @ mine
                solution = np.array(point.solve(b))
                if omega != 1.0:
                    relaxed = mine + omega * (solution - mine)
                    if point.stuck:
                        relaxed[:-1] = 0.0
                    relaxed[-1] = 0.0 if point.closed else max(relaxed[-1], 0.0)
                    solution = relaxed
                mine[:] = solution
            a = x.reshape(m, d)
