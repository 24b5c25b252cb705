"""Proofs that the rays out of a point are all, against the enumeration of pieces."""

from dataclasses import replace
from functools import partial

from mpi4py import MPI

import cases.ciarlet_geymonat
import numpy as np
import pytest
from cases._triangle import linear_triangle
from support.textbook import coulomb_system

from dolfinx_contact.continuation.rays import outgoing
from dolfinx_contact.proofs import ReducedProblem
from dolfinx_contact.proofs.rays import apex_problem, prove_rays

COMM = MPI.COMM_WORLD
OPEN = 0
STICK = 1
SLIP = 2


def decided(system, codes):
    """The cone of a state in which some points are inside the borders of a status."""
    allowed = system.allowed.copy()
    inequalities = system.inequalities.copy()
    for i, code in codes.items():
        allowed[i] = np.arange(4) == code
        inequalities[i] = 0.0
    return replace(system, allowed=allowed, inequalities=inequalities)


def random_cone(rng, m, codes, friction):
    G = rng.standard_normal((2 * m, 2 * m))
    S = G @ G.T / m + 0.1 * np.eye(2 * m)
    q = rng.standard_normal(2 * m)
    S = (S + S.T) / 2
    system = coulomb_system(S, np.zeros(2 * m), q, friction)
    whole = ReducedProblem(S, q, np.full(m, friction))
    return whole, system, decided(system, codes)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.verifies(
    "rays out of a kink",
    "certificates",
    reference="enumeration: the rays of all pieces",
    aspects=(
        "2D",
        "proofs",
    ),
    alone=True,
)
def test_against_enumeration(seed):
    """Three points at their apex, one open and one stuck: the rays of 4^3 pieces."""
    rng = np.random.default_rng(seed)
    friction = rng.uniform(0.2, 4.0)
    whole, system, cone = random_cone(rng, 5, {1: OPEN, 3: STICK}, friction)
    known = outgoing(cone)
    assert known.complete
    assert all(ray.rate != 0 for ray in known.rays)
    found = prove_rays(apex_problem(whole, system, cone), [], proof_seconds=30)
    assert found.verdict == "complete"
    mine = sorted((rate, codes.tolist()) for codes, rate in found.rays)
    assert mine == sorted((ray.rate, ray.codes.tolist()) for ray in known.rays)


def test_where_nothing_is_proved():
    """A point that slips does work along a ray, of any sign."""
    rng = np.random.default_rng(4)
    whole, system, cone = random_cone(rng, 3, {1: SLIP}, 1.0)
    assert "1 points slip" in apex_problem(whole, system, cone)
    whole, system, cone = random_cone(rng, 2, {0: OPEN, 1: STICK}, 1.0)
    assert "no point is at its apex" in apex_problem(whole, system, cone)


def rays_at(system, gamma):
    """Rays out of the unloaded state, with a proof."""
    x = system.create_vector()
    condensed = system.condensed(x, gamma)
    cone = condensed.system.tangent_cone(condensed.contract(x), 1e-9)
    return outgoing(cone, prove=partial(system.prove_rays, condensed))


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "rays out of a kink",
    "hyperelastic bodies",
    reference="itself: three rays to either side",
    aspects=(
        "2D",
        "proofs",
    ),
)
def test_a_hyperelastic_block():
    """The 20 x 40 block of the seed: 21 points at their apex, three rays to either side."""
    found = rays_at(cases.ciarlet_geymonat.block(20, 40, 1.0), 0.0)
    assert found.complete
    assert found.method.count("a proof of") == 2
    assert sorted(ray.rate for ray in found.rays) == 3 * [-1.0] + 3 * [1.0]


def test_no_time_no_proof():
    system = linear_triangle(16, 1.9)
    assert rays_at(system, 0.0).complete
    system.proof_seconds = 0.0
    found = rays_at(system, 0.0)
    assert not found.complete
    assert "proof" not in found.method
    system.proof_seconds = 1e-9
    found = rays_at(system, 0.0)
    assert not found.complete
    assert "a proof was tried" in found.method
    ranks = [1.0 + COMM.rank] if COMM.size > 1 else []
    for bad in (-1.0, np.nan, "1", True, *ranks):
        system.proof_seconds = bad
        with pytest.raises(ValueError, match="seconds"):
            rays_at(system, 0.0)
