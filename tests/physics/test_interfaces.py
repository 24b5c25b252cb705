"""Interfaces defined by an energy and a dissipation: special cases and closed forms."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize
from support.blocks import block
from support.bonds import Point, along, bar, bonded

import ufl

from dolfinx_contact import RCCM, BilinearCohesive, MaxwellLayer, Tresca
from dolfinx_contact.evolution import ArcLength, QuasiStatic
from dolfinx_contact.laws import Interface, Internal
from dolfinx_contact.laws.status import BROKEN, DAMAGING

C = 100.0
W = 1.0


def adhesion(end=None):
    """RCCM as Raous, Cangemi and Cocou write it: energy (1), dissipation (4)."""

    @dataclass(frozen=True)
    class Adhesion(Interface):
        normal: Any
        tangential: Any
        work: Any
        friction: Any = 0.0
        viscosity: Any = 0.0
        beta: Any = 1.0
        internal = (Internal("beta", "falls", end=end),)
        needs_time = ("viscosity",)

        def energy(self, state):
            beta = state["beta"]
            slid = ufl.dot(state.moved, state.moved)
            springs = self.normal * state.opening**2 + self.tangential * slid
            return beta**2 / 2 * springs + (1 - beta) * self.work

        def dissipation(self, rates, state):
            slips = self.friction * (1 - state["beta"]) * state.pressure * rates.slip
            return slips + self.viscosity / 2 * rates["beta"] ** 2

    return Adhesion


@dataclass(frozen=True)
class Given(Interface):
    """Tresca's friction."""

    threshold: Any
    needs_pressure = False

    def dissipation(self, rates, state):
        return self.threshold * rates.slip


@dataclass(frozen=True)
class Creeping(Interface):
    """A Maxwell layer that damage weakens, with its threshold and viscosity: all is coupled."""

    stiffness: Any
    flows: Any
    work: Any
    viscosity: Any
    damage: Any = 0.0
    internal = (Internal("y", vector=True), Internal("damage", "grows", end=1.0))
    needs_time = ("flows", "viscosity")

    def energy(self, state):
        elastic = state.jump - state["y"]
        return (1 - state["damage"]) ** 2 * self.stiffness / 2 * ufl.dot(elastic, elastic)

    def dissipation(self, rates, state):
        flow = self.flows / 2 * ufl.dot(rates["y"], rates["y"])
        return flow + self.work * rates["damage"] + self.viscosity / 2 * rates["damage"] ** 2


@pytest.mark.each_value
@pytest.mark.parametrize(("dim", "end"), [(2, None), (2, 0.0), (3, None)])
@pytest.mark.parametrize("viscosity", [0.0, 0.3])
def test_interface_adhesion_agrees_with_rccm_at_a_point(dim, end, viscosity):
    """Statuses, intensity, answers and derivatives agree with the direct law at any state."""
    given = dict(normal=100.0, tangential=60.0, work=1.0, friction=0.4, viscosity=viscosity)
    laws = RCCM(**given), adhesion(end)(**given)
    points = [Point(law, dim, r=1000.0) for law in laws]
    rng = np.random.default_rng(3)
    seen = set()
    for k in range(120):
        jump = 0.1 * rng.normal(size=dim) + 0.1 * (np.arange(dim) < dim - 1)
        traction = 10 * rng.normal(size=dim)
        a, b = (p.to(0.1 * k, jump, traction) for p in points)
        assert b == pytest.approx(a, rel=1e-12)
        one, other = (p.answers for p in points)
        codes = one.required
        np.testing.assert_array_equal(other.required, codes)
        for name, size in (("traction", 10.0), ("by_jump", 1000.0), ("by_traction", 1.0)):
            x = getattr(one, name)(codes)
            y = getattr(other, name)(codes)
            np.testing.assert_allclose(x, y, rtol=0, atol=1e-11 * size)
        lost = [p.answers.bond("spent")[0] for p in points]
        if k > 0:
            assert lost[0] - lost[1] == pytest.approx(points[0].lost * W, rel=1e-10, abs=1e-13)
        seen.add(int(codes[0]))
    assert {0, 1, 2, DAMAGING} <= seen


def senses(table):
    """Letters of a table; a slip that is round-off, as where all is only pressed, has no sense."""
    idle = np.linalg.norm(table.increment, axis=1) < 1e-12
    return "".join(
        "s" if none and a in "+-" else a for a, none in zip(table.letters, idle, strict=True)
    )


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("cell", "given"),
    [
        pytest.param("quad", {}, marks=pytest.mark.long),
        pytest.param("quad", {"method": "integral", "degree": 2}, marks=pytest.mark.long),
        pytest.param("tri", {"pair": True}, marks=pytest.mark.long),
        ("tet", {}),
    ],
)
@pytest.mark.verifies(
    "interfaces of one's own",
    "RCCM adhesion",
    "quasi-static",
    reference="itself: the law written out",
    aspects=(
        "2D",
        "3D",
        "pairs",
    ),
)
def test_interface_adhesion_agrees_with_rccm_on_a_block(cell, given):
    """A history with all statuses agrees with the direct law, and the cost of damage is stored."""
    aside = [0.0] * (cell == "tet")
    corners = (0.0, *aside, -0.02), (0.2, *aside, -0.02), (0.1, *aside, 0.3), (0.1, *aside, -0.01)
    histories = []
    for law in (RCCM(C, 0.6 * C, W, 0.4, 0.05), adhesion()(C, 0.6 * C, W, 0.4, 0.05)):
        problem, top = bonded(cell, law=law, **given)
        histories.append(QuasiStatic(problem, along(top, *corners)).run(np.linspace(0.0, 4.0, 25)))
    seen = set()
    for a, b in zip(*(h.steps for h in histories), strict=True):
        s, t = (step.result.tables["contact"] for step in (a, b))
        assert senses(s) == senses(t)
        assert "".join(s.bond) == "".join(t.bond)
        size = np.abs(s.force).max() + 1.0
        np.testing.assert_allclose(t.beta, s.beta, rtol=1e-10)
        np.testing.assert_allclose(t.force, s.force, rtol=0, atol=1e-10 * size)
        np.testing.assert_allclose(t.adhesion, s.adhesion, rtol=0, atol=1e-10 * size)
        damage = W * float(np.dot(1 - s.beta, s.area))
        one = a.energies
        other = b.energies
        assert other.stored - one.stored == pytest.approx(damage, rel=1e-9, abs=1e-12)
        assert one.damage - other.damage == pytest.approx(damage, rel=1e-9, abs=1e-12)
        assert other.dissipated == pytest.approx(one.dissipated, rel=1e-9, abs=1e-12)
        seen |= {*s.letters, *s.bond}
    assert {"o", "i", "w"} < seen


@pytest.mark.parametrize("cell", [pytest.param("tri", marks=pytest.mark.long), "hex"])
@pytest.mark.verifies(
    "interfaces of one's own",
    "Tresca",
    reference="itself: Tresca's law",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_interface_friction_agrees_with_tresca(cell):
    """Tresca's law, at open points too: static, and in a history."""
    found = []
    for law in (Tresca(2.0), Given(2.0)):
        problem = block(cell=cell, n=2, law=law)
        problem.solve()
        table = problem.table(problem.surfaces[0])
        problem2, top = bonded(cell, law=law)
        aside = [0.0] * (cell == "hex")
        load = along(top, (0.01, *aside, -0.01), (0.01, *aside, 0.01), (-0.01, *aside, 0.01))
        history = QuasiStatic(problem2, load).run(np.linspace(0.0, 3.0, 7))
        found.append((table, [s.result.tables["contact"] for s in history.steps], history))
    for a, b in zip([found[0][0], *found[0][1]], [found[1][0], *found[1][1]], strict=True):
        assert a.status == b.status
        size = np.abs(a.force).max() + 1.0
        np.testing.assert_allclose(a.force, b.force, rtol=0, atol=1e-10 * size)
        assert b.bond is None
    a = found[0][2].energies
    b = found[1][2].energies
    assert b.dissipated == pytest.approx(a.dissipated, rel=1e-9)
    assert a.dissipated > 0
    rubbed = [t.friction[t.letters == "o"] for t in found[1][1]]
    assert max(np.abs(f).max(initial=0.0) for f in rubbed) > 0.1


@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.long)])
@pytest.mark.verifies(
    "Maxwell layer",
    reference="closed form: relaxation of a jump that is held",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_maxwell_layer_relaxes_as_implicit_euler(dim):
    """Relaxation at a constant jump follows implicit Euler, converging at first order."""
    k = 3.0
    b = 0.6
    c = 0.5
    held = np.array([0.2, 0.1, 0.15])[-dim:]
    off = []
    for n in (10, 20, 40):
        point = Point(MaxwellLayer(k, b, c), dim, r=1000.0)
        dt = 0.4 / n
        point.to(0.0, 0.0 * held)
        y = 0.0 * held
        for i in range(1, n + 1):
            found = point.to(i * dt, held)
            y = (y + dt * k / b * held) / (1 + dt * k / b)
            np.testing.assert_allclose(found, y, rtol=1e-13)
            traction = point.answers.bond("traction")[0]
            np.testing.assert_allclose(traction, -k * (held - y) - c * held, rtol=1e-13)
        exact = -(k * np.exp(-k * 0.4 / b) + c) * held
        off.append(np.linalg.norm(traction - exact))
    assert 0.9 < np.log2(off[0] / off[1]) < 1.1
    assert 0.9 < np.log2(off[1] / off[2]) < 1.1


@pytest.mark.verifies(
    "bilinear cohesion", reference="closed form: traction, secant and cost", aspects=("2D",)
)
def test_cohesion_spends_its_fracture_energy():
    """The traction rises, falls, unloads along the secant and vanishes; its work is the energy."""
    strength = 2.0
    a = 0.1
    b = 0.3
    point = Point(BilinearCohesive(strength, a, b), r=1000.0)
    spent = 0.0
    far = 0.0
    ways = [0.05, 0.1, 0.15, 0.2, 0.1, 0.3, 0.399, 0.41, 0.5, 0.2]
    for k, d in enumerate(ways):
        jump = np.array([0.6, 0.8]) * d if k % 2 else np.array([0.0, d])
        damage = point.to(k, jump)
        far = max(far, d)
        secant = strength / a if far <= a else max(strength * (a + b - far) / b / far, 0.0)
        assert damage == pytest.approx(1 - secant / (strength / a), abs=1e-13)
        np.testing.assert_allclose(point.answers.bond("traction")[0], -secant * jump, atol=1e-13)
        spent += point.answers.bond("spent")[0]
        code = 0 if d <= a or d < far else DAMAGING if d < a + b else BROKEN
        assert point.answers.required[0] == (BROKEN if far >= a + b else code)
        assert point.answers.bond("broken")[0] == (far >= a + b)
    assert spent == pytest.approx(strength * (a + b) / 2, rel=1e-13)


@pytest.mark.long
@pytest.mark.parametrize("k", [pytest.param(1.0, marks=pytest.mark.long), 8.0])
@pytest.mark.verifies(
    "bilinear cohesion",
    "arc length paths",
    reference="closed form: a bar in series with the bond",
    aspects=("2D",),
)
def test_bar_on_cohesion_turns_back(k):
    """The path turns back where the bond softens faster than the bar, until the bond is broken."""
    strength = 2.0
    a = 0.1
    b = 0.3
    law = BilinearCohesive(strength, a, b)
    history = ArcLength(bar(k, 4, law=law)).run(gamma_range=(0.0, 3.0))
    assert history.complete
    stiffness = k * C
    seen = set()
    for step in history.steps:
        d = step.result.tables["contact"].un
        pull = np.where(d < a, strength * d / a, np.maximum(strength * (a + b - d) / b, 0.0))
        np.testing.assert_allclose(step.gamma, d + pull / stiffness, rtol=1e-9)
        seen |= set(step.result.tables["contact"].bond)
    assert seen == {"i", "w", "b"}
    assert history.energies.damage == pytest.approx(0.05 * strength * (a + b) / 2, rel=1e-6)


@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.long)])
@pytest.mark.verifies(
    "interfaces of one's own",
    reference="independent code: a minimiser of scipy",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_coupled_variables_minimise_energy_and_dissipation(dim):
    """Each step minimises energy plus dissipation, according to a minimiser working on its own."""
    stiffness = 40.0
    flows = 3.0
    work = 0.1
    viscosity = 0.02
    point = Point(Creeping(stiffness, flows, work, viscosity), dim, r=1000.0)
    rng = np.random.default_rng(1)
    y = np.zeros(dim)
    damage = 0.0
    time = 0.0
    seen = set()
    point.to(0.0, y)
    for _ in range(40):
        dt = rng.uniform(0.01, 0.2)
        jump = 0.15 * rng.normal(size=dim)
        jump[-1] = abs(jump[-1])

        def total(z, jump=jump, dt=dt, y=y, damage=damage):
            e = jump - z[:-1]
            lost = z[-1] - damage
            stored = (1 - z[-1]) ** 2 * stiffness / 2 * (e @ e)
            flow = flows / 2 * ((z[:-1] - y) @ (z[:-1] - y)) / dt
            return stored + flow + work * lost + viscosity / 2 * lost**2 / dt

        bounds = [(None, None)] * dim + [(damage, 1.0)]
        wanted = minimize(
            total, [*y, damage], bounds=bounds, method="L-BFGS-B",
            options={"ftol": 1e-16, "gtol": 1e-11},
        )  # fmt: skip
        time += dt
        point.to(time, jump)
        memory = point.memory.fields
        z = np.array([*(memory[f".y_{i}"][0] for i in range(dim)), memory["damage"][0]])
        np.testing.assert_allclose(z, wanted.x, rtol=0, atol=2e-5)
        assert total(z) <= wanted.fun * (1 + 1e-12)
        y = z[:-1]
        damage = z[-1]
        seen.add(int(point.answers.required[0]))
    assert {0, DAMAGING} <= seen
