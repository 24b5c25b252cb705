"""Affine pieces and the rays that leave a point where they meet, on small condensed problems."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from support.textbook import coulomb_system

from dolfinx_contact.continuation import rays as rays_module
from dolfinx_contact.continuation.rays import outgoing


def condensed(S, load, rate, friction):
    return coulomb_system(S, load, rate, friction, r=0.5)


def random_stiffness(random, m):
    A = random.standard_normal((2 * m, 2 * m))
    return A @ A.T + 0.1 * np.eye(2 * m)


def described(found):
    letters = ("".join("ok+-"[c] for c in ray.codes) for ray in found.rays)
    return sorted(zip((ray.rate for ray in found.rays), letters, strict=True))


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.verifies(
    "rays out of a kink",
    reference="enumeration: the rays of all pieces",
    aspects=("2D",),
    alone=True,
)
def test_unfolding_finds_what_enumeration_proves(seed, monkeypatch):
    """Random stiffness, load and friction, three points: both ways find the same rays."""
    random = np.random.default_rng(seed)
    S = random_stiffness(random, 3)
    rate = random.standard_normal(6)
    cone = condensed(S, np.zeros(6), rate, random.uniform(0.2, 6.0))
    proved = outgoing(cone)
    assert proved.complete
    assert len(proved.rays) % 2 == 0  # what comes in goes out
    monkeypatch.setattr(rays_module, "MOST_PIECES", 0)
    unfolded = outgoing(cone)
    assert not unfolded.complete
    assert described(unfolded) == described(proved)


@pytest.mark.verifies(
    "rays out of a kink", reference="closed form: the rays of one node", aspects=("2D",), alone=True
)
def test_one_point_against_the_closed_form():
    """kt = kn = 2, k = 1, F = 3 > kt / k: three rays iff -F |pn| < pt < -(kt / k) |pn|, pn < 0."""
    S = np.array([[2.0, 1.0], [1.0, 2.0]])
    for pt, expected in ((-2.5, {"o", "k", "-"}), (-1.5, {"k"}), (-3.5, {"o"})):
        found = outgoing(condensed(S, np.zeros(2), [pt, -1.0], 3.0))
        assert {letter for rate, letter in described(found) if rate == 1} == expected
    exact = {"o": np.linalg.solve(S, [-2.5, -1]), "k": np.zeros(2), "-": np.array([-0.5, 0.0])}
    found = outgoing(condensed(S, np.zeros(2), [-2.5, -1.0], 3.0))
    for ray in found.rays:
        if ray.rate == 1:
            np.testing.assert_allclose(
                ray.direction[0, :2], exact["ok+-"[ray.codes[0]]], atol=1e-12
            )


def test_rays_along_which_gamma_stands_still():
    """Slip to the left at the critical coefficient F = kt / k: the kernel, in both senses."""
    S = np.array([[2.0, 1.0], [1.0, 2.0]])
    system = condensed(S, np.zeros(2), [1.0, 0.0], 2.0)
    slipping = np.zeros_like(system.allowed)
    slipping[0, 3] = True
    # Inside its cone the point keeps its status, and no inequality binds.
    inside = replace(system, allowed=slipping, inequalities=np.zeros_like(system.inequalities))
    found = outgoing(inside)
    assert [ray.rate for ray in found.rays] == [0, 0]
    first, second = (ray.direction for ray in found.rays)
    np.testing.assert_allclose(first, -second, atol=1e-12)
    np.testing.assert_allclose(S @ first[0, :2], first[0, 2:], atol=1e-12)


def test_signs_of_determinants():
    """det (M B) has the sign of det [M; rows of the law], for every piece of two points."""
    random = np.random.default_rng(3)
    ut, un, rt, rn = np.eye(4)
    signs = set()
    for friction in (0.5, 4.0):
        system = condensed(random_stiffness(random, 2), np.zeros(4), np.ones(4), friction)
        rows = [(rt, rn), (ut, un), (rt + friction * rn, un), (rt - friction * rn, un)]
        for codes in itertools.product(range(4), repeat=2):
            law = np.zeros((4, 8))
            for i, code in enumerate(codes):
                law[2 * i : 2 * i + 2, 4 * i : 4 * i + 4] = rows[code]
            order = [0, 1, 4, 5, 2, 3, 6, 7]  # displacements, then forces
            whole = np.vstack([system.matrix.reshape(4, 8), law])[:, order]
            sign = np.sign(np.linalg.det(whole))
            assert system.piece(np.array(codes, dtype=np.int8)).sign == sign
            signs.add(sign)
    assert signs == {-1.0, 1.0}
