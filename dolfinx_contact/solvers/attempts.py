# SPDX-License-Identifier: LGPL-3.0-or-later
"""Record of a solve: Newton iterates, attempts of strategies, errors, and the progress line."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from mpi4py import MPI

from dolfinx_contact._mpi import any_rank, everywhere
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
    "unsolved",
]


@dataclass(frozen=True)
class Step:
    """Newton iterate, as reported to monitors.

    Attributes:
        iteration: number of the iterate, 0 for the start.
        measures: relative residuals of the iterate (`equations.measures.Measures`).
        flips: number of contact points whose status changed in the step to this iterate.
        load: applied fraction of the load, 0 to 1.
        krylov: iterations of the linear solver in the step to this iterate.
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
    """Attempt to solve the problem by one strategy.

    Attributes:
        strategy: name of the strategy.
        reason: reason why the attempt ended.
        steps: Newton iterates.
        converged: whether the strategy solved the problem.
        restless: coordinates of some contact points whose status changed in the last step, by name
            of the surface.
        limit: cost at which the strategy gives up, in units of a Newton step (`cost`).
        evaluations: number of residual evaluations.
        linear_solver_failed: whether the attempt ended because PETSc did not solve a linear system.
        floats: whether the attempt ended because nothing prevented a rigid motion of a body.
        evaluation: evaluation of H at the solution, from which the result is computed; None if H
            must be evaluated again.
        series: further values reported by an algorithm, by name; one per iterate unless the
            algorithm states otherwise.
    """

    strategy: str
    reason: str = "not started"
    steps: list[Step] = field(default_factory=list)
    converged: bool = False
    restless: dict[str, list[list[float]]] = field(default_factory=dict)
    limit: float = math.inf
    evaluations: int = 0
    linear_solver_failed: bool = False
    floats: bool = False
    evaluation: Evaluation | None = None
    series: dict[str, list[float]] = field(default_factory=dict)

    @property
    def iterations(self) -> int:
        """Number of Newton steps; initial iterates are not counted."""
        return len([s for s in self.steps if s.iteration > 0])

    @property
    def cost(self) -> float:
        """Cost in Newton steps; each residual evaluation beyond one per iterate costs a quarter."""
        return self.iterations + max(0, self.evaluations - len(self.steps)) / 4

    def gives_up(self) -> bool:
        """Return whether the cost has reached the limit; if so, set `reason`."""
        if self.limit == math.inf or self.cost < self.limit:
            return False
        self.reason = f"gave up after a cost of {self.limit:g} Newton steps"
        return True

    @property
    def krylov_iterations(self) -> int:
        """Total number of iterations of the linear solver."""
        return sum(s.krylov for s in self.steps)


class ConvergenceError(RuntimeError):
    """Error raised if no strategy solves the problem; Functions of the caller are unchanged.

    Attributes:
        attempts: attempts of the strategies.
    """

    def __init__(self, message: str, attempts: Sequence[Attempt] = ()):
        super().__init__(message)
        self.attempts = list(attempts)


class FloatingBodyError(ConvergenceError):
    """Error raised if neither Dirichlet data nor contact prevents a rigid motion of a body."""


def unsolved(attempts: Sequence[Attempt], causes: Sequence[str] = ()) -> str:
    """Return the message of a failed solve.

    Args:
        attempts: attempts of the strategies.
        causes: possible causes, one sentence each; default: none.
    """
    lines = ["the contact problem was not solved:", *causes]
    for a in attempts:
        worst = f", residual {a.steps[-1].measures.worst:.2g}" if a.steps else ""
        lines.append(f"- {a.strategy}: {a.reason} ({a.iterations} iterations{worst})")
        for name, places in a.restless.items():
            listed = "; ".join("(" + ", ".join(f"{c:.6g}" for c in x) + ")" for x in places)
            lines.append(f"  points of {name} that keep changing status, among them {listed}")
    lines.append("The displacement and the multipliers are as they were before the solve.")
    return "\n".join(lines)


class LinearSolverError(ArithmeticError):
    """Error raised if the linear system of a Newton step was not solved."""


class SolveProgress(Progress):
    """Monitor and progress line of a solve: strategy, iteration, residual, elapsed time.

    Args:
        comm: communicator; only rank 0 writes.
        wanted: whether to show progress; by default it is shown after some seconds, unless the log
            contains every iteration.
        monitor: function called with every iterate; an error on one rank is raised on all ranks.
            Default: None.

    Attributes:
        strategy: name of the strategy that is running.
    """

    def __init__(
        self, comm: MPI.Comm, wanted: bool | None, monitor: Callable[[Step], None] | None = None
    ):
        logged = wanted is None and logging.getLogger("dolfinx_contact").isEnabledFor(logging.INFO)
        super().__init__(comm, False if logged else wanted)
        self.strategy = ""
        self._comm = comm
        self._monitor = monitor
        self._is_monitored = any_rank(comm, monitor is not None)

    def step(self, step: Step) -> None:
        """Call the monitor with an iterate, and show it in the progress line. Collective."""
        if self._is_monitored:
            self.clear()  # the monitor may write to the terminal
            with everywhere(self._comm, "the monitor"):
                if self._monitor is not None:
                    self._monitor(step)
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
        """End the progress line.

        Args:
            iterations: number of iterations of a solve that converged; None if it failed.
        """
        text = f"solved by {self.strategy}, {iterations} iterations, {self.seconds:.1f} s"
        self.close("" if iterations is None else f"contact solve: {text}")
