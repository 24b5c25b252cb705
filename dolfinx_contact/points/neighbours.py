# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlocal laws, which average a quantity over neighbouring contact points of a surface.

The row of a contact point in the sparse averaging matrix contains the kernel weights times the
areas of the points within the radius of the kernel. A rank stores only the surroundings of its own
points.
"""

from __future__ import annotations

from dataclasses import replace

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array, Codes
from dolfinx_contact._geometry import dot
from dolfinx_contact._petsc import triplet_matrix
from dolfinx_contact.laws import Answers, Law, LawAtPoints, PointData
from dolfinx_contact.laws.answers import Spreading
from dolfinx_contact.laws.spreading import kernel
from dolfinx_contact.laws.status import closed
from dolfinx_contact.laws.symbols import AROUND
from dolfinx_contact.points.contact_points import ContactPoints
from dolfinx_contact.points.jump_operators import multiplied
from dolfinx_contact.points.spatial_search import around

__all__ = ["LawAmongPoints", "Neighbours"]


class Neighbours:
    """Matrix averaging over neighbouring contact points of a surface, assembled on first use.

    Args:
        points: contact points of the surface.
        radius: distance up to which points contribute to the average, a length.
    """

    def __init__(self, points: ContactPoints, radius: float):
        self._points = points
        self._radius = radius
        self._areas: Array | None = None
        self._matrix: PETSc.Mat | None = None

    @property
    def matrix(self) -> PETSc.Mat:
        """Averaging matrix, assembled again after areas have been redistributed. Collective."""
        points, radius = self._points, self._radius
        if self._matrix is None or self._areas is not points.areas:
            self._areas = points.areas
            comm, x = points.comm, points.positions
            n = len(x)
            first = comm.exscan(n) or 0
            known = {"x": x, "area": points.areas, "number": first + np.arange(n)}
            i, found = around(comm, known, {"x": x, "reach": np.full(n, radius)})
            away = np.linalg.norm(x[i] - found["x"], axis=1)
            weights = found["area"] * kernel(away / radius)
            weights = weights / np.bincount(i, weights, minlength=n)[i]
            self._matrix = triplet_matrix(comm, (n, n), first + i, found["number"], weights)
        return self._matrix

    def __call__(self, values: Array) -> Array:
        """Return averages of values at the points over their neighbours, shape (n,). Collective."""
        return multiplied(self.matrix, values[:, None])[:, 0]


class LawAmongPoints(LawAtPoints):
    """A nonlocal law on the contact points of a surface. All methods are collective.

    The law has a field that is the weighted sum of the pressures at neighbouring points. It is
    evaluated from the current pressures.

    Args:
        law: law with an `averaging`.
        points: contact points of the surface.
    """

    def __init__(self, law: Law, points: ContactPoints):
        super().__init__(law, points.dim, points.number, points.comm)
        assert law.averaging is not None
        self.neighbours = Neighbours(points, law.averaging)

    def __call__(
        self, jump: Array, traction: Array, data: PointData, codes: Codes | None = None
    ) -> Answers:
        alone = super().__call__(jump, traction, _with(data, np.zeros(self.number)))
        q, by_jump, by_traction = alone.pressure
        acts = closed(alone.required if codes is None else codes)
        around = self.neighbours(np.where(acts, q, 0.0))
        slopes = (np.where(acts[:, None], d, 0.0) for d in (by_jump, by_traction))
        values = self._evaluate(self.compiled.values, jump, traction, _with(data, around))
        return Answers(self.compiled, values, Spreading(self.neighbours, around, *slopes))

    def rate(
        self,
        jump: Array,
        traction: Array,
        data: PointData,
        rates: PointData,
        codes: Codes,
        moved: Array | None = None,
    ) -> Array:
        spread = self(jump, traction, data, codes).spreading
        assert spread is not None
        around = _with(data, spread.around)
        changes = self._evaluate(self.compiled.pressure_sensitivities, jump, traction, around)
        # fields in the memory do not change
        still = np.zeros(self.number)
        fields = [rates.fields.get(name, still) for name in self.compiled.names[:-1]]
        given = np.column_stack([rates.n, *fields])
        change = np.where(closed(codes), dot(changes, given), 0.0)
        # a gap is a negative jump along the normal
        change -= rates.gap * dot(spread.by_jump, data.n)
        if moved is not None:
            change += dot(spread.by_jump, moved)
        moving = _with(rates, self.neighbours(change))
        return super().rate(jump, traction, around, moving, codes, moved)


def _with(data: PointData, around: Array) -> PointData:
    return replace(data, fields={**data.fields, AROUND: around})
