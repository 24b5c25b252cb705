# SPDX-License-Identifier: LGPL-3.0-or-later
"""Evaluated laws: required tractions, derivatives and borders at contact points, by status."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from mpi4py import MPI

import numpy as np

from dolfinx_contact._arrays import Array, Codes, Mask
from dolfinx_contact._forms import PointValues
from dolfinx_contact.laws.compiled import CompiledLaw, compiled_law
from dolfinx_contact.laws.law import Law
from dolfinx_contact.laws.status import DAMAGING

__all__ = ["Answers", "Borders", "FrozenBonds", "LawAtPoints", "PointData", "Spreading"]

_ABSENT = -np.finfo(np.float64).max  # distance for a status that does not exist


@dataclass(frozen=True)
class PointData:
    """Data of a law at n points, other than jump and traction.

    Attributes:
        n: unit normals, shape (n, dim).
        gap: initial gaps, shape (n,).
        r: augmentation parameters, shape (n,).
        fields: values of the fields of the law by name, shape (n,) each.
        turn: derivatives of the normals with respect to the displacement of the points, shape (n,
            dim, dim); None if normals do not depend on it.
        moved: derivatives of the jump with respect to the displacement, shape (n, dim, dim); None
            if the jump equals the displacement. It is used if normals depend on the displacement.
    """

    n: Array
    gap: Array
    r: Array
    fields: Mapping[str, Array]
    turn: Array | None = None
    moved: Array | None = None


@dataclass(frozen=True)
class Borders:
    """Borders of the present statuses of n points, in terms of jump and traction.

    Attributes:
        distance: distances of the points to the borders, in units of traction, positive inside the
            status, shape (n, borders); infinite without a border.
        target: status codes beyond the borders, shape (n, borders).
    """

    distance: Array
    target: Codes


@dataclass(frozen=True)
class Spreading:
    """Average of the pressure over neighbouring points, for a nonlocal law.

    Attributes:
        average: function that maps values at the n points of this rank to averages, shape (n,).
            Collective.
        around: averaged pressures, shape (n,).
        by_jump, by_traction: derivatives of the pressure of each point, before averaging, with
            respect to its jump and its traction, shape (n, dim) each.
    """

    average: Callable[[Array], Array]
    around: Array
    by_jump: Array
    by_traction: Array


class Answers:
    """Tractions tau(j, t) that a law requires at n points, for every status.

    A state with the jumps j and the tractions t satisfies the law if t = tau(j, t) (`laws.law`).

    Args:
        law: compiled law that is evaluated.
        values: values of its compiled expressions.
        spreading: averaging of a nonlocal law; default: None (local law).
        turning: function mapping statuses to the derivatives of the required traction with respect
            to the displacement, shape (n, dim, dim), including changes of jumps and normals;
            default: None (fixed normals).

    Attributes:
        spreading: averaging; None for a local law.
    """

    def __init__(
        self,
        law: CompiledLaw,
        values: Array,
        spreading: Spreading | None = None,
        turning: Callable[[Codes], Array] | None = None,
    ):
        self._law = law
        self._values = values
        self.spreading = spreading
        self._turning = turning

    def _of(self, codes: Codes, what: str, shape: tuple[int, ...]) -> Array:
        columns = np.array(self._law.places[what])[self._law.rows[codes]]
        return self._values[np.arange(len(codes))[:, None], columns].reshape(-1, *shape)

    @cached_property
    def _table(self) -> tuple[Array, Codes, Mask]:
        """Borders of every status: distances, target statuses, and mask of existing statuses.

        For n points, the shapes are (n, statuses, borders), (statuses, borders) and (n, statuses).
        Distances are infinite where a status has fewer borders.
        """
        law = self._law
        shape = len(law.codes), max(map(len, law.borders))
        distance = np.full((len(self._values), *shape), np.inf)
        target = np.zeros(shape, dtype=np.int8)
        exists = np.ones((len(self._values), len(law.codes)), dtype=bool)
        for i, (columns, place) in enumerate(zip(law.borders, law.exists, strict=True)):
            for k, (column, where, beyond) in enumerate(columns):
                acts = True if where is None else self._values[:, where] > 0
                distance[:, i, k] = np.where(acts, self._values[:, column], np.inf)
                target[i, k] = beyond
            if place is not None:
                exists[:, i] = self._values[:, place] > 0
        return distance, target, exists

    @cached_property
    def required(self) -> Codes:
        """Admissible status of each of n points, or nearest one if none is, shape (n,)."""
        return self._nearest[0]

    @property
    def missed(self) -> Array:
        """Distance of each of n points to its nearest admissible status, shape (n,).

        It has the unit of a traction, and is 0 at points with an admissible status.
        """
        return np.maximum(-self._nearest[1], 0.0)

    @cached_property
    def _nearest(self) -> tuple[Codes, Array]:
        """Admissible or nearest status of each point, and distance to its nearest border."""
        distance, _, exists = self._table
        least = distance.min(axis=2, initial=np.inf)
        # A status with a distance of NaN counts as absent.
        least = np.where(exists & ~np.isnan(least), least, _ABSENT)
        # Choose the first status within all of its borders, otherwise the nearest one. If all are
        # absent, argmax is 0: the first status, with a distance that `missed` reports.
        beyond = least >= 0
        first = np.where(beyond.any(axis=1), beyond.argmax(axis=1), least.argmax(axis=1))
        worst = least[np.arange(len(least)), first]
        return np.array(self._law.codes, dtype=np.int8)[first], worst

    def borders(self, codes: Codes) -> Borders:
        """Return the borders of the given status of each point, with the distances to them."""
        rows = self._law.rows[codes]
        distance, target, _ = self._table
        return Borders(distance[np.arange(len(codes)), rows], target[rows])

    def may_be(self, code: int) -> Mask:
        """Return the mask of the points at which the status ``code`` exists, shape (n,)."""
        if code not in self._law.codes:
            return np.zeros(len(self._values), dtype=bool)
        return self._table[2][:, self._law.rows[code]]

    def holds(self, codes: Codes) -> Mask:
        """Return the mask of the points at which the given status is admissible, shape (n,)."""
        can = self._table[2][np.arange(len(codes)), self._law.rows[codes]]
        return can & (np.min(self.borders(codes).distance, axis=1, initial=np.inf) >= 0)

    def every_distance(self, code: int) -> Array:
        """Return distances to all borders of a status, also absent ones, shape (n, borders)."""
        return self._values[:, [c for c, _, _ in self._law.borders[self._law.rows[code]]]]

    @property
    def exists(self) -> Mask:
        """Mask of the statuses that exist at each point, shape (n, statuses).

        Statuses are in the order of `LawAtPoints.codes`.
        """
        return self._table[2]

    def traction(self, codes: Codes) -> Array:
        """Return the traction that the law requires for given statuses, shape (n, dim)."""
        return self._of(codes, "answer", (self._law.dim,))

    def by_jump(self, codes: Codes) -> Array:
        """Return the derivatives of the required traction with respect to the jump.

        The shape is (n, dim, dim) for n points. If normals depend on the displacement, these are
        derivatives with respect to the displacement, including the changes of jump and normal.
        """
        if self._turning is not None:
            return self._turning(codes)
        return self._of(codes, "by_jump", (self._law.dim, self._law.dim))

    def by_traction(self, codes: Codes) -> Array:
        """Return derivatives of required with respect to given tractions, shape (n, dim, dim)."""
        return self._of(codes, "by_traction", (self._law.dim, self._law.dim))

    def by_around(self, codes: Codes) -> Array:
        """Return the derivatives of tau with respect to the averaged pressure, shape (n, dim)."""
        return self._of(codes, "by_around", (self._law.dim,))

    @property
    def pressure(self) -> tuple[Array, Array, Array]:
        """Pressure that a nonlocal law averages, and its derivatives, at n points.

        The derivatives are with respect to jump and traction. Shapes: (n,), (n, dim), (n, dim).
        """
        q, by_jump, by_traction = (self._values[:, k] for k in self._law.places["pressure"])
        return q[:, 0], by_jump, by_traction

    def bond(self, name: str) -> Array:
        """Return an attribute of `Bond` at each of the n points; the first axis has length n.

        Args:
            name: name of the attribute, such as ``"traction"``, or ``"after.NAME"`` for the new
                value of an internal variable.
        """
        found = np.asarray(self._values[:, self._law.places[f"bond.{name}"][0]])
        return found if name == "traction" else found[:, 0]

    @property
    def bound(self) -> Array:
        """Radius of the friction disc at each point, shape (n,); NaN if the law has no disc."""
        return self._column("bound")

    @property
    def unit_bound(self) -> Array:
        """Radius of the friction disc at unit pressure, shape (n,); NaN if the law has no disc."""
        return self._column("unit_bound")

    def _column(self, name: str) -> Array:
        places = self._law.places[name]
        return self._values[:, places[0][0]] if places else np.full(len(self._values), np.nan)


class FrozenBonds(Answers):
    """Tractions that a law, evaluated in ``answers``, requires if no bond is being damaged."""

    def __init__(self, answers: Answers):
        super().__init__(answers._law, answers._values, answers.spreading, answers._turning)

    @cached_property
    def _table(self) -> tuple[Array, Codes, Mask]:
        distance, target, exists = super()._table
        damaging = np.array(self._law.codes) >= DAMAGING
        distance[:, ~damaging[:, None] & (target >= DAMAGING)] = np.inf
        return distance, target, exists & ~damaging


class LawAtPoints:
    """Contact law at the contact points of this rank. Only construction is collective.

    Args:
        law: law; its field values are passed with the data of the points.
        dim: dimension, 2 or 3.
        number: number of points.
        comm: communicator of the ranks that compile the law together.

    Attributes:
        codes: status codes of the law; the first admissible one applies.
    """

    def __init__(self, law: Law, dim: int, number: int, comm: MPI.Comm):
        self.law = law
        self.dim = dim
        self.number = number
        self.compiled = compiled_law(law, dim, comm)
        self.codes = self.compiled.codes

    def __call__(
        self, jump: Array, traction: Array, data: PointData, codes: Codes | None = None
    ) -> Answers:
        """Evaluate the law at jumps and tractions of n points, shape (n, dim) each.

        A nonlocal law averages over the points that are closed in the statuses ``codes``; default:
        required statuses.
        """
        turn, moved = data.turn, data.moved
        found = self._evaluate(self.compiled.values, jump, traction, data)
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
        """Return the rate of the required tractions due to rates of the data, shape (n, dim).

        The tractions themselves are constant.

        Args:
            jump: jumps, shape (n, dim).
            traction: tractions, shape (n, dim).
            data: data of the n points.
            rates: rates of normals, gaps and fields; the rate of the augmentation is ignored.
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
        """Differentiate the required tractions with respect to k parameters and to each field.

        Args:
            jump: jumps, shape (n, dim).
            traction: tractions, shape (n, dim).
            data: data of the n points.
            codes: status codes, shape (n,).
            normal: derivatives of the normals with respect to the parameters, shape (n, dim, k).
            moved: derivatives of the jumps with respect to the parameters, shape (n, dim, k).

        Returns:
            Derivatives with respect to the parameters, shape (n, dim, k); and a dictionary of the
            derivatives with respect to each field, shape (n, dim).
        """
        compiled, by_normal, by_field = self.compiled.sensitivities
        values = self._evaluate(compiled, jump, traction, data)
        mine = np.arange(len(codes))
        d = self.dim

        def chosen(places: list[list[int]], *shape: int) -> Array:
            every = np.stack([values[:, k] for k in places], axis=1)
            return every[mine, self.compiled.rows[codes]].reshape(-1, *shape)

        by_jump = self(jump, traction, replace(data, turn=None), codes).by_jump(codes)
        found = chosen(by_normal, d, d) @ normal + by_jump @ moved
        names = zip(self.compiled.names, by_field, strict=True)
        return found, {name: chosen(places, d) for name, places in names}
