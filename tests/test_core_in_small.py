"""Small parts of the core whose answers are known beforehand."""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import exp1

import ufl

from dolfinx_contact import Coulomb, MaxwellLayer
from dolfinx_contact.equations.order import Gathered
from dolfinx_contact.laws import Internal, LawAtPoints, PointData
from dolfinx_contact.laws.cones import _bounds, _plane
from dolfinx_contact.laws.damage import _solved
from dolfinx_contact.laws.interface import Interface
from dolfinx_contact.laws.law import Border, StatusPiece, checked_pieces
from dolfinx_contact.laws.spreading import KERNELS, whole
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK
from dolfinx_contact.points.memory import Memory, with_memory

COMM = MPI.COMM_WORLD


@dataclass(frozen=True)
class Oil(Interface):
    """A film that resists slip by its rate alone, pressed or not."""

    viscosity: Any
    needs_pressure = False
    needs_time = ("viscosity",)

    def dissipation(self, rates, state):
        return self.viscosity * rates.slip**2 / 2


def at_points(law, jump, traction, step=-1.0, **fields):
    """A law at points on a floor at y = 0 without a gap, a time after they were at rest."""
    at = LawAtPoints(law, jump.shape[1], len(jump), COMM)
    given = {name: np.full(len(jump), float(v)) for name, v in law.given.items()} | fields
    normal = np.tile(-np.eye(jump.shape[1])[-1], (len(jump), 1))
    data = PointData(normal, np.zeros(len(jump)), np.ones(len(jump)), given)
    rest = Memory(np.zeros_like(jump), step=step)
    return at(jump, traction, with_memory(at.compiled, rest, data))


@pytest.mark.skipif(COMM.size > 1, reason="one point")
def test_viscous_friction_at_a_point():
    """Shears by c |u_t|/dt against the slip, and sticks where nothing drags."""
    u = np.array([0.0, 0.2, -0.2])
    jump = np.column_stack([u, np.zeros(3)])
    traction = np.column_stack([-4.0 * np.sign(u), np.ones(3)])
    found = at_points(Oil(3.0), jump, traction, step=0.5)
    np.testing.assert_array_equal(found.required, [STICK, PLUS, MINUS])
    shear = found.traction(found.required)[:, 0]
    np.testing.assert_allclose(shear, -3.0 * u / 0.5, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(found.bound, np.abs(shear), rtol=1e-13, atol=1e-15)


@pytest.mark.skipif(COMM.size > 1, reason="one point")
def test_a_layer_with_friction_at_some_points():
    """Where its coefficient is 0 a point that is pressed slips, as with `Coulomb(0)`."""
    jump = np.zeros((2, 2))
    traction = np.tile([0.0, 1.0], (2, 1))
    law = MaxwellLayer(3.0, 2.0, 1.0, friction=0.5)
    found = at_points(law, jump, traction, friction=np.array([0.0, 0.5]))
    np.testing.assert_array_equal(found.required, [PLUS, STICK])


@pytest.mark.skipif(COMM.size > 1, reason="one point")
def test_an_open_point_closes_against_its_displacement():
    """By one of two borders, at a distance of its gap."""
    jump = np.array([[0.1, 0.05], [-0.1, 0.02]])
    found = at_points(Coulomb(0.5), jump, np.zeros((2, 2)))
    borders = found.borders(np.full(2, OPEN, dtype=np.int8))
    for k, (code, gap) in enumerate([(PLUS, 0.05), (MINUS, 0.02)]):
        there = np.isfinite(borders.distance[k])
        assert borders.target[k, there].tolist() == [code]
        np.testing.assert_allclose(borders.distance[k, there], gap, rtol=1e-14)


@pytest.mark.parametrize("place", ["exists", "where"])
def test_conditions_of_pieces_that_are_none(place):
    """Numbers, truths and UFL that is no condition, in the second of two pieces."""
    zero = ufl.as_ufl(0.0) * ufl.as_vector([1.0, 1.0])
    for bad in (True, 1.0, ufl.as_ufl(1.0)):
        exists, where = (bad, None) if place == "exists" else (None, bad)
        borders = [Border(ufl.as_ufl(1.0), OPEN), Border(ufl.as_ufl(1.0), OPEN, where)]
        pieces = {OPEN: StatusPiece(zero, []), PLUS: StatusPiece(zero, borders, exists)}
        with pytest.raises(ValueError, match="status 2: exists and where must be UFL conditions"):
            checked_pieces(pieces, 2)


def test_senses_of_variables():
    """By which they change is known of those that only fall or grow."""
    senses = {kind: Internal("x", kind).sense for kind in ("any", "falls", "grows")}
    assert senses == {"any": 0, "falls": -1, "grows": 1}


def test_kernels_in_closed_form():
    """Their integrals over line and plane, and nothing from the radius on."""
    expected = {
        ("biweight", 2): 16 / 15,
        ("biweight", 3): np.pi / 3,
        ("mollifier", 2): 0.44399381616807943782 * np.e,
        ("mollifier", 3): np.pi * (1 - np.e * exp1(1.0)),
    }
    for (kernel, dim), integral in expected.items():
        assert whole(kernel, dim) == pytest.approx(integral, rel=1e-9)
        np.testing.assert_array_equal(KERNELS[kernel](np.array([0.0, 1.0, 1.5])), [1.0, 0.0, 0.0])


def test_inequalities_that_others_imply():
    """Of x >= 0, y >= 0 and x + 2 y >= 0 the last is left out, in any units of each."""
    rows = np.array([[[1.0, 0.0], [0.0, 1.0], [1.0, 2.0]]])
    expected = np.zeros((1, 3, 4))
    expected[0, 0, 1] = expected[0, 1, 3] = 1.0
    there = np.ones((1, 3), dtype=bool)
    for units in ([1.0, 1.0, 1.0], [1.0, 1e-12, 1.0], [1e-12, 1.0, 1e12]):
        slopes = rows * np.array(units)[:, None]
        np.testing.assert_allclose(_bounds(slopes, [1, 3], there), expected, atol=1e-15)
    kept = _bounds(rows, [1, 3], np.array([[True, False, True]]))
    np.testing.assert_allclose(kept[0, :2, [1, 3]].T, [[1.0, 0.0], [0.5, 1.0]], atol=1e-15)


def test_planes_of_statuses_are_well_conditioned():
    """By Cramer's rule no coordinate is larger than 1 where the largest minor is inverted."""
    rng = np.random.default_rng(2)
    for sizes in ([1.0, 1e-3, 1.0, 1e-6], [1e-6, 1.0, 1e-3, 1.0], [1.0, 1.0, 1e-6, 1e-6]):
        rows = rng.normal(size=(1, 2, 4)) * sizes
        B, free = _plane(rows, np.ones(1, dtype=bool))
        np.testing.assert_allclose(rows @ B, 0.0, atol=1e-15)
        np.testing.assert_array_equal(B[0, free], np.eye(2))
        assert np.abs(B).max() <= 1.0 + 1e-9


@pytest.mark.parametrize("p", [0.25, 1.0, 5.0])
def test_a_step_of_damage_in_closed_form(p):
    """The y of y + k y^p = 1 for k of any size, from 1e-13 to 1e13."""
    for log in np.linspace(-30.0, 30.0, 31):
        y = _solved(ufl.as_ufl(float(log)), p)(())
        x = brentq(lambda x, k=log: np.logaddexp(-x, k - p * x), -1.0, 200.0, xtol=1e-15)
        assert y == pytest.approx(np.exp(-x), rel=2e-11)


def test_points_of_all_ranks_in_one_order():
    """By x, then y, then what distinguishes them, however they are numbered and rounded off."""
    x = np.array([[0.0, 0.0], [0.0, 1.0], [0.5, -1.0], [0.5, 2.0], [0.5, 2.0], [1.0, 0.0]])
    ids = np.array([[0, 3], [0, 2], [0, 9], [1, 7], [2, 5], [0, 1]])
    n = len(x)
    order = np.random.default_rng(COMM.rank).permutation(n)
    shifted = x + [10.0 * COMM.rank, 0.0]
    noise = 1e-13 * (-1.0) ** np.arange(2 * n).reshape(n, 2)
    known = Gathered(COMM, (shifted + noise)[order], ids[order])
    everywhere = np.concatenate([x + [10.0 * rank, 0.0] for rank in range(COMM.size)])
    assert len(known) == n * COMM.size
    np.testing.assert_allclose(known.positions, everywhere, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(known.mine, n * COMM.rank + order)
    np.testing.assert_array_equal(known(ids[order, 1]), np.tile(ids[:, 1], COMM.size))
    orders = COMM.allgather(order)
    for i in range(len(known)):
        rank, place = known.owner(i)
        assert (rank, orders[rank][place]) == divmod(i, n)
