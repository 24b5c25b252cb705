# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points of all ranks with their data and laws, replicated on every rank."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array, Codes, Ints, Mask
from dolfinx_contact._geometry import Gathered, unit_tangents
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.parametric_equations import ParametricEquations
from dolfinx_contact.laws import Frictionless, LawAtPoints, PointData
from dolfinx_contact.laws.cones import cones
from dolfinx_contact.laws.status import OPEN

__all__ = ["GatheredPoints", "PointLaws"]

T = TypeVar("T", bound=np.generic)


class GatheredPoints:
    """Contact points of all ranks that are not clamped, sorted by coordinates.

    Args:
        system: contact problem.

    Attributes:
        number: number m of points.
        local: indices of the points of this rank among all its contact points, also clamped ones.
        mine: indices of the points of this rank among the m points.
        positions: positions, shape (m, dim).
        normals: normals, shape (m, dim).
        frames: orthogonal matrices T of the points, shape (m, dim, dim). T (ut, un) is the
            Cartesian jump for the tangential displacement ut and the gap un, and T (rt, rn) the
            Cartesian force on the body for its tangential and normal parts.
        areas: areas, shape (m,).
        friction: friction coefficients, shape (m,); 0 without friction and at points with
            prescribed tangential displacements.
        bound: prescribed friction bounds (Tresca) as forces, shape (m,); 0 for other laws.
        augmentation: augmentation parameters of Newton's method, force per length, shape (m,).
        gap: initial gaps, shape (m,).
        reach: largest slips for which small sliding is accurate, shape (m,): half the mean facet
            size (in 3D the square root of the area) for contact with another body or a curved
            obstacle; infinite on flat obstacles.
        guided: whether Dirichlet data prescribe the tangential displacement of any point.
    """

    def __init__(self, system: ParametricEquations):
        eq = system.equations
        self.comm = system.comm
        self.local = np.flatnonzero(~system.clamped)
        self._surfaces = eq.surfaces
        tables = [self._table(eq, number) for number in range(len(eq.surfaces))]
        self._gathered = Gathered(self.comm, system.positions[self.local], system._ids[self.local])
        self.mine = self._gathered.mine
        self.positions = self._gathered.positions
        table = {
            name: self.gathered(np.concatenate([values[name] for values in tables]))
            for name in tables[0]
        }
        self._which = table["surface"]
        self._r = table["r"]
        self._guided = table["guided"]
        self.normals = table["normal"]
        self.areas = table["area"]
        self.gap = table["gap"]
        self.reach = table["reach"]
        self.number = len(self.normals)
        self.frames: Array = np.concatenate(
            [unit_tangents(self.normals), -self.normals[:, :, None]], axis=2
        )
        self.augmentation = self._r * self.areas
        self.friction = np.where(self._guided, 0.0, table["unit bound"])
        self.bound = np.where(self._guided, 0.0, table["bound"])
        self.guided = bool(self._guided.any())

    @staticmethod
    def _table(eq: ContactEquations, number: int) -> dict[str, npt.NDArray[Any]]:
        """Return data of all contact points of a surface on this rank, as arrays by name."""
        s = eq.surfaces[number]
        n = s.points.number
        at_rest = np.zeros((n, eq.dim))
        answers = s.law_at_points(at_rest, at_rest, s.point_data(eq.memory[number]))
        given = s.law.bound_kind == "given"
        flat = s.obstacle.flat and not s.between_bodies
        return {
            "surface": np.full(n, number),
            "normal": s.points.data.n,
            "area": s.points.areas,
            "r": s.points.data.r,
            "gap": s.points.data.gap,
            "guided": np.asarray(eq.constraints.surfaces[number].fixed_jumps[:n].any(axis=1)),
            "unit bound": np.zeros(n) if given else answers.unit_bound,
            "bound": answers.bound * s.points.areas if given else np.zeros(n),
            "reach": np.full(n, np.inf if flat else s.points.geometry.facet_size / 2),
        }

    def gathered(self, values: npt.NDArray[T]) -> npt.NDArray[T]:
        """Gather values at the m points of the problem, in the order of `positions`.

        ``values`` includes the clamped contact points of this rank. Collective.
        """
        return self._gathered(values[self.local])

    def owner(self, i: int) -> tuple[int, int]:
        """Return the rank that owns point ``i``, and the local index of the point. Collective.

        The local index counts all contact points of that rank, including clamped ones.
        """
        rank, number = self._gathered.owner(i)
        mine = int(self.local[number]) if self.comm.rank == rank else None
        return rank, int(self.comm.bcast(mine, root=rank))

    def laws(self, stiffness: float) -> PointLaws:
        """Return the contact laws of all points in 2D, in terms of lengths only. Collective.

        Args:
            stiffness: force per length by which forces are divided.
        """
        groups = []
        for number, s in enumerate(self._surfaces):
            fields = {}
            for name, values in s.points.data.fields.items():
                every: list[Any] = [np.zeros(t.points.number) for t in self._surfaces]
                every[number] = values
                fields[name] = self.gathered(np.concatenate(every))
            here = self._which == number
            for law, places in (
                (s.law, np.flatnonzero(here & ~self._guided)),
                (Frictionless(), np.flatnonzero(here & self._guided)),
            ):
                if len(places):
                    given = {name: fields[name][places] for name in law.given}
                    n = self.normals[places]
                    r = self._r[places]
                    none = np.zeros(len(places))
                    data = PointData(n, none, r, given)
                    known = LawAtPoints(law, 2, len(places), self.comm)
                    groups.append((places, known, data))
        return PointLaws(self.number, self.frames, stiffness / self.areas, groups)


@dataclass(frozen=True)
class PointLaws:
    """Contact laws of the points in 2D, in terms of the state w = (ut, un, rt, rn) of a point.

    ut is the tangential displacement, un the gap, and rt and rn are the tangential and normal
    forces divided by a stiffness, so that all entries are lengths.

    Attributes:
        number: number m of points.
        frames: orthogonal matrices T, shape (m, 2, 2): T (ut, un) and T (rt, rn) are Cartesian.
        scale: ratios of tractions to the forces in w, shape (m,).
        groups: for each law, indices of its points, the law, and its data at these points.
    """

    number: int
    frames: Array
    scale: Array
    groups: list[tuple[Ints, LawAtPoints, PointData]]

    def classify(self, w: Array) -> Codes:
        """Return the statuses that the laws determine at a state, shape (m,).

        Args:
            w: state of the points, shape (m, 4).
        """
        codes: Codes = np.full(self.number, OPEN, dtype=np.int8)
        for places, law, data in self.groups:
            T = self.frames[places]
            scale = self.scale[places, None]
            jump = np.einsum("iap,ip->ia", T, w[places, :2])
            traction = np.einsum("iap,ip->ia", T, w[places, 2:]) * scale
            codes[places] = law(jump, traction, data).required
        return codes

    def cones(self) -> tuple[Array, Array, Mask]:
        """Return the cones {w = B z : C w >= 0} of the four statuses of every point (`laws.cones`).

        Returns:
            Bases B, shape (m, 4, 4, 2); inequalities C, shape (m, 4, 3, 4); and mask of the
            statuses that exist at a point, shape (m, 4).
        """
        B = np.zeros((self.number, 4, 4, 2))
        C = np.zeros((self.number, 4, 3, 4))
        exists = np.zeros((self.number, 4), dtype=bool)
        for places, law, data in self.groups:
            found = cones(law, data, self.frames[places], self.scale[places])
            B[places], C[places], exists[places] = found
        return B, C, exists
