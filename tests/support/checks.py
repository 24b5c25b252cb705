"""Comparisons with closed forms, and assertions on warnings, on any number of ranks."""

import re
from collections.abc import Callable
from typing import Any, TypeVar

from mpi4py import MPI

import numpy as np

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
