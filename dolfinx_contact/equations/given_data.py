# SPDX-License-Identifier: LGPL-3.0-or-later
"""What users may change between two solves: the Functions and Constants of a contact problem.

With them the law of a surface must be one still, as must the memory be that of its law. And what
was put into unknowns of a state, to tell it from what users put there.
"""

from __future__ import annotations

import weakref
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_constants

from dolfinx_contact._compat import dirichlet_value
from dolfinx_contact._errors import require
from dolfinx_contact._mesh_mark import mesh_mark
from dolfinx_contact._shared import anywhere, largest
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.laws.law import obeys
from dolfinx_contact.obstacles import Measured
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.points.rigid_body import RigidBody
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = [
    "Constancy",
    "Datum",
    "GivenData",
    "check_law",
    "check_moduli",
    "check_surface",
    "check_time",
    "check_times",
    "check_turn",
    "data_in",
    "data_of_surface",
    "data_within",
    "given_data",
    "mark_of_data",
    "not_finite",
    "note_put",
    "numbers_of",
    "owned",
    "placed_data",
    "require_finite_geometry",
    "require_obstacles",
    "was_put",
]


_SAME = 1e-9  # of the size of data that are to stay


class Datum(NamedTuple):
    """What users may change.

    Attributes:
        place: where it occurs, in words.
        value: a Function or a Constant.
    """

    place: str
    value: Any


def placed_data(eq: ContactEquations, *, conditions: bool = True) -> list[Datum]:
    """Functions and Constants in bulk, obstacles, laws, rigid bodies and Dirichlet conditions.

    None of them is the displacement; one that is in several places is there several times.

    Args:
        eq: the contact problem.
        conditions: whether those of Dirichlet conditions are among them.
    """
    found = list(_placed("the form of the body", eq.bulk.functions, eq.bulk.constants))
    for s in eq.surfaces:
        found += data_of_surface(s)
    for body in eq.rigid.bodies:
        for component, e in zip(body.components, body.expressions, strict=True):
            found += data_in(e, f"what is given for {component} of {body.name!r}")
    for i, bc in enumerate(eq.bcs if conditions else [], 1):
        found.append(Datum(f"the value of the Dirichlet condition {i}", dirichlet_value(bc)))
    return [d for d in found if d.value is not eq.bulk.displacement]


def given_data(eq: ContactEquations) -> list[Any]:
    """What `placed_data` finds, without the places."""
    return [d.value for d in placed_data(eq)]


def mark_of_data(eq: ContactEquations) -> int:
    """A checksum of the values of `given_data` and of the nodes of the mesh. Not collective.

    It is that of this rank. Values that are put back have the mark that they had.
    """
    mark = mesh_mark(eq.V.mesh)
    for f in given_data(eq):
        # Adding zero makes -0.0 the same as 0.0.
        mark = zlib.crc32(np.ascontiguousarray(_values(f) + 0.0), mark)
    return mark


def data_of_surface(s: DiscreteSurface) -> list[Datum]:
    """Data in the obstacle and in the law of a surface."""
    obstacle = getattr(s.obstacle, "shape", s.obstacle)
    parts = [f.name for f in fields(obstacle)] if is_dataclass(obstacle) else []
    kind = type(obstacle).__name__
    found = []
    for name, e in (("gap", s.given.gap), ("normal", s.given.normal)):
        for d in _placed(f"the obstacle {kind} of {s.name!r}", *s.given.data[name], e):
            mine = [name for name in parts if getattr(obstacle, name) is d.value]
            found.append(Datum(f"the {mine[0]} of {kind} of {s.name!r}", d.value) if mine else d)
    for name, e in s.given.fields.items():
        place = f"the {name} of {s.law.name} of {s.name!r}"
        found += _placed(place, *s.given.data[f":{name}"], e)
    return found


def data_within(expressions: Sequence[Any]) -> list[Datum]:
    """Data in expressions by which gamma drives Dirichlet data."""
    return [
        d
        for i, e in enumerate(expressions, 1)
        for d in data_in(e, f"the expression {i} of gamma that drives Dirichlet data")
    ]


def data_in(e: Any, place: str) -> Iterator[Datum]:
    """Functions, then Constants, in the UFL of a place, in words."""
    is_form = isinstance(e, ufl.Form)
    functions = e.coefficients() if is_form else ufl.algorithms.extract_coefficients(e)
    return _placed(place, functions, extract_constants(e), e)


def _placed(
    place: str, functions: Sequence[Any], constants: Sequence[Any], e: Any = None
) -> Iterator[Datum]:
    """As `data_in`, of what is in the UFL ``e``."""
    for f in functions:
        if isinstance(f, Measured):  # at the points, of what does not change
            continue
        yield Datum(place if f is e else f"the Function {f.name!r} in {place}", f)
    for i, c in enumerate(constants, 1):
        which = f"the Constant {i}" if len(constants) > 1 else "the Constant"
        yield Datum(place if c is e else f"{which} in {place}", c)


def not_finite(eq: ContactEquations, data: list[Datum]) -> str:
    """The first place at which data are not finite on any rank; "" if all are. Collective."""
    here = [not np.isfinite(_values(d.value)).all() for d in data]
    return next((d.place for d, bad in zip(data, anywhere(eq.comm, *here), strict=True) if bad), "")


def require_obstacles(eq: ContactEquations) -> None:
    """Raise ``ValueError`` where an obstacle is not finite for what is given. Collective."""
    for s in eq.surfaces:
        values = s.points.vertex_gaps, s.points.vertex_normals
        finite = all(bool(np.isfinite(v).all()) for v in values)
        if not eq.comm.allreduce(int(finite), op=MPI.MIN):
            place = not_finite(eq, data_of_surface(s))
            message = f"{s.name}: the gap or normal of the obstacle is not finite: look at {place}"
            require(eq.comm, not place, message)


class GivenData:
    """The values of what users may change, as they are when this is made.

    Args:
        eq: the contact problem.
    """

    def __init__(self, eq: ContactEquations):
        self._data = placed_data(eq)
        self._values = [(d.value, _values(d.value).copy()) for d in self._data]

    def changed(self, comm: MPI.Comm, now: GivenData | None = None) -> str:
        """What is not as it was, in words; "" if all is. Collective.

        Args:
            comm: of all that have the data.
            now: as they were when that was made; by default as they are.
        """
        mine = ""
        for i, (d, (f, was)) in enumerate(zip(self._data, self._values, strict=True)):
            found = _values(f) if now is None else now._values[i][1]
            if not np.array_equal(_owned(f, was), _owned(f, found), equal_nan=True):
                mine = _before_and_now(d, was, found)
                break
        return next((words for words in comm.allgather(mine) if words), "")

    def unchanged(self) -> bool:
        """Whether all values are those still, on this rank. Not collective."""
        return all(np.array_equal(_values(f), values) for f, values in self._values)

    def agrees(self, other: GivenData, data: Sequence[fem.Function | fem.Constant]) -> bool:
        """Whether these of the data have the same values in another, on this rank."""
        wanted = {id(d) for d in data}
        pairs = zip(self._values, other._values, strict=True)
        return all(np.array_equal(v, w) for (f, v), (_, w) in pairs if id(f) in wanted)

    def restore(self) -> None:
        """Put the values back, bit by bit. Not collective."""
        for f, values in self._values:
            _values(f)[...] = values


class Constancy:
    """Data that are to stay what they are when this is made.

    Args:
        comm: communicator of all that have them.
        data: with their places.
    """

    def __init__(self, comm: MPI.Comm, data: Sequence[Datum]):
        self._comm = comm
        self._data = list(data)
        self._values = [_values(d.value).copy() for d in self._data]

    def changed(self) -> str:
        """What has changed beyond 1e-9 of its size, in words; "" if nothing has. Collective."""
        if not self._data:
            return ""
        off = [np.abs(_values(d.value) - v) for d, v in zip(self._data, self._values, strict=True)]
        mine = [
            (np.max(a, initial=0.0), np.max(np.abs(v), initial=0.0))
            for a, v in zip(off, self._values, strict=True)
        ]
        found: Any = largest(self._comm, mine)
        for d, v, (here, _), (away, size) in zip(
            self._data, self._values, mine, found, strict=True
        ):
            if not away <= _SAME * size:
                words = _before_and_now(d, v, _values(d.value))
                # In the words of a rank on which it has changed.
                told = self._comm.allgather("" if here <= _SAME * size else words)
                return next(w for w in told if w)
        return ""

    def restore(self) -> None:
        """Put the values back, bit by bit. Not collective."""
        for d, values in zip(self._data, self._values, strict=True):
            _values(d.value)[...] = values


#: Marks of what was put last into Functions and rigid bodies that live, on this rank. Problems
#: share these, so that none of them alone knows.
_PUT: dict[int, tuple[weakref.ref[Any], int]] = {}


def note_put(*unknowns: fem.Function | RigidBody) -> None:
    """Take what unknowns are now for what was put there, and not by users. Not collective."""
    for f in unknowns:
        _PUT[id(f)] = weakref.ref(f, _forgets(id(f))), _mark(f)


def _forgets(key: int) -> Callable[[object], None]:
    """What is called where that of a mark lives no longer."""

    def forget(_: object) -> None:
        _PUT.pop(key, None)

    return forget


def was_put(f: fem.Function | RigidBody) -> bool:
    """Whether an unknown is what was put there last. Not collective."""
    known, mark = _PUT.get(id(f), (None, 0))
    return known is not None and known() is f and mark == _mark(f)


def numbers_of(eq: ContactEquations) -> list[list[float]]:
    """The values of every Constant among the data."""
    constants = [c for c in given_data(eq) if not hasattr(c, "x")]
    return [[float(v) for v in np.real(np.ravel(c.value))] for c in constants]


def owned(
    f: fem.Function | RigidBody, values: npt.NDArray[np.float64] | None = None
) -> npt.NDArray[np.float64]:
    """Owned ones among all local values, by default those that are there. Not collective.

    Every rank has the motion of a rigid body.
    """
    if isinstance(f, RigidBody):
        return f.values if values is None else values
    dofs = f.function_space.dofmap
    found = f.x.array if values is None else values
    return np.asarray(found[: dofs.index_map.size_local * dofs.index_map_bs])


def _mark(f: fem.Function | RigidBody) -> int:
    return zlib.crc32(np.ascontiguousarray(owned(f) + 0.0))


def _before_and_now(d: Datum, was: npt.NDArray[np.float64], now: npt.NDArray[np.float64]) -> str:
    """What has changed, with both values of a Constant."""
    if hasattr(d.value, "x"):
        return d.place
    return f"{d.place} ({was.tolist()} before, {now.tolist()} now)"


def _owned(
    f: fem.Function | fem.Constant, values: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Of the values of a Constant or Function those of this rank alone."""
    return owned(f, values) if hasattr(f, "x") else values


def _values(f: fem.Function | fem.Constant) -> npt.NDArray[np.float64]:
    return np.asarray(f.x.array if hasattr(f, "x") else f.value)


def check_surface(s: DiscreteSurface, memory: Memory | None, where: str = "") -> None:
    """Raise ``ValueError`` if gaps, normals or law of a surface are not valid now.

    Collective; see `check_law`.
    """
    s.update_geometry()
    s.check_gaps()
    require_finite_geometry(s)
    check_law(s, memory, where)
    if memory is None:
        check_turn(s, None, where)


def check_turn(s: DiscreteSurface, before: npt.NDArray[np.float64] | None, where: str = "") -> None:
    """Raise ``ValueError`` if a rigid body turns by half a turn or more in a step. Collective.

    Slips on it are known up to there: a rotation of a whole turn leaves every place as it was.

    Args:
        s: a surface.
        before: motion of its rigid body at the last accepted state; None: where the mesh is.
        where: of the message.
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


def require_finite_geometry(s: DiscreteSurface) -> None:
    """Raise ``ValueError`` if a gap or normal is not finite as evaluated last. Collective."""
    gaps = bool(np.isfinite(s.points.vertex_gaps).all())
    normals = bool(np.isfinite(s.points.vertex_normals).all())
    message = f"{s.name}: the gap or normal of the obstacle is not finite"
    require(s.comm, gaps and normals, message)


def check_law(s: DiscreteSurface, memory: Memory | None, where: str = "") -> None:
    """Raise ``ValueError`` if a surface has no law with the fields as they are. Collective.

    They must be finite and of the sign that the law requires, and no radius of a friction disc
    negative; and the law must have what it needs, under the given memory.

    Args:
        s: contact surface.
        memory: memory of its points at the beginning of the step; None under the static law.
        where: part of the message.
    """
    check_time(s, memory)
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


def check_moduli(eq: ContactEquations, where: str = "") -> None:
    """Raise ``ValueError`` if a material of the body has moduli that none has. Collective."""
    message = ""
    try:
        for material in eq.bulk.materials:
            material.check_moduli()
    except ValueError as error:
        message = f"{error}{where}"
    require(eq.comm, not message, message)


def check_time(s: DiscreteSurface, memory: Memory | None) -> None:
    """Raise ``ValueError`` if the law lacks something under a memory. Collective.

    See `Law.lacks`; and a law that depends on the time needs one (`CompiledLaw.needs_time`).
    """
    history = memory is not None and memory.step > 0
    lack = s.law.lacks(history=history)
    kind = "in a history" if history else "statically"
    require(s.comm, not lack, f"{s.name}: {kind} the law {s.law.name} lacks {lack}")
    step = -1.0 if memory is None else min(memory.step, 0.0)
    # Laws that name the fields by which they need a time define what holds in a step of no length.
    time_known = history or (step == 0 and bool(s.law.needs_time))
    require(
        s.comm,
        time_known or not s.law_at_points.compiled.needs_time(step),
        f"{s.name}: the law {s.law.name} depends on the time of a step (a.step), and no time "
        "passes without a history: use evolution.QuasiStatic or NSCD, or define in the law what "
        "holds at rest, as in the speed ufl.conditional(ufl.gt(a.step, 0.0), (a.slid - "
        "a.slid_before) / a.step, 0.0)",
    )


def check_times(eq: ContactEquations) -> None:
    """`check_time` of all surfaces. Collective."""
    for s, memory in zip(eq.surfaces, eq.memory, strict=True):
        check_time(s, memory)
