# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact laws compiled from UFL: values and derivatives at contact points.

A compiled law depends only on the kind of the law and on the dimension, not on the discretisation.
Its UFL expressions are evaluated by `_forms.PointValues`.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from ufl.algorithms import extract_coefficients
from ufl.algorithms.analysis import extract_constants
from ufl.corealg.traversal import unique_pre_traversal

from dolfinx_contact._arrays import Array
from dolfinx_contact._forms import PointValues, ScalarList
from dolfinx_contact._mpi import all_ranks, everywhere
from dolfinx_contact._ufl import depends_on, not_affine
from dolfinx_contact.laws.law import Law, StatusPiece, checked_pieces
from dolfinx_contact.laws.roots import Roots
from dolfinx_contact.laws.symbols import SLID, Symbols, known_step

__all__ = ["CompiledLaw", "compiled_law"]

#: Errors of numpy, math and UFL about UFL in place of numbers.
_NOT_UFL = "ufunc", "__float__", "cannot be evaluated as bool"


def _columns(flat: ScalarList, piece: StatusPiece) -> list[tuple[int, int | None, int]]:
    """Add the border expressions of a status to ``flat`` and describe each border.

    Return the columns of its distance and condition (None if it always exists), and its target
    status.
    """
    found = []
    for border in piece.borders:
        where = None if border.where is None else flat.add(_number(border.where))[0]
        found.append((flat.add(border.distance)[0], where, border.target))
    return found


def _number(condition: Any) -> Any:
    return ufl.conditional(condition, 1.0, 0.0)


class _Written:
    """UFL expressions of a law at a contact point.

    Args:
        law: law of any kind.
        symbols: symbols for the data of the point.

    Attributes:
        equations: equations of the law, by name.
        pieces: required traction and borders, by status.
        bounds: radius of the friction disc at the present and at unit pressure, or None.
        bond: attributes of `Law.bond` by name; empty if the law has no bond.
        pressure: pressure to be averaged by a nonlocal law; None for a local law.
    """

    def __init__(self, law: Law, symbols: Symbols):
        point = symbols.point
        mine = law.having(symbols.of_the_law)
        self.equations = dict(mine.equations(point))
        point = replace(point, solved=symbols.exact(self.equations))
        local = law.averaging is None
        unit = point if local else replace(point, around=ufl.as_ufl(1.0))
        self.pieces = checked_pieces(mine.pieces(point), point.dim)
        pressed = mine.with_pressure(point)
        self.bounds = {
            "bound": mine.bound(pressed, pressed.p),
            "unit_bound": mine.bound(unit, ufl.as_ufl(1.0)),
        }
        bond = mine.bond(point)
        self.bond = dict[str, Any]()
        if bond is not None:
            known = "traction", "stored", "spent", "broken"
            self.bond = {name: getattr(bond, name) for name in known}
            self.bond |= {f"after.{name}": e for name, e in bond.after.items()}
        self.pressure = None if local else ufl.as_ufl(pressed.p)

    @property
    def scalars(self) -> list[Any]:
        """All scalar expressions to compile, component by component."""
        flat = ScalarList()
        for piece in self.pieces.values():
            flat.add(piece.answer)
            _columns(flat, piece)
            if piece.exists is not None:
                flat.add(_number(piece.exists))
        for e in (*self.bounds.values(), *self.bond.values(), self.pressure):
            if e is not None:
                flat.add(e)
        return flat.components


@contextmanager
def _ufl_alone(law: Law) -> Iterator[None]:
    """Context manager that explains errors of numpy, math or Python functions applied to UFL."""
    try:
        yield
    except (TypeError, ValueError) as error:
        if not any(text in str(error) for text in _NOT_UFL):
            raise
        raise TypeError(
            f"the formulas of the law {type(law).__name__} must be UFL: use ufl.exp, ufl.sqrt and "
            "ufl.max_value in place of functions of numpy, math and Python, and ufl.conditional "
            f"in place of if. The error was: {error}"
        ) from error


def _refuse_other_data(law: Law, scalars: list[Any], w: Any) -> None:
    """Raise `ValueError` if a law uses Constants or Functions that are not its fields.

    Args:
        law: law, for the message.
        scalars: expressions of the law.
        w: Function with the fields of the law.
    """
    data = [d for e in scalars for d in (*extract_coefficients(e), *extract_constants(e))]
    other = [type(d).__name__ for d in data if d is not w]
    if other:
        raise ValueError(
            f"the formulas of the law {type(law).__name__} contain a {other[0]} that is not one of "
            "its fields; only fields are known at the contact points. Declare a dataclass field, "
            f"such as `friction: Any`, give the {other[0]} as its value, and write self.friction"
        )


class CompiledLaw:
    """Compiled law, shared by all laws of the same kind (`Law.kind`).

    Args:
        law: law of this kind; its fields are replaced by symbols.
        dim: dimension, 2 or 3.
        comm: communicator of the ranks that compile the law together.

    Attributes:
        names: names of all fields: fields of the law, data of the last accepted state that the law
            uses, and `AROUND` for a nonlocal law.
        codes: status codes of the law.
        rows: position of each status code in `codes`.
        places: columns of each quantity in the array of compiled values, by name: one list per
            status, or a single list if independent of the status.
        borders: for each status and border, column of the distance, column of the condition (None
            for no condition), and target status.
        exists: column of the existence condition of each status; None without a condition.
        remembers: whether the law uses data of the last accepted state that are not its fields.
        kept: names of the internal variables that the law uses and that are not its fields.
        bonded: whether the law has a bond (`Law.bond`).
        knows_slip: whether the law depends on the slip distance.
    """

    def __init__(self, law: Law, dim: int, comm: MPI.Comm):
        self.dim = dim
        self._comm = comm
        # Evaluate the code of the user before compilation, which is collective.
        with everywhere(comm, f"the law {type(law).__name__}"):
            every = Symbols(law, dim)
            with _ufl_alone(law):
                scalars = _Written(law, every).scalars
            _refuse_other_data(law, scalars, every.w)
            memory = every.used(scalars)
            symbols = Symbols(law, dim, memory)
            written = _Written(law, symbols)
        self.names = symbols.names
        self.remembers = bool(memory)
        self._symbols = symbols
        self._written = written
        self.kept = [name for name in law.memory(dim) if name in memory]
        self.bonded: bool = bool(written.bond)
        self.knows_slip: bool = SLID in self.names
        self.codes = tuple(written.pieces)
        self.rows: npt.NDArray[np.int64] = np.zeros(max(self.codes) + 1, dtype=np.int64)
        self.rows[list(self.codes)] = np.arange(len(self.codes))
        flat = ScalarList()
        by = {"by_jump": symbols.jump, "by_traction": symbols.traction}
        if written.pressure is not None:
            by["by_around"] = symbols.fields[-1]
        self.places: dict[str, list[list[int]]] = {name: [] for name in ("answer", *by)}
        self.borders: list[list[tuple[int, int | None, int]]] = []
        self.exists: list[int | None] = []
        for piece in written.pieces.values():
            self.places["answer"].append(flat.add(piece.answer))
            for name, symbol in by.items():
                self.places[name].append(flat.add(ufl.diff(piece.answer, symbol)))
            self.borders.append(_columns(flat, piece))
            self.exists.append(None if piece.exists is None else flat.add(_number(piece.exists))[0])
        for name, bound in written.bounds.items():
            self.places[name] = [] if bound is None else [flat.add(bound)]
        self.places |= {f"bond.{name}": [flat.add(e)] for name, e in written.bond.items()}
        q = written.pressure
        if q is not None:
            slopes = (ufl.diff(q, by[name]) for name in ("by_jump", "by_traction"))
            self.places["pressure"] = [flat.add(e) for e in (q, *slopes)]
        self.values = self._values(flat)
        self._step = symbols.step
        self._needs: dict[float, bool] = {}
        roots = written.equations
        self._roots = Roots(roots, symbols.solved, symbols.w, comm) if roots else None

    def _values(self, flat: ScalarList) -> PointValues:
        """Compile scalar expressions of the law for evaluation at points. Collective."""
        return PointValues(flat.components, self._symbols.w, self._comm)

    def needs_time(self, step: float) -> bool:
        """Return whether the law depends on the duration of a step with the sign of ``step``.

        Comparisons of the duration with numbers are evaluated first (`known_step`). A negative sign
        means a static problem.
        """
        symbol = self._step
        if symbol is None:
            return False
        if step not in self._needs:
            scalars = self._written.scalars
            expressions = [known_step(ufl.as_ufl(e), symbol, step) for e in scalars]
            self._needs[step] = symbol in set(unique_pre_traversal(ufl.as_vector(expressions)))
        return self._needs[step]

    @property
    def signature(self) -> str:
        """Signature of the law, independent of its field values."""
        return str((sum(c * c for c in self.values.components) * ufl.dx).signature())

    @cached_property
    def is_piecewise_linear(self) -> bool:
        """Whether required traction and borders of each status are affine in jump, traction, gap.

        The existence conditions of statuses must not depend on these quantities. The decision is
        symbolic, because values or derivatives at sample states would not prove it.
        """
        if self._roots is not None:
            return False
        at = self._symbols
        moving = at.jump, at.traction, at.w[3 * self.dim]
        for piece in self._written.pieces.values():
            values = [piece.answer, *(b.distance for b in piece.borders)]
            if any(not_affine(ufl.as_ufl(e), *moving) for e in values):
                return False
            if piece.exists is not None and depends_on(_number(piece.exists), *moving):
                return False
        return True

    @cached_property
    def slopes(self) -> tuple[PointValues, list[list[int]]]:
        """Compiled derivatives of border distances with respect to jump and traction.

        They are compiled on first use. The second item contains the columns of each status, ordered
        by border, jump before traction, and component.
        """
        flat = ScalarList()
        places = []
        for piece in self._written.pieces.values():
            places.append(
                [
                    k
                    for border in piece.borders
                    for by in (self._symbols.jump, self._symbols.traction)
                    for k in flat.add(ufl.diff(border.distance, by))
                ]
            )
        return self._values(flat), places

    @cached_property
    def sensitivities(self) -> tuple[PointValues, list[list[int]], list[list[list[int]]]]:
        """Compiled derivatives of the answers with respect to normal and fields, and their columns.

        The columns are lists by status for the normal, and by field and status for the fields.
        """
        flat = ScalarList()
        answers = [piece.answer for piece in self._written.pieces.values()]
        by_normal = [flat.add(ufl.diff(answer, self._symbols.n)) for answer in answers]
        by_field = [
            [flat.add(ufl.diff(answer, f)) for answer in answers] for f in self._symbols.fields
        ]
        return self._values(flat), by_normal, by_field

    @cached_property
    def pressure_sensitivities(self) -> PointValues:
        """Compiled derivatives of the averaged pressure with respect to normal and fields.

        They are compiled on first use.
        """
        flat = ScalarList()
        for by in (self._symbols.n, *self._symbols.fields[:-1]):
            flat.add(ufl.diff(self._written.pressure, by))
        return self._values(flat)

    def evaluate(self, values: PointValues, columns: Array) -> Array:
        """Evaluate compiled scalars at n points, shape (n, number of scalars). Not collective.

        Args:
            values: compiled scalars of the law.
            columns: data of the points, one row per point and one column per scalar component.
        """
        return values(columns if self._roots is None else self._roots(columns))


_known: dict[tuple[Hashable, ...], CompiledLaw] = {}


def compiled_law(law: Law, dim: int, comm: MPI.Comm) -> CompiledLaw:
    """Return the compiled form of a law; laws of the same kind share it. Collective."""
    kind = law.kind
    if kind is None:
        return CompiledLaw(law, dim, comm)
    # Derivatives are compiled later on the same ranks, possibly after the mesh has been freed.
    key = kind, dim, tuple(comm.allgather(MPI.COMM_WORLD.rank))
    # Compilation is collective, so either all ranks compile or none does.
    if not all_ranks(comm, key in _known):
        _known[key] = CompiledLaw(law, dim, comm.Dup())
    return _known[key]
