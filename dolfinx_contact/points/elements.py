# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which elements a contact surface takes: what is supported, and what is inf-sup stable."""

from __future__ import annotations

import numpy as np

from dolfinx import fem

from dolfinx_contact._numbers import is_count

__all__ = ["check_elements", "check_name", "check_quadrature", "displacement_degree"]

#: Stable pairs of displacement and multiplier degrees, by method. P1 multipliers are traces of the
#: displacement space or smaller; P2/P2 is stable away from Dirichlet data, where nodes are removed.
_STABLE: dict[str, set[tuple[int, int]]] = {
    "nodal": {(1, 1)},
    "integral": {(1, 1), (2, 1), (2, 2)},
    "mixed": {(1, 1)},
}


def check_name(name: str, what: str) -> None:
    """Raise ``ValueError`` if the name of a contact surface or pair is no word."""
    if not isinstance(name, str) or not name:
        raise ValueError(f"the name of a contact {what} must be a word, got {name!r}")


def displacement_degree(u: fem.Function) -> int:
    """Degree of a vector Lagrange displacement, or ``ValueError``."""
    domain = u.function_space.mesh
    element = u.function_space.ufl_element()
    if domain.geometry.x.dtype != np.float64 or u.x.array.dtype != np.float64:
        raise ValueError("the mesh and the displacement must be in double precision")
    if domain.basix_cell().name not in ("triangle", "quadrilateral", "tetrahedron", "hexahedron"):
        raise ValueError(f"cells of kind {domain.basix_cell().name} are not supported")
    dim = domain.geometry.dim
    if domain.topology.dim != dim or dim not in (2, 3):
        raise ValueError("the body must be a 2D mesh in the plane or a 3D mesh")
    lagrange = element.family_name == "P" and not element.discontinuous
    if not lagrange or element.reference_value_shape != (dim,):
        raise ValueError(
            "the displacement must be a continuous vector Lagrange Function with "
            f"{dim} components, got {element}"
        )
    if element.degree not in (1, 2):
        raise ValueError(f"displacements of degree 1 and 2 are supported, got {element.degree}")
    return int(element.degree)


def check_elements(name: str, method: str, degrees: tuple[int, int]) -> None:
    """Raise ``ValueError`` if the pair of degrees is not stable in the method."""
    if not isinstance(method, str) or method not in _STABLE:
        raise ValueError(f"unknown contact method {method!r}; known: {sorted(_STABLE)}")
    if not is_count(degrees[1]):
        raise ValueError(f"{name}: the degree of the multiplier must be 1 or 2, got {degrees[1]!r}")
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
            f"{name}: the quadrature degree must be at least {least} for a stable contact "
            f"of P{degrees[0]} with P{degrees[1]}, got {quadrature_degree}"
        )
    return degree
