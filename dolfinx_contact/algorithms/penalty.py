# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Penalisation: contact and stick that yield by k, and what remains as k grows without bound.

With r = Pi(-k a) bodies penetrate and stuck points creep by r/k: the solution differs from that of
the laws by O(1/k). Solved by Newton's method for k_0, 2 k_0, 4 k_0, ..., the sequence is
extrapolated to 1/k = 0 by Neville's polynomials in 1/k, and its order is measured from three
successive solutions, log2 |x_1 - x_2|/|x_2 - x_3|, which is 1 once statuses do not change any more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from dolfinx_contact.algorithms.iteration import Algorithm, Iteration, check
from dolfinx_contact.algorithms.point_problem import PointProblem
from dolfinx_contact.algorithms.semismooth import solve_yielding

__all__ = ["Extrapolation", "Penalty"]

Array = npt.NDArray[np.float64]

#: Solutions of which the order is taken.
LEAST = 3
_MOST = 4  # solutions that an extrapolation takes


@dataclass(frozen=True)
class Penalty(Algorithm):
    """Penalisation with extrapolation; an iteration is an extrapolation, from three solutions on.

    Attributes:
        max_iterations: penalised problems.
        stiffness: k_0 over the augmentation of Newton's method.
        accuracy: measure of the extrapolated solution at which the sequence ends; beside it the
            tolerance of the other algorithms is out of reach.
        on: ``body`` for the whole finite element problem, ``points`` for the reduced one.
    """

    name: ClassVar[str] = "penalty"
    max_iterations: int = 30
    stiffness: float = 1000.0
    accuracy: float = 1e-6
    on: Literal["points", "body"] = "body"

    def __post_init__(self) -> None:
        super().__post_init__()
        check(
            self,
            stiffness=self.stiffness > 0,
            accuracy=0 < self.accuracy < 1,
            on=self.on in ("points", "body"),
        )

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        iteration.trend.tolerance = max(self.accuracy, iteration.trend.tolerance)
        none = np.zeros_like(r)
        k = self.stiffness * contact.augmentation
        a = contact.displacements(r)
        sequence = Extrapolation()
        stops = iteration.stops(a, r)
        while not stops:
            cold = not sequence.states
            a, steps, solved = solve_yielding(contact, a, none, k, cold=cold)
            if not solved:
                iteration.fails(f"contact that yields was not solved in {steps} steps")
                return
            state = np.stack([a, contact.forces(a)])
            sequence.add(state)
            k = 2.0 * k
            if len(sequence.states) < LEAST:
                continue
            limit = sequence.limit()
            penetration = float(np.maximum(-a[:, -1], 0.0).max())
            stops = iteration.stops(
                limit[0], limit[1], order=sequence.order(), penetration=penetration, steps=steps
            )


class Extrapolation:
    """States for k_0, 2 k_0, 4 k_0, ...; all methods need the same calls on every rank.

    Args:
        total: adds up numbers over all ranks.
    """

    def __init__(self, total: Callable[[Array], Array] = lambda v: v):
        self._total = total
        self.states: list[Array] = []
        self._changes: list[float] = []

    def add(self, state: Array) -> None:
        """Add the next state."""
        if self.states:
            change = (state - self.states[-1]).reshape(-1)
            self._changes.append(float(self._total(np.array([change @ change]))[0]) ** 0.5)
        self.states = [*self.states[-_MOST + 1 :], state]

    def limit(self) -> Array:
        """Polynomials in 1/k extrapolated to 1/k = 0, by Neville's scheme."""
        column: Sequence[Array] = self.states
        for j in range(1, len(self.states)):
            weight = 2.0**j
            column = [np.asarray((weight * b - a) / (weight - 1)) for a, b in pairwise(column)]
        return column[-1]

    def order(self) -> float:
        """The order of the last three states in 1/k; NaN if there are fewer."""
        if len(self._changes) < 2 or not self._changes[-1] > 0:
            return float("nan")
        return float(np.log2(self._changes[-2] / self._changes[-1]))
