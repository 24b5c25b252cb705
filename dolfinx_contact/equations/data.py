# SPDX-License-Identifier: LGPL-3.0-or-later
"""Data of a contact problem: Functions and Constants whose values users may change between solves.

Every datum has a place in words, for messages.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from ufl.algorithms.analysis import extract_constants

from dolfinx_contact._arrays import Array
from dolfinx_contact._compat import dirichlet_value
from dolfinx_contact._mpi import largest
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.obstacles import Measured
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["Constancy", "Datum", "data_in", "data_of_surface", "data_within", "placed_data"]

_SAME = 1e-9  # relative change that counts as none


class Datum(NamedTuple):
    """A Function or Constant of a problem.

    Attributes:
        place: place of its occurrence, in words.
        value: the Function or Constant.
    """

    place: str
    value: Any

    @property
    def values(self) -> Array:
        """Present values, those of a Function with ghosts; a view."""
        return np.asarray(self.value.x.array if hasattr(self.value, "x") else self.value.value)


def placed_data(eq: ContactEquations, *, conditions: bool = True) -> list[Datum]:
    """Data of bulk, obstacles, laws, rigid bodies and Dirichlet conditions.

    The displacement is not among them. A datum with several places is listed several times.

    Args:
        eq: contact problem.
        conditions: whether to include the Dirichlet conditions.
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


def data_of_surface(s: DiscreteSurface) -> list[Datum]:
    """Data of the obstacle and of the law of a surface."""
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
    """Data of the expressions by which gamma drives Dirichlet data."""
    return [
        d
        for i, e in enumerate(expressions, 1)
        for d in data_in(e, f"the expression {i} of gamma that drives Dirichlet data")
    ]


def data_in(e: Any, place: str) -> Iterator[Datum]:
    """Functions, then Constants, of a UFL form or expression at a place."""
    is_form = isinstance(e, ufl.Form)
    functions = e.coefficients() if is_form else ufl.algorithms.extract_coefficients(e)
    return _placed(place, functions, extract_constants(e), e)


def _placed(
    place: str, functions: Sequence[Any], constants: Sequence[Any], e: Any = None
) -> Iterator[Datum]:
    """Yield the data of `data_in`, from given Functions and Constants of ``e``.

    UFL sorts Constants by their creation. Those of DOLFINx have no name unless the user sets one.
    """
    for f in functions:
        if isinstance(f, Measured):  # computed at the points from data that do not change
            continue
        yield Datum(place if f is e else f"the Function {f.name!r} in {place}", f)
    for i, c in enumerate(constants, 1):
        number = f" {i}" if len(constants) > 1 else ""
        which = f"the Constant {c.name!r}" if hasattr(c, "name") else f"the Constant{number}"
        yield Datum(place if c is e else f"{which} in {place}", c)


class Constancy:
    """Test that data keep the values that they have at construction.

    Args:
        comm: communicator of all ranks with these data.
        data: tested data.
    """

    def __init__(self, comm: MPI.Comm, data: Sequence[Datum]):
        self._comm = comm
        self._data = list(data)
        self._values = [d.values.copy() for d in self._data]

    def changed(self) -> str:
        """Return the place of a datum that has changed by more than 1e-9 of its size. Collective.

        The text includes both values of a Constant; it is empty if nothing has changed.
        """
        if not self._data:
            return ""
        pairs = list(zip(self._data, self._values, strict=True))
        mine = [
            (np.max(_change(d.values, v), initial=0.0), np.max(np.abs(v), initial=0.0))
            for d, v in pairs
        ]
        found: Any = largest(self._comm, mine)
        for (d, v), (here, _), (away, size) in zip(pairs, mine, found, strict=True):
            if away > 0 and not away <= _SAME * size:  # the size is NaN where a datum is
                text = d.place
                if not hasattr(d.value, "x"):
                    text += f" ({v.tolist()} before, {d.values.tolist()} now)"
                # In the words of a rank on which it has changed.
                told = self._comm.allgather(text if here > 0 and not here <= _SAME * size else "")
                return next(w for w in told if w)
        return ""

    def restore(self) -> None:
        """Put the values back, bit by bit. Not collective."""
        for d, values in zip(self._data, self._values, strict=True):
            d.values[...] = values


def _change(a: npt.NDArray[Any], b: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Absolute differences; 0 where both are NaN, infinite where one of them is not finite."""
    away = np.full(np.shape(a), np.inf)
    np.subtract(a, b, out=away, where=np.isfinite(a) & np.isfinite(b))
    return np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.abs(away))
