"""Starts of branches and searches for all solutions."""

from __future__ import annotations

from typing import Any

from dolfinx_contact.continuation import find_solutions


def solved_start(system: Any, gamma: float | None = None) -> Any:
    """Solve at a parameter and return the solution as the start of a branch.

    Args:
        system: parametric problem.
        gamma: parameter; by default that of the problem as it is.
    """
    if gamma is not None:
        system.set_parameter(gamma)
    system.problem.solve()
    start = system.create_vector()
    system.problem.write(start)
    return start


def results_at(system: Any, start: Any, gamma: float) -> list[Any]:
    """Return the results of all solutions that a short search finds at a parameter."""
    found = find_solutions(system, [start], gamma, lengths=(0.5,), max_iterations=20)
    return [system.result_at(p) for p in found.points(system, found.found)]
