"""Formulas of laws at one point, in numbers: bonds that weaken, compliant surfaces, what creeps."""

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import ufl
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.utils.stacks import StackDict

from dolfinx_contact import BilinearCohesive, Coulomb, MaxwellLayer, NormalCompliance, Regularised
from dolfinx_contact.laws import RCCM, Answers
from dolfinx_contact.laws.compliant import _SERIES, _tanh
from dolfinx_contact.laws.damage import DamageStep
from dolfinx_contact.laws.law import Border, ContactPoint, StatusPiece, checked_pieces
from dolfinx_contact.laws.status import BROKEN, DAMAGING, MINUS, OPEN, PLUS, STICK
from dolfinx_contact.laws.still import known_step


def value(e):
    """UFL of numbers, a scalar or a vector, as numbers."""
    e = apply_algebra_lowering(ufl.as_ufl(e))
    known = {}

    def number(e, *at):
        return float(e.evaluate(None, known, at, StackDict()))

    if e.ufl_shape:
        return np.array([number(e, i) for i in range(e.ufl_shape[0])])
    return number(e)


def holds(condition):
    return value(ufl.conditional(condition, 1.0, 0.0)) == 1.0


def vector(v):
    return ufl.as_vector([float(x) for x in v])


def at_point(jump, traction=(0.0, 0.0), *, gap=0.1, r=5.0, before=(0.0, 0.0), step=-1.0, **kept):
    """A point over a floor at y = 0: a jump upwards opens it."""
    dim = len(jump)
    n = np.zeros(dim)
    n[-1] = -1.0
    return ContactPoint(
        vector(jump),
        vector(traction),
        vector(n),
        ufl.as_ufl(float(gap)),
        ufl.as_ufl(float(r)),
        dim,
        slid=ufl.as_ufl(0.0),
        before=vector(before),
        step=ufl.as_ufl(float(step)),
        kept={f".{name}": ufl.as_ufl(float(v)) for name, v in kept.items()},
    )


# -- bonds ----------------------------------------------------------------------------------------

C_N, C_T, W, MU, B, BETA = 4.0, 6.0, 0.5, 0.3, 2.0, 0.8


def rccm(**more):
    given = {"friction": MU, "viscosity": B, "beta": BETA} | more
    return RCCM(
        C_N,
        C_T,
        W,
        **{
            k: ufl.as_ufl(v) if isinstance(v, float) and k != "exponent" else v
            for k, v in given.items()
        },
    )


def fallen(energy, start, time, p=1.0, b=B):
    """The beta of b ((s - beta)/time)^p = E beta - w, where that is below s."""
    if energy * start <= W:
        return start
    return brentq(lambda x: b * ((start - x) / time) ** p - energy * x + W, W / energy, start)


def test_what_a_bond_is_by_default():
    bond = RCCM(1.0, 2.0, 3.0)
    given = {f.name: getattr(bond, f.name) for f in fields(bond)}
    assert given == {
        "normal": 1.0,
        "tangential": 2.0,
        "work": 3.0,
        "friction": 0.0,
        "viscosity": 0.0,
        "beta": 1.0,
        "broken": 1e-6,
        "exponent": 1.0,
        "order": 1,
        "recovers": False,
        "contact": None,
        "threshold": "pressure",
    }


@pytest.mark.parametrize(
    ("jump", "before", "p"),
    [
        ((0.3, 0.4), (0.2, 9.0), 1.0),
        ((0.3, 0.4), (0.2, 9.0), 2.0),
        ((0.3, 0.4), (0.2, 9.0), 0.5),
        ((0.9, -0.1), (0.1, 9.0), 1.0),
        ((0.0, 0.0), (0.0, 0.0), 1.0),
    ],
)
def test_a_bond_that_weakens_in_a_step(jump, before, p, monkeypatch):
    """Against its viscosity; what it carries, holds and has cost."""
    dt = 0.25
    a = at_point(jump, before=before, step=dt)
    opening = max(jump[1] + 0.1, 0.0)
    moved = jump[0] + before[0]
    energy = C_N * opening**2 + C_T * moved**2
    beta = fallen(energy, BETA, dt, p)
    assert value(rccm(exponent=p)._now(a)) == pytest.approx(beta, rel=1e-9)
    with monkeypatch.context() as quick:  # what is made of it has it many times
        quick.setattr(RCCM, "_now", lambda self, a: ufl.as_ufl(beta))
        bond = rccm(exponent=p).bond(a)
        broken = rccm(exponent=p, broken=0.9).bond(a).broken
    assert value(bond.after["beta"]) == beta
    expected = beta**2 * np.array([-C_T * moved, -C_N * opening])
    np.testing.assert_allclose(value(bond.traction), expected, rtol=1e-8, atol=1e-14)
    assert value(bond.stored) == pytest.approx(beta**2 * energy / 2, rel=1e-8)
    lost = BETA - beta
    assert value(bond.spent) == pytest.approx(
        W * lost + B * (lost / dt) ** p * lost, rel=1e-7, abs=1e-15
    )
    assert value(bond.broken) == 0.0
    assert value(broken) == 1.0
    # Without a time, or a viscosity, it is what the energy leaves.
    rests = min(BETA, W / energy) if energy else BETA
    for law, point in ((rccm(), at_point(jump, before=before)), (rccm(viscosity=0.0), a)):
        found = law.bond(point)
        assert value(found.after["beta"]) == pytest.approx(rests, rel=1e-12)
        assert value(found.spent) == pytest.approx(W * (BETA - rests), rel=1e-9, abs=1e-15)


@pytest.mark.parametrize(("dt", "length"), [(0.25, 0.5), (0.5, 0.25), (0.5, 0.1), (0.25, 0.0)])
def test_a_bond_by_the_second_order(dt, length):
    """By the rate of the step before, whose length is at least a half of the present one."""
    rate = 0.1
    a = at_point((0.3, 0.4), step=dt, rate=rate, length=length, rest=0.0)
    energy = C_N * 0.25 + C_T * 0.09
    x = min(dt / length, 2.0) if length else 0.0
    part = x / (1 + 2 * x)
    start, time = BETA - part * dt * rate, (1 - part) * dt
    beta = fallen(energy, start, time)
    bond = rccm(order=2).bond(a)
    assert value(bond.after["beta"]) == pytest.approx(beta, rel=1e-10)
    assert value(bond.after[".rate"]) == pytest.approx((BETA - beta) / dt)
    assert value(bond.after[".length"]) == dt
    assert value(bond.after[".rest"]) == pytest.approx(W / energy if beta * energy >= W else beta)
    still = rccm(order=2).bond(at_point((0.0, -0.1), step=-1.0, rate=rate, length=length, rest=0.0))
    assert (value(still.after[".rate"]), value(still.after[".length"])) == (0.0, 0.0)
    assert value(still.after[".rest"]) == value(still.after["beta"])


def test_a_step_of_damage_and_its_border():
    """Positive where the intensity stays; the driving force less what resists, over the work."""
    for start, energy in ((0.8, 0.5), (0.8, 0.7), (0.3, 2.0), (0.3, 1.0)):
        step = DamageStep(*(ufl.as_ufl(v) for v in (start, W, B)), 1.0, ufl.as_ufl(0.25))
        slack = value(step.slack(ufl.as_ufl(energy)))
        assert slack == pytest.approx(1 - energy * start / W)
        now = value(step.now(ufl.as_ufl(energy)))
        assert now == pytest.approx(fallen(energy, start, 0.25), rel=1e-10)
        assert value(step.cap) == start
    # Bonds that grow to 1 at most.
    for yes, cap in ((True, 1.0), (False, 0.3)):
        grows = ufl.gt(ufl.as_ufl(1.0 if yes else -1.0), 0.0)
        step = DamageStep(*(ufl.as_ufl(v) for v in (0.3, W, B)), 1.0, ufl.as_ufl(0.25), None, grows)
        assert value(step.cap) == cap
        energy = 0.1
        slack = 1 - energy * cap / W - (B * (cap - 0.3) / 0.25 / W if yes else 0.0)
        assert value(step.slack(ufl.as_ufl(energy))) == pytest.approx(slack)
        beta = (B * 0.3 + 0.25 * W) / (B + 0.25 * energy) if yes else 0.3
        assert value(step.now(ufl.as_ufl(energy))) == pytest.approx(beta)


def test_what_bonds_add_to_contact():
    """Springs where a point is open; friction by what of the bond is broken where it slips."""
    p, dt = 2.0, 0.25
    a = at_point((0.3, 0.4), (7.0, 9.0), before=(0.2, 0.0), step=dt)
    pieces = rccm().pieces(a)
    energy = C_N * 0.25 + C_T * 0.25
    beta = fallen(energy, BETA, dt)
    for code, b in ((OPEN, BETA), (OPEN + DAMAGING, beta)):
        expected = b**2 * np.array([-C_T * 0.5, -C_N * 0.5])
        np.testing.assert_allclose(value(pieces[code].answer), expected, rtol=1e-10)
    # A closed one under the pressure 2: the normal force is not the springs'.
    a = at_point((0.3, -0.1), (7.0, p), before=(0.2, 0.0), step=dt)
    pieces = rccm().pieces(a)
    energy = C_T * 0.25
    beta = fallen(energy, BETA, dt)
    assert beta < BETA
    for code, sense in ((PLUS, 1.0), (MINUS, -1.0)):
        for damage, b in ((0, BETA), (DAMAGING, beta)):
            shear = -sense * MU * (1 - b) * p - C_T * b**2 * 0.5
            np.testing.assert_allclose(value(pieces[code + damage].answer), [shear, p], rtol=1e-9)
    scale = np.sqrt(W * (C_N + C_T))
    slack = scale * (1 - energy * BETA / W)
    for code in (OPEN, STICK, PLUS, MINUS):
        border = pieces[code].borders[-1]
        assert border.target == code + DAMAGING
        if code != OPEN:
            assert value(border.distance) == pytest.approx(slack)
        back = [b for b in pieces[code + DAMAGING].borders if b.target == code]
        assert len(back) == 1
        if code != OPEN:
            assert value(back[0].distance) == pytest.approx(-slack)
    # The whole reaction: springs that are pressed together add to the pressure.
    soft = RCCM(C_N, C_T, W, friction=MU, beta=BETA, threshold="reaction")
    assert value(soft.bound(at_point((0.0, -0.3)), 2.0)) == pytest.approx(
        MU * (1 - BETA) * (2.0 + BETA**2 * C_N * 0.2)
    )
    assert value(soft.bound(at_point((0.0, 0.3)), 2.0)) == pytest.approx(
        MU * (1 - min(BETA, W / (C_N * 0.16))) * 2.0
    )


def test_bonds_that_recover():
    """At closed points, up to 1; one that was broken begins where it is."""
    dt = 0.25
    law = rccm(recovers=True)
    origin = {"origin_x": 0.1, "origin_y": 0.0}
    names = [n for n in law.memory(2) if "origin" in n]
    kept = dict(zip((n.lstrip(".") for n in names), origin.values(), strict=True))
    a = at_point((0.0, -0.1), (0.0, 2.0), before=(0.15, 0.0), step=dt, closed=1.0, **kept)
    bond = law.bond(a)
    energy = C_T * 0.05**2
    beta = min((B * BETA + dt * W) / (B + dt * energy), 1.0)
    assert value(bond.after["beta"]) == pytest.approx(beta)
    assert beta > BETA
    assert value(bond.spent) == pytest.approx(0.5 * energy * (BETA + beta) * (BETA - beta))
    assert value(bond.after[".closed"]) == 1.0
    assert [value(bond.after[n]) for n in names] == pytest.approx(list(origin.values()))
    np.testing.assert_allclose(value(bond.traction), [-(beta**2) * C_T * 0.05, 0.0], atol=1e-14)
    # Open before, it may only fall; broken, its springs are at rest where it is now.
    still = law.bond(
        at_point((0.0, -0.1), (0.0, 2.0), before=(0.15, 0.0), step=dt, closed=0.0, **kept)
    )
    assert value(still.after["beta"]) == BETA
    new = rccm(recovers=True, beta=1e-7).bond(a)
    assert value(new.after["beta"]) == pytest.approx((B * 1e-7 + dt * W) / B)
    assert [value(new.after[n]) for n in names] == pytest.approx([0.15, -0.1])
    np.testing.assert_allclose(value(new.traction), 0.0, atol=1e-14)
    opened = law.bond(
        at_point((0.0, 0.4), (0.0, 0.0), before=(0.15, 0.0), step=dt, closed=1.0, **kept)
    )
    assert value(opened.after[".closed"]) == 0.0


# -- compliant surfaces, and what creeps ----------------------------------------------------------


@pytest.mark.parametrize("m", [1.0, 1.5, 3.0])
@pytest.mark.parametrize("down", [0.2, -0.3])
def test_the_pressure_of_a_compliant_surface(m, down):
    """C u^m of a penetration; with m = 1 of what is augmented, so that it is linear."""
    a = at_point((0.4, -0.1 - down), (0.7, 1.5))
    law = NormalCompliance(ufl.as_ufl(3.0), m, Coulomb(0.3), ufl.as_ufl(2.0))
    b = law.with_pressure(a)
    if m == 1:
        assert value(b.p) == pytest.approx(3.0 / 8.0 * (1.5 + 5.0 * down))
        assert value(b.touch) == value(b.p)
    else:
        assert value(b.p) == pytest.approx(3.0 * np.sign(down) * abs(down) ** m)
        assert value(b.touch) == pytest.approx(5.0 * down)
    np.testing.assert_allclose(
        value(b.s), [2.0 / 7.0 * (0.7 - 5.0 * 0.4), 0.0], rtol=1e-12, atol=1e-14
    )
    plain = NormalCompliance(ufl.as_ufl(3.0), m).with_pressure(a)
    np.testing.assert_allclose(value(plain.s), [0.7 - 5.0 * 0.4, 0.0], rtol=1e-12, atol=1e-14)
    assert law.lacks(history=True)
    assert law.lacks(history=False) == ""


SHAPES = {
    "tanh": np.tanh,
    "sqrt": lambda x: x / np.sqrt(1 + x**2),
    "polynomial": lambda x: (3 * x - x**3) / 2 if x < 1 else 1.0,
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("x", [1e-6, 1e-3, 0.3, 0.999, 1.001, 4.0, 60.0])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_shears_that_grow_with_the_slip(shape, x, sense):
    """B phi(x) against the slip, in one status below x = 1 and in one beyond."""
    eps, p = 0.05, 2.0
    a = at_point((sense * x * eps, -0.1), (0.0, p))
    law = Regularised(Coulomb(0.3), ufl.as_ufl(eps), shape)
    pieces = law.shears(a)
    expected = -sense * 0.3 * p * SHAPES[shape](x)
    code = STICK if x < 1 else PLUS if sense > 0 else MINUS
    found = value(pieces[code].answer)
    np.testing.assert_allclose(found, [expected, 0.0], rtol=1e-9, atol=1e-14)
    along = sense * x * eps
    targets = {b.target: value(b.distance) for b in pieces[STICK].borders}
    assert targets == pytest.approx({MINUS: 5 * (eps + along), PLUS: 5 * (eps - along)})
    for code, distance in ((MINUS, -along - eps), (PLUS, along - eps)):
        (border,) = pieces[code].borders
        assert (border.target, value(border.distance)) == (STICK, pytest.approx(5 * distance))
    entered = {code: holds(c) for code, c in law.entered(a).items()}
    assert entered == {
        STICK: x < 1,
        PLUS: x > 1 and sense > 0,
        MINUS: x > 1 and sense < 0,
    }


@pytest.mark.parametrize("part", [0.01, 0.99, 1.01])
def test_the_series_of_a_hyperbolic_tangent(part):
    """Near no slip at all it is as good as the quotient."""
    x = np.sqrt(part * _SERIES)
    below, beyond = (value(f) for f in _tanh(ufl.as_ufl(float(x**2))))
    assert below == beyond == pytest.approx(np.tanh(x) / x, rel=0, abs=1e-15)


def test_shears_that_creep_in_space():
    eps = 0.05
    law = Regularised(Coulomb(0.3), ufl.as_ufl(eps), "sqrt", ufl.as_ufl(0.5))
    for size, step, width in ((0.03, -1.0, 0.05), (0.2, -1.0, 0.05), (0.03, 0.25, 0.125)):
        u = size * np.array([0.6, -0.8])
        a = at_point((*u, -0.1), (0.0, 0.0, 2.0), step=step)
        pieces = law.shears(a)
        x = size / width
        code, other = (STICK, PLUS) if x < 1 else (PLUS, STICK)
        shear = -0.3 * 2.0 * x / np.sqrt(1 + x**2) * np.array([0.6, -0.8])
        np.testing.assert_allclose(value(pieces[code].answer), [*shear, 0.0], rtol=1e-9, atol=1e-14)
        (border,) = pieces[code].borders
        assert (border.target, value(border.distance)) == (
            other,
            pytest.approx(5 * abs(width - size)),
        )
        entered = {c: holds(e) for c, e in law.entered(a).items()}
        assert entered == {STICK: x < 1, PLUS: x > 1}
    fast = Regularised(Coulomb(0.3), speed=ufl.as_ufl(0.5))
    assert value(fast._eps(at_point((0.0, 0.0), step=0.25))) == 0.125
    assert value(fast._eps(at_point((0.0, 0.0), step=0.0))) == 0.5
    assert fast.lacks(history=False)
    assert fast.lacks(history=True) == ""
    slow = Regularised(Coulomb(0.3), 0.1)
    assert slow.lacks(history=True)
    assert slow.lacks(history=False) == ""


# -- interfaces -----------------------------------------------------------------------------------


class State:
    """What an interface sees, in numbers."""

    def __init__(self, jump=(0.0, 0.0), pressure=0.0, **internal):
        self.jump = vector(jump)
        self.opening = ufl.as_ufl(float(jump[1]))
        self.moved = vector((jump[0], 0.0))
        self.pressure = ufl.as_ufl(float(pressure))
        self._internal = internal

    def __getitem__(self, name):
        v = self._internal[name]
        return vector(v) if np.ndim(v) else ufl.as_ufl(float(v))


class Rates(State):
    def __init__(self, slip, **internal):
        super().__init__(**internal)
        self.slip = ufl.as_ufl(float(slip))


def test_a_bilinear_bond():
    """Its traction rises to the strength, and falls to none; what it costs is the area below."""
    T, a, b, mu = 3.0, 0.2, 0.5, 0.4
    law = BilinearCohesive(*(ufl.as_ufl(v) for v in (T, a, b, mu)))
    assert (
        value(BilinearCohesive(T, a, b).friction) == value(BilinearCohesive(T, a, b).damage) == 0.0
    )

    def reached(D):
        """The jump from which a bond of this damage softens: its line meets the falling one."""
        return brentq(lambda K: (1 - D) * T / a * K - T * (a + b - K) / b, 0.0, a + b)

    for D in (0.0, 0.3, 0.9):
        state = State((0.3, 0.4), 2.0, damage=D)
        assert value(law.energy(state)) == pytest.approx((1 - D) * T / a * 0.25 / 2)
        K = reached(D)
        phi = law.dissipation(Rates(0.7, damage=0.6), state)
        assert value(phi) == pytest.approx(T / a * K**2 / 2 * 0.6 + mu * D * 2.0 * 0.7)
    cost = value(law.cost(State(damage=0.2), State(damage=0.7)))
    area, _ = quad(lambda D: T / a * reached(D) ** 2 / 2, 0.2, 0.7)
    assert cost == pytest.approx(area)


def test_a_layer_of_springs_and_a_dashpot():
    k, b, c, mu = 3.0, 2.0, 0.5, 0.4
    law = MaxwellLayer(*(ufl.as_ufl(v) for v in (k, b, c, mu)))
    state = State((0.3, -0.4), 2.0, flow=(0.1, 0.2))
    assert value(law.energy(state)) == pytest.approx(k * (0.04 + 0.36) / 2 + c * 0.25 / 2)
    rates = Rates(0.7, flow=(0.6, 0.8))
    assert value(law.dissipation(rates, state)) == pytest.approx(b / 2 + mu * 2.0 * 0.7)
    plain = MaxwellLayer(k, b)
    assert (plain.lasting, plain.friction) == (0.0, 0.0)


# -- steps of no length ---------------------------------------------------------------------------


@pytest.mark.parametrize("step", [0.0, -1.0])
def test_what_a_step_decides(step):
    """Comparisons with numbers from 0 on alone where it is any negative one."""
    symbol = ufl.variable(ufl.as_ufl(7.0))
    any_sign = step == 0.0
    for compare, number, answer in (
        (ufl.gt, 0.0, False),
        (ufl.ge, 0.0, any_sign),
        (ufl.lt, 0.0, not any_sign),
        (ufl.gt, 0.5, False),
        (ufl.lt, 0.5, True),
        (ufl.gt, -0.5, True if any_sign else None),
        (ufl.lt, -2.0, False if any_sign else None),
    ):
        e = ufl.conditional(compare(symbol, number), 1.0, 2.0)
        found = known_step(e, symbol, step)
        if answer is None:
            assert isinstance(found, ufl.classes.Conditional)
        else:
            assert value(found) == (1.0 if answer else 2.0)


# -- pieces of laws -------------------------------------------------------------------------------


@pytest.mark.parametrize(("damage", "changes"), [(0.3, True), (1.0, False)])
def test_a_bond_at_its_end_is_broken(damage, changes):
    """There is no status left in which it is whole, or damages."""
    law = BilinearCohesive(*(ufl.as_ufl(v) for v in (3.0, 0.2, 0.5, 0.4, damage)))
    a = at_point((0.3, 0.4), (1.0, 2.0))
    numbers = {name: (ufl.as_ufl(0.5),) * 9 for name in law.unknowns(2)}
    pieces = law.pieces(replace(a, solved=numbers))
    assert {code // DAMAGING * DAMAGING for code in pieces} == {0, DAMAGING, BROKEN}
    for code, piece in pieces.items():
        if code < BROKEN:
            assert holds(piece.exists) is changes
        elif piece.exists is not None:
            assert holds(piece.exists)


def test_borders_that_are_none():
    """Something that is no distance, or a vector, or leads to no status."""
    zero = ufl.as_vector([0.0, 1.0])
    for border, words in (
        (Border("far", OPEN), "distance of a border must be a UFL scalar"),
        (Border(zero, OPEN), "distance of a border must be a UFL scalar"),
        ("near", "a border must be a Border"),
        (Border(ufl.as_ufl(1.0), PLUS), "target of a border must be one of .*; got 2"),
    ):
        with pytest.raises(ValueError, match=words):
            checked_pieces({OPEN: StatusPiece(zero, [border])}, 2)
    for answer in (ufl.as_ufl(1.0), ufl.as_vector([1.0, 2.0, 3.0]), "none"):
        with pytest.raises(ValueError, match="a UFL vector of 2 components"):
            checked_pieces({OPEN: StatusPiece(answer, [])}, 2)
    for code in (-1, "open", BROKEN + DAMAGING, 7):
        with pytest.raises(ValueError, match=r"is none of laws\.status"):
            checked_pieces({code: StatusPiece(zero, [])}, 2)
    for none in ({}, [1], None):
        with pytest.raises(ValueError, match="must return a dictionary"):
            checked_pieces(none, 2)
    with pytest.raises(ValueError, match="must be a StatusPiece"):
        checked_pieces({OPEN: zero}, 2)


def test_the_status_whose_borders_are_nearest():
    """The first that holds; else the one that is violated least; NaN holds nothing."""
    nan, inf = np.nan, np.inf
    rows = [
        # Of three statuses the least distance to their borders, and whether they exist.
        ((1.0, 2.0, -1.0), (1, 1, 1), 0, 1.0),
        ((-1.0, 0.0, 3.0), (1, 1, 1), 1, 0.0),
        ((-3.0, -1.0, -2.0), (1, 1, 1), 1, -1.0),
        ((9.0, -1.0, -2.0), (0, 1, 1), 1, -1.0),
        ((nan, -1.0, -2.0), (1, 1, 1), 1, -1.0),
        ((nan, 1.0, -2.0), (1, 1, 1), 1, 1.0),
        ((inf, 1.0, 1.0), (1, 1, 1), 0, inf),
    ]
    distance = np.array([r[0] for r in rows])
    exists = np.array([r[1] for r in rows], dtype=bool)
    codes = (OPEN, STICK, PLUS)
    known = SimpleNamespace(
        _values=np.zeros(len(rows)),
        _law=SimpleNamespace(codes=codes),
        _borders=lambda code: (distance[:, [code, code]], exists[:, code], []),
    )
    found, worst = Answers._nearest.func(known)
    assert found.tolist() == [codes[r[2]] for r in rows]
    np.testing.assert_allclose(np.minimum(worst, 1e300), np.minimum([r[3] for r in rows], 1e300))
    missed = Answers.missed.fget(SimpleNamespace(_nearest=(found, worst)))
    np.testing.assert_allclose(missed, [0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0])
