# SPDX-License-Identifier: LGPL-3.0-or-later
"""Statuses of contact points: codes, letters, names and colours.

A status has three parts. The point is open or closed. Friction sticks, slips or is absent. The bond
is unchanged, being damaged, or broken. A prescribed friction bound (Tresca) also acts on open
points; `WHERE_OPEN` is added to their status codes. Result tables count these points as open. The
colours of Okabe and Ito are used, which most colour-blind readers can distinguish.
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
    "summary",
    "without_damage",
    "word",
]

#: Open without friction; stick; slip with u_t > 0 (in 3D: slip); slip with u_t < 0.
OPEN, STICK, PLUS, MINUS = range(4)
#: Added to the code of a closed status for the same friction status at an open point.
WHERE_OPEN = 3
#: Added to a status code if the bond is being damaged, or is broken.
DAMAGING = 8
BROKEN = 16

#: States of a bond: suffixes of the status names.
_BONDS = {0: "", DAMAGING: ", damaging", BROKEN: ", broken"}


class _State(NamedTuple):
    """Row of the table of statuses: contact and friction, for all states of the bond.

    Attributes:
        code: status code of an unchanged bond.
        dims: dimensions in which the status exists. Slip in 3D has no sign; its code is `PLUS`.
        words: description of contact and friction.
        looks: letter and colour for each state of the bond in `_BONDS`.
    """

    code: int
    dims: tuple[int, ...]
    words: str
    looks: tuple[str, str, str]


_HELD, _ALONG, _BACK = (code + WHERE_OPEN for code in (STICK, PLUS, MINUS))
#: Contact x friction x bond. A closed point without friction has no separate row: it slips with
#: zero bound and has the code `PLUS`.
_TABLE = (
    _State(OPEN, (2, 3), "open", ("o #dfe4ea", "a #f0c9dd", "b #c3cbd3")),
    _State(STICK, (2, 3), "stick", ("k #0072B2", "q #CC79A7", "h #5b9bc4")),
    _State(PLUS, (2,), "slip, $u_t > 0$", ("+ #009E73", "r #8f5573", "x #58b799")),
    _State(MINUS, (2,), "slip, $u_t < 0$", ("- #E69F00", "l #b3688f", "y #edc15e")),
    _State(PLUS, (3,), "slip", ("s #E69F00", "c #b3688f", "z #58b799")),
    _State(_HELD, (2, 3), "open, held by friction", ("K #56B4E9", "Q #e3b5cf", "H #a9c6d6")),
    _State(_ALONG, (2,), "open, rubbing, $u_t > 0$", ("P #99d8c7", "R #e3b5cf", "X #a9c6d6")),
    _State(_BACK, (2,), "open, rubbing, $u_t < 0$", ("M #f5d999", "L #e3b5cf", "Y #a9c6d6")),
    _State(_ALONG, (3,), "open, rubbing", ("S #f5d999", "C #e3b5cf", "Z #a9c6d6")),
)
_CLAMPED = "d"  # point with Dirichlet conditions


class _Row(NamedTuple):
    """One status: code, letter, colour, name, and the kind under which tables count it."""

    code: int
    letter: str
    colour: str
    name: str
    kind: str


def _rows(dim: int) -> list[_Row]:
    """Return the statuses that exist in 2D or in 3D."""
    states = [state for state in _TABLE if dim in state.dims]
    found = []
    for place, (bond, behind) in enumerate(_BONDS.items()):
        for state in states:
            letter, colour = state.looks[place].split()
            kind = state.words.partition(",")[0]
            found.append(_Row(state.code + bond, letter, colour, state.words + behind, kind))
    return found


_ROWS = {dim: _rows(dim) for dim in (2, 3)}
_ALL = {row.letter: row for dim in (2, 3) for row in _ROWS[dim]}

#: Descriptions of the status letters.
NAMES = {row.letter: row.name for row in _ALL.values()} | {_CLAMPED: "clamped"}
COLOURS = {row.letter: row.colour for row in _ALL.values()} | {_CLAMPED: "#555555"}
#: Letters of each kind counted in tables.
KINDS = {
    kind: "".join(row.letter for row in _ALL.values() if row.kind == kind)
    for kind in ("open", "stick", "slip")
} | {"clamped": _CLAMPED}


def letters(dim: int) -> npt.NDArray[np.str_]:
    """Return the status letters, indexed by status code, with blanks for unused codes."""
    found = np.full(1 + max([row.code for row in _ROWS[dim]]), " ")
    for row in _ROWS[dim]:
        found[row.code] = row.letter
    return found


def word(codes: npt.ArrayLike, dim: int = 2) -> str:
    """Return the letters of the given status codes as a string."""
    return "".join(letters(dim)[np.asarray(codes, dtype=np.int64)])


def count(word: str) -> dict[str, int]:
    """Return the numbers of open, sticking, slipping and clamped points in a string of letters."""
    return {kind: sum(map(word.count, those)) for kind, those in KINDS.items()}


def summary(letters: str) -> str:
    """Return the numbers of points of each status, such as "3 stick, 2 open"."""
    present = [k for k in NAMES if k in letters]
    return ", ".join(f"{letters.count(k)} {NAMES[k]}" for k in present)


def closed(codes: npt.NDArray[np.int8]) -> npt.NDArray[np.bool_]:
    """Return the mask of the status codes at which a point is closed."""
    contact = codes % DAMAGING
    return np.asarray((contact > OPEN) & (contact <= WHERE_OPEN))


def senses(codes: npt.NDArray[np.int8]) -> npt.NDArray[np.int8]:
    """Return the friction state of each point: no friction (`OPEN`), stick, or slip and its sign.

    Open points under a prescribed friction bound also stick or slip.
    """
    contact = codes % DAMAGING
    return np.where(contact > WHERE_OPEN, contact - WHERE_OPEN, contact).astype(np.int8)


def without_damage(codes: npt.NDArray[np.int8]) -> npt.NDArray[np.int8]:
    """Return the status codes without the state of the bond."""
    return np.asarray(codes % DAMAGING, dtype=np.int8)
