# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Penalty method with extrapolation to infinite stiffness.

With the penalised laws r = Pi(-k a) for forces r and displacements a, with a stiffness k and the
projection Pi onto admissible forces, bodies penetrate and sticking points slip by r/k, so that the
solution has an error of O(1/k). The penalised problems for k_0, 2 k_0, 4 k_0, ... are solved by
Newton's method and extrapolated to 1/k = 0 by Neville's polynomials in 1/k. The observed order of
convergence, log2 |x_1 - x_2|/|x_2 - x_3| for three successive solutions, is 1 as soon as the
statuses no longer change (Wriggers, Computational Contact Mechanics, 2006). The method stops when
the extrapolated state satisfies the exact laws up to `Penalty.accuracy`. It fails if Newton's
method does not solve a penalised problem.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._validate import positive
from dolfinx_contact.algorithms.iteration import Algorithm, Iteration, check_between
from dolfinx_contact.algorithms.semismooth import solve_yielding
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["Penalty"]


_LEAST = 3  # number of solutions that determine the order
_MOST = 4  # largest number of solutions in an extrapolation


@dataclass(frozen=True)
class Penalty(Algorithm):
    """Penalty method; one iteration is one extrapolation from at least three solutions.

    Attributes:
        max_iterations: maximum number of extrapolations.
        stiffness: first penalty stiffness k_0, relative to the augmentation of Newton's method.
        accuracy: relative residual at which the extrapolated solution is accepted. A smaller
            argument ``tolerance`` has no effect, since extrapolation does not reach it.
    """

    name: ClassVar[str] = "penalty"
    max_iterations: int = 30
    stiffness: float = 1000.0
    accuracy: float = 1e-6

    def __post_init__(self) -> None:
        super().__post_init__()
        positive(self.stiffness, "stiffness")
        check_between(self.accuracy, "accuracy", 1.0)

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        iteration.tolerance = max(self.accuracy, iteration.tolerance)
        none = np.zeros_like(r)
        k = self.stiffness * contact.augmentation
        a = contact.displacements(r)
        states: list[Array] = []
        stops = iteration.stops(a, r)
        while not stops:
            a, steps, solved = solve_yielding(contact, a, none, k, cold=not states)
            if not solved:
                iteration.fails(f"the penalised problem was not solved in {steps} steps")
                return
            states = [*states[1 - _MOST :], np.stack([a, contact.forces(a)])]
            k = 2.0 * k
            if len(states) < _LEAST:
                continue
            penetration = float(np.maximum(-a[:, -1], 0.0).max())
            stops = iteration.stops(
                *_limit(states), order=_order(states), penetration=penetration, steps=steps
            )


def _limit(states: list[Array]) -> Array:
    """Extrapolate states for the stiffnesses k, 2 k, 4 k, ... to 1/k = 0 by Neville's scheme."""
    column = states
    for j in range(1, len(states)):
        weight = 2.0**j
        column = [np.asarray((weight * b - a) / (weight - 1)) for a, b in pairwise(column)]
    return column[-1]


def _order(states: list[Array]) -> float:
    """Return the order of convergence observed in the last three penalised solutions.

    It refers to the reciprocal of the penalty stiffness. NaN if the last two solutions are equal.
    """
    before, last = (float(np.linalg.norm(b - a)) for a, b in pairwise(states[-_LEAST:]))
    return float(np.log2(before / last)) if last > 0 else float("nan")
