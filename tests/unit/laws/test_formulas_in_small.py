"""What laws answer at a point, in numbers: friction, interfaces and tables, with units not 1."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, ClassVar

from mpi4py import MPI

import numpy as np
import pytest
from scipy.integrate import quad
from test_laws_in_small import State, at_point, holds, value, vector

import ufl
from ufl.algorithms import expand_derivatives

from dolfinx_contact import (
    BilinearCohesive,
    Coulomb,
    Frictionless,
    MaxwellLayer,
    NonlocalCoulomb,
    NormalCompliance,
    Regularised,
    Tresca,
)
from dolfinx_contact.laws import RCCM, Answers, Internal, coulomb, status
from dolfinx_contact.laws.answers import HeldAnswers
from dolfinx_contact.laws.cones import _needed, no_cones
from dolfinx_contact.laws.damage import DamageStep, least_energy
from dolfinx_contact.laws.friction import FrictionLaw
from dolfinx_contact.laws.interface import Interface
from dolfinx_contact.laws.interface_point import InterfacePoint
from dolfinx_contact.laws.law import Law, obeys
from dolfinx_contact.laws.spreading import KERNELS
from dolfinx_contact.laws.status import BROKEN, DAMAGING, MINUS, OPEN, PLUS, STICK, WHERE_OPEN
from dolfinx_contact.laws.symbols import AROUND, SLID, STEP, Symbols, before, from_memory

COMM = MPI.COMM_WORLD
R = 5.0  # the augmentation of `at_point`, whose gap is 0.1


def number(v):
    return ufl.as_ufl(float(v))


def symbol(v):
    """A number that UFL does not know to be 0."""
    return ufl.variable(number(v))


def distances(piece):
    """Of a piece its borders: distance by the status beyond, where there is one."""
    return {b.target: value(b.distance) for b in piece.borders if b.where is None or holds(b.where)}


# -- points ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
def test_what_a_law_sees_at_a_point(dim):
    """Normal and tangential parts of jump and traction, along a normal that is no axis."""
    rng = np.random.default_rng(dim)
    n = np.array([0.6, 0.8]) if dim == 2 else np.array([2.0, -1.0, 2.0]) / 3
    j, t = rng.normal(size=(2, dim))
    a = replace(at_point(j, t), n=vector(n))
    along = np.eye(dim) - np.outer(n, n)
    assert value(a.u_n) == pytest.approx(n @ j - 0.1)
    np.testing.assert_allclose(value(a.u_t), along @ j, atol=1e-14)
    assert value(a.p) == pytest.approx(-(n @ t) + R * (n @ j - 0.1))
    assert value(a.touch) == value(a.p)
    np.testing.assert_allclose(value(a.s), along @ (t - R * j), atol=1e-13)
    if dim == 2:
        np.testing.assert_allclose(value(a.t), [-0.8, 0.6])
    soft = replace(a, pressure=number(7), shear=vector(j), touches=number(9))
    assert (value(soft.p), value(soft.touch)) == (7.0, 9.0)
    np.testing.assert_allclose(value(soft.s), j)
    assert a.slid_before == 0.0


def test_which_numbers_are_as_they_must_be():
    """Signs, but for round-off; what is positive is not zero."""
    v = np.array([-1e-13, -1e-15, 0.0, 1e-15, 1.0, 1 + 1e-15, 1 + 1e-13])
    assert obeys("any", v).tolist() == [True] * 7
    assert obeys("nonnegative", v).tolist() == [False] + [True] * 6
    assert obeys("positive", v).tolist() == [False] * 3 + [True] * 4
    assert obeys("fraction", v).tolist() == [False] + [True] * 5 + [False]
    assert obeys("nonnegative", v, 0.0).tolist() == [False] * 2 + [True] * 5
    assert obeys("fraction", v, 0.0).tolist() == [False] * 2 + [True] * 3 + [False] * 2


def test_what_laws_are_by_default():
    law = Law()
    a = at_point((0.0, 0.0))
    assert law.bound(a, 1.0) is law.bond(a) is law.averaging is law.weakening is law.kind is None
    assert law.with_pressure(a) is a
    assert law.lacks(history=True) == law.lacks(history=False) == ""
    assert (law.unknowns(2), law.equations(a), law.memory(2), law.given) == ({}, {}, [], {})
    assert (law.needs_pressure, law.compliant, law.creeps) == (True, False, False)
    assert (law.bound_kind, law.needs_time, law.signs) == (None, (), {})
    assert law.having({}) is law
    with pytest.raises(NotImplementedError, match="Law has no method pieces"):
        law.pieces(a)
    with pytest.raises(NotImplementedError, match="FrictionLaw has no method bound"):
        FrictionLaw().bound(a, 1.0)


def test_names_of_what_memory_has():
    """Fields of the law first, then what begins with a dot, component by component."""

    class Own(Law):
        internal = (
            Internal("flow", vector=True),
            Internal("hid", hidden=True),
            Internal("d", "grows", end=1.0),
            Internal("e"),
        )

    law = Own()
    assert law.memory(2) == ["d", "e", ".flow_0", ".flow_1", ".hid"]
    assert law.memory(3) == ["d", "e", ".flow_0", ".flow_1", ".flow_2", ".hid"]
    assert law.variables(2) == {"flow_0": ".flow_0", "flow_1": ".flow_1", "d": "d", "e": "e"}
    assert law.weakening is Own.internal[2]
    plain = Internal("x")
    assert (plain.change, plain.end, plain.vector, plain.hidden) == ("any", None, False, False)
    assert (plain.sense, plain.is_field) == (0, True)
    assert not Internal("x", vector=True).is_field
    assert not Internal("x", hidden=True).is_field
    for wrong, words in (
        ({"name": ""}, "needs a name"),
        ({"name": 3}, "needs a name"),
        ({"change": "falls", "end": True}, "must be a number"),
        ({"change": "falls", "end": np.inf}, "must be a number"),
        ({"change": "falls", "end": "x"}, "must be a number"),
        ({"end": 0.0}, "of a variable that falls or grows"),
    ):
        with pytest.raises(ValueError, match=words):
            Internal(**{"name": "x"} | wrong)
    assert Internal("x", "falls", end=np.float64(-2.0)).end == -2.0
    assert Internal("x", "falls", end=3).sense == -1


def test_columns_of_what_a_law_is_given():
    """Jump, traction, normal, gap and augmentation, then fields, then what equations give."""
    memory = from_memory(3, [".y"])
    assert memory == [*before(3), STEP, SLID, ".y"]
    assert before(3) == [".before_0", ".before_1", ".before_2"]
    s = Symbols(3, ["F"], [".y"], {"one": 2, "two": 1}, memory, local=False)
    assert s.names == ["F", *memory, AROUND]
    n = len(s.names)
    assert s.w.function_space.dofmap.bs * s.w.function_space.element.basix_element.dim >= 1

    def column(e):
        e = e.ufl_operands[0] if isinstance(e, ufl.classes.Variable) else e
        assert e.ufl_operands[0] is s.w
        return int(e.ufl_operands[1][0])

    vectors = [
        [column(e) for e in v.ufl_operands[0].ufl_operands] for v in (s.jump, s.traction, s.n)
    ]
    assert vectors == [[0, 1, 2], [3, 4, 5], [6, 7, 8]]
    point = s.point
    assert (column(point.gap), column(point.r)) == (9, 10)
    assert [column(f) for f in s.fields] == list(range(11, 11 + n))
    first = 11 + n
    one, two = s.solved["one"], s.solved["two"]
    assert (one.first, two.first) == (first, first + 6)
    assert [column(x) for x in one.numbers] == [first, first + 1]
    assert [[column(x) for x in row] for row in one.inverse] == [
        [first + 2, first + 3],
        [first + 4, first + 5],
    ]
    assert [column(x) for x in two.numbers] == [first + 6]
    assert column(two.inverse[0][0]) == first + 7
    assert s.w.function_space.dofmap.bs == first + 8
    assert s.of_the_law == {"F": s.fields[0]}
    assert s.step is s.fields[1 + memory.index(STEP)]
    assert point.around is s.fields[-1]
    assert point.kept == {".y": s.fields[1 + memory.index(".y")]}
    labels = [v.ufl_operands[1].count() for v in (s.jump, s.traction, s.n, *s.fields)]
    labels += [x.ufl_operands[1].count() for x in (*one.numbers, *two.numbers)]
    assert len(set(labels)) == len(labels)
    few = Symbols(2, ["F"], [], {}, [], local=True)
    assert (few.names, few.step, few.solved) == (["F"], None, {})
    assert few.point.around is None
    assert value(few.point.step) == few.point.slid_before == 0.0
    # Of the jump before all or nothing is used; what is not there is not.
    assert s.used([s.fields[1] * 2.0, s.fields[0]]) == before(3)
    assert s.used([s.step, s.point.kept[".y"]]) == [STEP, ".y"]
    assert s.used([s.fields[0]]) == []


# -- friction -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Weakening(FrictionLaw):
    """A coefficient that falls with the distance slipped."""

    at_rest: Any
    slope: Any

    def bound(self, a, p):
        return (self.at_rest - self.slope * a.slid) * p


@pytest.mark.parametrize("slip", [0.2, -0.3, 0.0])
def test_friction_that_weakens_in_the_plane(slip):
    """In a slip by what is slipped then, which is never backwards but for round-off."""
    F, c, p = 0.4, 0.5, 2.0
    a = replace(at_point((slip, -0.1), (0.7, p)), slid_before=number(0.1))
    assert value(a.p) == pytest.approx(p)
    law = Weakening(number(F), number(c))
    pieces = law.pieces(a)
    s = 0.7 - R * slip
    least = -1e-9 * p / R

    def radius(way):
        return (F - c * (0.1 + max(way, least))) * p

    np.testing.assert_allclose(value(pieces[STICK].answer), [s, p], rtol=1e-12)
    np.testing.assert_allclose(value(pieces[PLUS].answer), [-radius(slip), p], rtol=1e-12)
    np.testing.assert_allclose(value(pieces[MINUS].answer), [radius(-slip), p], rtol=1e-12)
    assert distances(pieces[STICK]) == pytest.approx(
        {OPEN: p, PLUS: radius(slip) + s, MINUS: radius(-slip) - s}
    )
    right, left = distances(pieces[PLUS]), distances(pieces[MINUS])
    assert right[OPEN] == left[OPEN] == pytest.approx(p)
    assert right[STICK] == pytest.approx(-s - radius(slip) if slip >= least else R * slip)
    assert left[STICK] == pytest.approx(s - radius(-slip) if -slip >= least else -R * slip)
    closing = {b.target: b.where for b in pieces[OPEN].borders}
    assert {value(b.distance) for b in pieces[OPEN].borders} == {-value(a.p)}
    assert holds(closing[MINUS]) is (s > 0)
    assert holds(closing[PLUS]) is (s <= 0)
    np.testing.assert_allclose(value(pieces[OPEN].answer), 0.0)


@pytest.mark.parametrize("way", [0.2, -0.2])
@pytest.mark.parametrize("size", [3.0, 0.03])
def test_friction_that_weakens_in_space(way, size):
    """Along the shear, by what of the displacement is against it."""
    F, c, p = 0.4, 0.5, 2.0
    e = np.array([0.6, -0.8])
    u = way * e + 0.05 * np.array([0.8, 0.6])
    t = R * u - size * e
    a = replace(at_point((*u, -0.1), (*t, p)), slid_before=number(0.1))
    pieces = Weakening(number(F), number(c)).pieces(a)
    radius = (F - c * (0.1 + max(way, -1e-9 * p / R))) * p
    np.testing.assert_allclose(value(pieces[PLUS].answer), [*(-radius * e), p], rtol=1e-12)
    np.testing.assert_allclose(value(pieces[STICK].answer), [*(-size * e), p], rtol=1e-12)
    assert distances(pieces[STICK]) == pytest.approx({OPEN: p, PLUS: radius - size})
    ends = size - radius if way >= 0 else R * way
    assert distances(pieces[PLUS]) == pytest.approx({OPEN: p, STICK: ends})
    assert [(b.target, b.where) for b in pieces[OPEN].borders] == [(PLUS, None)]
    # Where nothing shears a slip has no direction.
    still = replace(at_point((*u, -0.1), (*(R * u), p)), slid_before=number(0.1))
    pieces = Weakening(number(F), number(c)).pieces(still)
    np.testing.assert_allclose(value(pieces[PLUS].answer), [0, 0, p], atol=1e-14)
    held = (F - c * 0.1) * p
    assert distances(pieces[STICK]) == pytest.approx({OPEN: p, PLUS: held})
    assert distances(pieces[PLUS])[STICK] == pytest.approx(-held)


def test_given_friction_acts_on_open_points():
    """By a bound that knows no pressure, under statuses of their own."""
    g, p = 1.5, -0.4
    a = at_point((0.1, 0.0), (0.2, p + 0.5))
    assert value(a.p) == pytest.approx(p)
    pieces = Tresca(number(g)).pieces(a)
    s = 0.2 - R * 0.1
    assert set(pieces) == {c + w for c in (STICK, PLUS, MINUS) for w in (0, WHERE_OPEN)}
    for code, shear in ((STICK, s), (PLUS, -g), (MINUS, g)):
        np.testing.assert_allclose(value(pieces[code].answer), [shear, p], atol=1e-14)
        np.testing.assert_allclose(
            value(pieces[code + WHERE_OPEN].answer), [shear, 0.0], atol=1e-14
        )
        here, there = distances(pieces[code]), distances(pieces[code + WHERE_OPEN])
        assert here.pop(code + WHERE_OPEN) == pytest.approx(p)
        assert there.pop(code) == pytest.approx(-p)
        assert {k + WHERE_OPEN: v for k, v in here.items()} == pytest.approx(there)
    assert distances(pieces[STICK + WHERE_OPEN]) == pytest.approx(
        {STICK: -p, PLUS + WHERE_OPEN: g + s, MINUS + WHERE_OPEN: g - s}
    )
    # Without a bound nothing is held, and no slip ends.
    none = Tresca(symbol(0.0)).pieces(a)
    assert not holds(none[STICK].exists)
    assert not holds(none[MINUS].exists)
    assert none[PLUS].exists is None
    assert set(distances(none[PLUS])) == {PLUS + WHERE_OPEN}


def test_contact_without_friction():
    for law in (Frictionless(), Coulomb(0.0)):
        pieces = law.pieces(at_point((0.3, -0.2), (0.7, 1.5)))
        assert set(pieces) == {OPEN, PLUS}
        p = 1.5 + R * 0.1
        np.testing.assert_allclose(value(pieces[PLUS].answer), [0.0, p])
        np.testing.assert_allclose(value(pieces[OPEN].answer), 0.0)
        assert distances(pieces[PLUS]) == {OPEN: pytest.approx(p)}
        assert distances(pieces[OPEN]) == {PLUS: pytest.approx(-p)}
    assert (Frictionless.bound_kind, Coulomb.bound_kind, Tresca.bound_kind) == (
        "proportional",
        "proportional",
        "given",
    )
    assert value(Coulomb(number(0.3)).bound(None, number(2.0))) == pytest.approx(0.6)
    assert holds(Coulomb(number(0.1)).grips(None))
    assert not holds(Coulomb(number(0.0)).grips(None))


def test_friction_by_the_pressure_around():
    law = NonlocalCoulomb(number(0.4), 2)
    for around, grips in ((3.0, True), (0.0, False), (-1.0, False)):
        a = replace(at_point((0.0, -0.1)), around=number(around))
        assert value(law.bound(a, number(99.0))) == pytest.approx(0.4 * around)
        assert holds(law.holds(a)) is grips
    a = replace(at_point((0.0, -0.1)), around=number(3.0))
    assert not holds(NonlocalCoulomb(number(0.0), 2).holds(a))
    assert law.averaging == ("mollifier", 2.0, True)
    assert law.name == "NonlocalCoulomb(2, mollifier)"
    assert list(law.given) == ["friction"]
    assert not law.needs_pressure
    for wrong, words in (
        ({"radius": 0.0}, "radius of NonlocalCoulomb must be a finite and positive"),
        ({"radius": -1.0}, "radius"),
        ({"radius": np.inf}, "radius"),
        ({"radius": "x"}, "radius"),
        ({"radius": True}, "radius"),
        ({"kernel": "hat"}, "kernel of NonlocalCoulomb must be one of mollifier, biweight"),
        ({"kernel": 2}, "kernel"),
        ({"normalised": 1}, "normalised of NonlocalCoulomb must be True or False"),
    ):
        with pytest.raises(ValueError, match=words):
            NonlocalCoulomb(0.3, **{"radius": 1.0} | wrong)


def test_kernels_between_centre_and_radius():
    """By their formulas, the same on either side; steep but not cut off just inside."""
    for x in (0.3, 0.7, 0.99):
        assert KERNELS["mollifier"](x) == pytest.approx(np.e * np.exp(-1 / (1 - x**2)))
        assert KERNELS["biweight"](x) == pytest.approx((1 - x**2) ** 2)
        for kernel in KERNELS.values():
            assert kernel(np.array([-x])) == kernel(np.array([x]))
    for x in (1.0, 1.2, 5.0):
        assert [float(kernel(x)) for kernel in KERNELS.values()] == [0.0, 0.0]


# -- compliant surfaces ---------------------------------------------------------------------------


def test_laws_around_another_one():
    """Fields of the law inside have its name before theirs."""
    law = NormalCompliance(3.0, 2, Coulomb(0.3))
    assert law.given == {"stiffness": 3.0, "friction.friction": 0.3}
    assert law.signs == {
        "stiffness": "positive",
        "tangential": "positive",
        "friction.friction": "nonnegative",
    }
    assert law.name == "NormalCompliance(2.0) of Coulomb"
    assert (law.compliant, law.bound_kind, law.needs_pressure, law.creeps) == (
        True,
        None,
        True,
        False,
    )
    assert law.needs_time == ()
    assert law.lacks(history=True) == ""
    other = law.having({"stiffness": 5.0, "friction.friction": 0.4})
    assert (other.stiffness, other.friction, other.exponent) == (5.0, Coulomb(0.4), 2)
    held = replace(law, tangential=2.0)
    assert held.needs_time == ("tangential",)
    assert held.given["tangential"] == 2.0
    creeps = replace(law, friction=Regularised(Coulomb(0.3), speed=0.1))
    assert creeps.needs_time == ("friction.speed",)
    assert creeps.creeps
    assert creeps.lacks(history=False)
    assert not replace(law, friction=Tresca(1.0)).needs_pressure
    assert replace(law, friction=NonlocalCoulomb(0.3, 2.0)).averaging.radius == 2.0
    kinds = [
        law.kind,
        held.kind,
        replace(law, exponent=3).kind,
        replace(law, friction=Tresca(1.0)).kind,
    ]
    assert len(set(kinds)) == 4
    assert replace(law, stiffness=7.0).kind == law.kind
    assert (NormalCompliance(1.0).exponent, NormalCompliance(1.0).tangential) == (1.0, None)
    for wrong, words in (
        ({"exponent": 0.999}, "exponent of NormalCompliance must be at least 1, got 0.999"),
        ({"exponent": np.inf}, "exponent"),
        ({"exponent": "x"}, "exponent"),
        ({"exponent": True}, "exponent"),
        ({"friction": 0.3}, "friction of NormalCompliance must be a law of friction"),
        ({"friction": law}, "friction of NormalCompliance"),
    ):
        with pytest.raises(ValueError, match=words):
            NormalCompliance(**{"stiffness": 1.0} | wrong)


def test_regularised_laws():
    law = Regularised(Coulomb(0.3), 0.1)
    assert (law.shape, law.speed, law.creeps, law.bound_kind) == ("tanh", None, True, None)
    assert law.needs_time == ("width",)
    assert Regularised(Coulomb(0.3), 0.1, "sqrt", 0.2).needs_time == ("width", "speed")
    assert law.name == "Regularised(tanh) of Coulomb"
    for given, words in (
        (
            (Coulomb(0.3), 0.1, "cubic"),
            "must be one of tanh, sqrt, polynomial, linear, got 'cubic'",
        ),
        ((Coulomb(0.3), 0.1, ["tanh"]), "must be one of"),
        ((Coulomb(0.3),), "needs a width, or a speed, or both"),
        ((0.3, 0.1), "takes a law of friction"),
        ((NormalCompliance(1.0), 0.1), "takes a law of friction"),
    ):
        with pytest.raises(ValueError, match=words):
            Regularised(*given)
    both = Regularised(Coulomb(0.3), number(0.1), speed=number(0.5))
    for step, eps in ((0.25, 0.125), (0.0, 0.1), (-1.0, 0.1)):
        assert value(both._eps(at_point((0.0, 0.0), step=step))) == eps


def test_a_shear_that_grows_linearly():
    """As a spring up to the bound, with what is augmented as in stick."""
    eps, p = 0.05, 2.0
    law = Regularised(Coulomb(number(0.3)), number(eps), "linear")
    a = at_point((0.02, -0.1), (0.7, p))
    pieces = law.shears(a)
    b = 0.3 * p
    s = b / (b + R * eps) * (0.7 - R * 0.02)
    np.testing.assert_allclose(value(pieces[STICK].answer), [s, 0.0], rtol=1e-12)
    np.testing.assert_allclose(value(pieces[PLUS].answer), [-b, 0.0], rtol=1e-12)
    assert distances(pieces[STICK]) == pytest.approx({MINUS: b - s, PLUS: b + s})
    # At a state that obeys it the shear is that of the spring.
    t = -b * 0.02 / eps
    there = law.shears(at_point((0.02, -0.1), (t, p)))
    np.testing.assert_allclose(value(there[STICK].answer), [t, 0.0], rtol=1e-12)


@pytest.mark.parametrize("m", [1.0, 2.0])
def test_a_compliant_surface_with_friction(m):
    """Its statuses are those of its own pressure; open points come to touch where the gap ends."""
    C = 3.0
    a = at_point((0.0, -0.3), (0.1, 1.5))
    p = 3.0 / 8.0 * (1.5 + R * 0.2) if m == 1 else C * 0.2**2
    touch = p if m == 1 else R * 0.2
    pieces = NormalCompliance(number(C), m, Coulomb(number(0.3))).pieces(a)
    np.testing.assert_allclose(value(pieces[PLUS].answer), [-0.3 * p, p], rtol=1e-12)
    np.testing.assert_allclose(value(pieces[STICK].answer), [0.1, p], rtol=1e-12)
    assert distances(pieces[STICK]) == pytest.approx(
        {OPEN: touch, PLUS: 0.3 * p + 0.1, MINUS: 0.3 * p - 0.1}
    )
    assert [value(b.distance) for b in pieces[OPEN].borders] == pytest.approx([-touch, -touch])


# -- bonds of the RCCM law ------------------------------------------------------------------------


def test_what_is_no_bond():
    RCCM(1.0, 1.0, 1.0, exponent=0.1)
    RCCM(1.0, 1.0, 1.0, exponent=10, order=2, threshold="reaction")
    RCCM(1.0, 1.0, 1.0, recovers=True, contact=NormalCompliance(2.0))
    for wrong, words in (
        ({"exponent": 0.09}, "exponent of RCCM must be a number from 1/10 to 10"),
        ({"exponent": 10.1}, "exponent"),
        ({"exponent": "1"}, "exponent"),
        ({"exponent": True}, "exponent"),
        ({"order": 3}, "order of RCCM in time must be 1 or 2, got 3"),
        ({"order": True}, "order"),
        ({"order": 0}, "order"),
        ({"recovers": 1}, "recovers of RCCM must be True or False"),
        ({"recovers": True, "exponent": 2.0}, "recovers of RCCM"),
        ({"contact": 3.0}, "contact of RCCM must be None or a NormalCompliance"),
        ({"contact": NormalCompliance(1.0, friction=Coulomb(0.3))}, "contact of RCCM"),
        ({"contact": NormalCompliance(1.0, tangential=1.0)}, "contact of RCCM"),
        ({"threshold": "shear"}, "threshold of RCCM must be one of"),
    ):
        with pytest.raises(ValueError, match=words):
            RCCM(1.0, 1.0, 1.0, **wrong)


def test_what_bonds_remember():
    assert RCCM(1.0, 1.0, 1.0).memory(2) == ["beta"]
    two = RCCM(1.0, 1.0, 1.0, order=2)
    assert two.memory(2) == ["beta", ".rate", ".length", ".rest"]
    again = RCCM(1.0, 1.0, 1.0, recovers=True)
    assert again.memory(3) == ["beta", ".closed", ".origin_0", ".origin_1", ".origin_2"]
    assert again.variables(2) == {"beta": "beta"}
    assert again.weakening.sense == -1
    soft = RCCM(1.0, 2.0, 3.0, contact=NormalCompliance(4.0, 2))
    assert (soft.compliant, again.compliant) == (True, False)
    assert soft.given["stiffness"] == 4.0
    assert "stiffness" not in again.given
    other = soft.having({"normal": 5.0, "stiffness": 6.0})
    assert (other.normal, other.contact.stiffness, other.contact.exponent) == (5.0, 6.0, 2)
    assert soft.having({"normal": 5.0}).contact == soft.contact
    assert again.having({"work": 5.0}).work == 5.0
    kinds = {
        law.kind
        for law in (
            again,
            two,
            soft,
            RCCM(1.0, 1.0, 1.0),
            RCCM(1.0, 1.0, 1.0, exponent=2.0),
            RCCM(1.0, 1.0, 1.0, threshold="reaction"),
            RCCM(1.0, 1.0, 1.0, contact=NormalCompliance(1.0)),
        )
    }
    assert len(kinds) == 7
    assert replace(two, work=9.0).kind == two.kind


@pytest.mark.parametrize("down", [0.2, -0.4])
def test_a_bond_on_a_surface_that_gives_way(down):
    """Springs act both ways; the pressure is that of the surface, without theirs."""
    C_N, C_T, W, C, beta = 4.0, 6.0, 50.0, 3.0, 0.8
    law = RCCM(C_N, C_T, W, friction=0.3, beta=number(beta), contact=NormalCompliance(C))
    a = at_point((0.3, -0.1 - down), (0.7, 1.5))
    spring = beta**2 * C_N * down  # pushes the body up where it is pressed
    p = C / (C + R) * (1.5 - spring + R * down)
    assert value(law.with_pressure(a).p) == pytest.approx(p)
    pieces = law.pieces(a)
    shear = -C_T * beta**2 * 0.3
    mu = 0.3 * (1 - beta)
    np.testing.assert_allclose(value(pieces[PLUS].answer), [shear - mu * p, p + spring], rtol=1e-9)
    np.testing.assert_allclose(value(pieces[OPEN].answer), [shear, spring], rtol=1e-9)
    assert distances(pieces[OPEN])[PLUS] == pytest.approx(-p)
    bond = law.bond(a)
    np.testing.assert_allclose(value(bond.traction), [shear, spring], rtol=1e-9)
    assert value(bond.stored) == pytest.approx(beta**2 * (C_N * down**2 + C_T * 0.09) / 2)
    assert value(bond.spent) == pytest.approx(0.0, abs=1e-14)


def test_a_bond_that_is_pressed():
    """Under Signorini's conditions its springs are drawn by no penetration."""
    law = RCCM(40.0, 6.0, 0.5, friction=number(0.3), beta=number(0.8))
    a = at_point((0.4, -0.4), (7.0, 2.0))
    p = 2.0 + R * 0.3
    pieces = law.pieces(a)
    for code, beta in ((PLUS, 0.8), (PLUS + DAMAGING, 0.5 / (6.0 * 0.16))):
        shear = -0.3 * (1 - beta) * p - beta**2 * 6.0 * 0.4
        np.testing.assert_allclose(value(pieces[code].answer), [shear, p], rtol=1e-9)
    bond = law.bond(a)
    np.testing.assert_allclose(
        value(bond.traction), [-((0.5 / 0.96) ** 2) * 2.4, 0.0], rtol=1e-9, atol=1e-14
    )


def test_where_changes_of_bonds_end():
    """An intact one has no friction: what is pressed slips there; a weakened one holds."""
    for start, mu, sticks in ((1.0, 0.3, False), (0.8, 0.3, True), (0.8, 0.0, False)):
        law = RCCM(4.0, 6.0, 0.5, friction=symbol(mu), beta=symbol(start))
        a = at_point((0.3, -0.1), (7.0, 2.0))
        pieces = law.pieces(a)
        back = [b.target for b in pieces[STICK + DAMAGING].borders if b.target < DAMAGING]
        assert back == [STICK, PLUS]
        ends = distances(pieces[STICK + DAMAGING])
        assert (STICK in ends, PLUS in ends) == (sticks, not sticks)
        assert [b.target for b in pieces[PLUS + DAMAGING].borders if b.target < DAMAGING] == [PLUS]
        assert [b.target for b in pieces[OPEN + DAMAGING].borders if b.target < DAMAGING] == [OPEN]


def test_bonds_grow_in_time_alone():
    """Not under the static law, nor in a step of no length, though they were closed before."""
    law = RCCM(4.0, 6.0, 0.5, viscosity=number(2.0), beta=number(0.8), recovers=True)
    kept = {"closed": 1.0, "origin_0": 0.0, "origin_1": 0.0}
    for step, grown in ((0.25, 0.8 + 0.25 * 0.5 / 2.0), (0.0, 0.8), (-1.0, 0.8), (-0.5, 0.8)):
        bond = law.bond(at_point((0.0, -0.1), (0.0, 2.0), step=step, **kept))
        assert value(bond.after["beta"]) == pytest.approx(grown)
    for closed, grows in ((0.0, False), (0.49, False), (0.51, True)):
        a = at_point((0.0, -0.1), (0.0, 2.0), step=0.25, **kept | {"closed": closed})
        assert (value(law.bond(a).after["beta"]) > 0.8) is grows


@pytest.mark.parametrize(("new", "closed"), [(True, 1.0), (False, 1.0), (False, 0.0)])
def test_springs_that_stretch_in_a_step_are_augmentation(new, closed):
    """But for those of a bond that was broken, which begins where it is."""
    beta = 1e-7 if new else 0.8
    given = {"friction": number(0.3), "viscosity": number(2.0), "beta": number(beta)}
    law = RCCM(4.0, 6.0, 0.5, recovers=True, **given)
    kept = {"closed": closed, "origin_0": 0.05, "origin_1": 0.0}
    a = at_point((0.03, -0.1), (0.7, 2.0), before=(0.15, 0.0), step=0.25, **kept)
    pieces = law.pieces(a)
    s = 0.7 - R * 0.03
    # A bond that was closed may come to be whole; what the step has stretched is in the traction.
    carried = 0.0 if new else 6.0 * 0.03 * (1.0 if closed else 0.64)
    np.testing.assert_allclose(value(pieces[STICK].answer), [s - carried, 2.0], rtol=1e-12)


@pytest.mark.parametrize("p", [0.5, 1.0, 2.0])
def test_damage_in_no_time_or_without_a_force(p):
    """Nothing changes in a step of no length, nor where the energy is that of the bond."""
    s, w, b = 0.8, 0.5, 2.0
    for step, energy in ((0.0, 4.0), (0.25, w / s)):
        found = DamageStep(*map(number, (s, w, b)), p, number(step))
        assert value(found.intensity(number(energy))) == pytest.approx(s, rel=1e-9)
    # Without a time there is no viscosity, and what is below the least energy is not seen.
    static = DamageStep(*map(number, (s, w, b)), p, number(-1.0))
    assert value(static.intensity(number(4.0))) == pytest.approx(w / 4.0)
    assert value(least_energy(number(4.0), number(w))) == 4.0
    assert value(least_energy(number(0.1), number(w))) == 0.25 * w


@pytest.mark.parametrize(
    ("step", "missing"), [(0.25, 0.2), (0.0, 0.0), (-1.0, 0.0), (0.25, 0.0), (0.25, -0.1)]
)
@pytest.mark.parametrize("p", [1.0, 2.0])
def test_the_border_of_a_bond_that_grows(step, missing, p):
    """From below the cap, against its viscosity."""
    w, b, start = 0.5, 2.0, 1.0 - missing
    grows = ufl.gt(number(1.0), 0.0)
    found = DamageStep(*map(number, (start, w, b)), p, number(step), None, grows)
    assert value(found.cap) == 1.0
    held = b * (missing / step) ** p if missing > 0 and step > 0 else 0.0
    slack = (w - 0.3 - held) / w
    assert value(found.slack(number(0.3))) == pytest.approx(slack)


@pytest.mark.parametrize("rest", [0.3, 0.75, 0.79])
def test_a_second_step_of_damage(rest):
    """It may go on by what the bond still was above the rest; not below what the rate leads to."""
    beta, rate, length, dt = 0.8, 0.4, 0.5, 0.25
    given = {"length": number(length), "rate": number(rate), "rest": number(rest)}
    found = DamageStep(number(beta), number(0.5), number(2.0), 1.0, number(dt), given)
    x = 0.5
    start = beta - x / (1 + 2 * x) * dt * rate
    assert value(found.cap) == pytest.approx(max(start, rest))
    # A bond that had grown begins no higher than it is.
    given["rate"] = number(-rate)
    up = DamageStep(number(beta), number(0.5), number(2.0), 1.0, number(dt), given)
    assert value(up.cap) == pytest.approx(beta)


# -- interfaces -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Bonded(Interface):
    """A bond whose breaking gives work back, with a threshold that grows with damage."""

    k: Any
    work: Any
    c: Any
    mu: Any
    d: Any = 0.0
    internal = (Internal("d", "grows", end=1.0),)

    def energy(self, state):
        size = state.opening**2 + ufl.dot(state.moved, state.moved)
        return (1 - state["d"]) * self.k * size / 2 - self.work * state["d"]

    def dissipation(self, rates, state):
        slips = self.mu * state["d"] * state.pressure * rates.slip
        return slips + (self.work + self.c * (1 + 3 * state["d"] ** 2)) * abs(rates["d"])


K, WORK, CC, MU = 7.0, 0.25, 0.5, 0.4


def bonded(d, cls=Bonded):
    return cls(number(K), number(WORK), number(CC), number(MU), symbol(d))


def solved(law, a, now):
    """The point with what its equations give."""
    return replace(a, solved={n: (number(now),) * k for n, k in law.unknowns(a.dim).items()})


@pytest.mark.parametrize("jump", [(0.3, 0.4), (0.5, -0.2)])
@pytest.mark.parametrize("d", [0.0, 0.2])
def test_statuses_of_a_bond_by_its_energy(jump, d):
    """Borders are where the force on it is its threshold, at the start, or at the end."""
    law, now = bonded(d), 0.6
    a = solved(law, at_point(jump, (0.9, 1.5), before=(0.1, 0.0)), now)
    moved = jump[0] + 0.1
    up = max(jump[1] + 0.1, 0.0)
    pieces = law.pieces(a)
    assert sorted(pieces) == [c + f for f in (0, DAMAGING, BROKEN) for c in (0, 1, 2, 3)]

    def threshold(x):
        return WORK + CC * (1 + 3 * x**2)

    def slack(x, size):
        return threshold(x) - K * size / 2 - WORK

    # The force on the bond at rest is the work alone.
    for is_open in (True, False):
        opening = up if is_open else 0.0
        if is_open and jump[1] < -0.1:
            opening = jump[1] + 0.1
        size = moved**2 + opening**2
        scale = np.sqrt(R / (threshold(d) + WORK + K * size / 2))
        rests, goes = scale * slack(d, size), scale * slack(1.0, size)
        # A bond that is whole has no friction: stick and slip back lead to the one slip.
        for code in [OPEN] if is_open else [PLUS, MINUS] if d > 0 else [PLUS]:
            assert distances(pieces[code])[code + DAMAGING] == pytest.approx(rests)
            here = distances(pieces[code + DAMAGING])
            assert here[code] == pytest.approx(-rests)
            assert here[code + BROKEN] == pytest.approx(goes)
            assert distances(pieces[code + BROKEN])[code + DAMAGING] == pytest.approx(-goes)
        if not is_open:
            stuck = distances(pieces[STICK + DAMAGING])
            assert stuck[STICK if d > 0 else PLUS] == pytest.approx(-rests)
            assert (STICK in stuck) is (d > 0)
            assert stuck[STICK + BROKEN] == pytest.approx(goes)
        for family, value_of in ((0, d), (DAMAGING, now), (BROKEN, 1.0)):
            pull = (1 - value_of) * K
            if is_open:
                expected = [-pull * moved, -pull * opening]
                np.testing.assert_allclose(
                    value(pieces[family].answer), expected, rtol=1e-12, atol=1e-13
                )
            else:
                p = 1.5 - R * (jump[1] + 0.1)
                for code, sense in ((PLUS, 1), (MINUS, -1)):
                    shear = -pull * moved - sense * MU * value_of * p
                    np.testing.assert_allclose(
                        value(pieces[code + family].answer), [shear, p], rtol=1e-12, atol=1e-12
                    )


def test_equations_of_a_bond():
    """The force on it less what resists; it only grows, from its start to its end."""
    law = bonded(0.2)
    a = solved(law, at_point((0.3, 0.4)), 0.6)
    equations = law.equations(a)
    assert law.unknowns(2) == dict.fromkeys(equations, 1)
    assert len(equations) == 2
    found = []
    for e in equations.values():
        (residual,), (start,) = e.residual, e.start
        assert (e.sense, e.end, value(start)) == (1, 1.0, 0.2)
        found.append(value(residual))
    threshold = CC * (1 + 3 * 0.36)
    open_, closed = (threshold - K * s / 2 for s in (0.09 + 0.25, 0.09))
    assert sorted(found) == pytest.approx(sorted([open_, closed]))
    layer = MaxwellLayer(number(3.0), number(2.0))
    assert set(layer.unknowns(3).values()) == {3}
    a = at_point(
        (0.3, 0.4, 0.5), (0.0,) * 3, before=(0.0,) * 3, step=0.5, flow_0=0.1, flow_1=0.2, flow_2=0.3
    )
    a = solved(layer, a, 0.25)
    for name, e in layer.equations(a).items():
        assert (e.sense, e.end) == (0, None)
        assert [value(s) for s in e.start] == pytest.approx([0.1, 0.2, 0.3])
        up = 0.6 if name.startswith("open") else 0.0
        y = np.full(3, 0.25)
        force = 3.0 * (y - [0.3, 0.4, up]) + 2.0 * (y - [0.1, 0.2, 0.3]) / 0.5
        assert [value(f) for f in e.residual] == pytest.approx(force)


def test_how_many_numbers_an_interface_is_solved_for():
    """One of a scalar, as many as the jump has of a vector; the weakening one while it changes."""

    @dataclass(frozen=True)
    class Many(Interface):
        e: Any = 0.0
        d: Any = 0.0
        internal = (Internal("e"), Internal("y", vector=True), Internal("d", "grows", end=1.0))

    for dim in (2, 3):
        found = Many().unknowns(dim)
        assert sorted(found.values()) == [1 + dim] * 4 + [2 + dim] * 2
        assert {name for name, n in found.items() if n == 2 + dim} == {
            "open, changes",
            "closed, changes",
        }


@dataclass(frozen=True)
class Rough(Interface):
    """What resists grows with the rate of a variable that has no end."""

    k: Any
    d: Any = 0.0
    internal = (Internal("d", "falls"),)

    def energy(self, state):
        return self.k * state["d"] ** 2 * state.opening**2 / 2

    def dissipation(self, rates, state):
        return rates["d"] ** 2 / 2


def test_an_interface_that_knows_the_speed_says_so():
    law = Rough(number(3.0), number(0.5))
    with pytest.raises(ValueError, match="the dissipation of Rough is no linear function of the"):
        law.equations(solved(law, at_point((0.3, 0.4)), 0.25))
    assert law._families == [OPEN, DAMAGING]
    assert MaxwellLayer(1.0, 1.0)._families == [OPEN]
    assert law.broken(State(d=0.5)) is None


def test_friction_that_knows_the_speed_says_so():
    """At closed points, where it acts; unless it is named, and 0 where it is."""

    @dataclass(frozen=True)
    class Wet(Interface):
        c: Any

        def dissipation(self, rates, state):
            return self.c * state.pressure * rates.slip**2

    a = at_point((0.3, -0.2), (0.0, 1.5), step=0.5)
    with pytest.raises(ValueError, match="needs_time must name the fields"):
        Wet(number(2.0)).equations(a)

    @dataclass(frozen=True)
    class Known(Wet):
        needs_time = ("c",)

    assert Known(number(2.0)).equations(a) == {}


@pytest.mark.parametrize(("sense", "end"), [("grows", 1.0), ("falls", -2.0)])
def test_when_interfaces_count_as_broken(sense, end):
    class Own(Interface):
        d = 0.0
        internal = (Internal("d", sense, end=end),)

    for part, broken in ((0.0, False), (0.999, False), (1.0, True), (1.001, True)):
        assert holds(Own().broken(State(d=part * end))) is broken


def test_what_an_interface_has_cost():
    """The integral of its threshold, whatever its polynomial; nothing where nothing changes."""
    law = bonded(0.2)
    a = at_point((0.5, -0.2), (0.0, 1.5))
    side = InterfacePoint(law, a, number(0.0), {"d": number(0.7)}, {"d": number(0.2)}, [], False, 1)
    cost, _ = quad(lambda x: WORK + CC * (1 + 3 * x**2), 0.2, 0.7)
    assert value(side.spent) == pytest.approx(cost)

    class Hard(Bonded):
        def dissipation(self, rates, state):
            return rates["d"] / (1 - state["d"])

    class Power(Bonded):
        def dissipation(self, rates, state):
            return 8 * state["d"] ** 7 * rates["d"]

    values, start = {"d": number(0.9)}, {"d": number(0.3)}
    side = InterfacePoint(bonded(0.3, Power), a, number(0.0), values, start, [], False, 1)
    assert value(side.spent) == pytest.approx(0.9**8 - 0.3**8, rel=1e-12)
    values, start = {"d": number(1.0)}, {"d": number(1.0)}
    side = InterfacePoint(bonded(1.0, Hard), a, number(0.0), values, start, [], False, 1)
    assert value(side.spent) == 0.0


def side_of(law, a, is_open, **more):
    """A side at which the variables are as at the start, or as given."""
    start = {x.name: getattr(law, x.name) for x in law.internal}
    given = {"values": start, "opening": number(0.0)} | more
    return InterfacePoint(law, a, given["opening"], given["values"], start, [], is_open, 1)


@dataclass(frozen=True)
class Drag(Interface):
    """Friction by pressure, reaction and speed, under a pull that has no end."""

    mu: Any
    nu: Any
    c: Any
    pull: Any
    needs_time: ClassVar = ("c",)

    def energy(self, state):
        return self.pull * state.opening

    def dissipation(self, rates, state):
        bound = self.mu * state.pressure + self.nu * state.reaction
        return bound * abs(rates.slip) + self.c * rates.slip**2 / 2


@pytest.mark.parametrize("pressed", [True, False])
def test_what_slip_adds_to_a_threshold(pressed):
    """Where friction acts: not at open points of an interface that needs the pressure."""

    class Rubbed(Bonded):
        needs_pressure = pressed

        def dissipation(self, rates, state):
            return rates["d"] * (2.0 + 3.0 * rates.slip)

    law = bonded(0.2, Rubbed)
    a = at_point((0.3, -0.2), (0.0, 1.5), step=0.5)
    for is_open, rubs in ((False, True), (True, not pressed), (None, True)):
        resisted = value(side_of(law, a, is_open).resisted("d"))
        assert resisted == pytest.approx(2.0 + (3.0 * 0.6 if rubs else 0.0))


@pytest.mark.parametrize("pull", [0.0, 0.75, 9.0])
def test_friction_by_pressure_and_reaction(pull):
    """What pulls lessens the reaction, which is not negative; an open point has neither."""
    law = Drag(*map(number, (0.4, 0.3, 2.0)), ufl.as_ufl(pull))
    u, dt = 0.2, 0.5
    a = at_point((u, -0.2), (0.0, 1.5), step=dt)
    side = side_of(law, a, False)
    p = 1.5 + R * 0.1 + pull
    assert value(side.pressure) == pytest.approx(p)
    assert value(side.speed) == pytest.approx(u / dt)
    radius = 0.4 * p + 0.3 * max(p - pull, 0.0) + 2.0 * 0.7
    assert value(side.resistance(side.pressure, number(0.7))) == pytest.approx(radius)
    assert value(side.resistance(number(1.0), number(0.0))) == pytest.approx(
        0.4 + 0.3 * max(1.0 - pull, 0.0)
    )
    assert value(side_of(law, a, True).pressure) == 0.0
    # What counts as closed is smooth beyond its border.
    off = at_point((u, 0.9), (0.0, 1.5), step=dt)
    assert value(side_of(law, off, False).pressure) == pytest.approx(1.5 - R + pull)
    for down in (0.5, -0.9):
        b = at_point((u, -0.1 - down), (0.0, 1.5), step=dt)
        either = side_of(law, b, None)
        assert value(either.pressure) == pytest.approx(max(1.5 + R * down + pull, 0.0))
    assert side.knows_speed
    assert not side_of(replace(law, c=ufl.as_ufl(0.0)), a, False).knows_speed
    # Under a static law there is no speed, in no time any slip is fast.
    assert value(side_of(law, replace(a, step=number(-1.0)), False).speed) < 1e-280
    assert value(side_of(law, replace(a, step=number(0.0)), False).speed) > 1e50


def test_a_speed_has_a_slope_at_rest():
    """None: there the root of its square is not differentiated."""
    law = Drag(*map(number, (0.4, 0.3, 2.0, 0.0)))
    for u, slope in ((0.0, 0.0), (0.3, 4.0), (-0.3, -4.0)):
        x = ufl.variable(number(u))
        a = at_point((u, -0.2), step=0.25)
        a = replace(a, jump=ufl.as_vector([x, number(-0.2)]))
        found = expand_derivatives(ufl.diff(side_of(law, a, False).speed, x))
        assert value(found) == pytest.approx(slope)


def test_sizes_whose_signs_are_known():
    """Of rates that only grow or fall, and of the speed, the size is no kink."""

    class Falls(Bonded):
        internal = (Internal("d", "falls", end=-1.0),)

    for kind, sense in ((Bonded, 1.0), (Falls, -1.0)):
        law = bonded(0.2, kind)
        a = at_point((0.5, -0.2), (0.0, 1.5))
        side = side_of(law, a, False)
        force = WORK + CC * (1 + 3 * 0.04)
        assert value(side.resisted("d")) == pytest.approx(sense * force)
        assert value(side.driven("d")) == pytest.approx(sense * force - K * 0.25 / 2 - WORK)
        assert value(law._slack(side)) == pytest.approx(sense * value(side.driven("d")))
    drag = Drag(*map(number, (0.4, 0.0, 0.0, 0.0)))
    still = side_of(drag, at_point((0.0, -0.2), (0.0, 1.5)), False)
    assert value(still.resistance(number(2.0), number(0.0))) == pytest.approx(0.8)


@pytest.mark.parametrize("dim", [2, 3])
def test_springs_count_as_augmentation(dim):
    """So that what contact sees falls where the body moves away, however stiff they are."""
    law = MaxwellLayer(number(3.0), number(2.0), number(0.5))
    jump = (0.3, 0.2, 0.4)[-dim:]
    t = (0.7, -0.2, 1.5)[-dim:]
    y = {"flow": vector([0.1] * dim)}
    a = replace(
        at_point(jump, t, before=(0.0,) * dim), kept={f".flow_{i}": number(0.1) for i in range(dim)}
    )
    for is_open in (True, False):
        opening = number(jump[-1] + 0.1 if is_open else 0.0)
        side = InterfacePoint(law, a, opening, y, dict(y), [], is_open, 1)
        soft = side.soft
        up = value(opening)
        pull = 3.0 * (up - 0.1) + 0.5 * up
        along = np.array([3.0 * (u - 0.1) + 0.5 * u for u in jump[:-1]])
        traction = np.array([-v for v in along] + [-pull])
        np.testing.assert_allclose(value(side.traction), traction, atol=1e-13)
        stiff = 3.5 * (jump[-1] + 0.1) if is_open else 0.0
        expected = np.array(t)
        expected[-1] += pull - stiff
        np.testing.assert_allclose(value(soft.traction), expected, atol=1e-13)
        shear = np.array(t[:-1]) - R * np.array(jump[:-1]) + along - 3.5 * np.array(jump[:-1])
        np.testing.assert_allclose(value(soft.s), [*shear, 0.0], atol=1e-13)


def test_what_an_interface_is_now():
    """Open or closed, at rest, changing or at its end: values, energy and traction."""
    for jump, d, now, then in (
        ((0.1, 0.0), 0.2, 0.6, 0.2),
        ((0.3, 0.5), 0.2, 0.6, 0.6),
        ((1.9, 0.5), 0.2, 0.6, 1.0),
        ((1.9, -0.2), 0.2, 0.6, 1.0),
        ((0.6, -0.2), 0.2, 0.6, 0.6),
        ((0.3, 0.5), 1.0, 0.6, 1.0),
    ):
        law = bonded(d)
        a = solved(law, at_point(jump, (0.0, 1.5)), now)
        bond = law.bond(a)
        up = max(jump[1] + 0.1, 0.0)
        size = jump[0] ** 2 + up**2
        assert value(bond.after["d"]) == pytest.approx(then)
        assert value(bond.stored) == pytest.approx((1 - then) * K * size / 2 - WORK * then)
        pull = (1 - then) * K
        np.testing.assert_allclose(
            value(bond.traction), [-pull * jump[0], -pull * up], rtol=1e-12, atol=1e-14
        )
        assert value(bond.broken) == (1.0 if then == 1.0 else 0.0)
        p = max(1.5 - R * (jump[1] + 0.1), 0.0) if jump[1] < -0.1 else 0.0
        if jump[1] < -0.1:
            assert value(law.with_pressure(a).pressure) == pytest.approx(p)
        assert value(law.bound(a, number(2.0))) == pytest.approx(MU * then * 2.0)

    class Bare(Interface):
        pass

    assert Bare().bond(at_point((0.0, 0.0))) is None
    assert Bare().energy(None) == Bare().dissipation(None, None) == 0.0
    assert Bare().cost(None, None) is None


# -- Coulomb's law on arrays ----------------------------------------------------------------------


def test_forces_on_discs():
    rn = np.array([2.0, 0.0, -3.0])
    F, g = np.full(3, 0.5), np.array([0.25, 0.0, 0.25])
    np.testing.assert_allclose(coulomb.radius(rn, F, g), [1.25, 0.0, 0.25])
    s = np.array([[3.0, 4.0], [0.3, -0.4], [0.0, 0.0]])
    np.testing.assert_allclose(
        coulomb.project(s, np.array([2.5, 0.5, 0.0])), [[1.5, 2.0], [0.3, -0.4], [0.0, 0.0]]
    )
    r = np.array([[3.0, 4.0, 2.0], [0.3, -0.4, 0.0], [3.0, 4.0, -3.0]])
    expected = [[0.75, 1.0, 2.0], [0.0, 0.0, 0.0], [0.15, 0.2, 0.0]]
    np.testing.assert_allclose(coulomb.allowed(r, F, g), expected)


def test_statuses_at_borders():
    """Of points that are just pressed, or just held; without a bound and friction none is held."""
    rows = [
        # s_t, s_n, F, g, status in the plane
        (0.0, 0.0, 0.5, 0.0, STICK),
        (0.0, 0.0, 0.0, 0.0, PLUS),
        (0.0, 1.0, 0.0, 0.0, PLUS),
        (-1.0, 1.0, 0.0, 0.0, PLUS),
        (1.0, 1.0, 0.0, 0.0, MINUS),
        (0.5, 1.0, 0.5, 0.0, STICK),
        (0.5 + 1e-9, 1.0, 0.5, 0.0, MINUS),
        (-0.5, 1.0, 0.5, 0.0, STICK),
        (-0.5 - 1e-9, 1.0, 0.5, 0.0, PLUS),
        (0.0, -1e-9, 0.5, 0.0, OPEN),
        (0.25, -1.0, 0.5, 0.25, STICK + WHERE_OPEN),
        (0.26, -1.0, 0.5, 0.25, MINUS + WHERE_OPEN),
        (-0.26, -1.0, 0.0, 0.25, PLUS + WHERE_OPEN),
        (0.25, 0.0, 0.0, 0.25, STICK),
        (0.74, 1.0, 0.5, 0.25, STICK),
        (0.76, 1.0, 0.5, 0.25, MINUS),
    ]
    t, n, F, g, codes = (np.array(v) for v in zip(*rows, strict=True))
    s = np.column_stack([t, n])
    np.testing.assert_array_equal(coulomb.statuses(s, F, g), codes)
    assert coulomb.statuses(s, F, g).dtype == np.int8
    held = np.isin(codes, (STICK, STICK + WHERE_OPEN))
    np.testing.assert_array_equal(coulomb.stuck(s, F, g), held)
    np.testing.assert_array_equal(coulomb.closed(s), n >= 0)
    # In space a slip has no sense.
    s = np.column_stack([t, 0 * t, n])
    flat = np.where(codes == MINUS, PLUS, codes)
    flat = np.where(flat == MINUS + WHERE_OPEN, PLUS + WHERE_OPEN, flat)
    np.testing.assert_array_equal(coulomb.statuses(s, F, g), flat)


def test_derivatives_at_kinks():
    """One of those of either side: at no pressure that of an open point, on the disc of stick."""
    half = np.full(1, 0.5)
    none = np.zeros(1)
    for s, F, g, expected in (
        ((0.0, 0.0), half, none, [[0, 0], [0, 0]]),
        ((0.0, 1.0), half, none, [[1, 0], [0, 1]]),
        ((0.5, 1.0), half, none, [[1, 0], [0, 1]]),
        ((0.6, 1.0), half, none, [[0, 0.5], [0, 1]]),
        ((-0.6, 1.0), half, none, [[0, -0.5], [0, 1]]),
        ((0.6, 0.0), half, none, [[0, 0], [0, 0]]),
        ((0.6, -1.0), half, none, [[0, 0], [0, 0]]),
        ((0.6, -1.0), half, half / 2, [[0, 0], [0, 0]]),
        ((0.2, -1.0), half, half / 2, [[1, 0], [0, 0]]),
        ((0.0, 1.0), none, none, [[0, 0], [0, 1]]),
    ):
        D = coulomb.derivative(np.array([s]), F, g)
        np.testing.assert_allclose(D[0], expected, atol=1e-15)
    # In space what slips may still turn, across its direction.
    D = coulomb.derivative(np.array([[3.0, 4.0, 2.0]]), half, none)
    e = np.array([0.6, 0.8])
    expected = np.zeros((3, 3))
    expected[:2, :2] = 1.0 / 5.0 * (np.eye(2) - np.outer(e, e))
    expected[:2, 2] = 0.5 * e
    expected[2, 2] = 1.0
    np.testing.assert_allclose(D[0], expected, atol=1e-15)


def test_the_table_of_cones():
    """Of every status and border what is inside obeys the law, and what it borders on."""
    F = np.array([0.4])
    beyond = [[code for *_, code in rows] for rows in coulomb.INSIDE]
    first = coulomb.FIRST_BORDER
    assert first == 4
    sticks = [PLUS, MINUS]
    slips = [STICK, OPEN]
    assert beyond == [[PLUS], sticks, slips, slips, [first + 1], [first], [OPEN], [OPEN]]
    assert [[code for *_, code in rows] for rows in coulomb.WITHOUT_FRICTION] == [
        *([PLUS], [], [OPEN], [OPEN]),
        *([], [], [OPEN], [OPEN]),
    ]
    assert coulomb.BORDERS == ((OPEN, PLUS), (OPEN, MINUS), (STICK, PLUS), (STICK, MINUS))
    none = np.zeros(1)
    for code, (constant, slope) in enumerate(coulomb.BASES):
        B = (np.array(constant) + F * np.array(slope)).T
        for z in np.random.default_rng(code).normal(size=(40, B.shape[1])):
            w = B @ z
            inside = all((c + F * d) @ w >= 0 for c, d, _ in coulomb.INSIDE[code])
            parts = (w[k : k + 1] for k in range(4))
            obeys_it = coulomb.violation(*parts, F, none) < 1e-14
            assert inside is obeys_it if code < first else inside <= obeys_it
            found = coulomb.statuses(np.array([[w[2] - 3 * w[0], w[3] - 3 * w[1]]]), F, none)
            if inside and code < first:
                assert found[0] == code
    # A border is in both of its cones.
    for number, pair in enumerate(coulomb.BORDERS):
        (constant,), (slope,) = coulomb.BASES[first + number]
        w = constant + F * slope
        w = -w if number == 1 else w
        assert all((c + F * d) @ w >= 0 for c, d, _ in coulomb.INSIDE[first + number])
        for code in pair:
            B = np.array(coulomb.BASES[code][0]) + F * np.array(coulomb.BASES[code][1])
            assert np.linalg.matrix_rank(np.vstack([B, w])) == 2
            assert min((c + F * d) @ w for c, d, _ in coulomb.INSIDE[code]) == 0.0


def test_statuses_and_what_they_count_as():
    """Closed ones are those of contact, whatever the bond; letters are counted by their kinds."""
    assert status.count("okk+-saKPdd!") == {"open": 4, "stick": 2, "slip": 3, "clamped": 2}
    codes = np.arange(24, dtype=np.int8)
    assert np.flatnonzero(status.closed(codes)).tolist() == [
        b + c for b in (0, DAMAGING, BROKEN) for c in (STICK, PLUS, MINUS)
    ]
    assert status.senses(codes)[:7].tolist() == [0, 1, 2, 3, 1, 2, 3]
    assert status.without_damage(codes).tolist() == [0, 1, 2, 3, 4, 5, 6, 7] * 3
    assert status.word([OPEN, STICK], 3) == "ok"
    assert str(status.letters(2)[7]) == " "
    assert len(status.letters(2)) == BROKEN + 7
    assert (status.NAMES["d"], status.KINDS["clamped"]) == ("clamped", "d")


# -- answers --------------------------------------------------------------------------------------


def answers(values):
    """Of a law with three statuses in the plane, the last of which damages."""
    law = SimpleNamespace(
        dim=2,
        codes=(OPEN, PLUS, OPEN + DAMAGING),
        rows=np.array([0, 9, 1, 9, 9, 9, 9, 9, 2]),
        places={
            "answer": [[0, 1], [2, 3], [4, 5]],
            "by_jump": [[0, 1, 2, 3], [1, 2, 3, 4], [2, 3, 4, 5]],
            "by_traction": [[3, 2, 1, 0], [4, 3, 2, 1], [5, 4, 3, 2]],
            "by_around": [[5, 4], [4, 3], [3, 2]],
            "pressure": [[3], [0, 1], [1, 2]],
            "bond.traction": [[2, 4]],
            "bond.stored": [[5]],
            "bound": [[4]],
            "unit_bound": [],
        },
        borders=[[(6, None, PLUS), (7, None, DAMAGING)], [(8, 9, OPEN)], [(7, None, OPEN)]],
        exists=[None, 10, None],
    )
    return Answers(law, np.array(values, dtype=float))


def test_columns_of_answers():
    v = np.arange(33.0).reshape(3, 11)
    a = answers(v)
    codes = np.array([PLUS, DAMAGING, OPEN], dtype=np.int8)
    np.testing.assert_array_equal(a.traction(codes), [[2, 3], [15, 16], [22, 23]])
    np.testing.assert_array_equal(a.by_jump(codes)[0], [[1, 2], [3, 4]])
    np.testing.assert_array_equal(a.by_jump(codes)[2], [[22, 23], [24, 25]])
    np.testing.assert_array_equal(a.by_traction(codes)[1], [[16, 15], [14, 13]])
    np.testing.assert_array_equal(a.by_around(codes), [[4, 3], [14, 13], [27, 26]])
    q, by_jump, by_traction = a.pressure
    np.testing.assert_array_equal(q, v[:, 3])
    np.testing.assert_array_equal(by_jump, v[:, :2])
    np.testing.assert_array_equal(by_traction, v[:, 1:3])
    np.testing.assert_array_equal(a.bond("traction"), v[:, [2, 4]])
    np.testing.assert_array_equal(a.bond("stored"), v[:, 5])
    np.testing.assert_array_equal(a.bound, v[:, 4])
    assert np.isnan(a.unit_bound).all()
    assert a.unit_bound.shape == (3,)
    turning = Answers(a._law, v, turning=lambda codes: ("turned", codes))
    assert turning.by_jump(codes) == ("turned", codes)
    assert a.spreading is None


def test_borders_of_answers():
    """Infinite where there are none; a point on its border has its status still."""
    v = np.zeros((5, 11))
    v[:, 6] = [1.0, 0.0, -1.0, 1.0, 2.0]
    v[:, 7] = [2.0, 1.0, 1.0, 0.0, -3.0]
    v[:, 8] = -1.0
    v[:, 9] = [1.0, 0.0, 0.0, -1.0, 1.0]
    v[:, 10] = [1.0, 1.0, 0.0, -1.0, 1.0]
    a = answers(v)
    opened = np.full(5, OPEN, dtype=np.int8)
    np.testing.assert_array_equal(a.holds(opened), [True, True, False, True, False])
    assert a.may_be(PLUS).tolist() == [True, True, False, False, True]
    assert a.may_be(STICK).tolist() == [False] * 5
    np.testing.assert_array_equal(a.holds(np.full(5, PLUS)), [False, True, False, False, False])
    assert not a.holds(np.full(5, STICK)).any()
    found = a.borders(np.array([OPEN, PLUS, PLUS, DAMAGING, PLUS], dtype=np.int8))
    inf = np.inf
    np.testing.assert_array_equal(
        found.distance, [[1.0, 2.0], [inf, inf], [inf, inf], [0.0, inf], [-1.0, inf]]
    )
    np.testing.assert_array_equal(
        found.target, [[PLUS, DAMAGING], [OPEN, 0], [OPEN, 0], [OPEN, 0], [OPEN, 0]]
    )
    np.testing.assert_array_equal(a.every_distance(PLUS), v[:, [8]])
    np.testing.assert_array_equal(
        a.exists(), [[True, e, True] for e in (True, True, False, False, True)]
    )
    assert a.required.tolist() == [OPEN, OPEN, DAMAGING, OPEN, PLUS]
    np.testing.assert_array_equal(a.missed, [0.0, 0.0, 0.0, 0.0, 1.0])
    # Bonds that are held as they are: nothing damages, and no border leads there.
    held = HeldAnswers(a)
    assert held.may_be(DAMAGING).tolist() == [False] * 5
    assert held.holds(opened).tolist() == [True, True, False, True, True]
    np.testing.assert_array_equal(held.borders(opened).distance[:, 1], [inf] * 5)


def test_bonds_that_are_held_as_they_are():
    """No point damages or is broken, whatever contact and friction do; no border leads there."""
    codes = (STICK, PLUS, STICK + DAMAGING, PLUS + DAMAGING, STICK + BROKEN)
    rows = np.zeros(max(codes) + 1, dtype=int)
    rows[list(codes)] = range(len(codes))
    targets = [PLUS, STICK, STICK, PLUS, STICK + DAMAGING]
    law = SimpleNamespace(
        dim=2,
        codes=codes,
        rows=rows,
        places={},
        borders=[[(0, None, t), (1, None, t + DAMAGING), (1, None, BROKEN)] for t in targets],
        exists=[None] * len(codes),
    )
    held = HeldAnswers(Answers(law, np.array([[2.0, -1.0]]), "spreading", "turning"))
    assert [bool(held.may_be(c)[0]) for c in codes] == [True, True, False, False, False]
    assert held.borders(np.array([STICK])).distance.tolist() == [[2.0, np.inf, np.inf]]
    assert held.required.tolist() == [STICK]
    assert held.spreading == "spreading"
    assert held._turning == "turning"


def test_inequalities_that_several_pairs_imply():
    """Are left out once; of two that are the same one stays."""
    rows = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 2.0], [2.0, 1.0]])
    np.testing.assert_array_equal(_needed(rows), rows[:2])
    np.testing.assert_array_equal(_needed(rows[::-1]), rows[1::-1])
    same = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1e-10]])
    assert len(_needed(same)) == 2
    assert len(_needed(np.array([[1.0, 0.0], [1.0, 1e-8]]))) == 2
    assert len(_needed(np.array([[1.0, 0.0], [-1.0, 0.0]]))) == 2


def test_cones_of_no_status():
    B, C, exists = no_cones(5)
    assert (B.shape, C.shape, exists.shape) == ((5, 4, 4, 2), (5, 4, 3, 4), (5, 4))
    assert exists.dtype == bool
    assert not B.any()
    assert not C.any()
    assert not exists.any()


def test_bonds_by_default():
    bond = BilinearCohesive(1.0, 2.0, 3.0)
    assert bond.internal == (Internal("damage", "grows", end=1.0),)
    assert MaxwellLayer(1.0, 2.0).internal == (Internal("flow", vector=True),)
    assert MaxwellLayer.needs_time == ("viscosity",)
