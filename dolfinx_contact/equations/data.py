# SPDX-License-Identifier: LGPL-3.0-or-later
"""Data of a contact problem: Functions and Constants whose values users may change between solves.

Each datum is stored with a description of where it occurs, for messages.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

import ufl
from ufl.algorithms.analysis import extract_constants

from dolfinx_contact._arrays import Array
from dolfinx_contact._compat import dirichlet_value
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.obstacles import Measured
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["Datum", "data_in", "data_of_surface", "data_within", "placed_data"]


class Datum(NamedTuple):
    """A Function or Constant of a problem.

    Attributes:
        place: description of where it occurs, such as "the normal of HalfSpace of 'floor'".
        value: the Function or Constant.
    """

    place: str
    value: Any

    @property
    def values(self) -> Array:
        """Current values of the Function, ghosts included, or of the Constant, as a view."""
        return np.asarray(self.value.x.array if hasattr(self.value, "x") else self.value.value)


def placed_data(eq: ContactEquations, *, conditions: bool = True) -> list[Datum]:
    """Return the data of bulk, obstacles, laws, rigid bodies and Dirichlet conditions.

    The displacement is not included. A datum that occurs several times is listed several times.

    Args:
        eq: contact problem.
        conditions: whether to include the Dirichlet conditions.
    """
    data = list(_placed("the form of the body", eq.bulk.functions, eq.bulk.constants))
    for s in eq.surfaces:
        data += data_of_surface(s)
    for body in eq.rigid.bodies:
        for component, e in zip(body.components, body.expressions, strict=True):
            data += data_in(e, f"what is given for {component} of {body.name!r}")
    for i, bc in enumerate(eq.bcs if conditions else [], 1):
        data.append(Datum(f"the value of the Dirichlet condition {i}", dirichlet_value(bc)))
    return [d for d in data if d.value is not eq.bulk.displacement]


def data_of_surface(s: DiscreteSurface) -> list[Datum]:
    """Return the data of the obstacle and of the law of a surface."""
    obstacle = getattr(s.obstacle, "shape", s.obstacle)
    parts = [f.name for f in fields(obstacle)] if is_dataclass(obstacle) else []
    kind = type(obstacle).__name__
    data = []
    for name, e in (("gap", s.given.gap), ("normal", s.given.normal)):
        for d in _placed(f"the obstacle {kind} of {s.name!r}", *s.given.data[name], e):
            mine = [name for name in parts if getattr(obstacle, name) is d.value]
            data.append(Datum(f"the {mine[0]} of {kind} of {s.name!r}", d.value) if mine else d)
    for name, e in s.given.fields.items():
        place = f"the {name} of {s.law.name} of {s.name!r}"
        data += _placed(place, *s.given.data[f":{name}"], e)
    return data


def data_within(expressions: Sequence[Any]) -> list[Datum]:
    """Return Functions and Constants in UFL expressions of gamma that prescribe Dirichlet data."""
    return [
        d
        for i, e in enumerate(expressions, 1)
        for d in data_in(e, f"the expression {i} of gamma that drives Dirichlet data")
    ]


def data_in(e: Any, place: str) -> Iterator[Datum]:
    """Return the Functions, then the Constants, in a UFL form or expression.

    Args:
        e: form or expression.
        place: description of the form or expression, for messages.
    """
    is_form = isinstance(e, ufl.Form)
    functions = e.coefficients() if is_form else ufl.algorithms.extract_coefficients(e)
    return _placed(place, functions, extract_constants(e), e)


def _placed(
    place: str, functions: Sequence[Any], constants: Sequence[Any], e: Any = None
) -> Iterator[Datum]:
    """Yield each Function and each Constant with a description of where it occurs.

    Constants, which have no name by default, are numbered in the order of their creation. If the
    expression ``e`` is a single Function or Constant, its description is ``place`` alone.
    """
    for f in functions:
        if isinstance(f, Measured):  # computed at the points from data that do not change
            continue
        yield Datum(place if f is e else f"the Function {f.name!r} in {place}", f)
    for i, c in enumerate(constants, 1):
        number = f" {i}" if len(constants) > 1 else ""
        which = f"the Constant {c.name!r}" if hasattr(c, "name") else f"the Constant{number}"
        yield Datum(place if c is e else f"{which} in {place}", c)
