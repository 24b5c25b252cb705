"""Arguments that laws of contact and friction refuse: one table for each law."""

import logging
import math
from dataclasses import FrozenInstanceError, dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block, same_tables
from support.bonds import C, W

from dolfinx import fem

from dolfinx_contact import (
    RCCM,
    BilinearCohesive,
    Coulomb,
    MaxwellLayer,
    NonlocalCoulomb,
    NormalCompliance,
    Regularised,
    Sphere,
    Tresca,
)
from dolfinx_contact.analysis import stability_at_rest
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.laws import (
    OPEN,
    Border,
    FrictionLaw,
    Interface,
    Internal,
    Law,
    StatusPiece,
)
from dolfinx_contact.points.memory import Memory

COMM = MPI.COMM_WORLD


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"beta": 1.1}, "beta of RCCM must be between 0 and 1, got 1.1"),
        ({"beta": -0.1}, "beta of RCCM must be between 0 and 1"),
        ({"beta": np.nan}, "beta of RCCM must be between 0 and 1"),
        ({"work": 0.0}, "work of RCCM must be finite and positive"),
        ({"work": -1.0}, "work of RCCM must be finite and positive"),
        ({"normal": -1.0}, "normal of RCCM must be finite and nonnegative"),
        ({"tangential": -1.0}, "tangential of RCCM must be finite and nonnegative"),
        ({"viscosity": -1.0}, "viscosity of RCCM must be finite and nonnegative"),
        ({"friction": np.inf}, "friction of RCCM must be finite and nonnegative"),
        ({"broken": 1.5}, "broken of RCCM must be between 0 and 1"),
    ],
)
def test_rccm_refuses_numbers_out_of_range(arguments, message):
    with pytest.raises(ValueError, match=message):
        RCCM(**({"normal": C, "tangential": C, "work": W} | arguments))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        *(
            ({"order": order}, "order of RCCM in time must be one of 1, 2")
            for order in (0, 3, 1.5, None, True)
        ),
        ({"recovers": 1}, "recovers of RCCM must be True or False"),
    ],
)
def test_rccm_refuses_options(arguments, message):
    with pytest.raises(ValueError, match=message):
        RCCM(C, C, W, **arguments)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (lambda: Coulomb("0.3"), "friction of Coulomb must be a nonnegative number, .* got '0.3'"),
        (lambda: Coulomb(-0.3), "friction of Coulomb must be finite and nonnegative, got -0.3"),
        (lambda: Tresca(np.inf), "threshold of Tresca must be finite and nonnegative"),
        (lambda: BilinearCohesive(1.0, 0.0, 1.0), "elastic of BilinearCohesive .* positive"),
        (lambda: MaxwellLayer(1.0, None), "viscosity of MaxwellLayer must be a positive number"),
        (lambda: Falling([0.3], 1.0), "static of Falling must be a number"),
    ],
)
def test_laws_refuse_inadmissible_numbers_at_construction(law, message):
    with pytest.raises(ValueError, match=message):
        law()


def test_arrays_without_axes_are_numbers():
    """As from np.load, in a law and in an obstacle."""
    number, radius = np.array(0.3), np.array(10.0)
    law = NormalCompliance(np.array(1e5), np.array(1.5), Coulomb(number))
    problems = [
        block(law=law, obstacle=Sphere((0.5, -radius), radius)),
        block(law=NormalCompliance(1e5, 1.5, Coulomb(0.3)), obstacle=Sphere((0.5, -10.0), 10.0)),
    ]
    same_tables(*(problem.solve().tables["contact"] for problem in problems))
    with pytest.raises(ValueError, match=r"friction of Coulomb must be .*, got array\(\[0.3\]\)"):
        Coulomb(np.array([0.3]))


@pytest.mark.ranks(2)
def test_rccm_refuses_values_and_memory_that_have_changed():
    problem = block(law=RCCM(C, C, W))
    (surface,) = problem.surfaces
    problem.solve()
    with pytest.raises(ValueError, match="needs a law without adhesion, got RCCM"):
        stability_at_rest(problem, density=1.0)
    surface.law.beta.value = 1.5
    with pytest.raises(ValueError, match="contact: not between 0 and 1: beta of RCCM"):
        problem.solve()
    jump = np.zeros((surface.points.number, 2))
    with pytest.raises(ValueError, match="memory belongs to other contact surfaces"):
        problem.with_memory([Memory(jump, {"beta": np.ones(surface.points.number + 1)})])


def test_rccm_of_second_order_converges():
    assert block(law=RCCM(C, C, W, order=2)).solve().converged


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (lambda: NormalCompliance(1.0, 0.5), "exponent of NormalCompliance must be at least 1"),
        (lambda: NormalCompliance(1.0, np.nan), "exponent of NormalCompliance must be at least 1"),
        (lambda: NormalCompliance(1.0, friction=0.3), "must be a friction law"),
        (lambda: NormalCompliance(-1.0), "stiffness .* must be finite and positive"),
        (lambda: NormalCompliance(np.nan), "stiffness .* must be finite and positive"),
        (lambda: Regularised(Coulomb(0.3), 0.1, "cubic"), "shape of Regularised must be one of"),
        (lambda: Regularised(0.3, 0.1), "Regularised must be a friction law"),
        (lambda: Regularised(NormalCompliance(1.0), 0.1), "use NormalCompliance"),
        (lambda: Regularised(Coulomb(0.3), 0.0), "width .* must be finite and positive"),
        (lambda: Regularised(Coulomb(0.3), np.nan), "width .* finite and positive"),
        (lambda: Regularised(Coulomb(-0.3), 0.1), "friction .* nonnegative"),
        (lambda: Regularised(Coulomb(0.3)), "needs a width, or a speed"),
        (lambda: Regularised(Coulomb(0.3), speed=-1.0), "speed .* must be finite and positive"),
    ],
)
def test_compliant_laws_refuse_arguments(law, message):
    with pytest.raises(ValueError, match=message):
        law()


@pytest.mark.ranks(2)
def test_deep_compliance_gives_a_warning(caplog):
    with caplog.at_level(logging.WARNING):
        block(law=NormalCompliance(50.0), top=(0.0, -0.3)).solve()
    if COMM.rank == 0:
        assert "the surface gives way by" in caplog.text


@pytest.mark.ranks(2)
def test_regularised_law_refuses_a_width_that_becomes_zero():
    problem = block(law=Regularised(Coulomb(0.3), 0.1))
    problem.surfaces[0].law.width.value = 0.0
    with pytest.raises(ValueError, match="not positive: width"):
        problem.solve()


@pytest.mark.ranks(2)
def test_regularised_law_names_the_missing_width_or_speed():
    static = Regularised(Coulomb(0.4), 1e-3)
    for law in (static, NormalCompliance(1e6, friction=static)):
        with pytest.raises(ValueError, match=r"contact: the law .* lacks a speed"):
            QuasiStatic(block(law=law), lambda _: None)
    problem = block(law=Regularised(Coulomb(0.4), speed=1e-3))
    before = problem.u.x.array.copy()
    for algorithm in ("newton", "tresca"):
        with pytest.raises(ValueError, match=r"contact: statically the law .* lacks a width"):
            problem.solve(algorithm=algorithm)
    np.testing.assert_array_equal(problem.u.x.array, before)
    problem = block(law=static)
    (surface,) = problem.surfaces
    step = problem.with_memory([Memory(np.zeros((surface.points.number, 2)), step=0.1)])
    with pytest.raises(ValueError, match=r"in a history the law .* lacks a speed"):
        step.solve()


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("variables", "power", "message"),
    [
        ((Internal("d", "grows"), Internal("e", "falls")), 1, "only one variable may be monotone"),
        ((Internal("d"),), 2, "unless needs_time lists"),
        ((Internal("y", vector=True),), 1, "nothing determines y of Own"),
        ((Internal("e"),), 1, "nothing determines e of Own"),
        ((Internal("d", "grows", end=-1.0),), 1, "d of Own is beyond its end -1"),
    ],
)
def test_interface_law_refuses_energies_and_variables(variables, power, message):
    @dataclass(frozen=True)
    class Own(Interface):
        d: Any = 0.0
        e: Any = 0.0
        internal = variables

        def energy(self, state):
            return state.opening**2

        def dissipation(self, rates, state):
            return abs(rates["d"]) ** power if "d" in rates.internal else 0.0

    with pytest.raises(ValueError, match=message):
        block(n=1, law=Own()).solve()


RADIUS = "radius of NonlocalCoulomb must be a finite and positive"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        *(((0.3, radius), RADIUS) for radius in (np.nan, np.inf, -0.1, 0.0, "1")),
        ((-0.3, 0.5), "friction of NonlocalCoulomb.* nonnegative"),
        ((np.nan, 0.5), "friction of NonlocalCoulomb.* nonnegative"),
    ],
)
def test_nonlocal_law_refuses_arguments(arguments, message):
    with pytest.raises(ValueError, match=message):
        NonlocalCoulomb(*arguments)


@pytest.mark.ranks(2)
def test_nonlocal_law_with_a_radius_below_the_spacing_is_coulomb():
    options = {"n": 4, "cell": "quad", "top": (0.02, -0.02)}
    table = block(**options, law=NonlocalCoulomb(0.3, 0.2)).solve().tables["contact"]
    same_tables(table, block(**options, law=Coulomb(0.3)).solve().tables["contact"], 1e-12)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("pieces", "message"),
    [
        (lambda a: {}, "a dictionary of StatusPieces"),
        (lambda a: {24: StatusPiece(0.0 * a.n, [Border(a.p, 24)])}, "status 24 is not a code of"),
        (lambda a: {"x": StatusPiece(0.0 * a.n, [])}, "status 'x' is not a code of"),
        (
            lambda a: {OPEN: StatusPiece(0.0 * a.n, [Border(-a.p, 9)])},
            "the target of a border must be one of 0; got 9",
        ),
        (lambda a: {OPEN: StatusPiece(a.p, [])}, "a UFL vector of 2 components"),
        (lambda a: {OPEN: 0.0 * a.n}, "must be a StatusPiece"),
    ],
)
def test_own_law_refuses_pieces_without_statuses(pieces, message):
    @dataclass(frozen=True)
    class Own(Law):
        def pieces(self, a):
            return pieces(a)

    with pytest.raises(ValueError, match=message):
        block(law=Own())


@pytest.mark.ranks(2)
def test_own_law_refuses_data_that_are_not_its_fields():
    problem = block()
    factor = fem.Constant(problem.V.mesh, 0.5)

    class Own(FrictionLaw):
        def bound(self, a, p):
            return factor * p

    with pytest.raises(ValueError, match="the law Own contain a Constant that is not one of its"):
        block(law=Own())


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("bound", "message"),
    [
        (lambda a, p: np.exp(-a.slid) * p, "the law Own must be UFL: use ufl.exp"),
        (lambda a, p: math.exp(-a.slid) * p, "the law Own must be UFL: use ufl.exp"),
        (lambda a, p: max(p, 0.0), "the law Own must be UFL: .*ufl.max_value"),
        (lambda a, p: a.slip * p, "no attribute 'slip'"),
    ],
)
def test_own_law_refuses_other_functions_and_names(bound, message):
    class Own(FrictionLaw):
        def bound(self, a, p):
            return bound(a, p)

    with pytest.raises((TypeError, AttributeError), match=message):
        block(law=Own())


@dataclass(frozen=True)
class Falling(FrictionLaw):
    """Coefficient of friction that falls linearly, also below 0."""

    static: Any
    slope: Any

    def bound(self, a, p):
        return (self.static - self.slope * a.slid) * p


@pytest.mark.ranks(2)
def test_negative_bound_of_an_own_law_is_named():
    result = block(law=Falling(0.3, 300.0), top=(0.03, -0.02)).solve()
    assert "the friction bound of the law is neg" in result.warnings["negative_bound of 'contact'"]


@pytest.mark.parametrize("law", [Coulomb(0.3), RCCM(C, C, W), NormalCompliance(1e3)])
def test_assignment_to_a_law_names_the_way_to_change_it(law):
    with pytest.raises(FrozenInstanceError, match=r"surface\.law\.friction\.value"):
        law.friction = 0.5
