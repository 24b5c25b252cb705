# SPDX-License-Identifier: LGPL-3.0-or-later
"""History of a solve: Newton iterates, attempts of strategies, errors, and the progress line."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TextIO

from mpi4py import MPI

from dolfinx_contact._progress import Progress
from dolfinx_contact.equations.measures import Measures

if TYPE_CHECKING:
    from dolfinx_contact.equations.evaluation import Evaluation

__all__ = [
    "Attempt",
    "ConvergenceError",
    "FloatingBodyError",
    "LinearSolverError",
    "SolveProgress",
    "Step",
]


@dataclass(frozen=True)
class Step:
    """One Newton iterate: its residual, and how many points changed status on the way to it.

    Attributes:
        iteration: 0 for the start.
        measures: its residual.
        flips: points that changed status on the way to it.
        load: the part of the load that is applied.
        krylov: iterations of the linear solver on the way to it.
    """

    iteration: int
    measures: Measures
    flips: int
    load: float
    krylov: int = 0

    def __str__(self) -> str:
        m = self.measures
        load = f", load {self.load:.4g}" if self.load != 1.0 else ""
        return (
            f"iteration {self.iteration}: residual {m.worst:.1e} (force {m.force:.1e}, constraint "
            f"{m.constraint:.1e}, cone {m.cone:.1e}), {self.flips} changes of status, "
            f"{self.krylov} Krylov iterations{load}"
        )


@dataclass
class Attempt:
    """One strategy and its history.

    Attributes:
        strategy: name of the strategy.
        reason: why it stopped, in words.
        steps: its Newton iterates.
        converged: whether it solved the problem.
        restless: per surface name, coordinates of points that changed status in the last step.
        limit: cost at which it gives up.
        evaluations: of the residual.
        state: of the solution, until the result is made of it; None if it is to be evaluated.
        series: what else an algorithm reports, by name; one value an iterate where it states
            nothing else.
    """

    strategy: str
    reason: str = "not started"
    steps: list[Step] = field(default_factory=list)
    converged: bool = False
    restless: dict[str, list[list[float]]] = field(default_factory=dict)
    limit: float = math.inf
    evaluations: int = 0
    state: Evaluation | None = None
    series: dict[str, list[float]] = field(default_factory=dict)

    def report(self, **values: float) -> None:
        """Add values to the series."""
        for name, value in values.items():
            self.series.setdefault(name, []).append(float(value))

    @property
    def iterations(self) -> int:
        """Newton steps taken (the first iterate of every start is none)."""
        return len([s for s in self.steps if s.iteration > 0])

    @property
    def cost(self) -> float:
        """What it took, in Newton steps: a residual beside those of the iterates is a quarter."""
        return self.iterations + max(0, self.evaluations - len(self.steps)) / 4

    def gives_up(self) -> bool:
        """Whether its cost has reached its limit; `reason` names it then."""
        if self.cost < self.limit:
            return False
        self.reason = f"gave up after a cost of {self.limit:g} Newton steps"
        return True

    @property
    def krylov_iterations(self) -> int:
        """Iterations of the linear solver."""
        return sum(s.krylov for s in self.steps)


class ConvergenceError(RuntimeError):
    """No strategy solved the problem; the caller's Functions are as they were.

    Attributes:
        attempts: what was tried, with the history of each.
    """

    def __init__(self, message: str, attempts: Sequence[Attempt] = ()):
        super().__init__(message)
        self.attempts = list(attempts)


class FloatingBodyError(ConvergenceError):
    """A rigid motion of the body is held neither by Dirichlet data nor by contact."""


class LinearSolverError(ArithmeticError):
    """The linear system of a Newton step could not be solved; the message has the reason."""


class SolveProgress(Progress):
    """The line of a solve: strategy, iteration, residual, Krylov iterations, elapsed time.

    Args:
        comm: only rank 0 writes.
        wanted: True from the beginning, False never, None once the solve takes some seconds, unless
            the log has every iteration.
        stream: as in `Line`.

    Attributes:
        strategy: what is tried.
    """

    def __init__(self, comm: MPI.Comm, wanted: bool | None = None, *, stream: TextIO | None = None):
        logged = wanted is None and logging.getLogger("dolfinx_contact").isEnabledFor(logging.INFO)
        super().__init__(comm, False if logged else wanted, stream=stream)
        self.strategy = ""

    def step(self, step: Step) -> None:
        """Say where the solve is."""
        if not self.due:
            return
        parts = [
            f"contact solve: {self.strategy}",
            f"iteration {step.iteration}",
            f"residual {step.measures.worst:.1e}",
            *([f"load {step.load:.3g}"] if step.load != 1.0 else []),
            f"Krylov {step.krylov}",
            f"{self.seconds:.0f} s",
        ]
        self.update("  ".join(parts))

    def end(self, iterations: int | None = None) -> None:
        """End the line, with how a solve went that converged; None for one that did not."""
        text = f"solved by {self.strategy}, {iterations} iterations, {self.seconds:.1f} s"
        self.close("" if iterations is None else f"contact solve: {text}")
