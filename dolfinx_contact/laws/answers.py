# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a law answers at contact points, for every status, and what is given there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from dolfinx_contact.laws.status import DAMAGING

__all__ = ["Answers", "Borders", "Columns", "HeldAnswers", "PointData", "Spreading"]

Array = npt.NDArray[np.float64]
Codes = npt.NDArray[np.int8]
_ABSENT = -np.finfo(np.float64).max  # distance to the borders of a status that a point cannot have


class Columns(Protocol):
    """Which columns of the values of a compiled law are what; see `compiled.CompiledLaw`."""

    dim: int
    codes: tuple[int, ...]
    rows: npt.NDArray[np.int64]
    places: dict[str, list[list[int]]]
    borders: list[list[tuple[int, int | None, int]]]
    exists: list[int | None]


@dataclass(frozen=True)
class PointData:
    """What a law is given at n points beside jump and traction.

    Attributes:
        n: normals (n, dim).
        gap: initial gaps (n,).
        r: augmentation parameters (n,).
        fields: of the law, by name (n,).
        turn: derivatives of the normals by the displacement of the points (n, dim, dim); None where
            they stay.
        moved: derivatives of the jump by the displacement (n, dim, dim), where normals turn; None
            where the jump moves as the points do.
    """

    n: Array
    gap: Array
    r: Array
    fields: Mapping[str, Array]
    turn: Array | None = None
    moved: Array | None = None


@dataclass(frozen=True)
class Borders:
    """Borders of the statuses of points, (n, borders).

    Attributes:
        distance: tractions, positive inside; infinite where there is no such border.
        target: statuses beyond.
    """

    distance: Array
    target: Codes


class Spreading(Protocol):
    """How what points spread comes to those around them, of a law that is not local.

    Attributes:
        by_jump, by_traction: derivatives of what each point spreads (n, dim).
    """

    by_jump: Array
    by_traction: Array

    def __call__(self, values: Array) -> Array:
        """N times values (n,) at the points of this rank. Collective."""


class Answers:
    """The answers of a law to jumps and tractions at n points, for every status.

    Args:
        law: compiled.
        values: of its compiled expressions.
        spreading: of a law that is not local.
        turning: derivatives of the traction by the displacement of the points (n, dim, dim), which
            jumps and normals follow, by statuses; None where the jump is all that moves.

    Attributes:
        spreading: as given; None if the law sees its point alone.
    """

    def __init__(
        self,
        law: Columns,
        values: Array,
        spreading: Spreading | None = None,
        turning: Callable[[Codes], Array] | None = None,
    ):
        self._law = law
        self._values = values
        self.spreading = spreading
        self._turning = turning
        self._known: dict[int, tuple[Array, npt.NDArray[np.bool_], list[int]]] = {}

    def _of(self, codes: Codes, what: str, shape: tuple[int, ...]) -> Array:
        columns = np.array(self._law.places[what])[self._law.rows[codes]]
        return self._values[np.arange(len(codes))[:, None], columns].reshape(-1, *shape)

    @cached_property
    def required(self) -> Codes:
        """Statuses that jumps and tractions determine (n,)."""
        return self._nearest[0]

    @property
    def missed(self) -> Array:
        """By how much no status of the law holds the points, a traction (n,); 0 where one does."""
        return np.maximum(-self._nearest[1], 0.0)

    @cached_property
    def _nearest(self) -> tuple[Codes, Array]:
        """Statuses, and the distance to the nearest of their borders."""
        least = np.empty((len(self._values), len(self._law.codes)))
        for i, code in enumerate(self._law.codes):
            distance, exists, _ = self._borders(code)
            nearest = distance.min(axis=1, initial=np.inf)
            least[:, i] = np.where(exists, nearest, _ABSENT)
        least[np.isnan(least)] = -np.inf  # below what is absent
        # The first whose borders all are beyond; where there is none the one that is nearest.
        beyond = least >= 0
        first = np.where(beyond.any(axis=1), beyond.argmax(axis=1), least.argmax(axis=1))
        worst = least[np.arange(len(least)), first]
        return np.array(self._law.codes, dtype=np.int8)[first], worst

    def _borders(self, code: int) -> tuple[Array, npt.NDArray[np.bool_], list[int]]:
        """Distances to the borders of a status, whether points can have it, and what is beyond."""
        if code not in self._known:
            self._known[code] = self._found_borders(code)
        return self._known[code]

    def _found_borders(self, code: int) -> tuple[Array, npt.NDArray[np.bool_], list[int]]:
        law = self._law
        row = law.rows[code]
        columns = law.borders[row]
        distance = self._values[:, [c for c, _, _ in columns]]
        for i, (_, w, _) in enumerate(columns):
            if w is not None:
                distance[~(self._values[:, w] > 0), i] = np.inf
        place = law.exists[row]
        exists = np.ones(len(distance), bool) if place is None else self._values[:, place] > 0
        return distance, exists, [target for _, _, target in columns]

    def borders(self, codes: Codes) -> Borders:
        """Distances of the points to the borders of the statuses ``codes``."""
        width = max(len(columns) for columns in self._law.borders)
        distance = np.full((len(codes), width), np.inf)
        target = np.zeros((len(codes), width), dtype=np.int8)
        for code in self._law.codes:
            mine = codes == code
            if mine.any():
                found, _, targets = self._borders(code)
                distance[mine, : len(targets)] = found[mine]
                target[mine, : len(targets)] = targets
        return Borders(distance, target)

    def may_be(self, code: int) -> npt.NDArray[np.bool_]:
        """Which points can have a status (n,)."""
        if code not in self._law.codes:
            return np.zeros(len(self._values), dtype=bool)
        return self._borders(code)[1]

    def holds(self, codes: Codes) -> npt.NDArray[np.bool_]:
        """Which points have statuses whose borders are all beyond (n,)."""
        can = np.zeros(len(self._values), dtype=bool)
        for code in np.unique(codes):
            mine = codes == code
            can[mine] = self.may_be(int(code))[mine]
        return can & (np.min(self.borders(codes).distance, axis=1, initial=np.inf) >= 0)

    def every_distance(self, code: int) -> Array:
        """Distances to all borders of a status (n, borders), also where there are none."""
        return self._values[:, [c for c, _, _ in self._law.borders[self._law.rows[code]]]]

    def exists(self) -> npt.NDArray[np.bool_]:
        """Which statuses the points can have (n, statuses), in the order of `CompiledLaw.codes`."""
        return np.stack([self._borders(code)[1] for code in self._law.codes], axis=1)

    def traction(self, codes: Codes) -> Array:
        """The traction tau that the law answers (n, dim)."""
        return self._of(codes, "answer", (self._law.dim,))

    def by_jump(self, codes: Codes) -> Array:
        """Derivatives D_j of tau by the jump (n, dim, dim).

        Where normals turn, by the displacement that jump and normal follow.
        """
        if self._turning is not None:
            return self._turning(codes)
        return self._of(codes, "by_jump", (self._law.dim, self._law.dim))

    def by_traction(self, codes: Codes) -> Array:
        """Derivatives D_t of tau by the traction (n, dim, dim)."""
        return self._of(codes, "by_traction", (self._law.dim, self._law.dim))

    def by_around(self, codes: Codes) -> Array:
        """Derivatives D_s of tau by what the points around spread (n, dim)."""
        return self._of(codes, "by_around", (self._law.dim,))

    @property
    def pressure(self) -> tuple[Array, Array, Array]:
        """Of a law that is not local (n,), with its derivatives by jump and traction (n, dim)."""
        q, by_jump, by_traction = (self._values[:, k] for k in self._law.places["pressure"])
        return q[:, 0], by_jump, by_traction

    def bond(self, name: str) -> Array:
        """The parts of `law.Bond`: "traction" (n, dim); (n,) "stored", "broken", "after.NAME"..."""
        found = np.asarray(self._values[:, self._law.places[f"bond.{name}"][0]])
        return found if name == "traction" else found[:, 0]

    @property
    def bound(self) -> Array:
        """Radii of the friction disc at the pressure of the law (n,); NaN if the law has none."""
        return self._column("bound")

    @property
    def unit_bound(self) -> Array:
        """Radii of the friction disc at unit pressure (n,); NaN if the law has none."""
        return self._column("unit_bound")

    def _column(self, name: str) -> Array:
        places = self._law.places[name]
        return self._values[:, places[0][0]] if places else np.full(len(self._values), np.nan)


class HeldAnswers(Answers):
    """The answers of a law whose bonds are held as they are: none of its points is damaging.

    Args:
        answers: of the law.
    """

    def __init__(self, answers: Answers):
        super().__init__(answers._law, answers._values, answers.spreading, answers._turning)

    def _found_borders(self, code: int) -> tuple[Array, npt.NDArray[np.bool_], list[int]]:
        distance, exists, targets = super()._found_borders(code)
        if code >= DAMAGING:
            return distance, np.zeros_like(exists), targets
        changes = np.array(targets, dtype=np.int64) >= DAMAGING
        return np.where(changes, np.inf, distance), exists, targets
