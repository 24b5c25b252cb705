# SPDX-License-Identifier: LGPL-3.0-or-later
"""Validation of the arguments of a problem and of its data before a solve.

`check` validates arguments. `validate` is called once before every solve: values of Functions and
Constants are tested nowhere else, and the solvers trust them. `unintended` and `check_sides` warn
of data that are probably not intended.

Most tests are local and return an objection, a message that is empty if there is none. One
collective call per test raises the objection of the lowest rank on every rank.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import ufl
from dolfinx import fem, mesh
from ufl.corealg.traversal import unique_pre_traversal

from dolfinx_contact._arrays import Array, Indices
from dolfinx_contact._compat import dirichlet_value
from dolfinx_contact._mpi import (
    all_ranks,
    anywhere,
    count_of,
    maximum,
    minimum,
    require,
    same_everywhere,
)
from dolfinx_contact._ufl import refuse_other_condition, refuse_other_mesh
from dolfinx_contact._validate import count
from dolfinx_contact._validate import listed as as_list
from dolfinx_contact.body.cells import cells_around
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.data import Datum, data_of_surface, placed_data
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.equations.measures import without_normal
from dolfinx_contact.laws.law import obeys
from dolfinx_contact.laws.status import STICK
from dolfinx_contact.materials import Axisymmetric, materials_in, present_value
from dolfinx_contact.points.descriptions import Contact
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.points.rigid_body import shape_of
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import rounded
from dolfinx_contact.rigid_surfaces import RigidSurface

__all__ = [
    "check",
    "check_law",
    "check_moduli",
    "check_obstacle",
    "check_sides",
    "check_surface",
    "check_times",
    "check_turn",
    "unintended",
    "validate",
    "validate_data",
]

_ROUND_OFF = 1e-14  # relative excess of a bound that counts as round-off
_AGAINST = -0.5  # cosine of contact normal and outward normal below which they disagree
_BESIDE = 1e-3  # facet sizes from a contact point to the place where the body is searched
_UNITS = 100.0  # ratio of the sizes of body and obstacle above which units may differ
_MEASURES = {"cell": "dx", "exterior_facet": "ds", "interior_facet": "dS"}
_LOCKS = 0.48  # Poisson's ratio from which elements of degree 1 are about a tenth too stiff
_PERCENT = 5.0, 200.0  # friction coefficients between which they may be in percent
_TIED = 8  # contact points nearest to an obstacle that are examined, per rank


_Warning = tuple[str, str]  # name and text


# -- arguments of a problem ------------------------------------------------------------------------


def check(
    bulk: Any, u: fem.Function, surfaces: Any, bcs: Any
) -> tuple[list[Contact], list[fem.DirichletBC]]:
    """Return surfaces and Dirichlet conditions as lists if the arguments of a problem fit together.

    Not collective.

    Raises:
        ValueError: if they do not.
    """
    for name, value in (("surfaces", surfaces), ("bcs", bcs)):
        if isinstance(value, Contact | fem.DirichletBC):
            kind = type(value).__name__
            raise ValueError(f"{name} must be a list, got one {kind}: put it in brackets")
    surfaces, bcs = as_list(surfaces, "surfaces"), as_list(bcs, "bcs")
    if not all(isinstance(s, Contact) for s in surfaces):
        raise ValueError("surfaces must be a list of ContactSurface, ContactPair or SelfContact")
    if not all(isinstance(bc, fem.DirichletBC) for bc in bcs):
        raise ValueError("bcs must be a list of Dirichlet conditions")
    if not isinstance(bulk, ufl.Form):
        density = isinstance(bulk, ufl.core.expr.Expr)
        hint = ": multiply the energy density by ufl.dx" if density else ""
        raise ValueError(f"the bulk must be a UFL form, got {type(bulk).__name__}{hint}")
    names = [s.name for s in surfaces]
    plane = [s.name for s in surfaces if not s.axisymmetric]
    turned = [isinstance(m, Axisymmetric) for m in materials_in(bulk)]
    for wrong, objection in (
        (not surfaces, "a contact problem needs at least one contact surface"),
        (
            any(s.u is not u for s in surfaces),
            "every contact surface must be made with the displacement u",
        ),
        (len(set(names)) < len(names), f"contact surfaces need different names, got {names}"),
        (
            0 < len(plane) < len(surfaces),
            f"all contact surfaces are axisymmetric or none is, unlike {plane}",
        ),
        (
            any(turned) and plane,
            "the contact surfaces are plane, but the bulk is that of a body of revolution, whose "
            "surfaces need axisymmetric=True",
        ),
        (
            not all(turned) and not plane,
            "the contact surfaces are axisymmetric, but the bulk is that of a plane body: use "
            "materials.Axisymmetric",
        ),
    ):
        if wrong:
            raise ValueError(objection)
    refuse_other_mesh(bulk, u.function_space.mesh, "the bulk")
    _check_integrals(bulk)
    for number, bc in enumerate(bcs, 1):
        refuse_other_condition(bc, u.function_space.mesh)
        value = dirichlet_value(bc)
        if np.iscomplexobj(value.x.array if hasattr(value, "x") else value.value):
            raise ValueError(f"Dirichlet condition {number} is complex: give a real value")
    return surfaces, bcs


def _check_integrals(bulk: ufl.Form) -> None:
    """Raise ``ValueError`` for quadrature degrees and integrands that FFCx does not compile."""
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


# -- data before a solve ---------------------------------------------------------------------------


def validate(eq: ContactEquations, x0: PETSc.Vec) -> Evaluation | None:
    """Raise ``ValueError`` for data that are not admissible; otherwise adapt to them. Collective.

    Args:
        eq: contact problem.
        x0: start of the solve.

    Returns:
        Evaluation at ``x0``; None if the scales of the data, and with them H, have changed.
    """
    # data, without a state
    same_everywhere(eq.comm, "data of the problem", Constants=lambda: _constants(eq))
    eq.require_same_mesh()
    check_moduli(eq)
    if eq.read_data():
        _warn_of_dragging(eq)
        if not any(eq.memory):  # in an evolution, `results.indicators` measures this
            check_sides(eq)
    for s, memory in zip(eq.surfaces, eq.memory, strict=True):
        check_surface(s, memory)
    _warn_of_friction(eq)
    # the start, and H there
    names = ["displacement", *(f"traction of {s.name!r}" for s in eq.surfaces)]
    names.append("motion of the rigid bodies")
    bad = anywhere(eq.comm, *[not np.isfinite(part).all() for part in eq.unknowns.blocks(x0)])
    for name, wrong in zip(names, bad, strict=True):
        if wrong:
            raise ValueError(f"the {name} at the start is not finite")
    numbers = bool(np.isfinite(eq.rigid.numbers).all())
    require(eq.comm, numbers, "a load or motion of a rigid body is not finite")
    state = eq.evaluate(x0)
    finite = all(np.isfinite(rows).all() for rows in state.rows)
    lost = without_normal(eq, state)
    require(eq.comm, not lost, lost)
    eq.constraints.check_values(eq.surfaces, eq.body_size)
    eq.warn("bcs", eq.constraints.contradiction())
    if not all_ranks(eq.comm, finite):
        place = _not_finite(eq.comm, placed_data(eq)) or _not_finite_law(eq, state)
        place = place or "loads and material data, for NaN"
        raise ValueError(f"the residual is not finite at the start: look at {place}")
    # scales
    changed = eq.scaling.follow(eq.unknowns.displacement(x0))
    return None if changed else state


def validate_data(eq: ContactEquations) -> None:
    """Raise ``ValueError`` if mesh, material, obstacles or laws are not admissible. Collective.

    This is the part of `validate` that does not need a state, for questions about data.
    """
    eq.require_same_mesh()
    check_moduli(eq)
    eq.read_data()
    for s, memory in zip(eq.surfaces, eq.memory, strict=True):
        check_surface(s, memory)


def check_moduli(eq: ContactEquations) -> None:
    """Raise ``ValueError`` if the moduli of a material are not admissible. Collective."""
    objection = ""
    try:
        for material in eq.bulk.materials:
            material.check_moduli()
    except ValueError as error:
        objection = str(error)
    require(eq.comm, not objection, objection)


def check_surface(s: DiscreteSurface, memory: Memory | None) -> None:
    """Raise ``ValueError`` if gaps, normals or law of a surface are not valid now. Collective.

    Args:
        s: contact surface.
        memory: memory of its points at the beginning of the step; None under the static law.
    """
    check_obstacle(s)
    s.check_gaps()
    check_law(s, memory)
    if memory is None:
        check_turn(s, None)


def check_obstacle(s: DiscreteSurface) -> None:
    """Raise ``ValueError`` if a gap or normal is not finite, and name the datum. Collective."""
    finite = all(np.isfinite(v).all() for v in (s.points.vertex_gaps, s.points.vertex_normals))
    if not all_ranks(s.comm, finite):
        cause = "a contact point is the centre of a sphere, or a level set has no gradient there"
        if place := _not_finite(s.comm, data_of_surface(s)):
            cause = f"look at {place}"
        raise ValueError(f"{s.name}: the gap or normal of the obstacle is not finite: {cause}")


def check_law(s: DiscreteSurface, memory: Memory | None) -> None:
    """Raise ``ValueError`` if the law of a surface is not valid with its fields. Collective.

    Fields must be finite and have the sign that the law requires, the friction bound must not be
    negative, and the law must have all that it needs under the given memory.

    Args:
        s: contact surface.
        memory: memory of its points at the beginning of the step; None under the static law.
    """
    objection = _objection_to_time(s, memory) or _objection_to_fields(s)
    require(s.comm, not objection, f"{s.name}: {objection}")
    at_rest = np.zeros_like(s.points.data.n)
    radius = s.law_at_points(at_rest, at_rest, s.point_data(memory)).unit_bound
    good = not (radius < -_ROUND_OFF).any()
    require(s.comm, good, f"{s.name}: the law {s.law.name} has a negative radius")


def _objection_to_fields(s: DiscreteSurface) -> str:
    """Return the first objection to the values of the fields of a law. Not collective."""
    fields = s.points.data.fields
    wrong = {"positive": "not positive:", "fraction": "not between 0 and 1:"}
    for name, values in fields.items():
        what = f"{name} of {s.law.name}"
        if not np.isfinite(values).all():
            return f"NaN in the {what}"
        sign = s.law.sign(name)
        if not obeys(sign, values).all():
            return f"{wrong.get(sign, 'negative')} {what}"
    for x in s.law.internal:
        if x.end is not None:
            left = x.sense * (x.end - fields[x.name])
            if (left < -_ROUND_OFF * (1.0 + abs(x.end))).any():
                return f"{x.name} of {s.law.name} is beyond its end {x.end:g}"
    return ""


def check_times(eq: ContactEquations) -> None:
    """Raise ``ValueError`` if a law lacks something under the memory of the step. Collective."""
    for s, memory in zip(eq.surfaces, eq.memory, strict=True):
        objection = _objection_to_time(s, memory)
        require(s.comm, not objection, f"{s.name}: {objection}")


def _objection_to_time(s: DiscreteSurface, memory: Memory | None) -> str:
    """Return the objection to a law whose data are incomplete for a memory. Not collective.

    Missing data are those of `Law.lacks`, and the duration of a step for a law that depends on time
    (`CompiledLaw.needs_time`).
    """
    history = memory is not None and memory.step > 0
    lack = s.law.lacks(history=history)
    if lack:
        kind = "in a history" if history else "statically"
        return f"{kind} the law {s.law.name} lacks {lack}"
    step = -1.0 if memory is None else min(memory.step, 0.0)
    # Laws that name the fields by which they need a time define the answer in a step of no length.
    time_known = history or (step == 0 and bool(s.law.needs_time))
    if time_known or not s.law_at_points.compiled.needs_time(step):
        return ""
    return (
        f"the law {s.law.name} depends on the time of a step (a.step), and no time passes without "
        "a history: use evolution.QuasiStatic or NSCD, or define in the law what holds at rest, as "
        "in the speed ufl.conditional(ufl.gt(a.step, 0.0), (a.slid - a.slid_before) / a.step, 0.0)"
    )


def check_turn(s: DiscreteSurface, before: Array | None) -> None:
    """Raise ``ValueError`` if a rigid body turns by half a turn or more in a step. Collective.

    Slips on it are known only below half a turn: a whole turn leaves every place as it was.

    Args:
        s: contact surface.
        before: motion of its rigid body at the last accepted state; None: position of the mesh.
    """
    body = s.rigid_body
    if body is None or s.displaced is None or not s.displaced.friction:
        return
    motion = np.where(body.fixed, body.numbers(), body.values)
    step = motion if before is None else motion - before
    turned = float(np.linalg.norm(step[s.dim :]))
    require(
        s.comm,
        turned < np.pi,
        f"{s.name}: the rigid body {body.name!r} turns by {turned:.4g} rad in one step: "
        "slips on it are known below half a turn; take shorter steps of a history",
    )


# -- data that are probably not intended -----------------------------------------------------------


def unintended(
    form: ufl.Form, V: fem.FunctionSpace, bcs: Sequence[fem.DirichletBC]
) -> dict[str, str]:
    """Return warnings about data of a body that are probably not intended, by name. Collective.

    - An integral over a tag without entities is 0, so that a load is missing. Facets between cells
      do not belong to ds, and facets of the boundary do not belong to dS.
    - Cells without an integral have no stiffness.
    - A load on facets whose displacements are all held changes only the reactions.
    - A Dirichlet condition without dofs holds nothing.
    - With too few quadrature points a stiffness is singular (hourglass modes).
    - Elements of degree 1 lock if Poisson's ratio is near 1/2, as it is if Young's modulus and
      Poisson's ratio are given in place of the Lame coefficients.

    Args:
        form: energy or residual of the body.
        V: space of the displacement.
        bcs: Dirichlet conditions.
    """
    of_form = *_empty(form, V.mesh), *_hourglass(form, V), *_locking(form, V)
    return dict([*_without_dofs(V, bcs), *_held(form, V, bcs), *of_form])


def _without_dofs(V: fem.FunctionSpace, bcs: Sequence[fem.DirichletBC]) -> Iterator[_Warning]:
    """Yield warnings about conditions without dofs. Collective."""
    for number, bc in enumerate(bcs):
        if not V.mesh.comm.allreduce(bc.dof_indices()[1]):
            name = f"bcs[{number}]"
            yield name, f"the Dirichlet condition {name} holds nothing: no dof was located for it"


def _empty(form: ufl.Form, domain: mesh.Mesh) -> Iterator[_Warning]:
    """Yield warnings about integrals over nothing, and cells without an integral. Collective."""
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
    count = count_of(domain.comm, ~covered)
    if count:
        own = {tag for cell, tag in tags.items() if cell < len(covered) and not covered[cell]}
        every = sorted(set().union(*domain.comm.allgather(own)))
        names = f"; their tags: {', '.join(map(str, every))}" if every else ""
        yield "cells", f"{count} cells have no integral over dx, and no stiffness{names}"


def _held(
    form: ufl.Form, V: fem.FunctionSpace, bcs: Sequence[fem.DirichletBC]
) -> Iterator[_Warning]:
    """Yield warnings about loads on facets whose displacements are all held. Collective.

    Integrands with a gradient are left out: they also act on other displacements.
    """
    index_map, size = V.dofmap.index_map, V.dofmap.index_map_bs
    held = np.zeros((index_map.size_local + index_map.num_ghosts, size), dtype=bool)
    for bc in bcs:
        held.reshape(-1)[bc.dof_indices()[0]] = True
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
        found, free = V.mesh.comm.allreduce(np.array([len(dofs), (~held[dofs]).sum()]))
        if found and not free:
            name = f"integral over ds({', '.join(map(str, ids))})"
            text = "has no effect: Dirichlet conditions hold all displacements of its facets"
            yield name, f"an {name} {text}"


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


def check_sides(eq: ContactEquations) -> None:
    """Warn about obstacles on the wrong side of the undeformed body, or in other units. Collective.

    At the contact point nearest to such an obstacle, the contact normal points against the outward
    normal of the face and into the body. The solution is then wrong without any other sign.
    """
    for s in eq.surfaces:
        if s.between_bodies:
            continue
        units = _other_units(eq, s)
        eq.warn(f"units of {s.name!r}", units)
        message = ""
        gaps = np.abs(s.points.gaps)
        nearest = minimum(s.comm, gaps, np.inf)
        if not np.isfinite(nearest):
            eq.warn(f"side of {s.name!r}", "")
            continue
        # contact points nearest to the obstacle whose normal points against the outward normal
        n = s.points.data.n
        outward = s.points.outward(np.zeros_like(s.node_positions))
        against = np.sum(n * outward, axis=1) < _AGAINST
        tied = np.flatnonzero(against & (gaps <= nearest + 1e-9 * eq.body_size))
        # The order of coordinates makes the reported place the same on any number of ranks.
        tied = tied[np.lexsort(rounded(s.positions[tied]).T[::-1])][:_TIED]
        # body cells next to these points, in the direction of the contact normal
        into = s.positions[tied] + _BESIDE * s.points.geometry.facet_size * n[tied]
        x = np.concatenate(s.comm.allgather(np.stack([s.positions[tied], into])), axis=1)
        inside = cells_around(s.domain, x[1]) > 0
        if inside.any() and not units:
            place = min(tuple(p) for p in rounded(x[0])[inside])
            message = (
                f"the obstacle is on the wrong side: at ({', '.join(f'{c:.6g}' for c in place)}), "
                "where the body comes nearest to it, the contact normal points into the body; "
                "reverse the normal of a plane or the facets of a surface (reverse=True), or move "
                "a sphere out of the body"
            )
        eq.warn(f"side of {s.name!r}", message)


def _other_units(eq: ContactEquations, s: DiscreteSurface) -> str:
    """Return a message about a rigid surface of another order of magnitude; "" if it is not."""
    shape = shape_of(s.obstacle)
    if not isinstance(shape, RigidSurface):
        return ""
    size = float(np.linalg.norm(np.ptp(shape.points, axis=0)))
    if 1.0 / _UNITS <= size / eq.body_size <= _UNITS:
        return ""
    return (
        f"the size of the rigid surface is {size:.3g}, and that of the body {eq.body_size:.3g}: "
        "are both in the same unit of length?"
    )


def _warn_of_dragging(eq: ContactEquations) -> None:
    """Warn once about an obstacle that its Constants move along its surface. Collective."""
    along = [s.moved_along and STICK in s.law_at_points.codes for s in eq.surfaces]
    still = anywhere(eq.comm, *[not flag for flag in along])
    for s, other in zip(eq.surfaces, still, strict=True):
        if not other:
            eq.warn(
                f"dragging of {s.name!r}",
                "the obstacle was moved along its surface by its Constants, which drags nothing: "
                "friction opposes slip over the obstacle as it is now; use a RigidBody with the "
                "motion of the obstacle",
            )


def _warn_of_friction(eq: ContactEquations) -> None:
    """Warn about friction coefficients that may be in percent. Collective."""
    least, largest = _PERCENT
    for s in eq.surfaces:
        fields = s.points.data.fields
        given = [v for name, v in fields.items() if name.split(".")[-1] == "friction"]
        most = maximum(s.comm, np.concatenate(given)) if given else 0.0
        message = f"the friction coefficient is {most:.3g}: if it is in percent, divide it by 100"
        eq.warn(f"friction of {s.name!r}", message if least < most <= largest else "")


# -- data ------------------------------------------------------------------------------------------


def _not_finite(comm: MPI.Comm, data: Sequence[Datum]) -> str:
    """Return the place of the first datum that is not finite on some rank, or "". Collective."""
    bad = anywhere(comm, *(not np.isfinite(d.values).all() for d in data))
    return next((d.place for d, wrong in zip(data, bad, strict=True) if wrong), "")


def _not_finite_law(eq: ContactEquations, state: Evaluation) -> str:
    """Return the place of the first law whose answer is not finite, or "". Collective."""
    bad = anywhere(eq.comm, *(not np.isfinite(rows).all() for rows in state.rows[1:-1]))
    for s, wrong in zip(eq.surfaces, bad, strict=True):
        if wrong:
            return (
                f"the law {s.law.name} of {s.name}, whose answer or its derivatives are not finite "
                "there: powers and roots at 0, quotients"
            )
    return ""


def _constants(eq: ContactEquations) -> list[list[float]]:
    """Return the values of all Constants of the data, which must be the same on every rank."""
    constants = [d.values for d in placed_data(eq) if not hasattr(d.value, "x")]
    return [np.ravel(values).tolist() for values in constants]
