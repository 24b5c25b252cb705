# SPDX-License-Identifier: LGPL-3.0-or-later
"""Charts: how many solutions a contact problem has, over two parameters, cell by cell.

In the middle of a cell all solutions are looked for, with a proof that there are no others
(`solutions`). Cells that curves of folds pass are divided, and those beside which the number is
another where no curve is known to pass. What is proved holds in the middles: that nothing changes
within a cell is not.
"""

from __future__ import annotations

import json
import os
import time
import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact._files import part_of
from dolfinx_contact._mpi import Arguments, collective, everywhere
from dolfinx_contact._progress import Line
from dolfinx_contact._validate import count, flag, is_number, one_of, positive
from dolfinx_contact.analysis.event_curves import EventCurve, EventCurves
from dolfinx_contact.analysis.family import ContactFamily
from dolfinx_contact.continuation.arguments import checked_range
from dolfinx_contact.laws import status
from dolfinx_contact.proofs.solutions import prove_solutions

__all__ = ["Chart", "ChartCell", "ChartCurve", "count_solutions"]

Array = npt.NDArray[np.float64]
T = TypeVar("T", "ChartCell", "ChartCurve")

_PATIENCE = 3.0  # seconds before progress is shown
_LETTERS = status.word([status.OPEN, status.STICK, status.PLUS, status.MINUS])
_KIND = "a chart of solutions"
_FORMAT = 2
_STEPS = 32  # of a curve, between two points at which its statuses change


@dataclass(frozen=True)
class ChartCell:
    """A cell of a chart.

    Attributes:
        mu: its ends.
        gamma: its ends.
        solutions: statuses of those found in the middle, letters of the points, sorted.
        proved: whether it is proved that there are no others; not where slips of one are beyond
            small sliding (`ContactFamily.reach`).

    Raises:
        ValueError: for ends that are not two finite numbers in order, solutions that are not
            letters of statuses of as many points each, or ``proved`` that is no truth value.
    """

    mu: tuple[float, float]
    gamma: tuple[float, float]
    solutions: tuple[str, ...]
    proved: bool

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "mu", _ends("mu", self.mu))
        put(self, "gamma", _ends("gamma", self.gamma))
        found = self.solutions
        if isinstance(found, str) or not all(isinstance(s, str) for s in found):
            raise ValueError(f"solutions must be a sequence of str, got {found!r}")
        if not set().union(*found) <= set(_LETTERS) or len({len(s) for s in found}) > 1:
            raise ValueError(f"solutions must be letters of {_LETTERS!r}, a point each: {found!r}")
        put(self, "solutions", tuple(found))
        flag(self.proved, "proved")
        put(self, "proved", bool(self.proved))

    @property
    def middle(self) -> tuple[float, float]:
        """(mu, gamma) for which the solutions are known."""
        return (self.mu[0] + self.mu[1]) / 2, (self.gamma[0] + self.gamma[1]) / 2

    @property
    def count(self) -> int:
        """Number of solutions in the middle; if it is not proved, at least so many."""
        return len(self.solutions)

    def outline(self) -> tuple[Array, Array, Array]:
        """Values of mu (2,), and the least and the largest gamma there."""
        low, high = self.gamma
        return np.array(self.mu), np.full(2, low), np.full(2, high)


@dataclass(frozen=True)
class ChartCurve:
    """A curve of folds or events in a chart, by points of it.

    Attributes:
        kind: ``"fold"`` where gamma turns back, ``"event"`` where it continues.
        points: (mu, gamma), at least two, mu rising.

    Raises:
        ValueError: for another kind, or points that are not finite or not in order.
    """

    kind: str
    points: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        one_of(self.kind, "the kind of a curve", ("fold", "event"))
        try:
            points = np.array(self.points, dtype=float)
        except (TypeError, ValueError) as error:
            raise ValueError(f"points of a curve must be pairs of numbers: {error}") from None
        if points.ndim != 2 or points.shape[1:] != (2,) or len(points) < 2:
            raise ValueError(f"points of a curve must be two pairs or more, got {self.points!r}")
        if not np.isfinite(points).all() or not (np.diff(points[:, 0]) >= 0).all():
            raise ValueError("points of a curve must be finite, and mu must not fall along it")
        pairs = tuple((float(mu), float(gamma)) for mu, gamma in points)
        object.__setattr__(self, "points", pairs)

    @classmethod
    def of(cls, curve: EventCurve) -> ChartCurve:
        """Points of a curve, which lie on it to round-off."""
        points = curve.points(_STEPS)
        # At its own end a curve may have no gamma.
        known = points[np.isfinite(points).all(axis=1)]
        return cls(curve.kind, tuple((float(mu), float(gamma)) for mu, gamma in known))


@dataclass(frozen=True, eq=False)
class Chart:
    """Numbers of solutions over two parameters.

    Attributes:
        cells: that fill the ranges, without overlap, by mu and gamma.
        curves: along whose folds cells were divided.
    """

    cells: tuple[ChartCell, ...]
    curves: tuple[ChartCurve, ...] = ()

    @property
    def proved(self) -> bool:
        """Whether all numbers are proved."""
        return all(c.proved for c in self.cells)

    def at(self, mu: float, gamma: float) -> ChartCell:
        """The cell that holds (mu, gamma).

        Raises:
            ValueError: outside of the chart.
        """
        for c in self.cells:
            if c.mu[0] <= mu <= c.mu[1] and c.gamma[0] <= gamma <= c.gamma[1]:
                return c
        raise ValueError(f"({mu:g}, {gamma:g}) is outside of the chart")

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
        """Write it to a file, from which `load` reads it to the last bit; on this rank alone.

        Every rank has the same chart: one of several writes it. The file is JSON, with a check sum.

        Args:
            path: of the file, in a folder that exists.
            overwrite: whether a file that exists is replaced, whatever it is.

        Returns:
            The path.

        Raises:
            FileExistsError: if there is such a file, and it is not to be replaced.
            OSError: if it cannot be written; a file of before is then as it was.
        """
        file = Path(path)
        if file.exists() and not overwrite:
            raise FileExistsError(f"{file} exists: save with overwrite=True, or to another file")
        content = {
            "cells": [asdict(cell) for cell in self.cells],
            "curves": [asdict(curve) for curve in self.curves],
        }
        words = {"of": _KIND, "format": _FORMAT, "crc": _check_sum(content), **content}
        with part_of(file) as part:
            part.write_text(json.dumps(words))
        return file

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Chart:
        """Read a chart that `save` wrote; on this rank alone.

        Raises:
            OSError: if the file cannot be read.
            ValueError: if it is no chart, one of another version, or damaged.
        """
        try:
            words = json.loads(Path(path).read_bytes())
        except ValueError as error:
            raise ValueError(f"{path} is no chart, or is damaged: {error}") from None
        if not isinstance(words, dict) or words.get("of") != _KIND:
            raise ValueError(f"{path} is no chart")
        if words.get("format") != _FORMAT:
            raise ValueError(f"{path} has the format {words.get('format')}, known is {_FORMAT}")
        content = {name: words.get(name, []) for name in ("cells", "curves")}
        if words.get("crc") != _check_sum(content):
            raise ValueError(f"{path} is damaged: its check sum is wrong")
        try:
            cells = tuple(_made(ChartCell, "a cell", cell) for cell in content["cells"])
            curves = tuple(_made(ChartCurve, "a curve", curve) for curve in content["curves"])
            return Chart(cells, curves)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path} is no chart: {error}") from None


def _check_sum(content: dict[str, Any]) -> str:
    """CRC-32 of the cells as a file has them."""
    return f"{zlib.crc32(json.dumps(content, sort_keys=True).encode()):08x}"


def _ends(name: str, values: Any) -> tuple[float, float]:
    """Two finite numbers in order, or ``ValueError``."""
    if not isinstance(values, list | tuple) or len(values) != 2 or not all(map(is_number, values)):
        raise ValueError(f"{name} must be two numbers, got {values!r}")
    low, high = map(float, values)
    if not -np.inf < low <= high < np.inf:
        raise ValueError(f"{name} must be finite and in order, got {values!r}")
    return low, high


def _made(kind: type[T], what: str, content: Any) -> T:
    """A part of a chart, as a file has it, or ``ValueError``."""
    names = [f.name for f in fields(kind)]
    if not isinstance(content, dict) or sorted(content) != sorted(names):
        raise ValueError(f"{what} has {', '.join(names)}, not {content!r}")
    return kind(**content)


def _check(a: Arguments) -> None:
    a.mu_range = checked_range(a.mu_range, [], "mu")
    a.gamma_range = checked_range(a.gamma_range, [])
    a.cells = tuple(a.cells)
    if len(a.cells) != 2:
        raise ValueError(f"cells must be two whole numbers, got {a.cells!r}")
    for cells in a.cells:
        count(cells, "cells")
    count(a.depth, "depth", least=0)
    positive(a.proof_seconds, "proof_seconds", infinite=True)


@collective("a chart", _check)
def count_solutions(
    family: ContactFamily,
    *,
    mu_range: tuple[float, float],
    gamma_range: tuple[float, float],
    cells: tuple[int, int] = (6, 6),
    depth: int = 2,
    curves: EventCurves | None = None,
    proof_seconds: float = 20.0,
) -> Chart:
    """Count the solutions over two parameters, in cells that are the finer the closer to borders.

    Collective; ranks share the cells.

    Args:
        family: the problem with two parameters, the same on all ranks of its communicator.
        mu_range: least and largest mu.
        gamma_range: least and largest gamma.
        cells: numbers of cells to begin with, by mu and by gamma.
        depth: how often cells are divided by two.
        curves: along whose folds cells are divided as well; the chart keeps them.
        proof_seconds: for the proof in a cell.

    Raises:
        ValueError: on every rank, if an argument does not fit or differs between ranks.
    """
    return _Counting(family, (mu_range, gamma_range), cells, depth, proof_seconds).run(curves)


@dataclass(frozen=True)
class _Leaf:
    """A cell by the finest ones: where these begin, how many they are along an edge, and what is
    known of it: the statuses of solutions, and whether these are all.
    """

    i: int
    j: int
    size: int
    codes: tuple[bytes, ...] = ()
    proved: bool = False

    def parts(self) -> list[_Leaf]:
        """The four cells into which this one is divided, and that know what it knows."""
        half = self.size // 2
        return [
            _Leaf(self.i + a * half, self.j + b * half, half, self.codes)
            for a in (0, 1)
            for b in (0, 1)
        ]

    def place(self, more: int = 0) -> tuple[slice, slice]:
        """The finest cells, and ``more`` on every side."""
        i, j = (slice(max(k - more, 0), k + self.size + more) for k in (self.i, self.j))
        return i, j


class _Counting:
    def __init__(
        self,
        family: ContactFamily,
        ranges: tuple[tuple[float, float], tuple[float, float]],
        cells: tuple[int, int],
        depth: int,
        proof_seconds: float,
    ):
        self.comm = family.comm
        self.family = family
        self.ranges = ranges
        self.proof_seconds = proof_seconds
        self.cells = cells
        self.depth = depth
        #: Of the finest cells, the solutions of the cell that they are in, by number.
        self.raster: npt.NDArray[np.int64] = np.zeros([n * 2**depth for n in cells], dtype=int)
        self.found: list[_Leaf] = []
        self._line = Line(family.comm)
        self._begun = time.monotonic()

    def run(self, curves: EventCurves | None) -> Chart:
        """Count, and divide what is at a border."""
        size = 2**self.depth
        across, along = self.cells
        whole = [_Leaf(i * size, j * size, size) for i in range(across) for j in range(along)]
        self._count(whole)
        passed = self._passed(curves)
        while size > 1:
            divided = self._at_border([leaf for leaf in self.found if leaf.size == size], passed)
            self.found = [leaf for leaf in self.found if leaf not in divided]
            self._count([part for leaf in divided for part in leaf.parts()])
            size //= 2
        self.found.sort(key=lambda leaf: (leaf.i, leaf.j))
        kept = () if curves is None else tuple(map(ChartCurve.of, curves.curves))
        return Chart(tuple(self._cell(leaf) for leaf in self.found), kept)

    def _count(self, leaves: Sequence[_Leaf]) -> None:
        """Count the solutions in new cells, from what these know."""
        mine = []
        with everywhere(self.comm, "a chart"):
            for number in range(self.comm.rank, len(leaves), self.comm.size):
                if time.monotonic() - self._begun > _PATIENCE:
                    self._line.update(f"solutions in cells: {number + 1} of {len(leaves)}")
                leaf = leaves[number]
                mu, gamma = ((a + b) / 2 for a, b in self._ends(leaf))
                starts = [np.frombuffer(codes, dtype=np.int8) for codes in leaf.codes]
                problem = self.family.problem(mu, gamma)
                proof = prove_solutions(
                    problem, known=starts, proof_seconds=self.proof_seconds, progress=False
                )
                codes = tuple(sorted(s.codes.tobytes() for s in proof.solutions))
                small = self.family.are_small(s.state[:, 0] for s in proof.solutions)
                proved = proof.verdict == "complete" and small
                mine.append(replace(leaf, codes=codes, proved=proved))
        self._line.clear()
        for part in self.comm.allgather(mine):
            for leaf in part:
                self.found.append(leaf)
                self.raster[leaf.place()] = len(leaf.codes)

    def _ends(self, leaf: _Leaf) -> list[tuple[float, float]]:
        """Ends of a cell, of mu and of gamma."""
        found = []
        places = (leaf.i, leaf.j)
        for first, (low, high), number in zip(places, self.ranges, self.raster.shape, strict=True):
            step = (high - low) / number
            found.append((low + first * step, low + (first + leaf.size) * step))
        return found

    def _cell(self, leaf: _Leaf) -> ChartCell:
        mu, gamma = self._ends(leaf)
        words = (status.word(np.frombuffer(s, np.int8)) for s in leaf.codes)
        return ChartCell(mu, gamma, tuple(sorted(words)), leaf.proved)

    def _at_border(self, level: Sequence[_Leaf], passed: npt.NDArray[np.bool_]) -> list[_Leaf]:
        """Those cells that folds pass, and those whose number changes without a known fold."""
        found = [leaf for leaf in level if passed[leaf.place()].any()]
        explained = np.zeros_like(passed)
        for leaf in found:
            explained[leaf.place()] = True
        for leaf in level:
            other = self.raster[leaf.place(1)] != len(leaf.codes)
            if leaf not in found and (other & ~explained[leaf.place(1)]).any():
                found.append(leaf)
        return found

    def _passed(self, curves: EventCurves | None) -> npt.NDArray[np.bool_]:
        """Which of the finest cells curves of folds pass."""
        passed = np.zeros(self.raster.shape, dtype=bool)
        (low, high), (least, most) = self.ranges
        across = np.linspace(low, high, 8 * self.raster.shape[0] + 1)
        for number, mu in enumerate(float(mu) for mu in across):
            i = min(number // 8, len(passed) - 1)
            for gamma in curves.folds_at(mu) if curves is not None else ():
                j = int((gamma - least) / (most - least) * self.raster.shape[1])
                if 0 <= j < self.raster.shape[1]:
                    passed[i, j] = True
        return passed
