# SPDX-License-Identifier: LGPL-3.0-or-later
"""Validation of the arguments of a problem and of its data before a solve.

`check` validates arguments. `validate` is called once before every solve: values of Functions and
Constants are tested nowhere else, and the solvers trust them. `check_sides` warns of obstacles that
are probably not where they were intended.

Most tests are local and return an error message, which is empty if the test passes. A collective
call after each test raises the first nonempty message, in the order of the ranks, on every rank.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx import fem

from dolfinx_contact._arrays import Array
from dolfinx_contact._geometry import dot, rounded
from dolfinx_contact._mpi import (
    all_ranks,
    anywhere,
    everywhere,
    maximum,
    minimum,
    require,
    same_everywhere,
)
from dolfinx_contact._validate import listed as as_list
from dolfinx_contact.body.cells import cells_around
from dolfinx_contact.body.checks import check_body, contradiction
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.data import Datum, data_of_surface, placed_data
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.equations.measures import without_normal
from dolfinx_contact.laws.law import obeys
from dolfinx_contact.laws.status import STICK
from dolfinx_contact.materials import Axisymmetric, materials_in
from dolfinx_contact.points.descriptions import Contact
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.points.rigid_body import shape_of
from dolfinx_contact.points.surface import DiscreteSurface
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
    "validate",
    "validate_data",
]

_ROUND_OFF = 1e-14  # relative excess of a bound that counts as round-off
_AGAINST = -0.5  # cosine of contact normal and outward normal below which they disagree
_BESIDE = 1e-3  # facet sizes from a contact point to the place where the body is searched
_UNITS = 100.0  # ratio of the sizes of body and obstacle above which units may differ
_PERCENT = 5.0, 200.0  # friction coefficients between which they may be in percent
_TIED = 8  # contact points nearest to an obstacle that are examined, per rank


# -- arguments of a problem ------------------------------------------------------------------------


def check(
    bulk: Any, u: fem.Function, surfaces: Any, bcs: Any
) -> tuple[list[Contact], list[fem.DirichletBC]]:
    """Check the arguments of a problem; return its surfaces and Dirichlet conditions as lists.

    Not collective.

    Raises:
        ValueError: if the arguments do not fit together.
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
    check_body(bulk, u, bcs)
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
    return surfaces, bcs


# -- data before a solve ---------------------------------------------------------------------------


def validate(eq: ContactEquations, x0: PETSc.Vec) -> Evaluation | None:
    """Raise ``ValueError`` for inadmissible data; otherwise update the scales. Collective.

    Args:
        eq: contact problem.
        x0: unknowns at the start of the solve.

    Returns:
        Evaluation at ``x0``; None if the scales of the data, and with them H, have changed.
    """
    # data, without a state
    same_everywhere(eq.comm, "data of the problem", Constants=lambda: _constants(eq))
    if validate_data(eq):
        _warn_of_dragging(eq)
        if eq.is_static:  # in an evolution, `results.indicators` measures this
            check_sides(eq)
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
    evaluation = eq.evaluate(x0)
    finite = all(np.isfinite(rows).all() for rows in evaluation.rows)
    lost = without_normal(eq, evaluation)
    require(eq.comm, not lost, lost)
    eq.constraints.check_values(eq.surfaces, eq.body_size)
    eq.warn("bcs", contradiction(eq.V, eq.bcs))
    if not all_ranks(eq.comm, finite):
        place = _not_finite(eq.comm, placed_data(eq)) or _not_finite_law(eq, evaluation)
        place = place or "loads and material data, for NaN"
        raise ValueError(f"the residual is not finite at the start: look at {place}")
    # scales
    changed = eq.scaling.follow(eq.unknowns.displacement(x0))
    return None if changed else evaluation


def validate_data(eq: ContactEquations) -> bool:
    """Raise ``ValueError`` if mesh, material, obstacles or laws are not admissible. Collective.

    These are the tests of `validate` that do not need a state.

    Returns:
        Whether the data of a surface have changed.
    """
    eq.require_same_mesh()
    check_moduli(eq)
    changed = eq.read_data()
    for s, memory in zip(eq.surfaces, eq.memory, strict=True):
        check_surface(s, memory)
    return changed


def check_moduli(eq: ContactEquations) -> None:
    """Raise ``ValueError`` if the moduli of a material are not admissible. Collective."""
    with everywhere(eq.comm):
        for material in eq.bulk.materials:
            material.check_moduli()


def check_surface(s: DiscreteSurface, memory: Memory | None) -> None:
    """Raise ``ValueError`` if current gaps, normals or law of a surface are invalid. Collective.

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
    """Raise ``ValueError``, naming the datum, if a gap or normal is not finite. Collective."""
    finite = all(np.isfinite(v).all() for v in (s.points.vertex_gaps, s.points.vertex_normals))
    if not all_ranks(s.comm, finite):
        cause = "a contact point is the centre of a sphere, or a level set has no gradient there"
        if place := _not_finite(s.comm, data_of_surface(s)):
            cause = f"look at {place}"
        raise ValueError(f"{s.name}: the gap or normal of the obstacle is not finite: {cause}")


def check_law(s: DiscreteSurface, memory: Memory | None) -> None:
    """Raise ``ValueError`` if the law of a surface or a field of the law is invalid. Collective.

    Fields must be finite and have the sign that the law requires, the friction bound must not be
    negative, and the law must have all data that it needs with the given memory.

    Args:
        s: contact surface.
        memory: memory of its points at the beginning of the step; None under the static law.
    """
    objection = _objection_to_time(s, memory) or _objection_to_fields(s)
    require(s.comm, not objection, f"{s.name}: {objection}")
    at_rest = np.zeros_like(s.points.data.n)
    radius = s.law_at_points(at_rest, at_rest, s.point_data(memory)).unit_bound
    good = not (radius < -_ROUND_OFF).any()
    require(s.comm, good, f"{s.name}: the friction bound of the law {s.law.name} is negative")


def _objection_to_fields(s: DiscreteSurface) -> str:
    """Return an error message about the fields of a law; "" if they are valid. Not collective."""
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
    """Raise ``ValueError`` if a law lacks required data or the duration of the step. Collective."""
    for s, memory in zip(eq.surfaces, eq.memory, strict=True):
        objection = _objection_to_time(s, memory)
        require(s.comm, not objection, f"{s.name}: {objection}")


def _objection_to_time(s: DiscreteSurface, memory: Memory | None) -> str:
    """Return an error message if a law lacks data (`Law.lacks`), else "". Not collective.

    A law that depends on time (`CompiledLaw.needs_time`) also requires the duration of the step.
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
    """Raise ``ValueError`` if a rigid body rotates by 180 degrees or more in a step. Collective.

    Only for smaller rotations can the slip be determined from the initial and the final position.

    Args:
        s: contact surface.
        before: motion of the rigid body at the last accepted state; None for the initial position.
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


def check_sides(eq: ContactEquations) -> None:
    """Warn about obstacles on the wrong side of the body or in other length units. Collective.

    Such a problem has a solution, but not the intended one. The undeformed body is tested.
    """
    for s in eq.surfaces:
        if not s.between_bodies:
            units = _other_units(eq, s)
            eq.warn(f"units of {s.name!r}", units)
            eq.warn(f"side of {s.name!r}", "" if units else _wrong_side(eq, s))


def _wrong_side(eq: ContactEquations, s: DiscreteSurface) -> str:
    """Return a message about an obstacle on the wrong side of the body, else "". Collective.

    On the wrong side, the contact normal at the nearest contact point is opposite to the outward
    normal of the face and points into the body.
    """
    gaps = np.abs(s.points.gaps)
    nearest = minimum(s.comm, gaps, np.inf)
    if not np.isfinite(nearest):
        return ""
    # contact points nearest to the obstacle whose normal points against the outward normal
    n = s.points.data.n
    outward = s.points.outward(np.zeros_like(s.node_positions))
    against = dot(n, outward) < _AGAINST
    tied = np.flatnonzero(against & (gaps <= nearest + 1e-9 * eq.body_size))
    # The order of coordinates makes the reported place the same on any number of ranks.
    tied = tied[np.lexsort(rounded(s.positions[tied]).T[::-1])][:_TIED]
    # body cells next to these points, in the direction of the contact normal
    into = s.positions[tied] + _BESIDE * s.points.geometry.facet_size * n[tied]
    x = np.concatenate(s.comm.allgather(np.stack([s.positions[tied], into])), axis=1)
    inside = cells_around(s.domain, x[1]) > 0
    if not inside.any():
        return ""
    place = min(tuple(p) for p in rounded(x[0])[inside])
    return (
        f"the obstacle is on the wrong side: at ({', '.join(f'{c:.6g}' for c in place)}), where "
        "the body comes nearest to it, the contact normal points into the body; reverse the normal "
        "of a plane or the facets of a surface (reverse=True), or move a sphere out of the body"
    )


def _other_units(eq: ContactEquations, s: DiscreteSurface) -> str:
    """Return a message if body and rigid surface differ in size by orders of magnitude, else ""."""
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
    """Warn once if an obstacle was moved along its surface through its Constants. Collective."""
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
    """Describe the first datum that is not finite on some rank, else return "". Collective."""
    bad = anywhere(comm, *(not np.isfinite(d.values).all() for d in data))
    return next((d.place for d, wrong in zip(data, bad, strict=True) if wrong), "")


def _not_finite_law(eq: ContactEquations, evaluation: Evaluation) -> str:
    """Describe the first law whose residual is not finite, else return "". Collective."""
    bad = anywhere(eq.comm, *(not np.isfinite(rows).all() for rows in evaluation.rows[1:-1]))
    for s, wrong in zip(eq.surfaces, bad, strict=True):
        if wrong:
            return (
                f"the law {s.law.name} of {s.name}, whose answer or its derivatives are not finite "
                "there: powers and roots at 0, quotients"
            )
    return ""


def _constants(eq: ContactEquations) -> list[list[float]]:
    """Return the values of all Constants in the data, which must be equal on all ranks."""
    constants = [d.values for d in placed_data(eq) if not hasattr(d.value, "x")]
    return [np.ravel(values).tolist() for values in constants]
