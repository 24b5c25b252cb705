# SPDX-License-Identifier: LGPL-3.0-or-later
"""Relative residuals, stopping criteria and outcome shared by all algorithms.

An algorithm passes each iterate to an `Iteration`, which computes the same relative residuals
(`Measures`) as Newton's method and decides whether to stop. If an algorithm does not converge, the
reason is one of: the iterates repeat in a cycle, diverge or stagnate, or the limit on iterations is
reached.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import ClassVar

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._validate import count, number
from dolfinx_contact.equations.measures import Measures
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["Algorithm", "Iteration", "Outcome", "check_between"]

Monitor = Callable[[Measures], None]

_LONGEST_CYCLE = 24  # number of stored iterates
_SAME = 1e-6  # distance of equal iterates, relative to the last change
_STILL = 1e-15  # change that counts as zero, relative to the norm of the iterate
_FAR = 1e8  # divergence: ratio of the measure to the smallest one so far
_APART = 10.0  # scales are reset if they exceed the scales of a converged iterate by this factor


@dataclass
class Outcome:
    """Last iterate of an algorithm and the history of its iterations.

    Attributes:
        a: displacements of the points, tangential components first, then the gap, shape (m, dim).
        r: contact forces on the body, shape (m, dim).
        converged: whether the largest relative residual fell below the tolerance.
        reason: reason for stopping; empty while the algorithm runs.
        measures: relative residuals (`Measures`) of all iterates, beginning with the initial guess.
        series: additional quantities recorded by the algorithm, by name, usually one value per
            iterate.
    """

    a: Array
    r: Array
    converged: bool = False
    reason: str = ""
    measures: list[Measures] = field(default_factory=list)
    series: dict[str, list[float]] = field(default_factory=dict)

    @property
    def iterations(self) -> int:
        """Number of iterations, without the initial guess."""
        return max(len(self.measures) - 1, 0)

    @property
    def residuals(self) -> list[float]:
        """Largest relative residual of each iterate."""
        return [m.worst for m in self.measures]


class Iteration:
    """Monitor of an algorithm: records its iterates and their residuals and decides when it stops.

    Args:
        contact: reduced problem.
        limit: maximum number of iterations.
        tolerance: relative residual below which an algorithm stops.
        monitor: function called with the `Measures` of every iterate.

    Attributes:
        outcome: current iterate and history.
        force: force by which residual forces are divided.
        length: length by which residual displacements are divided.
    """

    def __init__(
        self,
        contact: PointProblem,
        limit: int,
        tolerance: float,
        monitor: Monitor | None = None,
    ):
        self.contact = contact
        self.limit = limit
        self.tolerance = tolerance
        self.monitor = monitor
        self.force = contact.force
        self.length = contact.length
        start = np.zeros((contact.number, contact.dim))
        self.outcome = Outcome(start, start)
        #: Last iterates, each with its largest measure.
        self._before: deque[tuple[Array, float]] = deque(maxlen=_LONGEST_CYCLE)
        #: Smallest of the largest measures so far.
        self._least = np.inf
        #: Number of successive iterates that repeat an earlier one.
        self._suspicion = 0

    def measure(self, a: Array, r: Array) -> Measures:
        """Return the relative residuals of a state, and update the scales `force` and `length`.

        The scales are the largest force and displacement so far. If they exceed the scales of an
        apparently converged state by a factor of 10, they are reset to the scales of this state:
        relative to much larger earlier iterates, any residual would be small.
        """
        if np.isfinite(a).all() and np.isfinite(r).all():
            self.force = max(self.force, float(np.abs(r).max()))
            self.length = max(self.length, float(np.abs(a).max()))
        measures = self.contact.measure(a, r, self.force, self.length)
        if measures.worst <= self.tolerance:
            force = max(self.contact.force, float(np.abs(r).max()))
            length = max(self.contact.length, float(np.abs(a).max()))
            if self.force > _APART * force or self.length > _APART * length:
                self.force = force
                self.length = length
                measures = self.contact.measure(a, r, force, length)
        return measures

    def stops(self, a: Array, r: Array, given: Array | None = None, **series: float) -> bool:
        """Record an iterate and return True if the algorithm must stop.

        Args:
            a: displacements, shape (m, dim).
            r: contact forces, shape (m, dim).
            given: friction bounds of this iteration, shape (m,); only for algorithms whose next
                iterate depends on them, so that a repetition of the iterates is detected correctly.
            series: additional quantities to record, by name.
        """
        measures = self.measure(a, r)
        outcome = self.outcome
        outcome.a = a.copy()
        outcome.r = r.copy()
        outcome.measures.append(measures)
        for name, value in series.items():
            outcome.series.setdefault(name, []).append(float(value))
        if self.monitor is not None:
            self.monitor(measures)
        outcome.converged = measures.worst <= self.tolerance
        outcome.reason = "converged" if outcome.converged else self._failure(measures.worst)
        if not outcome.reason:
            columns = [a / self.length, r / self.force]
            columns += [] if given is None else [given[:, None] / self.force]
            outcome.reason = self._repetition(np.hstack(columns).reshape(-1), measures.worst)
        return bool(outcome.reason)

    def _failure(self, worst: float) -> str:
        """Return the reason for stopping without convergence, "" to continue.

        Args:
            worst: largest relative residual of the iterate.
        """
        if not np.isfinite(worst):
            return "the iterates are not finite"
        self._least = min(self._least, worst)
        if worst > _FAR * self._least:
            return f"diverges: the residual is {worst:.1e} after {self._least:.1e}"
        if self.outcome.iterations >= self.limit:
            return f"no convergence in {self.limit} iterations: residual {worst:.1e}"
        return ""

    def _repetition(self, x: Array, worst: float) -> str:
        """Describe stagnation, or iterates that have repeated for a whole cycle; "" otherwise.

        Args:
            x: iterate as one vector, divided by the scales of force and length.
            worst: largest relative residual of the iterate.
        """
        away = [float(np.linalg.norm(x - y)) for y, _ in self._before]
        if away and away[-1] <= _STILL * float(np.linalg.norm(x)):
            return f"stagnates at a residual of {worst:.1e}"
        period = next(
            (
                len(away) - i
                for i in reversed(range(len(away) - 1))
                if away[i] <= _SAME * away[-1] and worst > 0.99 * self._before[i][1]
            ),
            0,
        )
        self._before.append((x, worst))
        self._suspicion = self._suspicion + 1 if period else 0
        if period and self._suspicion >= period:
            return f"a cycle of {period} iterates: residual {worst:.1e}"
        return ""

    def fails(self, reason: str) -> None:
        """Record the reason why an algorithm cannot continue."""
        self.outcome.converged = False
        self.outcome.reason = reason


@dataclass(frozen=True)
class Algorithm:
    """Base class of the algorithms for reduced problems; its fields are the options.

    Attributes:
        name: name of the algorithm in ``ContactProblem.solve(algorithm=...)``.
        max_iterations: maximum number of iterations.
    """

    name: ClassVar[str]
    max_iterations: int = 1000

    def __post_init__(self) -> None:
        count(self.max_iterations, "max_iterations")

    def run(
        self,
        contact: PointProblem,
        *,
        tolerance: float = 1e-10,
        start: Array | None = None,
        monitor: Monitor | None = None,
    ) -> Outcome:
        """Solve a reduced problem. If the algorithm does not converge, return its last iterate.

        Args:
            contact: reduced problem.
            tolerance: largest relative residual of a converged state.
            start: initial contact forces, shape (m, dim); zero by default.
            monitor: function called with the `Measures` of every iterate.
        """
        iteration = Iteration(contact, self.max_iterations, tolerance, monitor)
        begin = np.zeros((contact.number, contact.dim)) if start is None else start.copy()
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            try:
                self._iterate(contact, begin, iteration)
            except np.linalg.LinAlgError as error:
                iteration.fails(f"a linear system cannot be solved: {error}")
        return iteration.outcome

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        """Iterate from the forces ``r``, shape (m, dim), until ``iteration.stops`` returns True."""
        raise NotImplementedError

    def described(self) -> str:
        """Return the name of the algorithm and the options that differ from their defaults."""
        other = [
            f"{f.name}={getattr(self, f.name)!r}"
            for f in fields(self)
            if getattr(self, f.name) != f.default
        ]
        return f"{self.name}({', '.join(other)})" if other else self.name


def check_between(value: float, name: str, most: float) -> None:
    """Raise ``ValueError`` unless a number lies between 0 and ``most``, both excluded."""
    if not 0 < number(value, name) < most:
        raise ValueError(f"{name} must be between 0 and {most:g}, got {value!r}")
