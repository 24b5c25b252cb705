"""What continuation refuses: the call and its message."""

import numpy as np
import pytest
from support.textbook import one_node, smooth, start
from support.textbook_solutions import gould, state

from dolfinx_contact.continuation import (
    Ending,
    Follower,
    StepControl,
    explore,
    find_solutions,
    follow,
)


def test_follow_refuses_starts_and_controls():
    system = one_node(2.0, 2.0, 1.0, 3.0, (0.0, -1.0), (-1.0, 0.0))
    x = start(system, [0, 0, 0, 1.0])
    with pytest.raises(ValueError, match="must lie in the range"):
        follow(system, x, 7.0, gamma_range=(0.0, 5.0))
    with pytest.raises(ValueError, match="max_steps must be a whole number"):
        follow(system, x, 0.0, gamma_range=(0.0, 5.0), max_steps=0)
    still = one_node(2.0, 2.0, 1.0, 3.0, (0.0, -1.0), (0.0, 0.0))
    with pytest.raises(ValueError, match="gamma does not appear in H"):
        follow(still, x, 0.0, gamma_range=(0.0, 5.0))
    for bad in (
        dict(initial=1.0),
        dict(minimum=0.0),
        dict(increase=0.5),
        dict(decrease=2.0),
        dict(cosine=1.0),
        dict(tolerance=0.0),
    ):
        with pytest.raises(ValueError):  # noqa: PT011
            StepControl(**bad)
    nowhere = smooth(
        1, lambda x, g: x**2 + 1 + g**2, lambda x, g: [[2 * x[0]]], lambda x, g: [2 * g + 1e-3]
    )
    with pytest.raises(ValueError, match="no solution near"):
        follow(nowhere, start(nowhere, [1.0]), 0.0, gamma_range=(-1.0, 1.0))


@pytest.mark.ranks(2)
def test_explore_refuses_budgets():
    system = smooth(
        1,
        lambda x, g: x * (g - x**2),
        lambda x, g: [[g - 3 * x[0] ** 2]],
        lambda x, g: [x[0]],
    )
    x = start(system, [0.0])
    diagram = explore(system, [(x, -1.0)], gamma_range=(-1.0, 1.0), max_branches=2)
    assert diagram.reason == "the budget of 2 branches is exhausted"
    assert diagram.ending is Ending.BUDGET
    assert not diagram.complete
    assert len(diagram.edges) == 2
    with pytest.raises(ValueError, match="must lie in the range"):
        explore(system, [(x, 3.0)], gamma_range=(-1.0, 1.0))
    with pytest.raises(ValueError, match="max_branches must be a whole number"):
        explore(system, [(x, 0.5)], gamma_range=(-1.0, 1.0), max_branches=0)
    with pytest.raises(ValueError, match="route must be one of"):
        explore(system, [(x, 0.5)], gamma_range=(-1.0, 1.0), route="guess")
    with pytest.raises(ValueError, match="not affine"):
        explore(system, [(x, 0.5)], gamma_range=(-1.0, 1.0), route="pivoting")


@pytest.mark.ranks(2)
def test_step_control_refuses_ways_to_pass_kinks():
    with pytest.raises(ValueError, match="kinks are passed"):
        StepControl(kinks="somehow")
    system = one_node(2.0, 2.0, 1.0, 3.0, (0.0, -1.0), (-1.0, 0.0))
    with pytest.raises(ValueError, match="nothing to locate"):
        Follower(system, StepControl(), gamma_scale=1.0, locate=lambda change: True)


@pytest.mark.ranks(2)
def test_find_solutions_refuses_guesses():
    system = gould()
    with pytest.raises(ValueError, match="at least one guess"):
        find_solutions(system, [], 0.0)
    with pytest.raises(ValueError, match="must be a positive number"):
        find_solutions(system, [state(system, np.zeros(4))], 0.0, lengths=(0.0,))
