# SPDX-License-Identifier: LGPL-3.0-or-later
"""Data of a body that DOLFINx accepts, but that are probably not intended.

- An integral over a tag that its measure does not know is 0, so that a load is missing.
- A Dirichlet condition without dofs holds nothing.
- With too few quadrature points a stiffness is singular (hourglass modes).
- Elements of degree 1 lock if Poisson's ratio is near 1/2, as it is if Young's modulus and
  Poisson's ratio are given in place of the Lame coefficients.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from typing import Any

import ufl
from dolfinx import fem, mesh

from dolfinx_contact.materials import materials_in, present_value

__all__ = ["warn_of_unintended"]

logger = logging.getLogger(__name__)

_MEASURES = {"cell": "dx", "exterior_facet": "ds", "interior_facet": "dS"}
_LOCKS = 0.48  # Poisson's ratio from which elements of degree 1 are about a tenth too stiff


def warn_of_unintended(
    form: ufl.Form, V: fem.FunctionSpace, bcs: Sequence[fem.DirichletBC]
) -> None:
    """Warn about data of a body that are probably not intended. Collective.

    Args:
        form: energy or residual of the body.
        V: space of the displacement.
        bcs: Dirichlet conditions.
    """
    warnings = [*_empty(form, V, bcs), *_hourglass(form, V), *_locking(form, V)]
    if V.mesh.comm.rank == 0:
        for warning in dict.fromkeys(warnings):
            logger.warning(warning)


def _empty(form: ufl.Form, V: fem.FunctionSpace, bcs: Sequence[fem.DirichletBC]) -> Iterator[str]:
    """Yield warnings about integrals over nothing and conditions without dofs. Collective."""
    for number, bc in enumerate(bcs):
        if not V.mesh.comm.allreduce(bc.dof_indices()[1]):
            yield f"the Dirichlet condition bcs[{number}] holds nothing: no dof was located for it"
    for integral in form.integrals():
        for number in _ids(integral):
            if not isinstance(number, str) and not _size(integral, number, V):
                measure = f"{_MEASURES.get(integral.integral_type(), 'the measure')}({number})"
                unknown = integral.subdomain_data() is None
                reason = (
                    "its measure has no subdomain_data"
                    if unknown
                    else "no cell or facet has this tag"
                )
                yield f"an integral over {measure} is 0: {reason}"


def _hourglass(form: ufl.Form, V: fem.FunctionSpace) -> Iterator[str]:
    """Yield warnings about quadrature rules with too few points for a regular stiffness."""
    degrees: dict[Any, list[Any]] = {}  # of the integrals over each set of cells
    for integral in form.integrals():
        if integral.integral_type() == "cell":
            for number in _ids(integral):
                degrees.setdefault(number, []).append(integral.metadata().get("quadrature_degree"))
    degree = V.ufl_element().degree
    simplex = V.mesh.topology.cell_name() in ("triangle", "tetrahedron")
    least, usual = (2 * degree - 2, 2 * degree) if simplex else (2 * degree, 2 * degree + 1)
    for named in degrees.values():
        if all(isinstance(d, int) for d in named) and max(named) < least:
            yield (
                f"the quadrature degree {max(named)} of dx is below {least}, so that displacements "
                f"without energy may exist (hourglass modes): take quadrature_degree {usual}"
            )


def _locking(form: ufl.Form, V: fem.FunctionSpace) -> Iterator[str]:
    """Yield warnings about elements that lock."""
    rules = [integral.metadata().get("quadrature_rule") for integral in form.integrals()]
    if V.ufl_element().degree > 1 or "custom" in rules:  # a mean dilatation
        return
    for material in materials_in(form):
        given = getattr(material, "material", material)  # of a body of revolution
        moduli = (getattr(given, name, 0.0) for name in ("lmbda", "mu"))
        lmbda, mu = (present_value(modulus) for modulus in moduli)
        if not lmbda or mu is None or getattr(given, "plane_stress", False):
            continue
        poisson = lmbda / (2 * (lmbda + mu))
        if _LOCKS < poisson < 0.5:
            yield (
                f"elements of degree 1 lock at Poisson's ratio {poisson:.6g}, which follows from "
                f"lambda = {lmbda:.6g} and mu = {mu:.6g}: take mean_dilatation_energy or degree 2; "
                "if these are Young's modulus and Poisson's ratio, take LinearElastic.from_young "
                "or materials.lame"
            )


def _ids(integral: ufl.Integral) -> tuple[Any, ...]:
    """Return the tags of an integral, or the name of its domain."""
    ids = integral.subdomain_id()
    return ids if isinstance(ids, tuple) else (ids,)


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
