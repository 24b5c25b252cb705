"""What algorithms refuse: the call and its message."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block

from dolfinx_contact.algorithms import (
    GaussSeidel,
    PointProblem,
)

COMM = MPI.COMM_WORLD


@pytest.mark.ranks(2)
def test_algorithms_refuse_problems_of_bodies():
    problem = block(n=2)
    for wrong in ("magic", None, 3, GaussSeidel):
        with pytest.raises(ValueError, match="unknown algorithm"):
            problem.solve(algorithm=wrong)
    with pytest.raises(ValueError, match="at the nodes"):
        block(n=2, method="integral").solve(algorithm="lemke")
    if COMM.size > 1:
        mine = GaussSeidel(relaxation=1.0 + 0.1 * COMM.rank)
        with pytest.raises(ValueError, match="algorithm differs between ranks"):
            problem.solve(algorithm=mine)


NODE = np.array([[2.0, 1.0], [1.0, 2.0]])


@pytest.mark.ranks(2)
def test_algorithms_refuse_data():
    good = (NODE, np.array([0.0, -1.0]), np.array([0.3]))
    for S, p, F in (
        (np.array([[1.0, 2.0], [2.0, 1.0]]), *good[1:]),
        (NODE, np.array([np.nan, 0.0]), good[2]),
        (NODE, good[1], np.array([-0.1])),
        (np.eye(3), good[1], good[2]),
    ):
        with pytest.raises(ValueError, match=r"definite|finite|negative|shape"):
            PointProblem(S, p, F)
