"""What proofs refuse: the call and its message."""

import cases.proofs_3d
import numpy as np
import pytest

from dolfinx_contact.proofs import (
    ReducedProblem,
    prove_solutions,
)


@pytest.mark.ranks(2)
def test_reduced_problem_refuses_shapes_and_signs():
    S = np.eye(2)
    p = np.zeros(2)
    F = np.array([0.3])
    for bad, what in (
        ((S, np.zeros(3), F), "shape"),
        ((S, np.array([np.nan, 0.0]), F), "not finite"),
        ((S, p, -F), "negative"),
        ((S, p, F, np.array([1.0])), "either a coefficient"),
        ((-S, p, F), "positive definite"),
        ((S, p, F, None, np.full((2, 2), 0.6)), "positive definite"),
    ):
        with pytest.raises(ValueError, match=what):
            ReducedProblem(*bad)
    with pytest.raises(ValueError, match="statuses of 1 points"):
        prove_solutions(ReducedProblem(S, p, F), known=[np.array([0, 0])])


@pytest.mark.ranks(2)
def test_all_solutions_refuses_words():
    with pytest.raises(SystemExit):
        cases.proofs_3d.arguments(["--shape", "block", "--cells", "2", "2"])
