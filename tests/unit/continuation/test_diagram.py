"""Diagrams, closed branches and stop conditions on systems whose diagrams are known."""

from dataclasses import replace
from types import SimpleNamespace

from mpi4py import MPI

import cases.followed_mesh
import numpy as np
import pytest
from support.checks import solved_start
from support.textbook import circle, one_node, pitchfork, smooth, start

from dolfinx_contact import ParametricContact
from dolfinx_contact.analysis import event_curves
from dolfinx_contact.continuation import Ending, explore, follow, follow_special


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


COMM = MPI.COMM_WORLD


@pytest.mark.verifies(
    "curves of folds",
    reference="closed form: the folds of a cusp",
    aspects=("branches",),
    alone=True,
)
def test_curves_of_folds_meet_in_a_cusp():
    """g + m x - x^3 = 0: smooth folds at g = -+ 2 (m / 3)^(3/2), which meet in a cusp at 0."""
    m = SimpleNamespace(value=3.0)

    def with_parameter(derivative):
        return smooth(
            1,
            lambda x, g: g + m.value * x - x**3,
            lambda x, g: [[m.value - 3 * x[0] ** 2]],
            derivative,
        )

    system = with_parameter(lambda x, g: [1.0])
    other = with_parameter(lambda x, g: [x[0]])
    other.set_parameter = lambda value: setattr(m, "value", value)
    branch = follow(system, start(system, [-3.0]), -18.0, gamma_range=(-20.0, 20.0))
    assert [s.kind for s in branch.special] == ["fold", "fold"]
    curve = follow_special(
        system, other, 3.0, branch, branch.special[0], mu_range=(-1.0, 5.0), gamma_scale=10.0
    )
    mu, gamma = curve.points.T
    np.testing.assert_allclose(gamma**2, 4 * (mu / 3) ** 3, atol=1e-8)
    assert mu.max() == pytest.approx(5.0)
    assert gamma.min() < -1 < 1 < gamma.max()  # through the cusp, along both folds
    assert len(curve.turns) == 1
    np.testing.assert_allclose(curve.turns[0], (0.0, 0.0), atol=1e-6)


def one_node_with(set_other, derivative):
    """kt = kn = 2, k = 1 under (-g, -m), and the same with another parameter than g."""
    load = np.array([0.0, -1.0])
    F = np.array(3.0)
    system = one_node(2.0, 2.0, 1.0, F, load, (-1.0, 0.0))
    other = one_node(2.0, 2.0, 1.0, F, load, (-1.0, 0.0))
    other._c = derivative
    other.set_parameter = lambda value: set_other(load, F, value)
    branch = follow(system, start(system, [0, 0, 0, 1.0]), 0.0, gamma_range=(-1.0, 5.0))
    return system, other, branch


@pytest.mark.verifies(
    "curves of folds",
    "friction as parameter",
    reference="closed form: folds of one node",
    aspects=("branches",),
    alone=True,
)
def test_one_node_folds_along_friction():
    """Folds at g = F, where stick ends, and at g = kt / k = 2, where the pressure vanishes."""

    def by_friction(x, _g, codes):
        return [0, 0, {2: x[3], 3: -x[3]}.get(int(codes[0]), 0.0), 0]

    def set_friction(_load, F, value):
        F[...] = value

    system, other, branch = one_node_with(set_friction, by_friction)
    stuck, opened = (
        follow_special(system, other, 3.0, branch, s, mu_range=(1.0, 4.0), gamma_scale=5.0)
        for s in branch.folds
    )
    np.testing.assert_allclose(stuck.points[:, 1], stuck.points[:, 0], atol=1e-10)
    np.testing.assert_allclose(opened.points[:, 1], 2.0, atol=1e-10)
    for curve in (stuck, opened):
        assert curve.points[[0, -1], 0] == pytest.approx([1.0, 4.0])
        assert curve.points[:, 0].tolist() == sorted(curve.points[:, 0])
        assert len(curve.turns) == len(curve.meetings) == 0
    ends = dict(mu_range=(1.0, 3.0), gamma_scale=5.0)
    towards_less = follow_special(system, other, 3.0, branch, branch.folds[0], **ends)
    mu = towards_less.points[:, 0]
    assert mu[[0, -1]] == pytest.approx([1.0, 3.0])
    assert np.diff(mu).min() > 0  # each once


def test_a_curve_ends_where_its_point_lifts_off():
    """Stick ends at g = F m, as long as the load m presses."""

    def set_load(load, _F, value):
        load[1] = -value

    system, other, branch = one_node_with(set_load, lambda _x, _g, _codes: [0, 1.0, 0, 0])
    curve = follow_special(
        system, other, 1.0, branch, branch.folds[0], mu_range=(-1.0, 2.0), gamma_scale=5.0
    )
    np.testing.assert_allclose(curve.points[:, 1], 3 * curve.points[:, 0], atol=1e-10)
    np.testing.assert_allclose(curve.points[0], (0.0, 0.0), atol=1e-9)
    assert curve.points[-1, 0] == pytest.approx(2.0)
    assert "end of its range" not in curve.branches[0].reason


@pytest.mark.ranks(2)
def test_curves_in_two_parameters_refuse_other_points():
    system, other, branch = one_node_with(lambda *_: None, lambda *_: [0, 0, 0, 0])
    way = dict(mu_range=(1.0, 4.0), gamma_scale=1.0)
    with pytest.raises(ValueError, match="range"):
        follow_special(system, other, 5.0, branch, branch.folds[0], **way)
    two = replace(branch.folds[0], changes=2 * branch.folds[0].changes)
    with pytest.raises(ValueError, match="change of one point"):
        follow_special(system, other, 3.0, branch, two, **way)


def vee(*options):
    """The V-shaped body, and its branch."""
    system = cases.followed_mesh.system(
        cases.followed_mesh.arguments(["--size=0.1", *options]), COMM
    )
    return system, branch_of(system)


def branch_of(system):
    return follow(system, solved_start(system, 0.0), 0.0, gamma_range=(0.0, 1.0), route="steps")


@pytest.mark.verifies(
    "curves of folds",
    reference="itself: the exact curves of the condensed body",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_linear_vee_has_the_folds_of_the_condensed_problem():
    """Both folds as found exactly on the condensed problem, through changes of status."""
    system, branch = vee("--friction=1.4")
    (surface,) = system.problem.surfaces
    F = surface.law.friction
    span = (1.3, 1.52)
    exact = event_curves(system, F, [(1.4, branch)], mu_range=span, gamma_range=(0.0, 1.0))
    other = ParametricContact(system.problem, F)
    for special in branch.folds:
        way = dict(mu_range=span, gamma_scale=1.0)
        curve = follow_special(system, other, 1.4, branch, special, **way)
        assert curve.points[[0, -1], 0] == pytest.approx(span)
        (same,) = (c for c in exact.folds if abs(c.at(1.4) - special.gamma) < 1e-9)
        for mu, gamma in curve.points:
            assert gamma == pytest.approx(same.at(mu), abs=1e-8)
        met = [s.low for s in same.segments[1:]]
        np.testing.assert_allclose(curve.meetings[:, 0], met, atol=1e-8)
    assert float(F.value) == 1.4


@pytest.mark.long
@pytest.mark.verifies(
    "curves of folds",
    "hyperelastic bodies",
    reference="itself: folds of another branch",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_hyperelastic_vee_has_a_curve_of_folds():
    """A curve of folds in large displacements passes through folds of other branches."""
    system, branch = vee("--friction=1.4", "--law=neo-hookean")
    (surface,) = system.problem.surfaces
    F = surface.law.friction
    other = ParametricContact(system.problem, F)
    way = dict(mu_range=(1.3, 1.4), gamma_scale=1.0)
    curves = [follow_special(system, other, 1.4, branch, s, **way) for s in branch.folds[:2]]
    F.value = 1.3
    folds = [s.gamma for s in branch_of(system).folds[:2]]
    ends = [curve.points[0, 1] for curve in curves]
    np.testing.assert_allclose(sorted(ends), sorted(folds), atol=1e-8)
