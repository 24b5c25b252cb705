"""The last strategy of a solve, alone."""

from mpi4py import MPI

import numpy as np
import pytest
from cases._triangle import linear_triangle
from support.blocks import KINDS, block, same_tables

from dolfinx_contact.laws.status import STICK
from dolfinx_contact.solvers import ladder


@pytest.fixture
def only_following(monkeypatch):
    """No other strategy is tried."""
    whole = ladder.strategies
    monkeypatch.setattr(ladder, "strategies", lambda *a: whole(*a)[-1:])


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("dim", "cell"),
    [pytest.param(*k, marks=pytest.mark.long) if k == (2, "tri") else k for k in KINDS],
)
@pytest.mark.verifies(
    "loads in increments",
    "Newton's method",
    reference="itself: Newton's method",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_a_block_by_following_the_load(dim, cell, only_following, monkeypatch):
    """The same solution as by Newton's method."""
    followed = block(n=3, cell=cell).solve()
    assert [a.strategy for a in followed.attempts] == ["load following"]
    assert followed.kkt_violation < 1e-8
    monkeypatch.undo()
    same_tables(followed.tables["contact"], block(n=3, cell=cell).solve().tables["contact"], 1e-8)
    assert dim in (2, 3)


@pytest.mark.verifies(
    "loads in increments",
    reference="closed form: Hild's element beyond its folds",
    aspects=("2D",),
    alone=True,
)
def test_past_a_fold(only_following):
    """Hild's element beyond its folds: from stick at gamma = 0 only separation is left at 1.

    With F = 2.5 under (-4 gamma, -1) the branch of stick ends in a fold at gamma = F / 4.
    """
    system = linear_triangle(1, 2.5, (4.0, 0.0), preload=(0.0, -1.0), comm=MPI.COMM_SELF)
    problem = system.problem
    system.set_parameter(0.0)
    problem.solve()
    assert problem.statuses[0].tolist().count(STICK) == 1
    system.set_parameter(1.0)
    result = problem.solve()
    table = result.tables["contact"]
    assert table.letters[0] == "o"
    np.testing.assert_allclose(
        [table.ut[0, 0], table.un[0]],
        np.linalg.solve([[173.0, 91.0], [91.0, 173.0]], [-2.0, -0.5]),
        rtol=1e-8,
    )
