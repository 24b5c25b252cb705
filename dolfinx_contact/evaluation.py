# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of UFL expressions at contact points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, la

__all__ = ["Evaluator", "require_same_numbering"]


class Evaluator:
    """Values of UFL expressions at the points of a space on a facet submesh.

    The value at a point is the integral of the expression against the point's basis function over
    that of the basis function alone: exact for Gauss points, and for nodes as well where the
    expression has one value there (else the area-weighted mean of the adjacent facets).

    Args:
        W: scalar space with one dof per point: Lagrange degree 1 or a quadrature element.
        W_vector: the same with vector values.
        ds: measure of the surface whose quadrature points are the points of ``W``.
        expressions: UFL scalars and vectors; may contain Functions of body and surface.
        entity_maps: of the submesh.
    """

    def __init__(
        self,
        W: fem.FunctionSpace,
        W_vector: fem.FunctionSpace,
        ds: ufl.Measure,
        expressions: Sequence[Any],
        entity_maps: Any,
    ):
        q, q_vector = ufl.TestFunction(W), ufl.TestFunction(W_vector)
        one = fem.Constant(ds.ufl_domain(), 1.0)
        tested = [one * q] + [
            ufl.dot(e, q_vector) if len(e.ufl_shape) else e * q for e in expressions
        ]
        # UFL simplifies what is zero (the friction bound of `Frictionless`) to no form at all.
        self._forms = [
            None
            if isinstance(e, ufl.constantvalue.Zero)
            else fem.form(e * ds, entity_maps=entity_maps)
            for e in tested
        ]
        self._shapes = [e.ufl_shape for e in expressions]
        self._index_map = W.dofmap.index_map
        #: Area of each local point (ghosts included).
        self.areas = self._assemble(self._forms[0], ())

    def _assemble(self, form: fem.Form | None, shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
        bs = int(np.prod(shape, dtype=int))
        b = la.vector(self._index_map, bs)
        b.array[:] = 0.0
        if form is not None:
            fem.assemble_vector(b.array, form)
        b.scatter_reverse(la.InsertMode.add)
        b.scatter_forward()
        return b.array.reshape(-1, *shape).copy()

    def __call__(self) -> list[npt.NDArray[np.float64]]:
        """One array per expression over the local points, ghosts included. Collective."""
        values = []
        for form, shape in zip(self._forms[1:], self._shapes, strict=True):
            integral = self._assemble(form, shape)
            values.append(integral / self.areas.reshape(-1, *(1 for _ in shape)))
        return values


def require_same_numbering(W: fem.FunctionSpace, Q: fem.FunctionSpace) -> None:
    """Raise ``RuntimeError`` if two spaces of a surface differ in the numbering of their dofs."""
    if not np.array_equal(W.dofmap.list, Q.dofmap.list):
        raise RuntimeError("scalar and vector spaces of a contact surface are numbered differently")
