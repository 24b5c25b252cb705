"""Steps of adhesion in time: orders, recovery, at one point whose jump is given."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.bonds import Point

import ufl

from dolfinx_contact import RCCM
from dolfinx_contact.laws.adhesion import DamageStep

C = 100.0
W = 1.0
U0 = np.sqrt(W / C)
#: beta at 1.5, 2 and 3 u0 of a bond that opens at a constant speed, by b V/(u0 w).
OPENED = {
    1.0: (0.7811538113, 0.4048318120, 0.1218560409),
    0.01: (0.4471181641, 0.2506289459, 0.1111935685),
}
#: Each is compiled by itself.


def opened(law, times, speed=U0):
    point = Point(law)
    return np.array([point.to(t, (0.0, speed * t)) for t in times])


def exact(b):
    """The same by an integrator of ordinary differential equations."""
    found = solve_ivp(
        lambda t, beta: [-max(t**2 * beta[0] - 1, 0.0) / b],
        (1.0, 3.0), [1.0], method="Radau", rtol=1e-11, atol=1e-13, dense_output=True,
    )  # fmt: skip
    return found.sol([1.5, 2.0, 3.0])[0]


def errors(law, wanted, steps):
    """Largest errors at 1.5, 2, 3 u0 by steps for each u0."""
    found = []
    for n in steps:
        beta = opened(law, np.arange(3 * n + 1) / n)
        found.append(np.abs(beta[[3 * n // 2, 2 * n, 3 * n]] - wanted).max())
    return np.array(found)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("b", OPENED)
@pytest.mark.verifies(
    "RCCM adhesion",
    reference="independent code: an integrator of the equation of the intensity",
    alone=True,
)
def test_steps_of_damage_have_their_orders(b, order):
    np.testing.assert_allclose(exact(b), OPENED[b], rtol=1e-8)
    law = RCCM(C, C, W, viscosity=b * W, order=order)
    found = errors(law, OPENED[b], (16, 32, 64))
    np.testing.assert_allclose(np.log2(found[:-1] / found[1:]), order, atol=0.15)
    assert found[-1] < {1: 0.004, 2: 6e-5}[order]


@pytest.mark.verifies(
    "RCCM adhesion", reference="closed form: the slope of a parabola through three states"
)
@pytest.mark.parametrize("ratio", [0.25, 1.0, 1.7, 2.0, 6.0])
def test_rccm_is_of_second_order_in_time(ratio):
    """b beta' = w - E beta with the slope at the end of steps of any lengths, as far as 2 to 1."""
    before, now, step, w, b, energy = 0.95, 0.8, 0.3, 1.0, 0.7, 4.0
    length = step / ratio
    known = {"rate": (before - now) / length, "length": length, "rest": w / energy}
    values = {name: ufl.as_ufl(v) for name, v in known.items()}
    found = DamageStep(*map(ufl.as_ufl, (now, w, b)), ufl.as_ufl(step), values)
    # Where a step is longer, the state before is taken as if it were half as far back.
    back = max(length, step / 2)
    places = np.array([-back, 0.0, step])
    slopes = [
        np.polyval(np.polyder(np.polyfit(places, row, 2)), step) for row in np.eye(3)
    ]  # of the three states
    old = now + back * known["rate"]
    wanted = (w - b * (slopes[0] * old + slopes[1] * now)) / (energy + b * slopes[2])
    assert found.now(energy)(()) == pytest.approx(wanted, rel=1e-10)
