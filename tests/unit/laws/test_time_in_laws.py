"""Laws depending on time: behaviour without time, and refused combinations."""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import box, facets

import ufl
from dolfinx import fem

from dolfinx_contact import (
    RCCM,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    MaxwellLayer,
    NormalCompliance,
    ParametricContact,
    Regularised,
)
from dolfinx_contact.analysis import (
    SteadySliding,
    critical_friction,
    renard_criterion,
    stability_at_rest,
)
from dolfinx_contact.continuation import explore, find_solutions, follow
from dolfinx_contact.evolution import ArcLength, NoContinuation, QuasiStatic
from dolfinx_contact.laws import (
    OPEN,
    PLUS,
    STICK,
    Border,
    FrictionLaw,
    Interface,
    Law,
    StatusPiece,
)
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD
STATIC = 0.3
KINETIC = 0.1
V0 = 0.2
REFUSED = "depends on the time of a step"


def mu(v, exp=np.exp):
    return KINETIC + (STATIC - KINETIC) * exp(-v / V0)


@dataclass(frozen=True)
class OfSpeed(FrictionLaw):
    """Friction falling with the speed, which nothing says at rest."""

    scale: Any = 1.0

    def bound(self, a, p):
        return self.scale * mu((a.slid - a.slid_before) / a.step, ufl.exp) * p


@dataclass(frozen=True)
class OfSpeedAtRest(FrictionLaw):
    """The same, with the speed 0 where no time passes."""

    scale: Any = 1.0

    def bound(self, a, p):
        moves = ufl.Not(ufl.Or(ufl.le(a.step, 0.0), ufl.gt(1e-30, a.step)))
        speed = ufl.conditional(moves, (a.slid - a.slid_before) / a.step, 0.0)
        return self.scale * mu(speed, ufl.exp) * p


@dataclass(frozen=True)
class Sticky(Law):
    """A law by its pieces, viscous along the surface."""

    viscosity: Any = 1.0

    def pieces(self, a):
        answer = -a.p * a.n - self.viscosity * a.u_t / a.step
        return {
            OPEN: StatusPiece(0.0 * a.n, [Border(-a.p, STICK)]),
            STICK: StatusPiece(answer, [Border(a.p, OPEN)]),
            PLUS: StatusPiece(answer, [Border(a.p, OPEN)]),
        }


@dataclass(frozen=True)
class Viscous(Interface):
    """Friction with a viscous part, as an interface."""

    viscosity: Any
    needs_time = ("viscosity",)

    def dissipation(self, rates, state):
        return STATIC * state.pressure * rates.slip + self.viscosity * rates.slip**2 / 2


class Dragged:
    """A block pressed on a floor, whose top has moved aside so far that all of it slips."""

    def __init__(self, law, aside=0.2):
        domain = box(COMM, 2, "quad")
        V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
        self.u = fem.Function(V)
        self.top = fem.Function(V)
        surface = ContactSurface(
            self.u, facets(domain, 1, 0.0), obstacle=HalfSpace((0, 0), (0, 1)), law=law
        )
        held = fem.dirichletbc(self.top, fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0)))
        self.gamma = fem.Constant(domain, 1.0)
        energy = LinearElastic.from_young(1e4, 0.3).energy(self.u) * ufl.dx
        push = self.gamma * self.u[0] * ufl.dx
        self.problem = ContactProblem(energy - push, self.u, [surface], bcs=[held])
        self.put(aside)

    def put(self, aside, down=0.01):
        self.top.x.array[0::2] = aside
        self.top.x.array[1::2] = -down

    def ratio(self, result):
        fx, fy = result.resultants["contact"]
        return abs(fx) / fy


def test_statics_refuses_friction_of_a_speed_unless_it_knows_rest():
    """It gave Q/P above every friction coefficient."""
    for law in (OfSpeed(), NormalCompliance(1e6, friction=OfSpeed()), Sticky()):
        dragged = Dragged(law)
        with pytest.raises(ValueError, match=rf"{REFUSED} .*evolution\.QuasiStatic .*conditional"):
            dragged.problem.solve()
        assert not dragged.u.x.array.any()
    at_rest = Dragged(OfSpeedAtRest())
    assert at_rest.ratio(at_rest.problem.solve()) == pytest.approx(STATIC, rel=1e-8)


@pytest.mark.refuses("friction of speed and time", aspects=("branches",))
def test_branches_and_analyses_refuse_friction_of_a_speed():
    dragged = Dragged(OfSpeed())
    problem = dragged.problem
    system = ParametricContact(problem, dragged.gamma)
    x = problem.create_vector()
    for call in (
        lambda: follow(system, x, 0.0, gamma_range=(0.0, 1.0)),
        lambda: explore(system, [(x, 0.0)], gamma_range=(0.0, 1.0)),
        lambda: find_solutions(system, [x], gamma=0.0),
        lambda: ArcLength(system),
        problem.reduced,
        lambda: problem.solve(algorithm="uzawa"),
        lambda: stability_at_rest(problem, density=1.0),
        lambda: critical_friction(problem),
        lambda: renard_criterion(problem),
        lambda: SteadySliding(problem, density=1.0),
    ):
        with pytest.raises(ValueError, match=REFUSED):
            call()


@pytest.mark.ranks(2)
@pytest.mark.parametrize("law", [OfSpeed(), OfSpeedAtRest()])
@pytest.mark.verifies(
    "friction of speed and time",
    "quasi-static",
    reference="closed form: the friction of the speed",
    aspects=("2D",),
)
def test_friction_of_a_speed_acts_in_a_history(law):
    """Steps of 0.02 in times of 0.1 and of 1: the friction of that speed."""
    found = {}
    for time in (0.1, 1.0):
        dragged = Dragged(law, 0.0)
        evolution = QuasiStatic(
            dragged.problem, lambda t, d=dragged, s=time: d.put(0.02 * t / s, 0.01 * min(t / s, 1))
        )
        history = evolution.run(np.array([0.0, 1.0, 2.0, 3.0, 4.0]) * time)
        step = history.steps[-1]
        assert set(step.status) <= {"+", "-"}
        v = 0.02 / time
        found[time] = dragged.ratio(step.result)
        assert found[time] == pytest.approx(mu(v), rel=0.02)
    assert found[0.1] < 0.7 * found[1.0]
    if type(law) is OfSpeed:
        with pytest.raises(ValueError, match=REFUSED):
            dragged.problem.solve()
    else:
        dragged.problem.solve()


class Weakening(FrictionLaw):
    """Friction weakening with the speed: F(v) = 0.27 + 0.03 / (1 + v / 0.4)."""

    def bound(self, a, p):
        speed = ufl.conditional(ufl.gt(a.step, 0.0), (a.slid - a.slid_before) / a.step, 0.0)
        return (0.27 + 0.03 / (1 + speed / 0.4)) * p


@pytest.mark.verifies(
    "friction of speed and time",
    "quasi-static",
    reference="closed form: a quadratic equation for the speed in every step",
    aspects=("2D",),
)
def test_velocity_weakening_in_exactly_the_given_steps():
    """A column of stiffness 1 under the pressure 1 is dragged; shorter steps are not unique."""
    domain = box(COMM, 1, "quad")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    top = fem.Constant(domain, (0.0, -1.0))
    held = fem.dirichletbc(top, fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0)), V)
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Weakening())
    energy = ufl.inner(ufl.grad(u), ufl.grad(u)) / 2 * ufl.dx
    problem = ContactProblem(energy, u, [surface], bcs=[held])
    problem.solve()

    def load(t):
        top.value[0] = t

    times = np.linspace(0.0, 1.0, 11)
    history = QuasiStatic(problem, load).run(times)
    assert [s.time for s in history.steps] == times[1:].tolist()
    assert not any(s.inserted or s.jump for s in history.steps)
    slip = 0.0
    for step in history.steps:
        reach = step.time - slip - 0.27
        h = step.time - step.start
        if reach > 0.03:
            slip += h * np.roots([-h / 0.4, reach / 0.4 - h, reach - 0.03]).max()
        table = step.result.tables["contact"]
        np.testing.assert_allclose(np.abs(table.ut[:, 0]), slip, rtol=1e-8, atol=1e-12)
    assert slip > 0.7


def test_a_failed_step_of_velocity_weakening_asks_for_longer_steps():
    """In shorter steps, such a law is steeper."""
    dragged = Dragged(OfSpeedAtRest(), aside=0.0)
    history = QuasiStatic(dragged.problem, lambda t: dragged.put(t))
    with pytest.raises(NoContinuation, match=r"not solved; a law .* take longer steps"):
        history.run(np.linspace(0.0, 0.05, 101))


@pytest.mark.parametrize(
    "law",
    [
        Regularised(Coulomb(STATIC), width=1e-3, speed=1.0),
        RCCM(10.0, 10.0, 1e-9, STATIC, viscosity=5.0, beta=0.0),
        pytest.param(MaxwellLayer(1e-6, 1.0, 0.0, STATIC), marks=pytest.mark.long),
        Viscous(50.0),
    ],
)
def test_laws_with_a_static_limit_have_coulombs_friction_in_statics(law):
    """The width, no viscosity, no rates: all of them Coulomb's friction here."""
    dragged = Dragged(law)
    assert dragged.ratio(dragged.problem.solve()) == pytest.approx(STATIC, rel=1e-3)


@pytest.mark.ranks(2)
def test_speed_alone_gives_no_static_law():
    dragged = Dragged(Regularised(Coulomb(STATIC), speed=1.0))
    with pytest.raises(ValueError, match="lacks a width"):
        dragged.problem.solve()
