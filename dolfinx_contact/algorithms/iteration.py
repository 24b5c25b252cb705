# SPDX-License-Identifier: LGPL-3.0-or-later
"""What every algorithm reports of itself, and when it stops: one measure, one history, one end.

An algorithm shows each iterate to an `Iteration`, which measures it as Newton's method does and
decides whether to continue. Where an algorithm does not converge the reason is what it does: its
iterates repeat in a cycle, grow without bound, stand still, or there are too many of them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact._validate import is_count, is_number
from dolfinx_contact.algorithms.point_problem import PointProblem
from dolfinx_contact.equations.measures import Measures

__all__ = ["Algorithm", "Iteration", "Outcome", "Trend"]

Array = npt.NDArray[np.float64]
Monitor = Callable[[Measures], None]

_LONGEST_CYCLE = 24  # iterates that are remembered
_SAME = 1e-6  # of the last change, by which an iterate that returns may differ
_STILL = 1e-15  # of the size of an iterate: changes that are none
_FAR = 1e8  # times the smallest measure so far, beyond which an algorithm diverges
_APART = 10.0  # scales of iterates on the way over those of one beside which they do not count


@dataclass
class Outcome:
    """Where an algorithm ended.

    Attributes:
        a: displacements (m, dim): tangential, then the gap.
        r: forces on the body (m, dim).
        converged: whether the measure fell below the tolerance.
        reason: why it stopped, in words; empty as long as it continues.
        measures: of every iterate, the start first.
        series: what else the algorithm reports, by name; one value an iterate where it says
            nothing else.
    """

    a: Array
    r: Array
    converged: bool = False
    reason: str = ""
    measures: list[Measures] = field(default_factory=list)
    series: dict[str, list[float]] = field(default_factory=dict)

    @property
    def iterations(self) -> int:
        """Iterates after the start."""
        return max(len(self.measures) - 1, 0)

    @property
    def residuals(self) -> list[float]:
        """The worst measure of every iterate."""
        return [m.worst for m in self.measures]


class Trend:
    """Knows a cycle, a divergence and a standstill when it sees them.

    Args:
        limit: iterates after the start that there may be.
        tolerance: measure at which an algorithm has converged.
        total: adds up numbers over all ranks.
    """

    def __init__(self, limit: int, tolerance: float, total: Callable[[Array], Array] = lambda v: v):
        self.limit = limit
        self.tolerance = tolerance
        self._total = total
        self.count = -1
        self.converged = False
        self.reason = ""
        self._before: deque[tuple[Array, float]] = deque(maxlen=_LONGEST_CYCLE)
        self._least = np.inf
        self._suspicion = 0

    def stops(self, iterate: Array, worst: float) -> bool:
        """Whether an iterate with this measure is the last; then `reason` is why. Collective."""
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
        """Whether iterates return to what they were, twice in a row, without getting better."""
        squares = [x @ x, *((x - y) @ (x - y) for y, _ in self._before)]
        norms: list[float] = [float(v) for v in np.sqrt(self._total(np.array(squares)))]
        size = norms[0]
        away = norms[1:]
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
    """The iterates of an algorithm on a reduced problem.

    Args:
        contact: the problem.
        limit: iterates after the start that there may be.
        tolerance: measure at which an algorithm has converged.
        monitor: called with every measure.

    Attributes:
        outcome: where it is.
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
        """Measures of a state; the scales only grow, but for a state that looks converged.

        Where an algorithm has been far away everything is small beside that: then the state is
        judged by its own scales from now on.
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
        """Whether the algorithm is to stop at this iterate.

        Args:
            a: displacements (m, dim).
            r: forces (m, dim).
            given: forces (m,) that it was found with, if the next depends on them as well.
            series: what else there is to report of it.
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
        """The outcome of an algorithm that cannot continue."""
        self.outcome.converged = False
        self.outcome.reason = reason
        return self.outcome


@dataclass(frozen=True)
class Algorithm:
    """A way to solve a reduced problem, with its options.

    Attributes:
        name: by which a solve selects it.
        max_iterations: after which it gives up.
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
        """Solve a reduced problem; what did not converge is reported as it is.

        Args:
            contact: the problem.
            tolerance: of the measures.
            start: forces (m, dim) to begin with, by default none.
            monitor: called with the measures of every iterate.
        """
        iteration = Iteration(contact, self.max_iterations, tolerance, monitor)
        begin = np.zeros((contact.number, contact.dim)) if start is None else start.copy()
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            try:
                self._iterate(contact, begin, iteration)
            except np.linalg.LinAlgError as error:
                iteration.fails(f"a linear system that cannot be solved: {error}")
        return iteration.outcome

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        """Show iterates to ``iteration`` until it stops, from the forces ``r``."""
        raise NotImplementedError

    def described(self) -> str:
        """The name, with the options that are not the defaults."""
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
