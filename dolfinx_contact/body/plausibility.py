# SPDX-License-Identifier: LGPL-3.0-or-later
"""Data of a body that DOLFINx accepts, but that are probably not intended.

- An integral over a tag without entities is 0, so that a load is missing. Facets between cells do
  not belong to ds, and facets of the boundary do not belong to dS.
- Cells without an integral have no stiffness.
- A Dirichlet condition without dofs holds nothing.
- With too few quadrature points a stiffness is singular (hourglass modes).
- Elements of degree 1 lock if Poisson's ratio is near 1/2, as it is if Young's modulus and
  Poisson's ratio are given in place of the Lame coefficients.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact._arrays import Indices
from dolfinx_contact.materials import materials_in, present_value

__all__ = ["unintended"]

_MEASURES = {"cell": "dx", "exterior_facet": "ds", "interior_facet": "dS"}
_LOCKS = 0.48  # Poisson's ratio from which elements of degree 1 are about a tenth too stiff

_Warning = tuple[str, str]  # name and text


def unintended(
    form: ufl.Form, V: fem.FunctionSpace, bcs: Sequence[fem.DirichletBC]
) -> dict[str, str]:
    """Return warnings about data of a body that are probably not intended, by name. Collective.

    Args:
        form: energy or residual of the body.
        V: space of the displacement.
        bcs: Dirichlet conditions.
    """
    empty = *_empty(form, V.mesh), *_without_dofs(V, bcs), *_uncovered(form, V.mesh)
    return dict([*empty, *_hourglass(form, V), *_locking(form, V)])


def _without_dofs(V: fem.FunctionSpace, bcs: Sequence[fem.DirichletBC]) -> Iterator[_Warning]:
    """Yield warnings about conditions without dofs. Collective."""
    for number, bc in enumerate(bcs):
        if not V.mesh.comm.allreduce(bc.dof_indices()[1]):
            name = f"bcs[{number}]"
            yield name, f"the Dirichlet condition {name} holds nothing: no dof was located for it"


def _empty(form: ufl.Form, domain: mesh.Mesh) -> Iterator[_Warning]:
    """Yield warnings about integrals over nothing. Collective."""
    domain.topology.create_connectivity(domain.topology.dim - 1, domain.topology.dim)
    for integral in form.integrals():
        kind = integral.integral_type()
        for number in _ids(integral):
            if isinstance(number, str):
                continue
            found, tagged = _entities(integral, number, domain)
            if domain.comm.allreduce(found):
                continue
            reason = "no cell or facet has this tag"
            if integral.subdomain_data() is None:
                reason = "its measure has no subdomain_data"
            elif domain.comm.allreduce(len(tagged)):
                where = "on the boundary" if kind == "interior_facet" else "between cells"
                reason = f"all facets with this tag are {where}"
            name = f"{_MEASURES.get(kind, 'the measure')}({number})"
            yield f"integral over {name}", f"an integral over {name} is 0: {reason}"


def _uncovered(form: ufl.Form, domain: mesh.Mesh) -> Iterator[_Warning]:
    """Yield a warning about cells without an integral, which have no stiffness. Collective."""
    covered = np.zeros(domain.topology.index_map(domain.topology.dim).size_local, dtype=bool)
    tags: dict[int, int] = {}  # of the cells in the data of the measures
    for integral in form.integrals_by_type("cell"):
        for number in _ids(integral):
            if isinstance(number, str):  # over all cells
                return
            covered[_entities(integral, number, domain)[1]] = True
        data = integral.subdomain_data()
        if isinstance(data, mesh.MeshTags):
            tags |= zip(data.indices.tolist(), data.values.tolist(), strict=True)
    count = domain.comm.allreduce(int((~covered).sum()))
    if count:
        own = {tag for cell, tag in tags.items() if cell < len(covered) and not covered[cell]}
        found = sorted(set().union(*domain.comm.allgather(own)))
        names = f"; their tags: {', '.join(map(str, found))}" if found else ""
        yield "cells", f"{count} cells have no integral over dx, and no stiffness{names}"


def _hourglass(form: ufl.Form, V: fem.FunctionSpace) -> Iterator[_Warning]:
    """Yield warnings about quadrature rules with too few points for a regular stiffness."""
    degrees: dict[Any, list[int]] = {}  # of the integrals over each set of cells
    for integral in form.integrals():
        if integral.integral_type() == "cell":
            for number in _ids(integral):
                degree = integral.metadata().get("quadrature_degree", -1)  # -1: estimated
                degrees.setdefault(number, []).append(degree)
    degree = V.ufl_element().degree
    simplex = V.mesh.topology.cell_name() in ("triangle", "tetrahedron")
    least, usual = (2 * degree - 2, 2 * degree) if simplex else (2 * degree, 2 * degree + 1)
    for named in degrees.values():
        if min(named) >= 0 and max(named) < least:
            yield (
                "quadrature",
                f"the quadrature degree {max(named)} of dx is below {least}, so that displacements "
                f"without energy may exist (hourglass modes): take quadrature_degree {usual}",
            )


def _locking(form: ufl.Form, V: fem.FunctionSpace) -> Iterator[_Warning]:
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
                "locking",
                f"elements of degree 1 lock at Poisson's ratio {poisson:.6g}, which follows from "
                f"lambda = {lmbda:.6g} and mu = {mu:.6g}: take mean_dilatation_energy or degree 2; "
                "if these are Young's modulus and Poisson's ratio, take LinearElastic.from_young "
                "or materials.lame",
            )


def _ids(integral: ufl.Integral) -> tuple[Any, ...]:
    """Return the tags of an integral, or the name of its domain."""
    ids = integral.subdomain_id()
    return ids if isinstance(ids, tuple) else (ids,)


def _entities(integral: ufl.Integral, number: int, domain: mesh.Mesh) -> tuple[int, Indices]:
    """Return the number of entities of an integral over a tag, and the entities with this tag.

    Facets with the tag that are not of the kind of the measure are not integrated. Not collective.
    """
    data = integral.subdomain_data()
    if not isinstance(data, mesh.MeshTags):
        given = [np.ravel(entities) for tag, entities in data or () if tag == number]
        tagged = np.concatenate([*given, np.zeros(0, dtype=np.int32)])
        return len(tagged), tagged
    owned = domain.topology.index_map(data.dim).size_local
    tagged = data.find(number)
    tagged = tagged[tagged < owned]
    kind = integral.integral_type()
    if kind == "cell":
        return len(tagged), tagged
    boundary = np.isin(tagged, mesh.exterior_facet_indices(domain.topology))
    return int((boundary if kind == "exterior_facet" else ~boundary).sum()), tagged
