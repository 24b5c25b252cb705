# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which elements a contact surface takes: what is supported, and what is inf-sup stable."""

from __future__ import annotations

from typing import Any

import numpy as np

from dolfinx import fem

from dolfinx_contact._validate import count, one_of

__all__ = ["check_elements", "check_quadrature", "displacement_degree"]

#: Stable pairs of displacement and multiplier degrees, by method. P1 multipliers are traces of the
#: displacement space or smaller; P2/P2 is stable away from Dirichlet data, where nodes are removed.
_STABLE: dict[str, set[tuple[int, int]]] = {
    "nodal": {(1, 1)},
    "integral": {(1, 1), (2, 1), (2, 2)},
    "mixed": {(1, 1)},
}


def displacement_degree(u: Any) -> int:
    """Degree of a vector Lagrange displacement, or ``ValueError``."""
    if not isinstance(u, fem.Function):
        raise ValueError(f"the displacement must be a Function, got {type(u).__name__}")
    domain = u.function_space.mesh
    element = u.function_space.ufl_element()
    cell = domain.basix_cell().name
    dim = domain.geometry.dim
    lagrange = element.family_name == "P" and not element.discontinuous
    for right, message in (
        (
            domain.geometry.x.dtype == u.x.array.dtype == np.float64,
            "the mesh and the displacement must be in double precision",
        ),
        (
            cell in ("triangle", "quadrilateral", "tetrahedron", "hexahedron"),
            f"cells of kind {cell} are not supported",
        ),
        (
            domain.topology.dim == dim and dim in (2, 3),
            "the body must be a 2D mesh in the plane or a 3D mesh",
        ),
        (
            lagrange and element.reference_value_shape == (dim,),
            f"the displacement must be a continuous vector Lagrange Function with {dim} "
            f"components, got {element}",
        ),
        (
            element.degree in (1, 2),
            f"displacements of degree 1 and 2 are supported, got {element.degree}",
        ),
    ):
        if not right:
            raise ValueError(message)
    return int(element.degree)


def check_elements(name: str, method: str, degrees: tuple[int, int]) -> None:
    """Raise ``ValueError`` if the pair of degrees is not stable in the method."""
    one_of(method, f"{name}: method", sorted(_STABLE))
    count(degrees[1], f"{name}: multiplier_degree")
    if degrees not in _STABLE[method]:
        stable = ", ".join(f"P{d}/P{m}" for d, m in sorted(_STABLE[method]))
        raise ValueError(
            f"{name}: displacement P{degrees[0]} with multiplier P{degrees[1]} is not a stable "
            f"pair of the {method} method; stable: {stable}"
        )


def check_quadrature(
    name: str, degrees: tuple[int, int], quadrature_degree: int | None, *, weighted: bool
) -> int:
    """The quadrature degree of the integral method, by default twice that of the displacement.

    The weight of a body of revolution, its circumference, takes one degree more.

    Raises:
        ValueError: if the rule does not integrate multiplier times displacement exactly on flat
            facets, so that the pair loses its stability.
    """
    degree = 2 * degrees[0] + weighted if quadrature_degree is None else quadrature_degree
    least = sum(degrees) + weighted
    if not isinstance(degree, int) or degree < least:
        raise ValueError(
            f"{name}: the quadrature degree must be at least {least} for a stable contact of "
            f"P{degrees[0]} with P{degrees[1]}, got {quadrature_degree}"
        )
    return degree
