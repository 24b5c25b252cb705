# SPDX-License-Identifier: LGPL-3.0-or-later
"""Laws that see the points around theirs: a sparse matrix on the contact points of a surface.

N has a row for every point, with weights of the points within the radius of the kernel, times
their areas. Pairs are found by boxes and messages from rank to rank; no rank holds more of the
surface than lies around its own points.
"""

from __future__ import annotations

import logging
from dataclasses import replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import basix

from dolfinx_contact._petsc import Entries, matrix_of
from dolfinx_contact.laws import Answers, Kernel, Law, LawAtPoints, PointData
from dolfinx_contact.laws.spreading import KERNELS, whole
from dolfinx_contact.laws.status import closed
from dolfinx_contact.laws.symbols import AROUND
from dolfinx_contact.points.contact_points import ContactPoints
from dolfinx_contact.points.search import exchanged, ranks_nearby

__all__ = ["LawAmongPoints", "Neighbours", "spreading_matrix"]

logger = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]
Codes = npt.NDArray[np.int8]


def spreading_matrix(comm: MPI.Comm, x: Array, areas: Array, kernel: Kernel) -> PETSc.Mat:
    """N on the points of all ranks. Collective.

    Args:
        comm: communicator.
        x: points of this rank (n, dim).
        areas: of the points (n,).
        kernel: with its radius.
    """
    n, dim = x.shape
    first = comm.exscan(n) or 0
    known = np.column_stack([x, areas, first + np.arange(n)])
    places, tree = ranks_nearby(comm, x, x, lambda near, _: near <= kernel.radius)
    answers = []
    for q in exchanged(comm, [np.column_stack([x[i], i]) for i in places], (dim + 1,)):
        found = []
        if tree is not None and len(q):
            found = tree.query_ball_point(q[:, :dim], kernel.radius)
        k = np.array([j for part in found for j in part], dtype=np.int64)
        i = np.repeat(np.arange(len(q)), [len(part) for part in found]).astype(np.int64)
        away = np.linalg.norm(q[i, :dim] - x[k], axis=1)
        answers.append(np.column_stack([q[i, dim], known[k, dim:], away]))
    rows = np.concatenate(exchanged(comm, answers, (4,)))
    i = rows[:, 0].astype(np.int64)
    k = rows[:, 2].astype(np.int64)
    share = KERNELS[kernel.shape](np.asarray(rows[:, 3] / kernel.radius, dtype=np.float64))
    weights = np.asarray(rows[:, 1] * share, dtype=np.float64)
    if kernel.normalised:
        weights = np.asarray(weights / np.bincount(i, weights, minlength=n)[i])
    else:
        weights /= whole(kernel.shape, dim) * kernel.radius ** (dim - 1)
    entries = Entries(first + i, k)
    N = matrix_of(comm, (n, n), entries)
    entries.add(weights, N)
    return N


class Neighbours:
    """The matrix N of a surface, made when it is first wanted.

    Args:
        points: of the surface.
        kernel: with its radius.
        name: of the surface.
    """

    def __init__(self, points: ContactPoints, kernel: Kernel, name: str):
        self._points = points
        self._kernel = kernel
        self._name = name
        self._areas: Array | None = None
        self._matrix: PETSc.Mat | None = None

    @property
    def matrix(self) -> PETSc.Mat:
        """N; anew where areas have been given from held ends to their neighbours. Collective."""
        points = self._points
        if self._matrix is None or self._areas is not points.areas:
            if self._matrix is None:
                self._warn_of_size()
            else:
                self._matrix.destroy()
            self._areas = points.areas
            self._matrix = spreading_matrix(
                points.comm, points.positions, points.areas, self._kernel
            )
            self._in, self._out = self._matrix.createVecs()
        return self._matrix

    def _warn_of_size(self) -> None:
        """Warn of a radius below the mean size of the facets. Collective."""
        sub = self._points.submesh.mesh
        comm = self._points.comm
        area = comm.allreduce(float(self._points.areas.sum()))
        cells = sub.topology.index_map(sub.topology.dim).size_global
        share = basix.cell.volume(sub.basix_cell())
        size = (area / cells / share) ** (1.0 / sub.topology.dim)
        if self._kernel.radius < (1 - 1e-9) * size and comm.rank == 0:
            logger.warning(
                "%s: the radius of nonlocal friction, %.3g, is below the mesh size, %.3g: points "
                "hardly see one another, and friction is local",
                self._name,
                self._kernel.radius,
                size,
            )

    def __call__(self, values: Array) -> Array:
        """N times values (n,). Collective."""
        N = self.matrix
        self._in.array[:] = values
        N.mult(self._in, self._out)
        return self._out.array_r.copy()


class _Spread:
    """What points spread, and how; see `laws.answers.Spreading`."""

    def __init__(self, neighbours: Neighbours, around: Array, by_jump: Array, by_traction: Array):
        self.neighbours = neighbours
        self.around = around
        self.by_jump = by_jump
        self.by_traction = by_traction

    def __call__(self, values: Array) -> Array:
        return self.neighbours(values)


class LawAmongPoints(LawAtPoints):
    """A law that is not local, on the contact points of a surface. Collective, as its methods are.

    What the points around spread is one more field of the law, which is known when the pressures
    are.

    Args:
        law: with an `averaging`.
        points: of the surface.
        name: of the surface.
    """

    def __init__(self, law: Law, points: ContactPoints, name: str):
        super().__init__(law, points.dim, points.number, points.comm)
        kernel = law.averaging
        assert kernel is not None
        self.neighbours = Neighbours(points, kernel, name)

    def __call__(
        self, jump: Array, traction: Array, data: PointData, codes: Codes | None = None
    ) -> Answers:
        alone = super().__call__(jump, traction, _with(data, np.zeros(self.number)))
        q, by_jump, by_traction = alone.pressure
        acts = closed(alone.required if codes is None else codes)
        around = self.neighbours(np.where(acts, q, 0.0))
        slopes = (np.where(acts[:, None], d, 0.0) for d in (by_jump, by_traction))
        values = self._evaluate(self.compiled.values, jump, traction, _with(data, around))
        return Answers(self.compiled, values, _Spread(self.neighbours, around, *slopes))

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
        assert isinstance(spread, _Spread)
        around = _with(data, spread.around)
        changes = self._evaluate(self.compiled.pressure_sensitivities, jump, traction, around)
        # What memory has does not change.
        still = np.zeros(self.number)
        fields = [rates.fields.get(name, still) for name in self.compiled.names[:-1]]
        given = np.column_stack([rates.n, *fields])
        change = np.where(closed(codes), np.sum(changes * given, axis=1), 0.0)
        # A gap is a jump along the normal, backwards.
        change -= rates.gap * np.sum(spread.by_jump * data.n, axis=1)
        if moved is not None:
            change += np.sum(spread.by_jump * moved, axis=1)
        moving = _with(rates, self.neighbours(change))
        return super().rate(jump, traction, around, moving, codes, moved)


def _with(data: PointData, around: Array) -> PointData:
    return replace(data, fields={**data.fields, AROUND: around})
