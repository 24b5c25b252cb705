# SPDX-License-Identifier: LGPL-3.0-or-later
"""The statuses of a contact point: one table of their numbers, letters, names and colours.

A point is open or closed, and friction holds it, lets it slip, or does not act. A friction bound
that is given in advance (Tresca) acts on open points too: these have statuses of their own, the
closed ones shifted by `WHERE_OPEN`. Tables of results call them open, as their gap is.

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
]

#: Without contact and friction; stick; slip with u_t > 0 (in 3D: slip); slip with u_t < 0.
OPEN, STICK, PLUS, MINUS = range(4)
#: Added to the number of a closed status: friction as there, at an open point.
WHERE_OPEN = 3
#: Added to the number of any status: the strength of a bond changes there, or has come to its end.
DAMAGING = 8
BROKEN = 16

#: What contact and friction do, in words.
_CONTACT = {
    OPEN: "open",
    STICK: "stick",
    PLUS: "slip, $u_t > 0$",
    MINUS: "slip, $u_t < 0$",
    STICK + WHERE_OPEN: "open, held by friction",
    PLUS + WHERE_OPEN: "open, rubbing, $u_t > 0$",
    MINUS + WHERE_OPEN: "open, rubbing, $u_t < 0$",
}
#: What a bond does, in words: nothing, or what stands behind those of contact and friction.
_BOND = {0: "", DAMAGING: ", damaging", BROKEN: ", broken"}
#: Letters and colours in the plane, by what a bond does and what contact and friction do.
_IN_PLANE = {
    0: {
        OPEN: ("o", "#dfe4ea"),
        STICK: ("k", "#0072B2"),
        PLUS: ("+", "#009E73"),
        MINUS: ("-", "#E69F00"),
        STICK + WHERE_OPEN: ("K", "#56B4E9"),
        PLUS + WHERE_OPEN: ("P", "#99d8c7"),
        MINUS + WHERE_OPEN: ("M", "#f5d999"),
    },
    DAMAGING: {
        OPEN: ("a", "#f0c9dd"),
        STICK: ("q", "#CC79A7"),
        PLUS: ("r", "#8f5573"),
        MINUS: ("l", "#b3688f"),
        STICK + WHERE_OPEN: ("Q", "#e3b5cf"),
        PLUS + WHERE_OPEN: ("R", "#e3b5cf"),
        MINUS + WHERE_OPEN: ("L", "#e3b5cf"),
    },
    BROKEN: {
        OPEN: ("b", "#c3cbd3"),
        STICK: ("h", "#5b9bc4"),
        PLUS: ("x", "#58b799"),
        MINUS: ("y", "#edc15e"),
        STICK + WHERE_OPEN: ("H", "#a9c6d6"),
        PLUS + WHERE_OPEN: ("X", "#a9c6d6"),
        MINUS + WHERE_OPEN: ("Y", "#a9c6d6"),
    },
}
#: Those of slips in space, which have no sense and the numbers of `PLUS`.
_IN_SPACE = {
    0: {PLUS: ("s", "#E69F00"), PLUS + WHERE_OPEN: ("S", "#f5d999")},
    DAMAGING: {PLUS: ("c", "#b3688f"), PLUS + WHERE_OPEN: ("C", "#e3b5cf")},
    BROKEN: {PLUS: ("z", "#58b799"), PLUS + WHERE_OPEN: ("Z", "#a9c6d6")},
}
_CLAMPED = "d"  # held by Dirichlet data, whatever contact would do


class _Row(NamedTuple):
    """A status: its number, letter, name and colour, and what tables count it as."""

    number: int
    letter: str
    name: str
    colour: str
    kind: str


def _rows(dim: int) -> list[_Row]:
    """All statuses in a plane or in space."""
    found = []
    for bond, in_plane in _IN_PLANE.items():
        for contact, look in in_plane.items():
            words = _CONTACT[contact]
            letter, colour = look
            if dim == 3 and contact in (MINUS, MINUS + WHERE_OPEN):
                continue
            if dim == 3 and contact in _IN_SPACE[bond]:
                letter, colour = _IN_SPACE[bond][contact]
                words = words.partition(", $")[0]
            kind = words.partition(",")[0]
            found.append(_Row(contact + bond, letter, words + _BOND[bond], colour, kind))
    return found


_ROWS = {dim: _rows(dim) for dim in (2, 3)}
_ALL = {row.letter: row for dim in (2, 3) for row in _ROWS[dim]}

#: Human-readable, of every letter.
NAMES = {row.letter: row.name for row in _ALL.values()} | {_CLAMPED: "clamped"}
COLOURS = {row.letter: row.colour for row in _ALL.values()} | {_CLAMPED: "#555555"}
#: Letters of what tables count.
KINDS = {
    kind: "".join(row.letter for row in _ALL.values() if row.kind == kind)
    for kind in ("open", "stick", "slip")
} | {"clamped": _CLAMPED}


def letters(dim: int) -> npt.NDArray[np.str_]:
    """The letter of every status by its number; a blank where there is no such status."""
    found = np.full(1 + max(row.number for row in _ROWS[dim]), " ")
    for row in _ROWS[dim]:
        found[row.number] = row.letter
    return found


def count(word: str) -> dict[str, int]:
    """Numbers of open, stuck, slipping and clamped points among letters."""
    return {kind: sum(map(word.count, those)) for kind, those in KINDS.items()}


def closed(codes: npt.NDArray[np.int8]) -> npt.NDArray[np.bool_]:
    """Which statuses are closed."""
    contact = without_damage(codes)
    return (contact > OPEN) & (contact <= WHERE_OPEN)


def senses(codes: npt.NDArray[np.int8]) -> npt.NDArray[np.int8]:
    """What friction does whether the point is open or not: `OPEN` (nothing), stick, slips."""
    contact = without_damage(codes)
    return np.where(contact > WHERE_OPEN, contact - WHERE_OPEN, contact).astype(np.int8)


def without_damage(codes: npt.NDArray[np.int8]) -> npt.NDArray[np.int8]:
    """What contact and friction do, whatever happens to a bond."""
    return np.asarray(codes % DAMAGING, dtype=np.int8)
