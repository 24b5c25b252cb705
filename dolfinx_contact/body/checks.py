# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of the form and the Dirichlet conditions of a body: errors and warnings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np

import ufl
from dolfinx import fem, mesh
from ufl.corealg.traversal import unique_pre_traversal

from dolfinx_contact._arrays import Indices
from dolfinx_contact._compat import dirichlet_value
from dolfinx_contact._geometry import node_positions, rounded
from dolfinx_contact._mpi import count_of, maximum, sorted_rows
from dolfinx_contact._ufl import refuse_other_condition, refuse_other_mesh
from dolfinx_contact._validate import count
from dolfinx_contact.materials import materials_in, present_value

__all__ = ["check_body", "contradiction", "unintended"]

_MEASURES = {"cell": "dx", "exterior_facet": "ds", "interior_facet": "dS"}
_SAME = 1e-9  # difference, relative to the largest value, that counts as zero
_LOCKS = 0.48  # Poisson's ratio from which elements of degree 1 are about a tenth too stiff

_Warning: TypeAlias = tuple[str, str]  # name and text


def check_body(bulk: Any, u: fem.Function, bcs: Sequence[fem.DirichletBC]) -> None:
    """Raise ``ValueError`` if the form or a Dirichlet condition is invalid. Not collective.

    Args:
        bulk: energy or residual of the body.
        u: displacement.
        bcs: Dirichlet conditions.
    """
    if not isinstance(bulk, ufl.Form):
        density = isinstance(bulk, ufl.core.expr.Expr)
        hint = ": multiply the energy density by ufl.dx" if density else ""
        hint = ": pass the form of UFL, before fem.form" if isinstance(bulk, fem.Form) else hint
        raise ValueError(f"the bulk must be a UFL form, got {type(bulk).__name__}{hint}")
    refuse_other_mesh(bulk, u.function_space.mesh, "the bulk")
    _check_integrals(bulk)
    for number, bc in enumerate(bcs, 1):
        refuse_other_condition(bc, u.function_space.mesh)
        value = dirichlet_value(bc)
        if np.iscomplexobj(value.x.array if hasattr(value, "x") else value.value):
            raise ValueError(f"Dirichlet condition {number} is complex: give a real value")


def _check_integrals(bulk: ufl.Form) -> None:
    """Raise ``ValueError`` for quadrature degrees and integrands that FFCx cannot compile."""
    for integral in bulk.integrals():
        degree = integral.metadata().get("quadrature_degree", -1)
        if degree != -1:  # estimated
            count(degree, "a quadrature degree", 0)
        if integral.integral_type() != "interior_facet":
            continue
        nodes = unique_pre_traversal(integral.integrand())
        if not any(isinstance(node, ufl.classes.Restricted) for node in nodes):
            raise ValueError(
                "ufl.dS is over the facets between cells, where an integrand needs a side, as in "
                "ufl.jump(u) or u('+'); ufl.dx is over cells, and ufl.ds over the boundary"
            )


def unintended(
    form: ufl.Form, V: fem.FunctionSpace, bcs: Sequence[fem.DirichletBC]
) -> dict[str, str]:
    """Return warnings, by name, about data that are probably not intended. Collective.

    - An integral over a tag without entities is 0, so that a load is missing. The measure ds does
      not include facets between cells, and dS does not include facets of the boundary.
    - Cells without an integral have no stiffness.
    - A load on facets whose displacements are all prescribed changes only the reactions.
    - A Dirichlet condition without dofs has no effect.
    - With too few quadrature points a stiffness is singular (hourglass modes).
    - Elements of degree 1 lock if Poisson's ratio is near 1/2. Such a ratio can result from passing
      Young's modulus and Poisson's ratio in place of the Lame coefficients.

    Args:
        form: energy or residual of the body.
        V: space of the displacement.
        bcs: Dirichlet conditions.
    """
    of_form = *_empty(form, V.mesh), *_hourglass(form, V), *_locking(form, V)
    return dict([*_without_dofs(V, bcs), *_loads_on_fixed(form, V, bcs), *of_form])


def _without_dofs(V: fem.FunctionSpace, bcs: Sequence[fem.DirichletBC]) -> Iterator[_Warning]:
    """Yield warnings about Dirichlet conditions without dofs. Collective."""
    for number, bc in enumerate(bcs):
        if not V.mesh.comm.allreduce(bc.dof_indices()[1]):
            name = f"bcs[{number}]"
            yield name, f"the Dirichlet condition {name} holds nothing: no dof was located for it"


def _empty(form: ufl.Form, domain: mesh.Mesh) -> Iterator[_Warning]:
    """Yield warnings about integrals over no entity and cells without an integral. Collective."""
    dim = domain.topology.dim
    domain.topology.create_connectivity(dim - 1, dim)
    covered = np.zeros(domain.topology.index_map(dim).size_local, dtype=bool)
    tags: dict[int, int] = {}  # of the cells in the data of the measures
    for integral in form.integrals():
        kind = integral.integral_type()
        data = integral.subdomain_data()
        if kind == "cell" and isinstance(data, mesh.MeshTags):
            tags |= zip(data.indices.tolist(), data.values.tolist(), strict=True)
        for number in _ids(integral):
            if isinstance(number, str):  # over all cells or facets
                covered |= kind == "cell"
                continue
            found, tagged = _entities(integral, number, domain)
            if kind == "cell":
                covered[tagged] = True
            if domain.comm.allreduce(found):
                continue
            reason = "no cell or facet has this tag"
            if data is None:
                reason = "its measure has no subdomain_data"
            elif domain.comm.allreduce(len(tagged)):
                where = "on the boundary" if kind == "interior_facet" else "between cells"
                reason = f"all facets with this tag are {where}"
            name = f"{_MEASURES.get(kind, 'the measure')}({number})"
            yield f"integral over {name}", f"an integral over {name} is 0: {reason}"
    bare = count_of(domain.comm, ~covered)
    if bare:
        own = {tag for cell, tag in tags.items() if cell < len(covered) and not covered[cell]}
        every = sorted(set().union(*domain.comm.allgather(own)))
        names = f"; their tags: {', '.join(map(str, every))}" if every else ""
        yield "cells", f"{bare} cells have no integral over dx, and no stiffness{names}"


def _loads_on_fixed(
    form: ufl.Form, V: fem.FunctionSpace, bcs: Sequence[fem.DirichletBC]
) -> Iterator[_Warning]:
    """Yield warnings about loads on facets with prescribed displacements. Collective.

    Integrands with a gradient are skipped, because they also act on displacements that are not
    prescribed.
    """
    index_map, size = V.dofmap.index_map, V.dofmap.index_map_bs
    fixed = np.zeros((index_map.size_local + index_map.num_ghosts, size), dtype=bool)
    for bc in bcs:
        fixed.reshape(-1)[bc.dof_indices()[0]] = True
    dim = V.mesh.topology.dim - 1
    for integral in form.integrals_by_type("exterior_facet"):
        nodes = unique_pre_traversal(integral.integrand())
        if any(isinstance(node, ufl.classes.Grad) for node in nodes):
            continue
        ids = _ids(integral)
        if any(isinstance(number, str) for number in ids):  # the whole boundary
            continue
        facets = np.concatenate([_entities(integral, number, V.mesh)[1] for number in ids])
        dofs = fem.locate_dofs_topological(V, dim, facets)
        found, free = V.mesh.comm.allreduce(np.array([len(dofs), (~fixed[dofs]).sum()]))
        if found and not free:
            name = f"integral over ds({', '.join(map(str, ids))})"
            text = "has no effect: Dirichlet conditions hold all displacements of its facets"
            yield name, f"an {name} {text}"


def _hourglass(form: ufl.Form, V: fem.FunctionSpace) -> Iterator[_Warning]:
    """Yield warnings about quadrature rules whose stiffness is singular (too few points)."""
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
    """Yield warnings about elements that lock for nearly incompressible materials."""
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


def contradiction(V: fem.FunctionSpace, bcs: Sequence[fem.DirichletBC]) -> str:
    """Return a message about dofs with contradictory Dirichlet values, or "". Collective.

    DOLFINx applies the last condition. Values count as equal if they differ by round-off of the
    largest value.

    Args:
        V: space of the displacement.
        bcs: Dirichlet conditions with their present values.
    """
    if len(bcs) < 2:
        return ""
    bs = V.dofmap.index_map_bs
    x = rounded(node_positions(V))
    values = np.full(bs * len(x), np.nan)
    rows = []  # condition, place, earlier value, value
    for number, bc in enumerate(bcs):
        # DOLFINx 0.9 counts ghosts among the owned dofs of a condition on several components
        dofs = bc.dof_indices()[0]
        dofs = dofs[dofs < V.dofmap.index_map.size_local * bs]
        before = values[dofs]
        bc.set(values)
        numbers = np.full(len(dofs), number)
        rows.append(np.column_stack([numbers, x[dofs // bs], before, values[dofs]]))
    changes = np.concatenate(rows)
    tolerance = _SAME * maximum(V.mesh.comm, np.abs(changes[:, -1]))
    several = np.abs(changes[:, -1] - changes[:, -2]) > tolerance
    found = sorted_rows(V.mesh.comm, changes[several])
    if not found:
        return ""
    condition, *place, first, last = found[0]
    where = ", ".join(f"{c:.6g}" for c in place)
    return (
        f"Dirichlet conditions give {len(found)} of the degrees of freedom several values: "
        f"{first:.6g}, and {last:.6g} by bcs[{condition:.0f}], at ({where}); the last "
        "condition holds"
    )


def _ids(integral: ufl.Integral) -> tuple[Any, ...]:
    """Return the tags of an integral; for an integral over all entities, UFL's name of these."""
    ids = integral.subdomain_id()
    return ids if isinstance(ids, tuple) else (ids,)


def _entities(integral: ufl.Integral, number: int, domain: mesh.Mesh) -> tuple[int, Indices]:
    """Return the number of integrated entities with a tag, and all entities with this tag.

    Tagged facets that do not belong to the measure (``ds`` or ``dS``) are not integrated. Not
    collective.
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
