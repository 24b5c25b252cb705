"""Diagrams, closed branches and stop conditions on systems whose diagrams are known."""

import numpy as np
import pytest
from support.textbook import circle, one_node, pitchfork, smooth, start

from dolfinx_contact.continuation import Ending, explore, follow


def gammas(branch):
    return branch.points[0].gamma, branch.points[-1].gamma


@pytest.mark.verifies(
    "branches", reference="closed form: a circle", aspects=("branches",), alone=True
)
def test_closed_branch_ends_at_its_start():
    """The circle inside the range: the branch ends where it began, having folded twice."""
    system = circle()
    branch = follow(system, start(system, [1.0]), 0.0, gamma_range=(-2.0, 2.0))
    assert branch.reason == "the branch is closed"
    assert branch.ending is Ending.CLOSED
    np.testing.assert_allclose([s.gamma for s in branch.folds], [1.0, -1.0], atol=1e-10)
    assert branch.points[-1].y.equal(branch.points[0].y)


def test_diagram_names_an_unfinished_branch():
    """The diagram is incomplete and names the branch and the reason."""
    system = circle()
    span = dict(gamma_range=(-2.0, 2.0))
    whole = explore(system, [(start(system, [1.0]), 0.0)], **span)
    assert whole.complete
    assert whole.ending is Ending.REACHED
    part = explore(system, [(start(system, [1.0]), 0.0)], max_steps=3, **span)
    assert not part.complete
    assert part.ending is Ending.BUDGET
    assert part.reason.startswith("branch 0 was cut off (and 1 more): the budget of 3 steps")
    assert not part.summary()["converged"]


@pytest.mark.verifies(
    "stops", "branches", reference="closed form: a circle", aspects=("branches",), alone=True
)
def test_branch_stops_where_the_caller_says():
    """A branch ends where the caller says so, with the caller's reason."""
    system = circle()
    branch = follow(
        system,
        start(system, [1.0]),
        0.0,
        gamma_range=(-2.0, 2.0),
        stop=lambda step: "enough" if step.point.gamma > 0.5 else "",
    )
    assert branch.reason == "enough"
    assert branch.ending is Ending.STOPPED
    assert branch.points[-1].gamma > 0.5 >= branch.points[-2].gamma


@pytest.mark.verifies(
    "all solutions",
    "branches",
    reference="closed form: a pitchfork",
    aspects=("branches",),
    alone=True,
)
def test_pitchfork_has_one_node_and_four_rays():
    """x (g - x^2) = 0: one node with four rays; two ends at g = 1, one at -1, one arch cut off."""
    system = pitchfork()
    diagram = explore(system, [(start(system, [0.0]), -1.0)], gamma_range=(-1.0, 1.0))
    assert len(diagram.nodes) == 1
    assert abs(diagram.nodes[0].point.gamma) < 1e-8
    assert diagram.open_rays() == []
    assert sorted(round(b.points[-1].gamma, 8) for b in diagram.branches) == [0, 1, 1, 1]
    assert [edge.start for edge in diagram.edges] == [None, 0, 0, 0]


def test_transcritical_branches_merge_at_one_node():
    """x (g - x) = 0 from two starts: four edges and one node; neither branch is found twice."""
    system = smooth(1, lambda x, g: x * (g - x), lambda x, g: [[g - 2 * x[0]]], lambda x, g: [x[0]])
    starts = [(start(system, [0.0]), -1.0), (start(system, [-1.0]), -1.0)]
    diagram = explore(system, starts, gamma_range=(-1.0, 1.0))
    assert len(diagram.nodes) == 1
    assert len(diagram.edges) == 4
    assert diagram.nodes[0].edges.count(None) == 0
    assert sorted(edge.end is None for edge in diagram.edges) == [False, False, True, True]


@pytest.mark.verifies(
    "all solutions",
    "branches",
    reference="closed form: a line through a circle",
    aspects=("branches",),
    alone=True,
)
def test_a_loop_of_two_nodes_is_followed_once():
    """(x - a)(x^2 + g^2 - 1) = 0, a = g / 2: a line through a circle, two nodes, six edges."""
    system = smooth(
        1,
        lambda x, g: (x - g / 2) * (x**2 + g**2 - 1),
        lambda x, g: [[(x[0] ** 2 + g**2 - 1) + (x[0] - g / 2) * 2 * x[0]]],
        lambda x, g: [-(x[0] ** 2 + g**2 - 1) / 2 + (x[0] - g / 2) * 2 * g],
    )
    diagram = explore(system, [(start(system, [-1.0]), -2.0)], gamma_range=(-2.0, 2.0))
    at = 2 / np.sqrt(5)
    np.testing.assert_allclose([n.point.gamma for n in diagram.nodes], [-at, at], atol=1e-8)
    # The line: in, between, out; the circle: two arcs.
    assert len(diagram.edges) == 5
    assert diagram.open_rays() == []


def test_two_starts_on_one_branch_merge():
    """Both starts lie on the S path of one node: one of them is merged."""
    system = one_node(2.0, 2.0, 1.0, 3.0, (0.0, -1.0), (-1.0, 0.0))
    stuck = (start(system, [0, 0, 0, 1.0]), 0.0)
    open_ = (start(system, [*np.linalg.solve([[2, 1], [1, 2]], [-5, -1]), 0, 0]), 5.0)
    diagram = explore(system, [stuck, open_], gamma_range=(0.0, 5.0))
    assert len(diagram.edges) == 1
    assert gammas(diagram.branches[0]) == (0.0, pytest.approx(5.0, abs=1e-12))
