"""Assumption: steps of a path by arc length are short enough to see every fold.

Bonds in series with springs, and friction at one point, have folds in closed form. A path that
claims to be complete has all of them, whatever its longest step, its units and its ranges are.
"""

import numpy as np
import pytest
from support.bodies import free_row, one_point
from support.checks import assert_close

import ufl
from dolfinx import fem

from dolfinx_contact import (
    RCCM,
    BilinearCohesive,
    Coulomb,
    ParametricContact,
)
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength

C = 100.0  # stiffness of RCCM's bond
U0 = 0.1  # opening at which its damage begins: work 1 = C U0^2


def path_of(body, problem, lift, start=None):
    """Path by arc length of a body whose top is moved by ``lift(gamma)``."""
    gamma = fem.Constant(body.domain, 0.0 if start is None else start)
    way = ufl.as_vector(lift(gamma))
    system = ParametricContact(problem, gamma, driven=[(body.moved, way)])
    if start is not None:
        system.set_parameter(start)
        problem.solve()
    return ArcLength(system)


def bonded(K, lift=lambda gamma: gamma):
    """A point on a bond of RCCM, lifted by a spring of K times its stiffness."""
    body, energy = one_point([[50.0, 0.0], [0.0, K * C / 2]])
    return path_of(body, body.problem(RCCM(C, 0.0, 1.0), energy), lambda g: (0, lift(g)))


def opening(lift, K):
    """Opening of the damaged bond: U = u + u0^4 / (K u^3)."""
    roots = np.roots([1.0, -lift, 0, 0, U0**4 / K])
    return max(r.real for r in roots if abs(r.imag) < 1e-12)


def folds_of_the_bond(K):
    return [U0 * (1 + 1 / K), 4 / 3 * U0 * (3 / K) ** 0.25]


def end_of(history):
    """Table of the last step, and its row of the free point."""
    table = history.steps[-1].result.tables["contact"]
    return table, free_row(table)


@pytest.mark.parametrize("longest", [0.3, pytest.param(0.05, marks=pytest.mark.sample), 0.02])
def test_long_steps_miss_no_fold_of_a_bond(longest):
    control = StepControl(initial=longest / 2, maximum=longest)
    history = bonded(0.5).run(gamma_range=(0.0, 8 * U0), control=control)
    assert history.complete
    assert_close([step.gamma for step in history.folds], folds_of_the_bond(0.5), 1e-5)


def test_a_path_run_in_parts_has_the_folds_of_one():
    """Ranges end just before and just after a fold."""
    first = folds_of_the_bond(0.5)[0]
    path = bonded(0.5)
    found = []
    for end in (0.5 * first, first * (1 - 1e-4), first * (1 + 1e-4), 0.6):
        history = path.run(gamma_range=(0.0, end), control=StepControl(initial=0.05, maximum=0.1))
        assert history.complete
        found += [p.gamma for p in history.folds]
    assert_close(found, folds_of_the_bond(0.5), 1e-5)
    assert_close(history.steps[-1].gamma, 0.6)
    table, k = end_of(history)
    assert_close(table.un[k], opening(0.6, 0.5), 1e-5)


@pytest.mark.parametrize(
    ("shape", "end"), [(lambda g: g, 1.0), (lambda g: g * (2 - g), 2.0)], ids=["up", "back"]
)
def test_a_bond_keeps_the_damage_of_the_largest_lift(shape, end):
    """K = 4: no snap-back."""
    path = bonded(4.0, lambda gamma: 0.2 * shape(gamma))
    history = path.run(gamma_range=(0.0, end), control=StepControl(initial=0.05, maximum=0.05))
    u = opening(0.2, 4.0)
    table, k = end_of(history)
    assert history.complete
    assert_close(history.steps[-1].gamma, end)
    assert_close(table.beta[k], (U0 / u) ** 2, 2e-3)
    assert_close(table.un[k], 0.0 if end == 2.0 else u, 2e-3)
    assert not history.folds


def test_a_lift_with_a_kink_ends_the_path_there():
    path = bonded(4.0, lambda gamma: 0.2 * (1 - abs(gamma - 1)))
    history = path.run(gamma_range=(0.0, 2.0), control=StepControl(initial=0.05, maximum=0.05))
    assert not history.complete
    assert "kinks or jumps in gamma" in history.reason


def bilinear(force=1.0, length=1.0, lift=lambda gamma: gamma, inverse=lambda lift: lift):
    """A bilinear bond in series with a soft spring: it turns at a + s / k and at a + b."""
    s, a, b, k = 2.0 * force, 0.01 * length, 0.02 * length, 40.0 * force / length
    body, energy = one_point([[k / 2, 0.0], [0.0, k / 2]])
    path = path_of(body, body.problem(BilinearCohesive(s, a, b), energy), lambda g: (0, lift(g)))
    control = StepControl(initial=0.05, maximum=0.1)
    history = path.run(gamma_range=(0.0, inverse(0.1 * length)), control=control)
    assert history.complete
    assert_close([p.gamma for p in history.folds], [inverse(a + s / k), inverse(a + b)])
    assert all(p.event == "nonsmooth fold" for p in history.folds)
    table, row = end_of(history)
    assert_close(table.un[row], 0.1 * length)


@pytest.mark.parametrize(("force", "length"), [(1.0, 1.0), (1e9, 1.0), (1e-9, 1e3)])
def test_folds_of_a_bilinear_bond_do_not_depend_on_units(force, length):
    bilinear(force, length)


@pytest.mark.parametrize(
    ("lift", "inverse"),
    [(lambda g: g**2, np.sqrt), (lambda g: ufl.exp(g) - 1, np.log1p)],
    ids=["square", "exponential"],
)
def test_folds_come_where_a_lift_that_is_not_affine_has_their_values(lift, inverse):
    bilinear(lift=lift, inverse=inverse)


#: Stiffness of a point, way of its top along the tangents, friction, folds and longest step.
POINTS = {
    "turns": ([[1.0, -1.5], [-1.5, 4.0]], [1.0], 1.0, [0.2, 0.0], 0.1),
    "turns, long steps": ([[1.0, -1.5], [-1.5, 4.0]], [1.0], 1.0, [0.2, 0.0], 0.5),
    "does not turn": ([[1.0, -1.5], [-1.5, 4.0]], [1.0], 0.5, [], 0.1),
    "turns in space": (
        [[1.0, 0.0, -0.9], [0.0, 1.0, -1.2], [-0.9, -1.2, 4.0]],
        [0.6, 0.8],
        1.0,
        [0.2, 0.0],
        0.1,
    ),
}


@pytest.mark.parametrize("name", POINTS)
def test_a_load_turns_back_where_a_point_with_much_friction_slips(name):
    """The point sticks up to gamma = 0.2, slips back to 0, and opens or is pressed again."""
    stiffness, aside, friction, folds, longest = POINTS[name]
    dim = len(stiffness)
    body, energy = one_point(stiffness, dim)
    problem = body.problem(Coulomb(friction), energy)
    path = path_of(body, problem, lambda g: (*aside, g), start=-1.0)
    start = problem.table(problem.surfaces[0])
    assert_close(start.force[free_row(start), -1], 5.5)
    control = StepControl(initial=longest / 2, maximum=longest)
    history = path.run(gamma_range=(-1.0, 1.0), control=control)
    end = history.steps[-1].gamma
    table, k = end_of(history)
    assert history.complete
    found = [p.gamma for p in history.folds]
    assert_close(found, folds if end > 0 or not folds else folds[:1])
    assert_close(abs(end), 1.0)
    assert_close(table.un[k], max(end, 0.0), 1e-9)
    assert_close(table.ut[k], [*aside, 0.0])
    assert_close(table.force[k, -1], max(-4 * end, 0.0))
