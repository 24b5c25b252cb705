"""Comparisons with closed forms and dense linear algebra, warnings, and searches for solutions."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, TypeVar

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact.continuation import find_solutions

COMM = MPI.COMM_WORLD
T = TypeVar("T")


def assert_close(found: Any, expected: Any, tolerance: float = 1e-6) -> None:
    """Assert that numbers agree relative to the largest expected one.

    Args:
        found: numbers of the package, of any shape.
        expected: right numbers, of the same shape.
        tolerance: bound of the error, relative to the largest absolute value of ``expected``;
            absolute where all expected values are zero.
    """
    found = np.asarray(found, dtype=float)
    expected = np.asarray(expected, dtype=float)
    assert found.shape == expected.shape
    size = float(np.max(np.abs(expected), initial=0.0)) or 1.0
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * size)


def warnings_of(caplog: Any) -> list[str]:
    """Return the warnings logged so far on all ranks. Collective."""
    mine = [r.getMessage() for r in caplog.records if r.levelname == "WARNING"]
    return [text for part in COMM.allgather(mine) for text in part]


def assert_warned(caplog: Any, pattern: str) -> str:
    """Assert that a logged warning matches a pattern, ignoring case; return it. Collective."""
    texts = warnings_of(caplog)
    found = [text for text in texts if re.search(pattern, text, re.IGNORECASE)]
    assert found, f"no warning matches {pattern!r}: {texts}"
    return found[0]


def on_rank_0(evaluate: Callable[[], T]) -> T:
    """Evaluate a function on rank 0 and return its value on every rank. Collective."""
    value, error = None, None
    if COMM.rank == 0:
        try:
            value = evaluate()
        except Exception as raised:  # every rank has to learn of it
            error = raised
    value, error = COMM.bcast((value, error))
    if error is not None:
        raise error
    return value


def verdict(problem: Any) -> str:
    """Return whether the solution in the Functions is the only one: "proved", "not proved", ..."""
    return problem.uniqueness().verdict


def warnings_in(result: Any) -> Any:
    """Return the warnings that a result keeps."""
    return result.warnings


def solved_start(system: Any, gamma: float | None = None) -> Any:
    """Solve at a parameter and return the solution as the start of a branch.

    Args:
        system: parametric problem.
        gamma: parameter; default: the present value.
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


def dense(form: Any) -> np.ndarray:
    """Return the matrix of a bilinear form on a mesh of one rank, without conditions."""
    return fem.assemble_matrix(fem.form(form)).to_dense()


def tangent(energy: Any, body: Any) -> Any:
    """Return the second derivative of an energy, a bilinear form."""
    trial = ufl.TrialFunction(body.V)
    test = ufl.TestFunction(body.V)
    return ufl.derivative(ufl.derivative(energy, body.u, test), body.u, trial)


def nodes_of(V: fem.FunctionSpace, where: Any) -> np.ndarray:
    """Return the nodes (not dofs) on one rank where ``where(y)`` holds, sorted by coordinates.

    Args:
        V: vector space.
        where: mask of positions, shape (n, 3).
    """
    y = V.tabulate_dof_coordinates()
    found = np.flatnonzero(where(y))
    return found[np.lexsort(y[found].round(12).T[::-1])]


def condensed(K: np.ndarray, kept: np.ndarray, gone: np.ndarray) -> np.ndarray:
    """Return the Schur complement of ``K`` on ``kept``; dofs ``gone`` are held at zero."""
    rest = np.setdiff1d(np.arange(len(K)), np.concatenate([kept, gone]))
    S = K[np.ix_(kept, kept)]
    if len(rest):
        S = S - K[np.ix_(kept, rest)] @ np.linalg.solve(
            K[np.ix_(rest, rest)], K[np.ix_(rest, kept)]
        )
    return S
