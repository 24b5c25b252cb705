"""Bonds that recover, surfaces that give way, and both printed thresholds of friction."""

from mpi4py import MPI

import numpy as np
import pytest
from support.bonds import U0, C, Point, W, along, bonded

from dolfinx_contact import RCCM
from dolfinx_contact.evolution import QuasiStatic

PRESSED = (0.0, 5.0)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.verifies("RCCM adhesion", reference="closed form: beta_0 + w t/b, up to 1", alone=True)
def test_recovering_bonds_grow_at_rest_up_to_one(order):
    """From beta_0 by w t/b, up to 1; exactly, with steps of any length."""
    law = RCCM(C, C, W, viscosity=2.0, beta=0.3, recovers=True, order=order)
    point = Point(law)
    assert point.to(0.0, (0.0, 0.0), PRESSED) == 0.3
    for t in (0.1, 0.3, 0.35, 1.0, 1.39):
        assert point.to(t, (0.0, 0.0), PRESSED) == pytest.approx(0.3 + t / 2, rel=1e-12)
    for t in (1.5, 2.0, 3.0):
        assert point.to(t, (0.0, 0.0), PRESSED) == 1.0
    # What does not recover keeps its strength, bit by bit; so do open points.
    point = Point(RCCM(C, C, W, viscosity=2.0, beta=0.3, order=order))
    assert {point.to(t, (0.0, 0.0), PRESSED) for t in (0.0, 1.0, 3.0)} == {0.3}
    point = Point(law)
    assert {point.to(t, (0.0, 0.1 * U0)) for t in (0.0, 1.0, 3.0)} == {0.3}


@pytest.mark.parametrize(("order", "most"), [(1, 0.005), (2, 5e-5)])
@pytest.mark.parametrize(("start", "u"), [(0.9, 2.0), (0.1, 1.25)])
@pytest.mark.verifies(
    "RCCM adhesion", reference="closed form: exponentially to w/(C u^2)", alone=True
)
def test_rccm_relaxes_exponentially_at_a_fixed_jump(start, u, order, most):
    """Exponentially to w/(C u^2), from above and from below; orders of the steps."""
    b = 0.5
    errors = []
    law = RCCM(C, C, W, viscosity=b, beta=start, recovers=True, order=order)
    for n in (64, 128, 256):
        point = Point(law)
        point.to(0.0, (0.0, 0.0), PRESSED)
        point.to(1e-7, (u * U0, 0.0), PRESSED)
        t = np.linspace(0.0, 0.5, n + 1)[1:]
        beta = np.array([point.to(v + 1e-7, (u * U0, 0.0), PRESSED) for v in t])
        wanted = u**-2 + (start - u**-2) * np.exp(-(u**2) * t / b)
        errors.append(np.abs(beta - wanted).max())
    assert errors[-1] < most
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(rates, order, atol=0.25)


def test_a_new_bond_begins_where_it_is():
    """Drawn off by 2000 u0 and put down aside; its springs are at rest there, and break anew."""
    law = RCCM(C, C, W, viscosity=0.1, recovers=True)
    point = Point(law)
    aside = 5 * U0
    point.to(0.0, (0.0, 0.0), PRESSED)
    broken = point.to(100.0, (0.0, 2000 * U0))
    assert broken < 1e-6
    assert point.answers.bond("broken")[0] == 1
    assert point.to(101.0, (aside, 0.0), PRESSED) == broken  # it was open until now
    assert point.to(101.05, (aside, 0.0), PRESSED) == pytest.approx(0.5, rel=1e-5)
    np.testing.assert_allclose(point.answers.bond("traction"), 0.0, atol=1e-12)
    beta = point.to(101.06, (aside + 0.5 * U0, 0.0), PRESSED)
    assert beta == pytest.approx((0.1 * 0.5 + 0.01) / (0.1 + 0.01 * 0.25), rel=1e-5)
    traction = point.answers.bond("traction")[0]
    np.testing.assert_allclose(traction, (-(beta**2) * C * 0.5 * U0, 0.0), rtol=1e-12)
    assert point.answers.bond("stored")[0] == pytest.approx(beta**2 * W * 0.25 / 2, rel=1e-12)
    assert point.to(200.0, (aside + 2 * U0, 0.0), PRESSED) == pytest.approx(0.25, rel=0.01)
    # A bond that was not broken keeps its reference.
    kept = Point(law)
    kept.to(0.0, (0.0, 0.0), PRESSED)
    weak = kept.to(100.0, (0.0, 20 * U0))
    kept.to(101.0, (aside, 0.0), PRESSED)
    assert weak < kept.to(1e3, (aside, 0.0), PRESSED) == pytest.approx(1 / 25, rel=1e-5)


@pytest.mark.long
@pytest.mark.parametrize(
    "given",
    [
        pytest.param({}, marks=pytest.mark.long),
        {"recovers": True, "broken": 0.1},
    ],
)
def test_the_energy_residue_of_recovering_bonds_falls_with_the_steps(given):
    left = []
    for n in (12, 24):
        law = RCCM(C, C, W, 0.3, viscosity=0.2, **given)
        problem, top = bonded(n=1, law=law, young=1e3, comm=MPI.COMM_SELF)
        load = along(top, (0.0, -0.05), (0.1, 0.4), (0.05, -0.05))
        history = QuasiStatic(problem, load).run(np.linspace(0.0, 3.0, 3 * n + 1))
        left.append(abs(history.energies.residue))
        spent = [s.energies.damage for s in history.steps]
        assert max(spent) > 0.5 * W
        # A bond that grows freely gives back w, all of which viscosity takes: b beta'^2 = w beta'.
        assert spent[-1] == pytest.approx(max(spent), rel=1e-6)
    assert left[1] < 0.6 * left[0]
    assert left[0] < 0.1 * history.energies.external
