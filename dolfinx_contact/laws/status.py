# SPDX-License-Identifier: LGPL-3.0-or-later
"""The statuses of a contact point: one table of their numbers, letters, names and colours.

A status has three parts. A point is open or closed; friction holds it, lets it slip, or does not
act; a bond is unchanged, damages, or is broken. A prescribed friction bound (Tresca) acts on open
points too: their statuses are those of closed points plus `WHERE_OPEN`. Tables of results count
them as open.

Colours are those of Okabe and Ito, which most colour-blind readers tell apart.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = [
    "BROKEN",
    "COLOURS",
    "DAMAGING",
    "KINDS",
    "MINUS",
    "NAMES",
    "OPEN",
    "PLUS",
    "STICK",
    "WHERE_OPEN",
    "closed",
    "count",
    "letters",
    "senses",
    "without_damage",
    "word",
]

#: Without contact and friction; stick; slip with u_t > 0 (in 3D: slip); slip with u_t < 0.
OPEN, STICK, PLUS, MINUS = range(4)
#: Added to the number of a closed status: the same friction at an open point.
WHERE_OPEN = 3
#: Added to the number of any status: the bond is being damaged, or is broken.
DAMAGING = 8
BROKEN = 16

#: States of a bond: words appended to those of contact and friction.
_BONDS = {0: "", DAMAGING: ", damaging", BROKEN: ", broken"}


class _State(NamedTuple):
    """A row of the table: a state of contact and friction, and its looks with each state of a bond.

    Attributes:
        is_open: whether the point is open.
        friction: `OPEN` (no friction), stick, or slip.
        dims: dimensions in which the state exists. Slip in 3D has no sign and the number of `PLUS`.
        words: description.
        looks: letter and colour for each of `_BONDS`.
    """

    is_open: bool
    friction: int
    dims: tuple[int, ...]
    words: str
    looks: tuple[str, str, str]

    def number(self, bond: int) -> int:
        """Number of the status with a state of a bond."""
        acts = self.friction != OPEN
        return self.friction + (WHERE_OPEN if self.is_open and acts else 0) + bond


#: Contact x friction x bond. A closed point without friction has no separate row: it slips with the
#: bound zero and has the number of `PLUS`.
_TABLE = (
    _State(True, OPEN, (2, 3), "open", ("o #dfe4ea", "a #f0c9dd", "b #c3cbd3")),
    _State(False, STICK, (2, 3), "stick", ("k #0072B2", "q #CC79A7", "h #5b9bc4")),
    _State(False, PLUS, (2,), "slip, $u_t > 0$", ("+ #009E73", "r #8f5573", "x #58b799")),
    _State(False, MINUS, (2,), "slip, $u_t < 0$", ("- #E69F00", "l #b3688f", "y #edc15e")),
    _State(False, PLUS, (3,), "slip", ("s #E69F00", "c #b3688f", "z #58b799")),
    _State(True, STICK, (2, 3), "open, held by friction", ("K #56B4E9", "Q #e3b5cf", "H #a9c6d6")),
    _State(True, PLUS, (2,), "open, rubbing, $u_t > 0$", ("P #99d8c7", "R #e3b5cf", "X #a9c6d6")),
    _State(True, MINUS, (2,), "open, rubbing, $u_t < 0$", ("M #f5d999", "L #e3b5cf", "Y #a9c6d6")),
    _State(True, PLUS, (3,), "open, rubbing", ("S #f5d999", "C #e3b5cf", "Z #a9c6d6")),
)
_CLAMPED = "d"  # held by Dirichlet data


class _Row(NamedTuple):
    """A status: its number, letter, name, colour, and the kind that tables count it as."""

    number: int
    letter: str
    name: str
    colour: str
    kind: str


def _rows(dim: int) -> list[_Row]:
    """Return all statuses in 2D or 3D."""
    found = []
    for place, (bond, behind) in enumerate(_BONDS.items()):
        for doing in _TABLE:
            if dim not in doing.dims:
                continue
            letter, colour = doing.looks[place].split()
            kind = doing.words.partition(",")[0]
            name = doing.words + behind
            found.append(_Row(doing.number(bond), letter, name, colour, kind))
    return found


_ROWS = {dim: _rows(dim) for dim in (2, 3)}
_ALL = {row.letter: row for dim in (2, 3) for row in _ROWS[dim]}

#: Descriptions of the letters.
NAMES = {row.letter: row.name for row in _ALL.values()} | {_CLAMPED: "clamped"}
COLOURS = {row.letter: row.colour for row in _ALL.values()} | {_CLAMPED: "#555555"}
#: Letters of each kind that tables count.
KINDS = {
    kind: "".join(row.letter for row in _ALL.values() if row.kind == kind)
    for kind in ("open", "stick", "slip")
} | {"clamped": _CLAMPED}


def letters(dim: int) -> npt.NDArray[np.str_]:
    """Return letters by status number, with a blank for numbers without a status."""
    found = np.full(1 + max([row.number for row in _ROWS[dim]]), " ")
    for row in _ROWS[dim]:
        found[row.number] = row.letter
    return found


def word(codes: npt.ArrayLike, dim: int = 2) -> str:
    """Return the letters of points with statuses (m,) as one string."""
    return "".join(letters(dim)[np.asarray(codes, dtype=np.int64)])


def count(word: str) -> dict[str, int]:
    """Return the numbers of open, stuck, slipping and clamped points in a string of letters."""
    return {kind: sum(map(word.count, those)) for kind, those in KINDS.items()}


def closed(codes: npt.NDArray[np.int8]) -> npt.NDArray[np.bool_]:
    """Return which statuses are closed."""
    contact = codes % DAMAGING
    return np.asarray((contact > OPEN) & (contact <= WHERE_OPEN))


def senses(codes: npt.NDArray[np.int8]) -> npt.NDArray[np.int8]:
    """Return the state of friction at open and closed points: `OPEN` (none), stick or slip."""
    contact = codes % DAMAGING
    return np.where(contact > WHERE_OPEN, contact - WHERE_OPEN, contact).astype(np.int8)


def without_damage(codes: npt.NDArray[np.int8]) -> npt.NDArray[np.int8]:
    """Return the statuses without the state of the bond."""
    return np.asarray(codes % DAMAGING, dtype=np.int8)
