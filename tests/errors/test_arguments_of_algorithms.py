"""Arguments that algorithms refuse: one table for each class."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block

from dolfinx_contact.algorithms import (
    GaussSeidel,
    InteriorPoint,
    Lemke,
    Penalty,
    PointProblem,
    TrescaFixedPoint,
    Uzawa,
)

COMM = MPI.COMM_WORLD


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("algorithm", "options", "message"),
    [
        *((algorithm, {}, "unknown algorithm") for algorithm in ("magic", None, 3, GaussSeidel)),
        ("lemke", {"method": "integral"}, "at the nodes"),
        ("uzawa", {"method": "integral"}, "at the nodes"),
        ("tresca", {"method": "integral", "degree": 2}, "at the nodes"),
    ],
)
def test_solve_refuses_algorithms(algorithm, options, message):
    problem = block(n=2, **options)
    with pytest.raises(ValueError, match=message):
        problem.solve(algorithm=algorithm)


@pytest.mark.ranks(2)
@pytest.mark.skipif(COMM.size == 1, reason="for ranks that differ")
def test_solve_refuses_an_algorithm_that_differs_between_ranks():
    with pytest.raises(ValueError, match="algorithm differs between ranks"):
        block(n=2).solve(algorithm=GaussSeidel(relaxation=1.0 + 0.1 * COMM.rank))


NODE = {
    "S": np.array([[2.0, 1.0], [1.0, 2.0]]),
    "p": np.array([0.0, -1.0]),
    "friction": np.array([0.3]),
}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"S": np.array([[1.0, 2.0], [2.0, 1.0]])}, "definite"),
        ({"S": np.eye(3)}, "shape"),
        ({"p": np.array([np.nan, 0.0])}, "finite"),
        ({"friction": np.array([-0.1])}, "negative"),
    ],
)
def test_point_problem_refuses_data(arguments, message):
    with pytest.raises(ValueError, match=message):
        PointProblem(**(NODE | arguments))


@pytest.mark.parametrize("value", ["word", None, [], {}, 1j])
@pytest.mark.parametrize(
    ("algorithm", "option"),
    [
        (Uzawa, "step"),
        (Penalty, "stiffness"),
        (Penalty, "accuracy"),
        (TrescaFixedPoint, "relaxation"),
        (GaussSeidel, "relaxation"),
        (Lemke, "facets"),
        (InteriorPoint, "max_iterations"),
    ],
)
def test_algorithms_refuse_options_that_are_not_numbers(algorithm, option, value):
    with pytest.raises(ValueError, match=f"{option} must be"):
        algorithm(**{option: value})
