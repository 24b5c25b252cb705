# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact laws compiled from UFL: values and derivatives at contact points.

A compiled law depends only on the kind of the law and on the dimension, not on the discretisation
(`_forms`).
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

from dolfinx_contact._forms import PointValues, ScalarList
from dolfinx_contact._mpi import all_ranks, everywhere
from dolfinx_contact._ufl import depends_on, not_affine
from dolfinx_contact.laws.answers import Answers, Array, Codes, PointData
from dolfinx_contact.laws.law import Law, StatusPiece, checked_pieces
from dolfinx_contact.laws.roots import Roots
from dolfinx_contact.laws.symbols import SLID, Symbols, from_memory, known_step

__all__ = ["CompiledLaw", "LawAtPoints"]

#: Errors of numpy, math and UFL about UFL in place of numbers.
_NOT_UFL = "ufunc", "__float__", "cannot be evaluated as bool"


class _Written:
    """UFL expressions of a law at a point.

    Args:
        law: law of any kind.
        symbols: symbols for the data of the point.

    Attributes:
        equations: equations of the law, by name.
        pieces: smooth pieces of the law, by status.
        bounds: radii of the friction disc, at the pressure of the law and at unit pressure.
        bond: parts of `Law.bond` by name; empty if the law has no bond.
        pressure: pressure averaged by a nonlocal law; None for a local law.
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
    """Explain errors that occur if a law applies numpy, math or Python functions to UFL."""
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
    """Compiled law, shared by all laws of the same kind.

    Args:
        law: law of this kind; its fields are replaced by symbols.
        dim: dimension, 2 or 3.
        comm: communicator of the ranks compiling together.

    Attributes:
        names: names of all fields: fields of the law, used fields of the memory
            (`symbols.from_memory`), and `AROUND` for a nonlocal law.
        codes: status codes of the law.
        rows: index of each status code in `codes`.
        places: columns of the values, by quantity and status.
        borders: columns of distance and condition, and target status, by status and border.
        exists: column of the existence condition of each status; None for unconditional ones.
        remembers: whether the law uses fields of the memory (`symbols.from_memory`).
        kept: used fields of the memory that are not fields of the law.
        bonded: whether the law has a bond (`Law.bond`).
        knows_slip: whether the law depends on the slip distance.
    """

    def __init__(self, law: Law, dim: int, comm: MPI.Comm):
        local = law.averaging is None
        self.dim = dim
        self._comm = comm
        # Evaluate the code of the user before compilation, which is collective.
        with everywhere(comm, f"the law {type(law).__name__}"):
            kept = [name for name in law.memory(dim) if name not in law.given]
            given = dim, law.given, kept, law.unknowns(dim)
            every = Symbols(*given, from_memory(dim, kept), local=local)
            with _ufl_alone(law):
                scalars = _Written(law, every).scalars
            _refuse_other_data(law, scalars, every.w)
            memory = every.used(scalars)
            symbols = Symbols(*given, memory, local=local)
            written = _Written(law, symbols)
        self.names = symbols.names
        self.remembers = bool(memory)
        self._w = symbols.w
        self._fields = symbols.fields
        self._jump = symbols.jump
        self._traction = symbols.traction
        self._n = symbols.n
        self._pieces = written.pieces
        self._pressure = written.pressure
        bond = written.bond
        self.kept = [name for name in kept if name in self.names]
        self.bonded: bool = bool(bond)
        self.knows_slip: bool = SLID in self.names
        self.codes = tuple(self._pieces)
        self.rows: npt.NDArray[np.int64] = np.zeros(max(self.codes) + 1, dtype=np.int64)
        self.rows[list(self.codes)] = np.arange(len(self.codes))
        flat = ScalarList()
        known = "answer", "by_jump", "by_traction", "by_around"
        self.places: dict[str, list[list[int]]] = {name: [] for name in known}
        self.borders: list[list[tuple[int, int | None, int]]] = []
        self.exists: list[int | None] = []
        for piece in self._pieces.values():
            self.places["answer"].append(flat.add(piece.answer))
            self.places["by_jump"].append(flat.add(ufl.diff(piece.answer, self._jump)))
            self.places["by_traction"].append(flat.add(ufl.diff(piece.answer, self._traction)))
            if not local:
                slope = ufl.diff(piece.answer, self._fields[-1])
                self.places["by_around"].append(flat.add(slope))
            self.borders.append(_columns(flat, piece))
            self.exists.append(None if piece.exists is None else flat.add(_number(piece.exists))[0])
        for name, bound in written.bounds.items():
            self.places[name] = [] if bound is None else [flat.add(bound)]
        self.places |= {f"bond.{name}": [flat.add(e)] for name, e in bond.items()}
        q = self._pressure
        if q is not None:
            slopes = (ufl.diff(q, by) for by in (self._jump, self._traction))
            self.places["pressure"] = [flat.add(e) for e in (q, *slopes)]
        self.values = PointValues(flat.components, self._w, comm)
        roots = written.equations
        self._needs: dict[float, bool] = {}
        self._roots = Roots(roots, symbols.solved, self._w, comm) if roots else None
        self._step = symbols.step
        self._expressions = written.scalars

    def needs_time(self, step: float) -> bool:
        """Return whether the law depends on the duration of a step of the given sign.

        Conditions on the duration are resolved first (`known_step`).
        """
        if self._step is None:
            return False
        if step not in self._needs:
            expressions = [known_step(ufl.as_ufl(e), self._step, step) for e in self._expressions]
            nodes = set(unique_pre_traversal(ufl.as_vector(expressions)))
            self._needs[step] = self._step in nodes
        return self._needs[step]

    @property
    def signature(self) -> str:
        """Signature of the law, independent of its field values."""
        return str((sum(c * c for c in self.values.components) * ufl.dx).signature())

    @cached_property
    def is_piecewise_linear(self) -> bool:
        """Whether answers and borders of each status are affine in jump, traction and gap.

        The decision is symbolic, because values or derivatives at sample states would not prove it.
        The existence conditions of statuses must not depend on these quantities.
        """
        if self._roots is not None:
            return False
        moving = self._jump, self._traction, self._w[3 * self.dim]
        for piece in self._pieces.values():
            values = [piece.answer, *(b.distance for b in piece.borders)]
            if any(not_affine(ufl.as_ufl(e), *moving) for e in values):
                return False
            if piece.exists is not None and depends_on(_number(piece.exists), *moving):
                return False
        return True

    @cached_property
    def slopes(self) -> tuple[PointValues, list[list[int]]]:
        """Derivatives of border distances with respect to jump and traction.

        They are compiled on first use.
        """
        flat = ScalarList()
        places = []
        for piece in self._pieces.values():
            places.append(
                [
                    k
                    for border in piece.borders
                    for by in (self._jump, self._traction)
                    for k in flat.add(ufl.diff(border.distance, by))
                ]
            )
        return PointValues(flat.components, self._w, self._comm), places

    @cached_property
    def sensitivities(self) -> tuple[PointValues, list[list[int]], list[list[list[int]]]]:
        """Derivatives of the answers with respect to normal and fields, compiled on first use."""
        flat = ScalarList()
        by_normal = [flat.add(ufl.diff(p.answer, self._n)) for p in self._pieces.values()]
        by_field = [
            [flat.add(ufl.diff(p.answer, f)) for p in self._pieces.values()] for f in self._fields
        ]
        return PointValues(flat.components, self._w, self._comm), by_normal, by_field

    @cached_property
    def pressure_sensitivities(self) -> PointValues:
        """Derivatives of the averaged pressure with respect to normal and fields.

        They are compiled on first use.
        """
        flat = ScalarList()
        for by in (self._n, *self._fields[:-1]):
            flat.add(ufl.diff(self._pressure, by))
        return PointValues(flat.components, self._w, self._comm)

    def evaluate(self, values: PointValues, columns: Array) -> Array:
        """Return values (n, width) at points with data ``columns`` (n, columns). Not collective."""
        return values(columns if self._roots is None else self._roots(columns))


_known: dict[tuple[Hashable, ...], CompiledLaw] = {}


def _compiled(law: Law, dim: int, comm: MPI.Comm) -> CompiledLaw:
    """Return the compiled law, cached for all laws of the same kind. Collective."""
    kind = law.kind
    if kind is None:
        return CompiledLaw(law, dim, comm)
    # Derivatives are compiled later on the same ranks, possibly after the mesh has been freed.
    key = kind, dim, tuple(comm.allgather(MPI.COMM_WORLD.rank))
    # Compilation is collective, so either all ranks compile or none does.
    if not all_ranks(comm, key in _known):
        _known[key] = CompiledLaw(law, dim, comm.Dup())
    return _known[key]


class LawAtPoints:
    """Law at the contact points of this rank. Only construction is collective.

    Args:
        law: law; its field values are passed with the data of the points.
        dim: dimension, 2 or 3.
        number: number of points.
        comm: communicator of the ranks compiling together.

    Attributes:
        codes: status codes; if several statuses are admissible, the first one is used.
    """

    def __init__(self, law: Law, dim: int, number: int, comm: MPI.Comm):
        self.law = law
        self.dim = dim
        self.number = number
        self.compiled = _compiled(law, dim, comm)
        self.codes = self.compiled.codes

    def __call__(
        self, jump: Array, traction: Array, data: PointData, codes: Codes | None = None
    ) -> Answers:
        """Evaluate the law at jumps and tractions (n, dim); ``codes`` fixes the statuses."""
        turn = data.turn
        moved = data.moved
        values = self.compiled.values
        found = self._evaluate(values, jump, traction, data)
        if turn is None or moved is None:
            return Answers(self.compiled, found)

        def turning(codes: Codes) -> Array:
            return self._by_given(jump, traction, data, codes, turn, moved)[0]

        return Answers(self.compiled, found, turning=turning)

    def _evaluate(
        self, values: PointValues, jump: Array, traction: Array, data: PointData
    ) -> Array:
        fields = [data.fields[name][:, None] for name in self.compiled.names]
        given = [data.n, data.gap[:, None], data.r[:, None], *fields]
        return self.compiled.evaluate(values, np.concatenate([jump, traction, *given], axis=1))

    def slopes(self, code: int, jump: Array, traction: Array, data: PointData) -> Array:
        """Return the derivatives of the border distances of a status, shape (n, borders, 2 dim).

        Args:
            code: status code.
            jump: jumps, shape (n, dim); derivatives with respect to the jump come first.
            traction: tractions, shape (n, dim).
            data: data of the points.
        """
        slopes, places = self.compiled.slopes
        values = self._evaluate(slopes, jump, traction, data)
        mine = values[:, places[self.compiled.rows[code]]]
        return mine.reshape(self.number, len(mine.T) // (2 * self.dim), 2 * self.dim)

    def rate(
        self,
        jump: Array,
        traction: Array,
        data: PointData,
        rates: PointData,
        codes: Codes,
        moved: Array | None = None,
    ) -> Array:
        """Return the rate of the answer (n, dim) at fixed tractions, for given rates of the data.

        Args:
            jump: jumps, shape (n, dim).
            traction: tractions, shape (n, dim).
            data: data of the points.
            rates: rates of normals, gaps and fields; the rate of r is ignored.
            codes: status codes, shape (n,).
            moved: rates of the jumps, shape (n, dim); default: None (constant jumps).
        """
        normal = rates.n[:, :, None]
        # A gap acts like a negative jump along the normal.
        by = -rates.gap[:, None] * data.n
        by = (by if moved is None else by + moved)[:, :, None]
        rate, by_field = self._by_given(jump, traction, data, codes, normal, by)
        for name, slope in by_field.items():
            if name in rates.fields:  # fields in memory are constant
                rate[:, :, 0] += slope * rates.fields[name][:, None]
        return rate[:, :, 0]

    def _by_given(
        self,
        jump: Array,
        traction: Array,
        data: PointData,
        codes: Codes,
        normal: Array,
        moved: Array,
    ) -> tuple[Array, dict[str, Array]]:
        """Return the derivatives of the answers with respect to k parameters and each field.

        Args:
            jump: jumps, shape (n, dim).
            traction: tractions, shape (n, dim).
            data: data of the points.
            codes: status codes, shape (n,).
            normal: derivatives of the normals with respect to the parameters, shape (n, dim, k).
            moved: derivatives of the jumps with respect to the parameters, shape (n, dim, k).

        Returns:
            Derivatives with respect to the parameters, shape (n, dim, k), and to each field, by
            name, shape (n, dim).
        """
        compiled, by_normal, by_field = self.compiled.sensitivities
        values = self._evaluate(compiled, jump, traction, data)
        mine = np.arange(len(codes))
        d = self.dim

        def chosen(places: list[list[int]], *shape: int) -> Array:
            every = np.stack([values[:, k] for k in places], axis=1)
            return every[mine, self.compiled.rows[codes]].reshape(-1, *shape)

        held = self(jump, traction, replace(data, turn=None), codes).by_jump(codes)
        found = chosen(by_normal, d, d) @ normal + held @ moved
        names = zip(self.compiled.names, by_field, strict=True)
        return found, {name: chosen(places, d) for name, places in names}


def _columns(flat: ScalarList, piece: StatusPiece) -> list[tuple[int, int | None, int]]:
    """Return the columns of distance and condition and the target of each border of a status."""
    found = []
    for border in piece.borders:
        where = None if border.where is None else flat.add(_number(border.where))[0]
        found.append((flat.add(border.distance)[0], where, border.target))
    return found


def _number(condition: Any) -> Any:
    return ufl.conditional(condition, 1.0, 0.0)
