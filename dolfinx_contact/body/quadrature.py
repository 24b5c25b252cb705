# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rules of quadrature that UFL estimates for energies that are no polynomials.

UFL adds up degrees, of a logarithm and of a quotient too. So it takes degree 20 for the second
derivative of a neo-Hookean energy on hexahedra of degree 1, which is 1331 points a cell, where 8
are usual: assembly takes fifty times as long, for digits that are far below the error of the mesh.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import basix
import ufl
from dolfinx import fem
from ufl.algorithms import compute_form_data

__all__ = ["EstimatedRule", "estimated_rule", "warn_of_rule"]

_MANY = 20  # times the points of the usual rule
_WITHOUT_DEGREE = "vertex", "custom"  # rules of quadrature
_SIMPLICES = "interval", "triangle", "tetrahedron"
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class EstimatedRule:
    """A rule over cells whose degree UFL estimates.

    Attributes:
        degree: that is estimated.
        points: of a cell.
        usual_degree: that is enough for the order of the element.
        usual_points: of a cell.
    """

    degree: int
    points: int
    usual_degree: int
    usual_points: int


def estimated_rule(form: ufl.Form, V: fem.FunctionSpace) -> EstimatedRule | None:
    """The longest rule over cells whose degree is estimated; None if degrees are given.

    Usual are rules that are exact for polynomials of degree 2k on simplices, of degree 2k + 1 in
    each coordinate, by k + 1 points, on other cells: with elements of degree k the error of the
    rule is of no lower order than that of the mesh (Ciarlet, The Finite Element Method for
    Elliptic Problems, 1978, theorem 4.1.6).

    Args:
        form: UFL.
        V: displacement space.
    """
    data = compute_form_data(
        form,
        do_apply_function_pullbacks=True,
        do_apply_integral_scaling=True,
        do_apply_geometry_lowering=True,
        do_estimate_degrees=True,
    )
    integrals = [i for part in data.integral_data for i in part.integrals]
    degrees = [
        int(i.metadata()["estimated_polynomial_degree"])
        for i in integrals
        if i.integral_type() == "cell" and _is_estimated(i.metadata())
    ]
    if not degrees:
        return None
    name = V.mesh.topology.cell_name()
    k = V.ufl_element().embedded_subdegree
    usual = 2 * k if name in _SIMPLICES else 2 * k + 1
    return EstimatedRule(max(degrees), _points(name, max(degrees)), usual, _points(name, usual))


def _is_estimated(metadata: Mapping[str, Any]) -> bool:
    """Whether the degree is not named; the rules that need none name their points."""
    degree = metadata.get("quadrature_degree", -1)
    return degree in (-1, "auto") and metadata.get("quadrature_rule") not in _WITHOUT_DEGREE


def _points(cell: str, degree: int) -> int:
    return len(basix.make_quadrature(basix.CellType[cell], degree)[1])


def warn_of_rule(rule: EstimatedRule | None, rank: int) -> None:
    """Warn, on rank 0, where an estimated rule has many times the usual points."""
    if rule is None or rule.points <= _MANY * rule.usual_points or rank != 0:
        return
    logger.warning(
        "UFL estimates degree %d of the bulk, and its Jacobian is integrated at %d points a cell: "
        'with ufl.dx(metadata={"quadrature_degree": %d}) there are %d, and assembly takes a small '
        "part of the time",
        rule.degree,
        rule.points,
        rule.usual_degree,
        rule.usual_points,
    )
