# SPDX-License-Identifier: LGPL-3.0-or-later
"""Convergence measures, stopping criteria and outcome shared by all algorithms.

An algorithm passes each iterate to an `Iteration`, which measures it in the same way as Newton's
method and decides whether to stop. If an algorithm does not converge, the reason is one of: the
iterates repeat in a cycle, diverge or stagnate, or the limit on iterations is reached.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._validate import is_count, is_number
from dolfinx_contact.equations.measures import Measures
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["Algorithm", "Iteration", "Outcome", "Trend"]

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
        a: displacements of the points, shape (m, dim): tangential components, then the gap.
        r: contact forces on the body, shape (m, dim).
        converged: whether the measure fell below the tolerance.
        reason: reason for stopping; empty while the algorithm runs.
        measures: convergence measures of all iterates, beginning with the initial guess.
        series: further quantities of the algorithm by name, by default one value per iterate.
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
        """Largest measure of every iterate."""
        return [m.worst for m in self.measures]


class Trend:
    """Stopping test: detects convergence, cycles, divergence and stagnation.

    Args:
        limit: maximum number of iterations.
        tolerance: measure at which an algorithm has converged.
    """

    def __init__(self, limit: int, tolerance: float):
        self.limit = limit
        self.tolerance = tolerance
        self.count = -1
        self.converged = False
        self.reason = ""
        self._before: deque[tuple[Array, float]] = deque(maxlen=_LONGEST_CYCLE)
        self._least = np.inf
        self._suspicion = 0

    def stops(self, iterate: Array, worst: float) -> bool:
        """Return True if this iterate is the last one, and set `reason`.

        Args:
            iterate: state of the algorithm, any shape.
            worst: largest measure of the iterate.
        """
        self.count += 1
        if not np.isfinite(worst):
            return self._end("the iterates are not finite")
        if worst <= self.tolerance:
            self.converged = True
            return self._end("converged")
        self._least = min(self._least, worst)
        if worst > _FAR * self._least:
            return self._end(f"diverges: the residual is {worst:.1e} after {self._least:.1e}")
        if self.count >= self.limit:
            return self._end(f"no convergence in {self.limit} iterations: residual {worst:.1e}")
        return self._repeats(iterate.reshape(-1), worst)

    def _repeats(self, x: Array, worst: float) -> bool:
        """Return True if the iterates stagnate or repeat for a period without improvement."""
        size = float(np.linalg.norm(x))
        away = [float(np.linalg.norm(x - y)) for y, _ in self._before]
        if away and away[-1] <= _STILL * size:
            return self._end(f"stands still at a residual of {worst:.1e}")
        period = next(
            (
                len(away) - i
                for i in reversed(range(len(away) - 1))
                if away[i] <= _SAME * away[-1] and worst > 0.99 * self._before[i][1]
            ),
            0,
        )
        self._before.append((x.copy(), worst))
        self._suspicion = self._suspicion + 1 if period else 0
        if period and self._suspicion >= period:
            return self._end(f"a cycle of {period} iterates: residual {worst:.1e}")
        return False

    def _end(self, reason: str) -> bool:
        self.reason = reason
        return True


class Iteration:
    """Measures and records the iterates of an algorithm on a reduced problem.

    Args:
        contact: reduced problem.
        limit: maximum number of iterations.
        tolerance: measure at which an algorithm has converged.
        monitor: function called with the measures of every iterate.

    Attributes:
        outcome: current iterate and history.
    """

    def __init__(
        self,
        contact: PointProblem,
        limit: int,
        tolerance: float,
        monitor: Monitor | None = None,
    ):
        self.contact = contact
        self.monitor = monitor
        self.trend = Trend(limit, tolerance)
        self.force = contact.force
        self.length = contact.length
        start = np.zeros((contact.number, contact.dim))
        self.outcome = Outcome(start, start)

    def measure(self, a: Array, r: Array) -> Measures:
        """Return the measures of a state and update the scales of force and length.

        The scales are the largest force and displacement so far. If they exceed the scales of an
        apparently converged state by a factor of 10, they are reset to the scales of this state:
        relative to much larger earlier iterates, any residual would be small.
        """
        if np.isfinite(a).all() and np.isfinite(r).all():
            self.force = max(self.force, float(np.abs(r).max()))
            self.length = max(self.length, float(np.abs(a).max()))
        measures = self.contact.measure(a, r, self.force, self.length)
        if measures.worst <= self.trend.tolerance:
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
            given: friction bounds of the iterate, shape (m,), if the next iterate depends on them.
            series: further quantities to record by name.
        """
        measures = self.measure(a, r)
        found = self.outcome
        found.a = a.copy()
        found.r = r.copy()
        found.measures.append(measures)
        for name, value in series.items():
            found.series.setdefault(name, []).append(float(value))
        if self.monitor is not None:
            self.monitor(measures)
        columns = [a / self.length, r / self.force]
        columns += [] if given is None else [given[:, None] / self.force]
        state = np.concatenate(columns, axis=1)
        stops = self.trend.stops(state, measures.worst)
        found.converged = self.trend.converged
        found.reason = self.trend.reason
        return stops

    def fails(self, reason: str) -> Outcome:
        """Return the outcome of an algorithm that cannot continue, with its reason."""
        self.outcome.converged = False
        self.outcome.reason = reason
        return self.outcome


@dataclass(frozen=True)
class Algorithm:
    """Base class of the algorithms for reduced problems; the fields are their options.

    Attributes:
        name: name of the algorithm in ``ContactProblem.solve(algorithm=...)``.
        max_iterations: maximum number of iterations.
    """

    name: ClassVar[str]
    max_iterations: int = 1000

    def __post_init__(self) -> None:
        kinds = {"float": is_number, "int": is_number, "bool": _is_truth}
        for f in fields(self):
            is_kind = kinds.get(str(f.type))
            check(self, **{f.name: is_kind is None or is_kind(getattr(self, f.name))})
        check(self, max_iterations=is_count(self.max_iterations))

    def run(
        self,
        contact: PointProblem,
        *,
        tolerance: float = 1e-10,
        start: Array | None = None,
        monitor: Monitor | None = None,
    ) -> Outcome:
        """Solve a reduced problem; without convergence, return the last iterate.

        Args:
            contact: reduced problem.
            tolerance: largest measure of a converged state.
            start: initial contact forces, shape (m, dim); zero by default.
            monitor: function called with the measures of every iterate.
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
        """Iterate from the forces ``r`` until ``iteration.stops`` returns True."""
        raise NotImplementedError

    def described(self) -> str:
        """Return the name with the options differing from their defaults."""
        other = [
            f"{f.name}={getattr(self, f.name)!r}"
            for f in fields(self)
            if getattr(self, f.name) != f.default
        ]
        return f"{self.name}({', '.join(other)})" if other else self.name


def check(options: Algorithm, **valid: bool) -> None:
    """Raise ``ValueError`` for the first option that is not valid."""
    wrong: Mapping[str, bool] = {name: ok for name, ok in valid.items() if not ok}
    for name in wrong:
        raise ValueError(f"{options.name}: {name} must not be {getattr(options, name)!r}")


def _is_truth(value: Any) -> bool:
    return isinstance(value, bool | np.bool_)
