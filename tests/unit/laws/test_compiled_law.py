"""Laws that are compiled, at points alone: every derivative against differences of the values."""

from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

import ufl

from dolfinx_contact.laws import (
    OPEN,
    PLUS,
    RCCM,
    BilinearCohesive,
    Coulomb,
    Frictionless,
    LawAtPoints,
    MaxwellLayer,
    NonlocalCoulomb,
    NormalCompliance,
    PointData,
    Regularised,
    Tresca,
)
from dolfinx_contact.laws.compiled import _Written
from dolfinx_contact.laws.law import Bond, Border, StatusPiece
from dolfinx_contact.laws.symbols import STEP, Symbols, from_memory

COMM = MPI.COMM_WORLD
N = 6


@dataclass(frozen=True)
class RoughNonlocal(NonlocalCoulomb):
    """A law of two fields, and what is around: the third."""

    roughness: float = 1.5

    @property
    def given(self):
        return {"friction": self.friction, "roughness": self.roughness}

    def bound(self, a, p):
        return self.roughness * super().bound(a, p)


LAWS = {
    "Frictionless": Frictionless(),
    "Coulomb": Coulomb(0.3),
    "Tresca": Tresca(0.4),
    "compliance": NormalCompliance(3.0, 1, Coulomb(0.3)),
    "power": NormalCompliance(3.0, 1.5, Coulomb(0.3)),
    "Regularised": Regularised(Coulomb(0.3), 1e-2),
    "nonlocal": NonlocalCoulomb(0.3, 0.5),
    "RCCM": RCCM(3.0, 2.0, 0.5, 0.3),
    "bilinear": BilinearCohesive(2.0, 0.1, 0.5),
    "Maxwell": MaxwellLayer(3.0, 2.0, 1.0),
}
KINDS = [(name, dim) for name in LAWS for dim in (2, 3)]
ROUGH = RoughNonlocal(0.3, 0.5)
#: Of laws by energy and dissipation, which take two seconds to derive, one in each dimension.
FEW = [kind for kind in KINDS if kind not in (("bilinear", 3), ("Maxwell", 2))]


@cache
def at_points(name, dim):
    """A law, jumps, tractions and data of points, and rates of all that is given."""
    law = ROUGH if name == "rough" else LAWS[name]
    known = LawAtPoints(law, dim, N, COMM)
    rng = np.random.default_rng(3)
    jump, traction = 0.2 * rng.normal(size=(2, N, dim))
    # Some pressed, some sheared more than that, some apart.
    traction[:, -1] = [1.0, 2.0, 0.2, 0.1, -1.0, 1.5]
    jump[:, -1] = [0.1, 0.2, 0.15, 0.3, -0.2, 0.1]
    normal = np.tile(-np.eye(dim)[-1], (N, 1))
    normal[:, 0] = 0.28
    normal[:, -1] = -0.96
    fields = {}
    for field in known.compiled.names:
        value = float(law.given.get(field, 0.1)) or 0.1  # inside, where there are derivatives
        fields[field] = np.full(N, value) * rng.uniform(0.9, 1.1, N)
    data = PointData(normal, rng.uniform(0, 0.05, N), rng.uniform(1, 2, N), fields)
    given = {field: rng.normal(size=N) for field in law.given}
    rates = PointData(rng.normal(size=(N, dim)), rng.normal(size=N), np.zeros(N), given)
    return known, jump, traction, data, rates


def slope(function, direction, h=1e-6):
    """The derivative of a function of h, by central differences."""
    return (function(h * direction) - function(-h * direction)) / (2 * h)


def near(found, expected):
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6)


def moved(data, rates, h):
    """Data after a time h."""
    fields = {k: v + h * rates.fields.get(k, 0.0) for k, v in data.fields.items()}
    return replace(data, n=data.n + h * rates.n, gap=data.gap + h * rates.gap, fields=fields)


@pytest.mark.parametrize(
    ("name", "dim"),
    [
        *((name, 2) for name in LAWS if name not in ("bilinear", "Maxwell")),
        *(("Coulomb", 3), ("power", 3), ("Regularised", 3)),
    ],
)
@pytest.mark.verifies(
    "laws of one's own",
    reference="differences: answers and borders by jump, traction, normal, gap and fields",
    aspects=("2D", "3D"),
)
def test_derivatives(name, dim):
    known, jump, traction, data, rates = at_points(name, dim)
    found = known(jump, traction, data)
    pushed = np.cos(np.arange(N * dim)).reshape(N, dim)
    for code in known.codes:
        codes = np.full(N, code, dtype=np.int8)

        def answer(j=jump, t=traction, d=data, codes=codes):
            return known(j, t, d).traction(codes)

        distances = found.every_distance(code)
        slopes = known.slopes(code, jump, traction, data)
        assert slopes.shape == (*distances.shape, 2 * dim)
        for i, e in enumerate(np.eye(dim)):
            near(found.by_jump(codes)[:, :, i], slope(lambda h: answer(j=jump + h), e))
            near(found.by_traction(codes)[:, :, i], slope(lambda h: answer(t=traction + h), e))
            by = [
                slope(lambda h: known(jump + h, traction, data).every_distance(code), e),  # noqa: B023
                slope(lambda h: known(jump, traction + h, data).every_distance(code), e),  # noqa: B023
            ]
            near(slopes[:, :, i], by[0])
            near(slopes[:, :, dim + i], by[1])
        by_time = slope(lambda h: answer(d=moved(data, rates, h)), 1.0)
        near(known.rate(jump, traction, data, rates, codes), by_time)
        by_time = slope(lambda h: answer(jump + h * pushed, d=moved(data, rates, h)), 1.0)
        near(known.rate(jump, traction, data, rates, codes, pushed), by_time)


@pytest.mark.parametrize(("name", "dim"), [("Coulomb", 2), ("RCCM", 2), ("power", 3)])
def test_derivatives_where_normals_turn(name, dim):
    """By a displacement that jump and normal follow, each in its way."""
    known, jump, traction, data, _ = at_points(name, dim)
    rng = np.random.default_rng(4)
    turn, shift = rng.normal(size=(2, N, dim, dim))
    turning = replace(data, turn=turn, moved=shift)
    codes = known(jump, traction, data).required
    found = known(jump, traction, turning).by_jump(codes)
    for i in range(dim):
        j, n = shift[:, :, i], turn[:, :, i]

        def answer(h, j=j, n=n):
            return known(jump + h * j, traction, replace(data, n=data.n + h * n)).traction(codes)

        by = slope(answer, 1.0)
        near(found[:, :, i], by)
    # Without either the jump is all that moves.
    for half in (replace(turning, turn=None), replace(turning, moved=None)):
        plain = known(jump, traction, half).by_jump(codes)
        np.testing.assert_array_equal(plain, known(jump, traction, data).by_jump(codes))


@pytest.mark.parametrize("name", ["nonlocal", "rough"])
def test_what_spreads(name):
    """The pressure that others see, and the answer by what they send."""
    known, jump, traction, data, _ = at_points(name, 2)
    q, by_jump, by_traction = known(jump, traction, data).pressure
    for i, e in enumerate(np.eye(2)):
        near(by_jump[:, i], slope(lambda h: known(jump + h, traction, data).pressure[0], e))
        near(by_traction[:, i], slope(lambda h: known(jump, traction + h, data).pressure[0], e))
    assert q.max() > 0
    around = known.compiled.names[-1]

    def answer(h, codes):
        fields = {**data.fields, around: data.fields[around] + h}
        return known(jump, traction, replace(data, fields=fields)).traction(codes)

    for code in known.codes:
        codes = np.full(N, code, dtype=np.int8)
        found = known(jump, traction, data).by_around(codes)
        near(found, slope(lambda h: answer(h, codes), 1.0))  # noqa: B023
    columns = [data.gap, data.r, *(data.fields[name] for name in known.compiled.names)]
    given = np.concatenate([jump, traction, data.n, np.stack(columns, axis=1)], axis=1)
    values = known.compiled.evaluate(known.compiled.pressure_sensitivities, given)
    for i, e in enumerate(np.eye(2)):
        by = slope(lambda h: known(jump, traction, replace(data, n=data.n + h)).pressure[0], e)
        near(values[:, i], by)
    assert values.shape[1] == 2 + len(known.law.given)


@pytest.mark.parametrize("kinds", [FEW, pytest.param(KINDS, marks=pytest.mark.long)])
def test_what_is_known_of_laws(kinds):
    """Which are linear status by status, remember, have bonds, and are nothing without a time."""
    linear = {"Frictionless", "Coulomb", "Tresca", "nonlocal", "compliance"}
    bonds = {"RCCM", "bilinear", "Maxwell"}
    signatures = set()
    for name, dim in kinds:
        law = LAWS[name]
        compiled = LawAtPoints(law, dim, N, COMM).compiled
        assert compiled.bonded == (name in bonds)
        flat = dim == 2 or name == "Frictionless"
        assert compiled.is_piecewise_linear == (name in linear and flat)
        assert not compiled.knows_slip
        assert compiled.rows[list(compiled.codes)].tolist() == list(range(len(compiled.codes)))
        assert [n for n in compiled.names if n in law.given] == list(law.given)
        assert compiled.needs_time(0.0) == (name == "RCCM")
        assert isinstance(compiled.signature, str)
        signatures.add(compiled.signature)
    assert len(signatures) == len(kinds)


def test_every_status_is_asked_whether_it_is_linear():
    """Also after one that there always is, and whether it is there by what may change."""
    known = LawAtPoints(Coulomb(0.3), 2, N, COMM).compiled
    j, t = known._jump, known._traction
    plain = StatusPiece(t, [Border(j[0] + t[1], PLUS)])
    fixed = replace(plain, exists=ufl.lt(known._n[0], 0.0))
    bent = StatusPiece(j[0] * t, [])
    curved = StatusPiece(t, [Border(j[0] ** 2, PLUS)])
    sometimes = replace(plain, exists=ufl.lt(j[0], 0.0))
    for pieces, linear in (
        ((plain, fixed, plain), True),
        ((plain, bent), False),
        ((plain, curved), False),
        ((fixed, curved), False),
        ((plain, sometimes), False),
        ((fixed, plain, sometimes), False),
    ):
        w, dim = known._w, known.dim
        one = SimpleNamespace(_roots=None, _jump=j, _traction=t, _w=w, dim=dim)
        one._pieces = dict(enumerate(pieces))
        assert type(known).is_piecewise_linear.func(one) == linear
    one._pieces, one._roots = {0: plain}, "equations at points"
    assert not type(known).is_piecewise_linear.func(one)


def test_laws_of_a_kind_are_compiled_once():
    one, other = (LawAtPoints(Coulomb(F), 2, N, COMM).compiled for F in (0.3, 0.7))
    assert one is other
    assert one is not LawAtPoints(Coulomb(0.3), 3, N, COMM).compiled
    assert one is not LawAtPoints(Tresca(0.3), 2, N, COMM).compiled
    assert one.signature != LawAtPoints(Tresca(0.3), 2, N, COMM).compiled.signature
    alone = LawAtPoints(Coulomb(0.3), 2, N, MPI.COMM_SELF).compiled
    assert (alone is one) == (COMM.size == 1)


def test_bounds_of_the_disc():
    """F p and F at unit pressure of Coulomb, where slips answer the pressure p along the normal."""
    known, jump, traction, data, _ = at_points("Coulomb", 2)
    found = known(jump, traction, data)
    F = data.fields["friction"]
    p = np.abs((found.traction(np.full(N, PLUS)) * data.n).sum(axis=1))
    np.testing.assert_allclose(found.unit_bound, F, rtol=1e-12)
    np.testing.assert_allclose(np.abs(found.bound), F * p, rtol=1e-12)
    known, jump, traction, data, _ = at_points("nonlocal", 2)
    found = known(jump, traction, data)
    np.testing.assert_allclose(found.unit_bound, data.fields["friction"], rtol=1e-12)
    known, jump, traction, data, _ = at_points("Tresca", 2)
    found = known(jump, traction, data)
    (g,) = data.fields.values()
    np.testing.assert_array_equal(found.bound, g)
    np.testing.assert_array_equal(found.unit_bound, g)


class Timed(Frictionless):
    """A law with the step of time in one place."""

    place = ""

    def pieces(self, a):
        passes = ufl.gt(a.step, -1.0)
        found = dict(super().pieces(a))
        piece = found[OPEN]
        border = piece.borders[0]
        if self.place == "answer":
            piece = replace(piece, answer=a.step * a.n)
        if self.place == "distance":
            border = border._replace(distance=a.step * border.distance)
        if self.place == "where":
            border = border._replace(where=passes)
        if self.place == "exists":
            piece = replace(piece, exists=passes)
        return {**found, OPEN: replace(piece, borders=[border, *piece.borders[1:]])}

    def bound(self, a, p):
        return a.step * p if self.place == "bound" else super().bound(a, p)

    def bond(self, a):
        if self.place != "bond":
            return None
        zero = ufl.as_ufl(0.0)
        return Bond({}, 0.0 * a.n, a.step, zero, zero)


@pytest.mark.parametrize("place", ["", "answer", "distance", "where", "exists", "bound", "bond"])
def test_where_a_law_has_the_time(place):
    """What it needs of memory is found wherever that stands."""
    law = type("OfTime", (Timed,), {"place": place})()
    symbols = Symbols(2, law.given, [], {}, from_memory(2), local=True)
    found = symbols.used(_Written(law, symbols).scalars)
    assert found == ([STEP] if place else [])


class Sometimes(Frictionless):
    """A law one of whose statuses there is under a condition."""

    of_slip = True

    def pieces(self, a):
        found = dict(super().pieces(a))
        condition = ufl.gt(ufl.dot(a.u_t, a.u_t), 1.0) if self.of_slip else ufl.gt(a.step, -2.0)
        return {**found, OPEN: replace(found[OPEN], exists=condition)}


@pytest.mark.parametrize("of_slip", [True, False])
def test_statuses_that_come_and_go_with_a_displacement(of_slip):
    """A law that has them is not linear status by status."""
    law = type("Named", (Sometimes,), {"of_slip": of_slip})()
    compiled = LawAtPoints(law, 2, N, COMM).compiled
    assert compiled.is_piecewise_linear is not of_slip
