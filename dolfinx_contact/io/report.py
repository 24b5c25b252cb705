# SPDX-License-Identifier: LGPL-3.0-or-later
"""Progress lines of a script on rank 0."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mpi4py import MPI

if TYPE_CHECKING:
    from dolfinx_contact.results.result import Result
    from dolfinx_contact.solvers.attempts import Step

__all__ = ["Report"]


class Report:
    """Progress messages of a script, printed and flushed on rank 0. Not collective.

    Args:
        comm: communicator; only rank 0 prints.

    Example:
        ::

            say = Report(comm)
            say("solving")
            result = problem.solve(monitor=say.newton)
            say.result(result)
    """

    def __init__(self, comm: MPI.Comm):
        self._speaks = comm.rank == 0

    def __call__(self, text: str) -> None:
        """Print a line of text on rank 0."""
        if self._speaks:
            print(text, flush=True)

    def newton(self, step: Step) -> None:
        """Print a line for a Newton iterate; a ``monitor`` of `ContactProblem.solve`."""
        m = step.measures
        self(
            f"  Newton {step.iteration:2d}: force {m.force:.1e}, constraint {m.constraint:.1e}, "
            f"cone {m.cone:.1e}, {step.flips} points changed status"
        )

    def result(self, result: Result) -> None:
        """Print the number of points by status, the contact forces and the violation of the law."""
        self(f"{result.reason}: {result.iterations} Newton iterations, {result.dofs} unknowns")
        self("contact points: " + ", ".join(f"{n} {k}" for k, n in result.counts.items() if n))
        pairs = result.pairs
        for name, force in result.resultants.items():
            numbers = ", ".join(f"{v:.6g}" for v in force + 0.0)
            self(f"contact force on the {'slave' if name in pairs else 'body'} ({name}): {numbers}")
            if name in pairs:
                numbers = ", ".join(f"{v:.6g}" for v in pairs[name].master + 0.0)
                self(f"contact force on the master ({name}): {numbers}")
        self(f"worst violation of the contact law: {result.kkt_violation:.1e} (relative)")
