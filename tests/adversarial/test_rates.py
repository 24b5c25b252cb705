"""Assumption: a law is one of the increment, or the length of the step does not matter.

Laws of the speed, viscous bonds and friction that wears need the time of a step, which statics,
branches and paths do not have. Steady sliding and states at rest have closed forms.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from support.bodies import SlipWeakening, block, floor, friction_ratio
from support.checks import assert_close, solved_start

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Frictionless,
    HalfSpace,
    NormalCompliance,
    ParametricContact,
)
from dolfinx_contact.continuation import StepControl, follow
from dolfinx_contact.evolution import NSCD, ArcLength, QuasiStatic
from dolfinx_contact.laws import FrictionLaw, Interface


@dataclass(frozen=True)
class OfSpeed(FrictionLaw):
    """Friction falling with the speed of slip, treating the length of the step as known."""

    static: Any
    kinetic: Any
    scale: Any

    def bound(self, a, p):
        return self.at_speed((a.slid - a.slid_before) / a.step) * p

    def at_speed(self, v):
        return self.kinetic + (self.static - self.kinetic) * ufl.exp(-v / self.scale)


@dataclass(frozen=True)
class OfSpeedOrRest(OfSpeed):
    """The same, at rest where no step is known."""

    def bound(self, a, p):
        moved = a.slid - a.slid_before
        return self.at_speed(ufl.conditional(ufl.gt(a.step, 0.0), moved / a.step, 0.0)) * p


@dataclass(frozen=True)
class Below(OfSpeed):
    """Compares with < 0, and divides in the branch that is not taken."""

    def bound(self, a, p):
        moved = a.slid - a.slid_before
        return self.at_speed(ufl.conditional(ufl.lt(a.step, 0.0), 0.0, moved / a.step)) * p


@dataclass(frozen=True)
class AboveMinusTwo(OfSpeed):
    """Compares with a negative number, which does not distinguish rest from a history."""

    def bound(self, a, p):
        moved = a.slid - a.slid_before
        v = ufl.conditional(ufl.gt(a.step, -2.0), abs(moved / a.step), 0.0)
        return self.at_speed(v) * p


@dataclass(frozen=True)
class Scaled(OfSpeed):
    """Compares twice the step with a field of the law."""

    def bound(self, a, p):
        moved = a.slid - a.slid_before
        v = ufl.conditional(ufl.gt(2.0 * a.step + self.scale, 1.0), moved / a.step, moved)
        return self.at_speed(v) * p


@dataclass(frozen=True)
class Squared(OfSpeed):
    """The root of a square loses the sign of the step."""

    def bound(self, a, p):
        return self.at_speed((a.slid - a.slid_before) / ufl.sqrt(a.step**2)) * p


@dataclass(frozen=True)
class AtLeast(OfSpeed):
    """Cuts small steps off."""

    def bound(self, a, p):
        return self.at_speed((a.slid - a.slid_before) / ufl.max_value(a.step, 0.01)) * p


@dataclass(frozen=True)
class ByJumps(OfSpeed):
    """Takes the speed from the jump and the one before, by |step|."""

    def bound(self, a, p):
        moved = a.jump - a.before
        slip = moved - ufl.dot(moved, a.n) * a.n
        return self.at_speed(ufl.sqrt(ufl.dot(slip, slip) + 1e-30) / abs(a.step)) * p


def coefficient(law, v):
    """The coefficient of a law of numbers at a speed."""
    return law.kinetic + (law.static - law.kinetic) * np.exp(-v / law.scale)


def dragged(law, aside=0.05, cells=(2, 1)):
    """A block whose top is pressed by 0.01 and dragged until all of the bottom slips."""
    body = block(cells)
    body.move_top(aside, *[0.0] * (len(cells) - 2), -0.01)
    return body, body.problem(law)


def pressed(law):
    """A block that is pressed, with the frictionless state in its displacement."""
    body = block((2, 1))
    body.move_top(0.0, -0.01)
    body.problem().solve()
    return body, body.problem(law)


#: Laws that do not say what holds without a step.
UNDECIDED = [OfSpeed, AboveMinusTwo, Scaled, Squared, AtLeast, ByJumps]


@pytest.mark.parametrize("law", [pytest.param(OfSpeed, marks=pytest.mark.sample), *UNDECIDED[1:]])
def test_friction_of_the_speed_is_refused_in_statics(law):
    _, problem = dragged(law(0.5, 0.1, 0.02))
    with pytest.raises(ValueError, match="step"):
        problem.solve()


@pytest.mark.parametrize("law", [OfSpeedOrRest, Below])
def test_friction_that_knows_rest_has_its_static_coefficient(law):
    _, problem = dragged(law(0.5, 0.1, 0.02))
    assert_close(friction_ratio(problem.solve().tables["contact"]), 0.5)


@pytest.mark.parametrize(("law", "refused"), [(OfSpeed, True), (OfSpeedOrRest, False)])
def test_friction_of_the_speed_acts_below_a_compliance(law, refused):
    _, problem = dragged(NormalCompliance(1e5, friction=law(0.5, 0.1, 0.02)))
    if refused:
        with pytest.raises(ValueError, match="step"):
            problem.solve()
    else:
        assert_close(friction_ratio(problem.solve().tables["contact"]), 0.5)


def driven(law):
    """The dragged block as a system whose parameter is the share of the way."""
    body, problem = dragged(law)
    gamma = fem.Constant(body.domain, 1.0)
    way = ufl.as_vector((0.05 * gamma, -0.01))
    return ParametricContact(problem, gamma, driven=[(body.moved, way)])


def test_branches_of_friction_that_knows_rest_have_its_static_coefficient():
    system = driven(OfSpeedOrRest(0.5, 0.1, 0.02))
    x = solved_start(system)
    branch = follow(system, x, 1.0, gamma_range=(0.9, 1.0), direction="decreasing", max_steps=5)
    assert len(branch.points) > 1
    for point in branch.points:
        assert_close(friction_ratio(system.result_at(point).tables["contact"]), 0.5)


def test_two_faces_with_other_coefficients_have_their_own_friction():
    """A block dragged at its sides between a floor and a ceiling."""
    body = block()
    sides = mesh.locate_entities_boundary(
        body.domain, 1, lambda x: np.isclose(x[0], 0.0) | np.isclose(x[0], 1.0)
    )
    way = fem.Constant(body.domain, 0.0)
    held = [fem.dirichletbc(way, body.dofs_of(0, sides), body.V.sub(0))]
    obstacles = {"floor": floor(0.01), "ceiling": HalfSpace((0.0, 0.99), (0.0, -1.0))}
    facets = {"floor": body.bottom, "ceiling": body.top}
    laws = {"floor": OfSpeed(0.5, 0.1, 2.0), "ceiling": OfSpeed(0.3, 0.6, 1.0)}

    def problem_of(laws):
        faces = [
            ContactSurface(body.u, facets[n], obstacle=obstacles[n], law=laws[n], name=n)
            for n in laws
        ]
        return ContactProblem(body.elastic(), body.u, faces, bcs=held)

    problem_of(dict.fromkeys(laws, Frictionless())).solve()
    evolution = QuasiStatic(problem_of(laws), lambda t: setattr(way, "value", t))
    history = evolution.run([0.05 * k for k in range(10)])
    for name, law in laws.items():
        table = history.steps[-1].result.tables[name]
        free = np.abs(table.x[:, 0] - 0.5) < 0.4
        found = np.sum(np.abs(table.rt[free, 0])) / np.sum(table.rn[free])
        assert_close(found, coefficient(law, 1.0))


def test_friction_in_a_motion_follows_the_mean_speed_of_each_step():
    law = OfSpeed(0.5, 0.1, 2.0)
    body, problem = pressed(law)
    motion = NSCD(
        problem,
        1e-3,
        dt=0.02,
        load=lambda t: body.move_top(t, -0.01),
        scheme="theta-euler",
        theta=1.0,
    )
    slipped = 0
    for step in motion.run([0.0, 0.2]).steps:
        table = step.result.tables["contact"]
        slips = (table.letters == "+") | (table.letters == "-")
        slipped += np.sum(slips)
        speed = np.abs(table.increment[slips, 0]) / 0.02
        assert_close(np.abs(table.rt[slips, 0]), coefficient(law, speed) * table.rn[slips])
    assert slipped > 10


@dataclass(frozen=True)
class Drag(Interface):
    """Coulomb's friction and a viscous film: Phi = mu p v + c v^2 / 2."""

    friction: Any
    film: Any
    needs_time = ("film",)

    def energy(self, state):
        return 0.0 * state.opening**2

    def dissipation(self, rates, state):
        return self.friction * state.pressure * rates.slip + self.film / 2 * rates.slip**2


def test_a_viscous_film_adds_its_drag_in_a_history_alone():
    body, problem = dragged(Drag(0.2, 3.0))
    assert_close(friction_ratio(problem.solve().tables["contact"]), 0.2)
    evolution = QuasiStatic(problem, lambda t: body.move_top(0.05 + t, -0.01))
    last = evolution.run([0.05 * k for k in range(12)]).steps[-1]
    assert_close(friction_ratio(last.result.tables["contact"]), 0.2 + 3.0 / 10.0)


def worn(way):
    return 0.1 + 0.4 * np.exp(-way / 0.1)


def test_wear_counts_the_whole_slip_in_statics():
    _, problem = dragged(SlipWeakening(0.5, 0.1, 0.1), aside=0.06)
    table = problem.solve().tables["contact"]
    assert np.all(table.letters == "+")
    assert_close(table.rt[:, 0], -worn(table.ut[:, 0]) * table.rn)


def test_wear_counts_the_way_there_and_back_in_a_history():
    body, problem = pressed(SlipWeakening(0.5, 0.1, 0.1))
    evolution = QuasiStatic(problem, lambda t: body.move_top(min(t, 0.2 - t), -0.01))
    way = 0.0
    for step in evolution.run(np.linspace(0.0, 0.2, 9)).steps:
        table = step.result.tables["contact"]
        way = way + np.abs(table.increment[:, 0])
        if set(table.status) <= set("+-"):
            sign = np.where(table.letters == "+", -1.0, 1.0)
            assert_close(table.rt[:, 0], sign * worn(way) * table.rn)
    assert set(table.status) == {"-"}


def test_a_path_refuses_friction_of_the_speed():
    body = block((1, 1))
    gamma = fem.Constant(body.domain, 0.0)
    problem = body.problem(OfSpeedOrRest(0.5, 0.1, 0.02))
    way = ufl.as_vector((gamma, -0.01))
    system = ParametricContact(problem, gamma, driven=[(body.moved, way)])
    system.set_parameter(0.0)
    problem.solve()
    with pytest.raises(ValueError, match="depends on"):
        ArcLength(system).run(gamma_range=(0.0, 0.02), control=StepControl(maximum=0.2))
