# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Volumes of bilinear and trilinear cells and their change by a displacement, in UFL.

With reference coordinates xi_i from -1/2 to 1/2, a point of a cell is x = a_0 + sum_i a_i xi_i +
sum_{i<j} b_ij xi_i xi_j + c xi_1 xi_2 xi_3. Integration of det dx/dxi term by term gives the volume
of a hexahedron,

    [a_1, a_2, a_3] + ([a_1, b_12, b_13] + [b_12, a_2, b_23] + [b_13, b_23, a_3]) / 12,

the area [a_1, a_2] of a quadrilateral, and the integral of the radius r over a quadrilateral of the
meridian section of a body of revolution,

    r_0 [a_1, a_2] + (r_1 [a_1, b_12] + r_2 [b_12, a_2]) / 12,

where [...] are determinants, r_0 is the radius at the midpoint, and r_i = dr/dxi_i there. The
volume does not depend on c. Determinants are linear in each column. Replacing one column at a time
by the coefficients of the displacement u therefore gives the integral of its divergence.

All expressions must be evaluated at the midpoint of the cell. The coefficients a and b of u follow
from its gradient and second derivatives at the midpoint, the coefficients of x from the vertices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import ufl
from dolfinx import fem

__all__ = ["Volumes", "volumes_of"]


@dataclass(frozen=True)
class Volumes:
    """Cell volumes as UFL expressions, to be evaluated at cell midpoints.

    Attributes:
        share: cell volume divided by the determinant of the Jacobian at the midpoint and, for a
            body of revolution, by the radius at the midpoint.
        dilatation: cell mean of div u, including u_r / r for a body of revolution.
        ratio: displaced volume divided by reference volume.
    """

    share: Any
    dilatation: Any
    ratio: Any


@dataclass(frozen=True)
class _Shape:
    """Coefficients of a vector field on a cell as a polynomial in reference coordinates xi.

    Attributes:
        a: vector coefficient of each linear term xi_i.
        b: vector coefficient of each bilinear term xi_i xi_j, by (i, j).
        r: first component at the midpoint, followed by its derivatives with respect to xi there.
    """

    a: list[Any]
    b: dict[tuple[int, int], Any]
    r: list[Any]


def volumes_of(u: fem.Function, *, revolution: bool = False) -> Volumes:
    """Return cell volumes and their change by a displacement, for a one-point quadrature rule.

    Args:
        u: displacement of degree 1 on quadrilaterals or hexahedra with straight edges.
        revolution: whether the mesh is the meridian section of a body of revolution.
    """
    domain = u.function_space.mesh
    integral: Callable[..., Any] = _volume
    factors = 3
    if revolution:
        integral = _section
    elif len(u) == 2:
        integral = _area
        factors = 2
    x = _of_vertices(domain)
    moving = _of_displacement(u, x)
    moved = _Shape(
        [p + q for p, q in zip(x.a, moving.a, strict=True)],
        {key: x.b[key] + moving.b[key] for key in x.b},
        [p + q for p, q in zip(x.r, moving.r, strict=True)],
    )
    before = integral(*[x] * factors)
    by_one = [
        integral(*[moving if k == other else x for other in range(factors)]) for k in range(factors)
    ]
    at_middle = _determinant(x.a) * (x.r[0] if revolution else 1)
    ratio = integral(*[moved] * factors) / before
    return Volumes(before / at_middle, sum(by_one[1:], by_one[0]) / before, ratio)


def _of_vertices(domain: Any) -> _Shape:
    """Return the coefficients of the position, computed from the vertices of the cell."""
    dim = domain.geometry.dim
    nodes = ufl.classes.CellVertices(domain)
    corners = [ufl.as_vector([nodes[k, i] for i in range(dim)]) for k in range(2**dim)]
    # Vertex k of the reference cell has its i-th coordinate by the i-th bit of k.
    sign = [[1 if k >> i & 1 else -1 for i in range(dim)] for k in range(2**dim)]

    def mean(weights: list[int], power: int) -> Any:
        terms = [w * corner for w, corner in zip(weights, corners, strict=True)]
        return sum(terms[1:], terms[0]) * (2.0**power / len(corners))

    a = [mean([s[i] for s in sign], 1) for i in range(dim)]
    b = {(i, j): mean([s[i] * s[j] for s in sign], 2) for j in range(dim) for i in range(j)}
    return _Shape(a, b, [mean([1] * len(corners), 0)[0], *[column[0] for column in a]])


def _of_displacement(u: fem.Function, x: _Shape) -> _Shape:
    """Return the coefficients of a displacement, computed from its derivatives at the midpoint."""
    gradient, second = ufl.grad(u), ufl.grad(ufl.grad(u))
    k, m, n = ufl.indices(3)
    a = [gradient * column for column in x.a]
    b = {
        (i, j): gradient * x.b[i, j] + ufl.as_vector(second[k, m, n] * x.a[i][m] * x.a[j][n], k)
        for i, j in x.b
    }
    return _Shape(a, b, [u[0], *[column[0] for column in a]])


def _determinant(columns: list[Any]) -> Any:
    return ufl.det(ufl.as_matrix([[c[i] for c in columns] for i in range(len(columns))]))


def _area(p: _Shape, q: _Shape) -> Any:
    return _determinant([p.a[0], q.a[1]])


def _volume(p: _Shape, q: _Shape, s: _Shape) -> Any:
    """Return the hexahedron volume, linear in three fields, one per column of the Jacobian."""
    around = [
        [p.a[0], q.b[0, 1], s.b[0, 2]],
        [p.b[0, 1], q.a[1], s.b[1, 2]],
        [p.b[0, 2], q.b[1, 2], s.a[2]],
    ]
    total = sum(_determinant(columns) for columns in around)
    return _determinant([p.a[0], q.a[1], s.a[2]]) + total / 12


def _section(p: _Shape, q: _Shape, s: _Shape) -> Any:
    """Integrate a radius (in p) over a quadrilateral with the Jacobian columns of q and s."""
    total = p.r[1] * _determinant([q.a[0], s.b[0, 1]]) + p.r[2] * _determinant([q.b[0, 1], s.a[1]])
    return p.r[0] * _determinant([q.a[0], s.a[1]]) + total / 12
