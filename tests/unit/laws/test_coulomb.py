"""Coulomb's and Tresca's laws on numpy arrays agree with their UFL."""

import numpy as np
import pytest
from support.blocks import block

from dolfinx_contact import Coulomb, Frictionless, ParametricContact, Tresca
from dolfinx_contact.laws import coulomb
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK

LAWS = [Coulomb(0.7), Frictionless(), Tresca(2.0)]


def reduced(law):
    """A reduction, friction, bound and augmentation of its points, in units of w."""
    problem = block(n=3, law=law)
    system = ParametricContact(problem)
    x = system.create_vector()
    found = system.condensed(x, 0.0, conic=False)
    x.destroy()
    points = found.problem(unit=found.force_unit)
    return system, found, points.friction, points.bound, points.augmentation


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
@pytest.mark.verifies(
    "Coulomb",
    "Signorini",
    "Tresca",
    reference="itself: the laws in UFL",
    aspects=("2D",),
    alone=True,
)
def test_coulomb_statuses_follow_their_inequalities(law):
    system, found, F, g, k = reduced(law)
    rng = np.random.default_rng(1)
    seen = set()
    for _ in range(40):
        w = rng.standard_normal((len(F), 4))
        if g.any():
            w *= (g / k)[:, None]
        w[:, 2:] *= k[:, None]
        codes = coulomb.statuses(w[:, 2:] - k[:, None] * w[:, :2], F, g)
        asked = found.system.classify(w)
        # Without friction slips have no sense.
        codes = np.where((codes == MINUS) & (F == 0) & (g == 0), MINUS - 1, codes)
        np.testing.assert_array_equal(codes, asked)
        seen |= set(codes.tolist())
    assert len(seen) == (2 if isinstance(law, Frictionless) else 6 if g.any() else 4)
    system.destroy()


@pytest.mark.parametrize("law", LAWS[:2], ids=lambda law: type(law).__name__)
def test_coulomb_cones_agree_with_the_compiled_law(law):
    """Planes and inequalities of the table, against those that the compiled law gives."""
    system, found, F, _, _ = reduced(law)
    affine = found.system
    inside = coulomb.WITHOUT_FRICTION if isinstance(law, Frictionless) else coulomb.INSIDE
    rng = np.random.default_rng(2)
    for i in range(affine.points):
        exists = np.flatnonzero(affine.allowed[i])
        assert exists.tolist() == ([0, 2] if isinstance(law, Frictionless) else [0, 1, 2, 3])
        for code in exists:
            constant, slope = coulomb.BASES[code]
            B = np.array(constant).T + F[i] * np.array(slope).T
            both = np.hstack([B, affine.bases[i, code]])
            assert np.linalg.matrix_rank(both, tol=1e-9) == 2
            for w in rng.standard_normal((20, 2)) @ B.T:
                least = min((c + F[i] * d) @ w for c, d, _ in inside[code])
                assert (least >= 0) == ((affine.inequalities[i, code] @ w).min() >= 0)
    system.destroy()


def test_states_on_borders_are_in_both_cones():
    """A state on a border is in both cones, and an inequality of each names the other."""
    F = 0.4
    for number, pair in enumerate(coulomb.BORDERS):
        constant, slope = coulomb.BASES[coulomb.FIRST_BORDER + number]
        (w,) = np.array(constant) + F * np.array(slope)
        w = w if number != 1 else -w  # open and slipping back: ut < 0
        for code in pair:
            B = np.array(coulomb.BASES[code][0]) + F * np.array(coulomb.BASES[code][1])
            assert np.linalg.matrix_rank(np.vstack([B, w])) == 2
            slacks = [(c + F * d) @ w for c, d, _ in coulomb.INSIDE[code]]
            assert min(slacks) == pytest.approx(0.0, abs=1e-15)


def test_violation_vanishes_for_slips_that_obey_the_law():
    """Zero for slips obeying the law; otherwise the distance of every number from the law."""
    one = np.ones(1)
    slip = {"ut": one, "un": 0 * one, "rt": -0.3 * one, "rn": one}
    given = {"friction": 0.3 * one, "bound": 0 * one}
    assert coulomb.violation(**slip, **given) == 0
    for name, value, off in (("un", -0.2, 0.2), ("rt", 0.3, 0.6), ("rt", -0.5, 0.2)):
        assert coulomb.violation(**(slip | {name: value * one}), **given) == pytest.approx(off)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.verifies(
    "Coulomb", "Tresca", reference="differences: of the projection", aspects=("2D", "3D")
)
def test_derivative_of_the_projection_agrees_with_differences(dim):
    """Away from its kinks; sticking, slipping and open points, with a bound and without."""
    rng = np.random.default_rng(4)
    m = 300
    s = rng.normal(size=(m, dim))
    friction, bound = rng.uniform(0.1, 2.0, m), rng.choice([0.0, 0.4], m)
    D = coulomb.derivative(s, friction, bound)
    h = 1e-6
    for j, e in enumerate(np.eye(dim)):
        after, before = (coulomb.allowed(s + t * e, friction, bound) for t in (h, -h))
        np.testing.assert_allclose(D[:, :, j], (after - before) / (2 * h), atol=1e-7)
    seen = coulomb.statuses(s, friction, bound)
    assert {OPEN, STICK, PLUS} <= set(seen.tolist())
