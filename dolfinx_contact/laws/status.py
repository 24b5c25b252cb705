# SPDX-License-Identifier: LGPL-3.0-or-later
"""The statuses of a contact point: one table of their numbers, letters, names and colours.

A point is open or closed, and friction holds it, lets it slip, or does not act. A friction bound
that is given in advance (Tresca) acts on open points too: these have statuses of their own, the
closed ones shifted by `WHERE_OPEN`. Tables of results call them open, as their gap is.

Colours are those of Okabe and Ito, which most colour-blind readers tell apart.
"""

from __future__ import annotations

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

_LETTERS = {2: "ok+-KPM aqrl QRL bhxyHXY", 3: "oks KS  aqc  QC  bhz HZ  "}

#: Human-readable, of every letter; ``d`` is held by Dirichlet data.
NAMES = {
    "o": "open",
    "k": "stick",
    "+": "slip, $u_t > 0$",
    "-": "slip, $u_t < 0$",
    "s": "slip",
    "K": "open, held by friction",
    "P": "open, rubbing, $u_t > 0$",
    "M": "open, rubbing, $u_t < 0$",
    "S": "open, rubbing",
    "d": "clamped",
    "a": "open, damaging",
    "q": "stick, damaging",
    "r": "slip, $u_t > 0$, damaging",
    "l": "slip, $u_t < 0$, damaging",
    "c": "slip, damaging",
    "Q": "open, held by friction, damaging",
    "R": "open, rubbing, $u_t > 0$, damaging",
    "L": "open, rubbing, $u_t < 0$, damaging",
    "C": "open, rubbing, damaging",
    "b": "open, broken",
    "h": "stick, broken",
    "x": "slip, $u_t > 0$, broken",
    "y": "slip, $u_t < 0$, broken",
    "H": "open, held by friction, broken",
    "X": "open, rubbing, $u_t > 0$, broken",
    "Y": "open, rubbing, $u_t < 0$, broken",
    "z": "slip, broken",
    "Z": "open, rubbing, broken",
}
COLOURS = {
    "o": "#dfe4ea",
    "k": "#0072B2",
    "+": "#009E73",
    "-": "#E69F00",
    "s": "#E69F00",
    "K": "#56B4E9",
    "P": "#99d8c7",
    "M": "#f5d999",
    "S": "#f5d999",
    "d": "#555555",
    "a": "#f0c9dd",
    "q": "#CC79A7",
    "r": "#8f5573",
    "l": "#b3688f",
    "c": "#b3688f",
    **dict.fromkeys("QRLC", "#e3b5cf"),
    "b": "#c3cbd3",
    "h": "#5b9bc4",
    **dict.fromkeys("xz", "#58b799"),
    "y": "#edc15e",
    **dict.fromkeys("HXYZ", "#a9c6d6"),
}
#: Letters of what tables count.
KINDS = {"open": "oKPMSaQRLCbHXYZ", "stick": "kqh", "slip": "+-srlcxyz", "clamped": "d"}


def letters(dim: int) -> npt.NDArray[np.str_]:
    """The letter of every status by its number; a blank where there is no such status."""
    return np.array(list(_LETTERS[dim]))


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
