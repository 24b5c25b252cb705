# SPDX-License-Identifier: LGPL-3.0-or-later
"""Validation of the data before a solve or a question.

`validate` is called once before every solve. It is the only place where values of Functions and
Constants are tested: afterwards the solvers trust them.
"""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from ufl.algorithms.analysis import extract_constants

from dolfinx_contact._compat import dirichlet_value
from dolfinx_contact._errors import require, same_everywhere
from dolfinx_contact._shared import anywhere
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.data import Datum, data_of_surface, placed_data
from dolfinx_contact.equations.evaluation import Evaluated, Evaluation
from dolfinx_contact.laws.law import obeys
from dolfinx_contact.laws.status import closed
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = [
    "check_law",
    "check_moduli",
    "check_surface",
    "check_times",
    "check_turn",
    "require_obstacles",
    "validate",
    "validate_data",
    "without_normal",
]

Array = npt.NDArray[np.float64]

#: Largest admissible slope of a gap along the normal at a touching point: -1 where a level set has
#: a gradient, -1/m where it vanishes like the m-th power of the distance.
_STEEPEST = -0.75
_NO_NORMAL = (
    "the obstacle has no normal at a contact point that is at ({}) or next to it: the gradient of "
    "a level set vanishes there, or it is the centre of a sphere"
)
_TURNED = (
    "the normal of the obstacle has turned by half a turn in this step at a contact point that is "
    "at ({}), as where a body passes through a thin tool: how far it slipped is not known; take "
    "shorter steps"
)


def validate(eq: ContactEquations, x0: PETSc.Vec) -> Evaluated | None:
    """Raise ``ValueError`` for data that are not admissible; otherwise adapt to them. Collective.

    Args:
        eq: contact problem.
        x0: start of the solve.

    Returns:
        The evaluation at ``x0``; None if the scales of the data, and with them H, have changed.
    """
    same_everywhere(eq.comm, "data of the problem", Constants=_numbers(eq))
    eq.require_same_mesh()
    check_moduli(eq)
    eq.refresh()
    for s, memory in zip(eq.surfaces, eq.memory, strict=True):
        s.check_gaps()
        check_law(s, memory)
        if memory is None:
            check_turn(s, None)
    _require_finite_start(eq, x0)
    require_obstacles(eq)
    b = eq.create_vector()
    state = eq.residual(x0, b)
    finite = bool(np.isfinite(b.array_r).all())
    b.destroy()
    lost = without_normal(eq, state)
    require(eq.comm, not lost, lost)
    for s in eq.surfaces:
        _require_finite_geometry(s)
    given = bool(np.isfinite(eq.rigid.numbers()).all())
    require(eq.comm, given, "a load or motion of a rigid body is not finite")
    eq.constraints.check_values(eq.surfaces, eq.body_size)
    if not eq.comm.allreduce(int(finite), op=MPI.MIN):
        place = _not_finite(eq, placed_data(eq)) or _not_finite_law(eq, state)
        place = place or "loads and material data, for NaN"
        raise ValueError(f"the residual is not finite at the start: look at {place}")
    changed = eq.scaling.follow(eq.displacement(x0))
    return None if changed else Evaluated(x0.array_r.copy(), state)


def validate_data(eq: ContactEquations) -> None:
    """Raise ``ValueError`` if mesh, material, obstacles or laws are not admissible. Collective.

    This is the part of `validate` that does not need a state, for questions about data.
    """
    eq.require_same_mesh()
    check_moduli(eq)
    for s, memory in zip(eq.surfaces, eq.memory, strict=True):
        check_surface(s, memory)


def check_moduli(eq: ContactEquations, where: str = "") -> None:
    """Raise ``ValueError`` if the moduli of a material are not admissible. Collective."""
    message = ""
    try:
        for material in eq.bulk.materials:
            material.check_moduli()
    except ValueError as error:
        message = f"{error}{where}"
    require(eq.comm, not message, message)


# -- surfaces --------------------------------------------------------------------------------------


def check_surface(s: DiscreteSurface, memory: Memory | None, where: str = "") -> None:
    """Raise ``ValueError`` if gaps, normals or law of a surface are not valid now. Collective.

    Args:
        s: contact surface.
        memory: memory of its points at the beginning of the step; None under the static law.
        where: end of the message.
    """
    s.update_geometry()
    s.check_gaps()
    _require_finite_geometry(s)
    check_law(s, memory, where)
    if memory is None:
        check_turn(s, None, where)


def check_law(s: DiscreteSurface, memory: Memory | None, where: str = "") -> None:
    """Raise ``ValueError`` if the law of a surface is not valid with its fields. Collective.

    Fields must be finite and have the sign that the law requires, the friction bound must not be
    negative, and the law must have all that it needs under the given memory.

    Args:
        s: contact surface.
        memory: memory of its points at the beginning of the step; None under the static law.
        where: end of the message.
    """
    _check_time(s, memory)
    fields = s.points.data.fields
    for name, values in fields.items():
        what = f"{name} of {s.law.name}{where}"
        require(s.comm, bool(np.isfinite(values).all()), f"{s.name}: NaN in the {what}")
        sign = s.law.signs.get(name, "any")
        words = {"positive": "not positive:", "fraction": "not between 0 and 1:"}
        good = bool(obeys(sign, values).all())
        require(s.comm, good, f"{s.name}: {words.get(sign, 'negative')} {what}")
    for x in s.law.internal:
        if x.end is None:
            continue
        left = x.sense * (x.end - fields[x.name])
        good = bool(np.all(left >= -1e-14 * (1.0 + abs(x.end))))
        what = f"{x.name} of {s.law.name}{where}"
        require(s.comm, good, f"{s.name}: {what} is beyond its end {x.end:g}")
    at_rest = np.zeros_like(s.points.data.n)
    radius = s.law_at_points(at_rest, at_rest, s.point_data(memory)).unit_bound
    message = f"{s.name}: the law {s.law.name} has a negative radius{where}"
    require(s.comm, not bool((radius < -1e-14).any()), message)


def check_times(eq: ContactEquations) -> None:
    """Raise ``ValueError`` if a law lacks something under the memory of the step. Collective."""
    for s, memory in zip(eq.surfaces, eq.memory, strict=True):
        _check_time(s, memory)


def _check_time(s: DiscreteSurface, memory: Memory | None) -> None:
    """Raise ``ValueError`` if a law lacks something under a memory. Collective.

    See `Law.lacks`. A law that depends on the time needs a step with a duration
    (`CompiledLaw.needs_time`).
    """
    history = memory is not None and memory.step > 0
    lack = s.law.lacks(history=history)
    kind = "in a history" if history else "statically"
    require(s.comm, not lack, f"{s.name}: {kind} the law {s.law.name} lacks {lack}")
    step = -1.0 if memory is None else min(memory.step, 0.0)
    # Laws that name the fields by which they need a time define the answer in a step of no length.
    time_known = history or (step == 0 and bool(s.law.needs_time))
    require(
        s.comm,
        time_known or not s.law_at_points.compiled.needs_time(step),
        f"{s.name}: the law {s.law.name} depends on the time of a step (a.step), and no time "
        "passes without a history: use evolution.QuasiStatic or NSCD, or define in the law what "
        "holds at rest, as in the speed ufl.conditional(ufl.gt(a.step, 0.0), (a.slid - "
        "a.slid_before) / a.step, 0.0)",
    )


def check_turn(s: DiscreteSurface, before: Array | None, where: str = "") -> None:
    """Raise ``ValueError`` if a rigid body turns by half a turn or more in a step. Collective.

    Slips on it are known only below half a turn: a whole turn leaves every place as it was.

    Args:
        s: contact surface.
        before: motion of its rigid body at the last accepted state; None: position of the mesh.
        where: end of the message.
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
        f"{s.name}: the rigid body {body.name!r} turns by {turned:.4g} rad in one step{where}: "
        "slips on it are known below half a turn; take shorter steps of a history",
    )


def require_obstacles(eq: ContactEquations) -> None:
    """Raise ``ValueError`` if a gap or normal is not finite, and name the datum. Collective."""
    for s in eq.surfaces:
        values = s.points.vertex_gaps, s.points.vertex_normals
        finite = all(bool(np.isfinite(v).all()) for v in values)
        if not eq.comm.allreduce(int(finite), op=MPI.MIN):
            place = _not_finite(eq, data_of_surface(s))
            message = f"{s.name}: the gap or normal of the obstacle is not finite: look at {place}"
            require(eq.comm, not place, message)


def _require_finite_geometry(s: DiscreteSurface) -> None:
    """Raise ``ValueError`` if a gap or normal is not finite as evaluated last. Collective."""
    gaps = bool(np.isfinite(s.points.vertex_gaps).all())
    normals = bool(np.isfinite(s.points.vertex_normals).all())
    message = f"{s.name}: the gap or normal of the obstacle is not finite"
    require(s.comm, gaps and normals, message)


# -- state -----------------------------------------------------------------------------------------


def without_normal(eq: ContactEquations, state: Evaluation) -> str:
    """Message on a displaced point without a normal; "" if all have one. Collective."""
    for s, found in zip(eq.surfaces, state.surfaces, strict=True):
        data = found.data
        place = found.kinematics.place
        if place is None:
            continue
        fall = np.sum(found.kinematics.gap_slope * data.n, axis=1)
        lost = ~np.isfinite(fall + found.kinematics.gap) | (
            closed(found.statuses) & (fall > _STEEPEST)
        )
        # If the normal is finite, the undefined quantity is the slip in the step.
        turned = lost & np.isfinite(data.n).all(axis=1) & ~np.isfinite(fall)
        for which, why in ((lost & ~turned, _NO_NORMAL), (turned, _TURNED)):
            mine = sorted(np.round((s.positions + place)[which] / eq.body_size, 9).tolist())
            places = sorted(p for part in eq.comm.allgather(mine) for p in part)
            if places:
                where = ", ".join(f"{c * eq.body_size:.6g}" for c in places[0])
                return f"{s.name}: {why.format(where)}"
    return ""


def _require_finite_start(eq: ContactEquations, x0: PETSc.Vec) -> None:
    """Raise ``ValueError`` if a start is not finite. Collective."""
    tractions = [f"traction of {s.name!r}" for s in eq.surfaces]
    names = "displacement", *tractions, "motion of the rigid bodies"
    bad = [not np.isfinite(part).all() for part in eq.blocks(x0)]
    for name, wrong in zip(names, anywhere(eq.comm, *bad), strict=True):
        if wrong:
            raise ValueError(f"the {name} at the start is not finite")


def _not_finite(eq: ContactEquations, data: Sequence[Datum]) -> str:
    """First place at which data are not finite on any rank; "" if all are. Collective."""
    bad = [not np.isfinite(d.values).all() for d in data]
    places = zip(data, anywhere(eq.comm, *bad), strict=True)
    return next((d.place for d, wrong in places if wrong), "")


def _not_finite_law(eq: ContactEquations, state: Evaluation) -> str:
    """First law whose answer is not finite on any rank; "" if all are. Collective."""
    for s, rows in zip(eq.surfaces, state.rows[1:-1], strict=True):
        if not eq.comm.allreduce(int(np.isfinite(rows).all()), op=MPI.MIN):
            return (
                f"the law {s.law.name} of {s.name}, whose answer or its derivatives are not finite "
                "there: powers and roots at 0, quotients"
            )
    return ""


def _numbers(eq: ContactEquations) -> list[list[float]]:
    """Values of all Constants of the data, which must be the same on every rank."""
    constants = list(eq.bulk.constants)
    for s in eq.surfaces:
        constants += s.given.constants
    for body in eq.rigid.bodies:
        for e in body.expressions:
            constants += extract_constants(e)
    prescribed = map(dirichlet_value, eq.bcs)
    constants += [value for value in prescribed if not hasattr(value, "x")]
    return [[float(v) for v in np.ravel(c.value)] for c in constants]
