# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Entries of the Jacobian of a law that sees the points around its own.

Its answer is tau(j, t; N q) with what points spread, q(j, t), and N of the surface, so that the
contact rows gain

    -E^T W D_s N (q_j B, q_t E)

off the blocks of single points. N never changes, nor does the pattern of the product.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._entries import Entries, matrix_of
from dolfinx_contact.equations.state import ContactState
from dolfinx_contact.points.neighbours import LawAmongPoints
from dolfinx_contact.points.surface import ContactSurface

__all__ = ["SpreadTerms"]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
_NEEDED_BY = "a law that sees the points around its own"


class SpreadTerms:
    """Entries of one surface. Collective, as its methods are.

    Args:
        surface: with a law that is not local.
        unit: of its multipliers.
        bodies: places of displacements among all unknowns (groups, k, dim), -1 where fixed.
        multipliers: the same of its multipliers (groups, l, dim).
        unknowns: of this rank.
    """

    def __init__(
        self,
        surface: ContactSurface,
        unit: float,
        bodies: Indices,
        multipliers: Indices,
        unknowns: int,
    ):
        self._surface = surface
        self._unit = unit
        comm = surface.comm
        stencils = surface._constant_operator(_NEEDED_BY).stencils
        n = surface.points.number
        law = surface.law_at_points
        assert isinstance(law, LawAmongPoints)
        self._N = law.neighbours.matrix
        point = (comm.exscan(n) or 0) + stencils.points[:, :, None, None]

        def pairs(places: Indices) -> tuple[Indices, Indices]:
            shape = *stencils.points.shape, *places.shape[1:]
            at = np.broadcast_to(point, shape)
            of = np.broadcast_to(places[:, None], shape)
            return at.reshape(-1), of.reshape(-1)

        at, of = pairs(multipliers)
        self._left_entries = Entries(of, at)
        self._left = matrix_of(comm, (unknowns, n), self._left_entries)
        both = zip(pairs(bodies), (at, of), strict=True)
        self._right_entries = Entries(*(np.concatenate(pair) for pair in both))
        self._right = matrix_of(comm, (n, unknowns), self._right_entries)
        self._number = 0
        self._first: PETSc.Mat | None = None
        self._product: PETSc.Mat | None = None

    def _multiply(self) -> None:
        self._first = self._left.matMult(self._N, self._first)
        self._product = self._first.matMult(self._right, self._product)

    def entries(self) -> tuple[Indices, Indices]:
        """Rows and columns, in the order of `values`."""
        self._multiply()
        assert self._product is not None
        indptr, columns, _ = self._product.getValuesCSR()
        first, last = self._product.getOwnershipRange()
        rows = np.repeat(np.arange(first, last, dtype=np.int64), np.diff(indptr))
        self._number = len(rows)
        return rows, columns.astype(np.int64)

    def values(self, state: ContactState) -> Array:
        """The entries at a state; none where another law, that is local, stands in."""
        if state.answers.spreading is None:
            return np.zeros(self._number)
        stencils = self._surface._constant_operator(_NEEDED_BY).stencils
        areas = self._surface.points.areas
        at = stencils.points
        e = stencils.multiplier_weights
        by_jump, by_traction = state.spread_by
        weighted = (areas[:, None] * state.by_around)[at]
        left = e[..., None] * weighted[:, :, None, :]
        jump = stencils.weights[..., None] * by_jump[at][:, :, None, :]
        traction = self._unit * e[..., None] * by_traction[at][:, :, None, :]
        self._left.zeroEntries(), self._right.zeroEntries()
        self._left_entries.add(left.reshape(-1), self._left)
        self._right_entries.add(
            np.concatenate([jump.reshape(-1), traction.reshape(-1)]), self._right
        )
        self._multiply()
        assert self._product is not None
        return -np.asarray(self._product.getValuesCSR()[2])
