"""Laws that are compiled, at single points: every derivative against differences of the values."""

from dataclasses import dataclass, replace
from functools import cache

from mpi4py import MPI

import numpy as np
import pytest

from dolfinx_contact.laws import (
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

COMM = MPI.COMM_WORLD
N = 6


@dataclass(frozen=True)
class RoughNonlocal(NonlocalCoulomb):
    """Law of two fields and a third nonlocal one."""

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
ROUGH = RoughNonlocal(0.3, 0.5)


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
def test_derivatives_of_a_compiled_law_agree_with_differences(name, dim):
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
def test_derivatives_of_laws_include_turning_normals(name, dim):
    """Jump and normal depend on the displacement in their own ways."""
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
def test_averaged_pressure_and_answer_agree(name):
    """The pressure is averaged over other points, and so is the answer."""
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
