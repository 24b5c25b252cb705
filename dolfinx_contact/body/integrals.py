# SPDX-License-Identifier: LGPL-3.0-or-later
"""Integrals of the form of a body that are probably not what the user intended.

DOLFINx evaluates an integral over a tag that its measure does not know as 0, so that a load is
missing without an error. With too few quadrature points a stiffness is singular (hourglass modes).
"""

from __future__ import annotations

import logging
from typing import Any

import ufl
from dolfinx import fem, mesh

__all__ = ["warn_of_integrals"]

logger = logging.getLogger(__name__)

_MEASURES = {"cell": "dx", "exterior_facet": "ds", "interior_facet": "dS"}


def warn_of_integrals(form: ufl.Form, V: fem.FunctionSpace) -> None:
    """Warn about integrals over nothing, and about too few quadrature points. Collective.

    Args:
        form: energy or residual of the body.
        V: space of the displacement.
    """
    warnings = []
    degrees: dict[Any, list[Any]] = {}  # of the integrals over each set of cells
    for integral in form.integrals():
        kind = integral.integral_type()
        ids = integral.subdomain_id()
        for number in ids if isinstance(ids, tuple) else (ids,):
            if kind == "cell":
                degrees.setdefault(number, []).append(integral.metadata().get("quadrature_degree"))
            if not isinstance(number, str) and not _size(integral, number, V):
                measure = f"{_MEASURES.get(kind, kind)}({number})"
                reason = "no cell or facet has this tag"
                if integral.subdomain_data() is None:
                    reason = "its measure has no subdomain_data"
                warnings.append(f"an integral over {measure} is 0: {reason}")
    degree = V.ufl_element().degree
    simplex = V.mesh.topology.cell_name() in ("triangle", "tetrahedron")
    least, usual = (2 * degree - 2, 2 * degree) if simplex else (2 * degree, 2 * degree + 1)
    for named in degrees.values():
        if all(isinstance(d, int) for d in named) and max(named) < least:
            warnings.append(
                f"the quadrature degree {max(named)} of dx is below {least}, so that displacements "
                f"without energy may exist (hourglass modes): take quadrature_degree {usual}"
            )
    if V.mesh.comm.rank == 0:
        for warning in dict.fromkeys(warnings):
            logger.warning(warning)


def _size(integral: ufl.Integral, number: int, V: fem.FunctionSpace) -> int:
    """Return the number of cells or facets of an integral over a tag on all ranks. Collective."""
    data = integral.subdomain_data()
    if data is None:
        return 0
    if isinstance(data, mesh.MeshTags):
        count = len(data.find(number))
    else:
        count = sum(len(entities) for tag, entities in data if tag == number)
    return int(V.mesh.comm.allreduce(count))
