# SPDX-License-Identifier: LGPL-3.0-or-later
"""How a body is deformed: where it is turned inside out."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx import fem, mesh

from dolfinx_contact._compat import geometry_dofmap
from dolfinx_contact.body.cells import (
    chunks,
    determinants,
    gradients,
    is_affine,
    midpoints,
    reference_points,
)

__all__ = ["smallest_jacobian"]

Array = npt.NDArray[np.float64]

_OFF_AXIS = 1e-6  # of the way to the middle of a cell


def smallest_jacobian(
    V: fem.FunctionSpace, u: Array, *, vertices: bool = True, axisymmetric: bool = False
) -> tuple[float, Array]:
    """The smallest det(I + grad u) and the midpoint of its cell in the reference. Collective.

    It is looked for at quadrature points, which is where an energy sees the body, and if wanted at
    the vertices of the cells; linear simplices have one value. The same on
    every rank. NaN, if the displacement is not finite: accept a state where it is ``> 0``.

    Args:
        V: displacement space.
        u: displacement at all local dofs.
        vertices: whether to look at the vertices too.
        axisymmetric: whether the body is one of revolution, which stretches by 1 + u_r / r around.
    """
    domain = V.mesh
    dim = domain.geometry.dim
    degree = V.ufl_element().degree
    n = domain.topology.index_map(dim).size_local
    order = 0 if is_affine(domain) and degree == 1 and not axisymmetric else 2 * degree
    points = reference_points(domain.basix_cell(), order, vertices=vertices)
    if axisymmetric:  # off the axis
        points = points + _OFF_AXIS * (points.mean(axis=0) - points)
    X = domain.geometry.x[:, :dim]
    elements = domain.ufl_domain().ufl_coordinate_element()
    fields = [
        (geometry_dofmap(domain), X, gradients(elements, points)),
        (
            V.dofmap.list,
            u.reshape(-1, dim),
            gradients(V.ufl_element(), points),
        ),
    ]
    values = np.empty(n)
    shapes = (_values(elements, points), _values(V.ufl_element(), points))
    radial = [(nodes, f, shape) for (nodes, f, _), shape in zip(fields, shapes, strict=True)]
    for part in chunks(n):
        dX, du = (
            (f[nodes[part]].transpose(0, 2, 1) @ table)
            .reshape(-1, dim, len(points), dim)
            .transpose(0, 2, 1, 3)
            for nodes, f, table in fields
        )
        # A corner of a degenerate quadrilateral has no gradient.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            J = determinants(dX)
            ratio = np.where(J == 0, np.inf, determinants(dX + du) / J)
        if axisymmetric:
            r, moved = (f[nodes[part]][:, :, 0] @ table for nodes, f, table in radial)
            ratio *= 1 + moved / r
        values[part] = ratio.min(axis=1)
    return _least(domain, values)


def _least(domain: mesh.Mesh, values: Array) -> tuple[float, Array]:
    """The least of the values of all cells, and the midpoint of its cell. Collective."""
    smallest = domain.comm.allreduce(float(values.min(initial=np.inf)), op=np.minimum)
    # Of cells with the same value, up to round-off, the first in the order of the input.
    tolerance = 1e-9 * abs(smallest) if np.isfinite(smallest) else 0.0
    cells = np.flatnonzero((values <= smallest + tolerance) | np.isnan(values))
    original = np.asarray(domain.topology.original_cell_index)[cells]
    mine = [
        (int(original[i]), midpoints(domain, cells[i : i + 1])[0])
        for i in ([int(np.argmin(original))] if len(cells) else [])
    ]
    found = [c for part in domain.comm.allgather(mine) for c in part]
    return float(smallest), min(found, key=lambda c: c[0])[1]


def _values(element: Any, points: Array) -> Array:
    """Values of a blocked Lagrange element at reference points, (nodes, points)."""
    table = element.sub_elements[0].basix_element.tabulate(0, points)
    return np.asarray(table[0, :, :, 0].T)
