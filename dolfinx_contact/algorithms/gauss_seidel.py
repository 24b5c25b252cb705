# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Nonsmooth Gauss-Seidel with over-relaxation and projection (SORP), point by point.

A sweep visits all contact points. The contact problem of each point is solved exactly while the
other points are fixed, and the free components are over-relaxed,

    a_i <- a_i + omega (a_i* - a_i),   S_ii a_i* = r_i* + p_i - sum_{j != i} S_ij a_j.

Sticking points keep zero slip, and points in contact remain on the obstacle (Raous, Chabrand and
Lebon, J. Mec. Theor. Appl. 7 suppl. 1, 1988; Jourdan, Alart and Jean, CMAME 155, 1998). In a
two-level scheme (`two_level`), sweeps are the smoother: they visit the coarse points first, and the
coarse problem corrects long-wave errors. Sweeps stop when the measure is below the tolerance; for
large friction they may cycle or diverge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact.algorithms.iteration import Algorithm, Iteration, check
from dolfinx_contact.algorithms.one_point import one_point
from dolfinx_contact.algorithms.point_problem import PointProblem
from dolfinx_contact.algorithms.two_level import CoarseProblem

__all__ = ["GaussSeidel", "Sweeps"]

Array = npt.NDArray[np.float64]
_FEW = 8  # largest number of points without an initial solve on a coarser level
_START = 1e-3  # tolerance of the initial solve of the coarse problem


@dataclass(frozen=True)
class GaussSeidel(Algorithm):
    """Nonsmooth Gauss-Seidel; an iteration is a sweep.

    Attributes:
        relaxation: relaxation factor omega, between 0 and 2.
        two_level: whether a coarse correction follows every sweep.
    """

    name: ClassVar[str] = "gauss-seidel"
    max_iterations: int = 20000
    relaxation: float = 1.0
    two_level: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check(self, relaxation=0 < self.relaxation < 2)

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        coarse = CoarseProblem(contact) if self.two_level else None
        sweeps = Sweeps(contact, self.relaxation, coarse.order if coarse else None)
        a = contact.displacements(r)
        if coarse is not None and not r.any() and contact.number > _FEW:
            start = self.run(coarse.contact, tolerance=_START)
            a = coarse.prolonged(start.a)
            iteration.outcome.series["coarse sweeps"] = [
                start.iterations,
                *start.series.get("coarse sweeps", []),
            ]
        while not iteration.stops(a, contact.forces(a)):
            a = sweeps(a)
            if coarse is not None:
                a = coarse.corrected(a, iteration.force, iteration.length)


class Sweeps:
    """Gauss-Seidel sweeps over the points of a problem.

    Args:
        contact: reduced problem.
        relaxation: relaxation factor omega.
        order: numbers of the points in the order of a sweep, shape (m,); by default ascending.
    """

    def __init__(
        self,
        contact: PointProblem,
        relaxation: float,
        order: npt.NDArray[np.int_] | None = None,
    ):
        self._contact = contact
        self._relaxation = relaxation
        self._order = range(contact.number) if order is None else [int(i) for i in order]
        m = contact.number
        d = contact.dim
        self._rows = np.ascontiguousarray(contact.S.reshape(m, d, m * d))
        self._blocks = contact.blocks
        self._points = [
            one_point(contact.blocks[i], float(contact.friction[i]), float(contact.bound[i]))
            for i in range(m)
        ]

    def __call__(self, a: Array) -> Array:
        """Return the displacements (m, dim) after a sweep that starts from ``a``."""
        d = self._contact.dim
        omega = self._relaxation
        x = a.reshape(-1).copy()
        load = self._contact.p.reshape(-1, d)
        for i in self._order:
            point = self._points[i]
            mine = x[d * i : d * i + d]
            b = load[i] - self._rows[i] @ x + self._blocks[i] @ mine
            found = np.array(point.solve(b))
            if omega != 1.0:
                relaxed = mine + omega * (found - mine)
                if point.stuck:
                    relaxed[:-1] = 0.0
                relaxed[-1] = 0.0 if point.closed else max(relaxed[-1], 0.0)
                found = relaxed
            mine[:] = found
        return x.reshape(a.shape)
