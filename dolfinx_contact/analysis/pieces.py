# SPDX-License-Identifier: LGPL-3.0-or-later
"""One status at every point: a linear problem, its solution with error bounds, and the law there.

Where ut is free rt = -sense (F rn + g), else ut = 0; where un is free rn = 0, else un = 0. What
remains are two unknowns at every point.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from dolfinx_contact.analysis.reduced_problem import IS_FREE, IS_OPEN, SENSE, ReducedProblem
from dolfinx_contact.analysis.rounding import gamma, solved, up

__all__ = ["Interval", "Piece", "solve_piece"]

Array = npt.NDArray[np.float64]
Codes = npt.NDArray[np.int8]


@dataclass(frozen=True)
class Interval:
    """Numbers, and by how much they may be off."""

    value: Array
    away: Array

    @cached_property
    def low(self) -> Array:
        """Lower ends; a difference of two numbers is rounded to its nearest."""
        return np.asarray(self.value - self.away * (1 + gamma(4)) - gamma(0) * np.abs(self.value))

    @cached_property
    def high(self) -> Array:
        """Upper ends."""
        return np.asarray(self.value + self.away * (1 + gamma(4)) + gamma(0) * np.abs(self.value))


@dataclass(frozen=True, eq=False)
class Piece:
    """The solution of a piece.

    Attributes:
        problem: scaled.
        codes: statuses (m,).
        ut, un, rt, rn: numbers at the points (m,).
    """

    problem: ReducedProblem
    codes: Codes
    ut: Interval
    un: Interval
    rt: Interval
    rn: Interval

    @cached_property
    def slacks(self) -> tuple[Interval, Interval]:
        """s+ and s-, F rn + g plus and minus rt."""
        F, g = self.problem.friction, self.problem.g
        size = F * np.abs(self.rn.value) + g + np.abs(self.rt.value)
        away = up(F * self.rn.away + self.rt.away + gamma(2) * size)
        found = (F * self.rn.value + g + sign * self.rt.value for sign in (1, -1))
        plus, minus = (Interval(v, away) for v in found)
        return plus, minus

    @cached_property
    def inequalities(self) -> Interval:
        """What must not be negative for the law to hold (m, 3); 1 fills up."""
        is_open, is_free = IS_OPEN[self.codes], IS_FREE[self.codes]
        rubs = (self.problem.friction > 0) | (self.problem.g > 0)
        sense = np.where(rubs, SENSE[self.codes], 0)
        plus, minus = self.slacks
        rows = []
        for part in ("value", "away"):
            ut, un, rn, s, z = (getattr(v, part) for v in (self.ut, self.un, self.rn, plus, minus))
            slip = sense * ut if part == "value" else ut
            nothing = np.full(len(un), 1.0 if part == "value" else 0.0)
            first = np.where(is_free, np.where(sense != 0, slip, nothing), s)
            second = np.where(is_free, nothing, z)
            rows.append(np.stack([np.where(is_open, un, rn), first, second], axis=1))
        return Interval(rows[0], rows[1])

    @property
    def verdict(self) -> Literal["inside", "outside", "border"]:
        """Whether the law certainly holds beyond its borders, certainly does not, or neither."""
        if (self.inequalities.high < 0).any():
            return "outside"
        return "inside" if (self.inequalities.low > 0).all() else "border"

    @property
    def state(self) -> Array:
        """(ut, un, rt, rn) of the points (m, 4)."""
        return np.stack([v.value for v in (self.ut, self.un, self.rt, self.rn)], axis=1)

    @property
    def away(self) -> Array:
        """By how much the state may be off (m, 4)."""
        return np.stack([v.away for v in (self.ut, self.un, self.rt, self.rn)], axis=1)


def matrix_of(S: Array, friction: Array, codes: Codes) -> Array:
    """Of the equations of a piece; unknowns ut or rt, un or rn point by point (2 m, 2 m)."""
    n = len(S)
    t, k = np.arange(0, n, 2), np.arange(1, n, 2)
    A = np.zeros((n, n))
    free, opened = IS_FREE[codes], IS_OPEN[codes]
    A[:, t[free]], A[:, k[opened]] = S[:, t[free]], S[:, k[opened]]
    stuck, closed = t[~free], k[~opened]
    A[stuck, stuck] = -1.0
    A[closed, closed] = -1.0
    slips = free & ~opened
    A[t[slips], k[slips]] = (SENSE[codes] * friction)[slips]
    return A


def solve_piece(problem: ReducedProblem, codes: Codes) -> Piece | None:
    """The solution of a piece; None if the piece may be singular.

    Args:
        problem: scaled.
        codes: statuses (m,).
    """
    free, opened, sense = IS_FREE[codes], IS_OPEN[codes], SENSE[codes]
    F, g, n = problem.friction, problem.g, len(problem.p)
    load = problem.p.copy()
    load[0::2] -= np.where(free, sense * g, 0.0)
    off = problem.dp + gamma(1) * np.abs(load)
    dA = np.zeros((n, n))
    columns = np.stack([free, opened], axis=1).reshape(-1)
    dA[:, columns] = problem.dS[:, columns]
    found = solved(matrix_of(problem.S, F, codes), load, dA, off)
    if found is None:
        return None
    z, e = (v.reshape(-1, 2) for v in found)
    zero = np.zeros(len(F))
    rn = Interval(np.where(opened, zero, z[:, 1]), np.where(opened, zero, e[:, 1]))
    slip = -sense * (F * rn.value + g)
    slip_off = np.where(sense == 0, 0, up(F * rn.away + gamma(2) * (F * np.abs(rn.value) + g)))
    return Piece(
        problem,
        codes,
        Interval(np.where(free, z[:, 0], zero), np.where(free, e[:, 0], zero)),
        Interval(np.where(opened, z[:, 1], zero), np.where(opened, e[:, 1], zero)),
        Interval(np.where(free, slip, z[:, 0]), np.where(free, slip_off, e[:, 0])),
        rn,
    )
