# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Nonsmooth Gauss-Seidel with over-relaxation and projection (SORP), point by point.

A sweep visits all contact points. The contact problem of each point is solved exactly while the
other points are fixed, and the free components are over-relaxed,

    a_i <- a_i + omega (a_i* - a_i),   S_ii a_i* = r_i* + p_i - sum_{j != i} S_ij a_j.

Sticking points keep zero slip, and points in contact remain on the obstacle (Raous, Chabrand and
Lebon, J. Mec. Theor. Appl. 7 suppl. 1, 1988; Jourdan, Alart and Jean, CMAME 155, 1998). Aitken's
extrapolation a_k + (a_{k+1} - a_k)/(1 - lambda) with the ratio lambda of successive changes is
accepted if it reduces the residual. In a two-level scheme (`two_level`), sweeps are the smoother:
they visit the coarse points first, and the coarse problem corrects long-wave errors.
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
        aitken: number of sweeps between two extrapolations; 0 for no extrapolation.
        two_level: whether a coarse correction follows every sweep.
        coarsening: number of points per coarse point along one direction.
    """

    name: ClassVar[str] = "gauss-seidel"
    max_iterations: int = 20000
    relaxation: float = 1.0
    aitken: int = 0
    two_level: bool = False
    coarsening: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check(
            self,
            relaxation=0 < self.relaxation < 2,
            aitken=self.aitken >= 0,
            coarsening=self.coarsening > 1,
        )

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        coarse = CoarseProblem(contact, self.coarsening) if self.two_level else None
        sweeps = Sweeps(contact, self.relaxation, coarse.order if coarse else None)
        a = contact.displacements(r)
        if coarse is not None and not r.any() and contact.number > _FEW:
            start = self.run(coarse.contact, tolerance=_START)
            a = coarse.prolonged(start.a)
            iteration.outcome.series["coarse sweeps"] = [
                start.iterations,
                *start.series.get("coarse sweeps", []),
            ]
        changes: list[Array] = []
        while not iteration.stops(a, contact.forces(a)):
            before = a
            a = sweeps(a)
            if coarse is not None:
                a = coarse.corrected(a, iteration.force, iteration.length)
            if self.aitken:
                changes = [*changes[-1:], a - before]
                if (iteration.trend.count + 1) % self.aitken == 0 and len(changes) == 2:
                    a = self._extrapolated(a, changes, iteration)
                    changes = []

    def _extrapolated(self, a: Array, changes: list[Array], iteration: Iteration) -> Array:
        old, new = (c.reshape(-1) for c in changes)
        ratio = float(new @ old) / (float(old @ old) or 1.0)
        if not 0 < ratio < 1:
            return a
        further = a + changes[1] * ratio / (1 - ratio)
        further[:, -1] = np.maximum(further[:, -1], 0.0)
        forces = iteration.contact.forces
        better = iteration.measure(further, forces(further)).worst
        return further if better < iteration.measure(a, forces(a)).worst else a


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
