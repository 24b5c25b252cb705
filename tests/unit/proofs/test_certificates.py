"""Proofs of all solutions, against the enumeration of all statuses."""

import numpy as np
import pytest
from support.enumeration import enumerated, random_problem

from dolfinx_contact.algorithms import coulomb_by_lemke
from dolfinx_contact.proofs import (
    ReducedProblem,
    check,
    prove_solutions,
)
from dolfinx_contact.proofs.check_proof import StatusRegion, solve_piece


def statuses(solutions):
    return sorted(tuple(int(c) for c in s.codes) for s in solutions)


def compare(seed, number):
    """Verdicts of random problems, each compared with the enumeration and checked again."""
    rng = np.random.default_rng(seed)
    verdicts = []
    for k in range(number):
        S, p, F = random_problem(rng, rounded=k % 5 == 0)
        found = prove_solutions(ReducedProblem(S, p, F), proof_seconds=60)
        assert check(found.certificate).verdict == found.verdict
        known, near = enumerated(S, p, F)
        if found.verdict == "complete" and p.any():
            assert statuses(found.solutions) == known, (seed, k)
        elif found.verdict == "degenerate":
            assert near, (seed, k)
            assert set(statuses(found.solutions)) <= set(known), (seed, k)
        verdicts.append((found.verdict, len(found.solutions)))
    return verdicts


@pytest.mark.verifies(
    "certificates",
    reference="enumeration: all statuses of random problems",
    aspects=(
        "2D",
        "proofs",
    ),
    alone=True,
)
def test_proofs_of_random_problems_agree_with_enumeration():
    verdicts = compare(0, 100)
    assert sum(v == "complete" for v, _ in verdicts) > 95
    assert any(count == 3 for _, count in verdicts)


@pytest.mark.long
def test_many_random_problems_agree_with_enumeration():
    verdicts = compare(1, 2000)
    assert sum(v == "complete" for v, _ in verdicts) > 1900


def several(number, seed=5):
    """Problems with several solutions, and these as pieces."""
    rng = np.random.default_rng(seed)
    while number:
        S, p, F = random_problem(rng, most=4)
        codes, near = enumerated(S, p, 3 * F)
        if len(codes) > 1 and not near:
            problem = ReducedProblem(S, p, 3 * F).scaled
            yield problem, [solve_piece(problem, np.array(c, dtype=np.int8)) for c in codes]
            number -= 1


@pytest.mark.verifies(
    "certificates",
    reference="enumeration: all statuses of random problems",
    aspects=(
        "2D",
        "proofs",
    ),
    alone=True,
)
def test_bounds_hold_every_solution():
    for problem, pieces in several(10):
        ub = StatusRegion.whole(problem).ub
        for q in pieces:
            plus, minus = (s.value for s in q.slacks)
            s = [np.maximum(q.ut.value, 0), np.maximum(-q.ut.value, 0), q.un.value, plus, minus]
            used = np.array([*s, q.rn.value])
            used[3:5, problem.friction == 0] = 0
            assert (used <= ub + 1e-13).all()


def test_a_proof_in_the_plane_holds_for_all_data_within_their_errors():
    rng = np.random.default_rng(8)
    proved = 0
    for _ in range(30):
        S, p, F = random_problem(rng, most=3)
        dS = np.full_like(S, 1e-3 * np.abs(S).max())
        dp = np.full_like(p, 1e-3)
        try:
            found = prove_solutions(ReducedProblem(S, p, F, None, dS, dp))
        except ValueError:
            continue
        if found.verdict != "complete":
            continue
        proved += 1
        for _ in range(5):
            E = dS * rng.choice([-1, 1], S.shape)
            E = np.triu(E) + np.triu(E, 1).T
            near = p + dp * rng.choice([-1, 1], p.shape)
            assert enumerated(S + E, near, F)[0] == statuses(found.solutions)
            for s in found.solutions:
                other = solve_piece(ReducedProblem(S + E, near, F), s.codes)
                assert (np.abs(other.state - s.state) <= s.away).all()
    assert proved > 12


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e12])
def test_a_proof_does_not_depend_on_units(scale):
    problem, pieces = next(several(1))
    found = prove_solutions(
        ReducedProblem(scale * problem.S, scale**2 * problem.p, problem.friction)
    )
    assert statuses(found.solutions) == statuses(pieces)
    for s in found.solutions:
        (same,) = (q for q in pieces if np.array_equal(q.codes, s.codes))
        np.testing.assert_allclose(s.state[:, :2], scale * same.state[:, :2], atol=1e-12 * scale)


@pytest.mark.verifies(
    "certificates",
    "Tresca",
    reference="itself: Lemke's method",
    aspects=(
        "2D",
        "proofs",
    ),
    alone=True,
)
def test_trescas_law_in_the_plane_has_one_proved_solution():
    """Tresca's law, beside Coulomb's and none."""
    rng = np.random.default_rng(9)
    for k in range(20):
        S, p, F = random_problem(rng, most=8)
        given = rng.random(len(F)) < (1.0 if k % 2 else 0.5)
        F[given] = 0
        g = np.where(given, rng.uniform(0, 1, len(F)), 0)
        found = prove_solutions(ReducedProblem(S, p, 0.3 * F, g), proof_seconds=20)
        assert check(found.certificate).verdict == "complete"
        (one,) = found.solutions
        w, _ = coulomb_by_lemke(S, p, 0.3 * F, bound=g)
        np.testing.assert_allclose(one.state, w, atol=1e-9)


def test_rest_in_the_plane_is_the_only_solution_without_load():
    """Every point is at every border; a small load has other solutions."""
    S, _, F = random_problem(np.random.default_rng(10))
    found = prove_solutions(ReducedProblem(S, np.zeros(len(S)), F))
    assert found.verdict == "complete"
    assert len(found.solutions) == 1
    assert not found.solutions[0].state.any()
    assert check(found.certificate).at_rest


@pytest.mark.verifies(
    "certificates",
    reference="closed form: Hild's element, with a grazing state",
    aspects=(
        "2D",
        "proofs",
    ),
    alone=True,
)
def test_degenerate_problems_are_said_to_be():
    """Hild's element: the free state grazes, beside stick; with F = 2 slips join both."""
    S = np.array([[2.0, 1.0], [1.0, 2.0]])
    p = np.array([-1.0, -0.5])
    border = prove_solutions(ReducedProblem(S, p, np.array([3.0])))
    assert border.verdict == "degenerate"
    assert statuses(border.solutions) == [(1,)]
    assert statuses(border.border) == [(0,), (3,)]
    assert not border.singular
    for s in border.border:
        np.testing.assert_allclose(s.state, [[-0.5, 0.0, 0.0, 0.0]], atol=1e-15)
    continuum = prove_solutions(ReducedProblem(S, p, np.array([2.0])))
    assert continuum.verdict == "degenerate"
    assert not continuum.solutions
    assert statuses(continuum.border) == [(0,), (1,)]
    assert [s.tolist() for s in continuum.singular] == [[3]]


def test_a_search_in_the_plane_that_is_cut_short_says_so():
    rng = np.random.default_rng(11)
    G = rng.standard_normal((24, 24))
    problem = ReducedProblem(G @ G.T + np.eye(24), rng.standard_normal(24), np.full(12, 4.0))
    found = prove_solutions(problem, proof_seconds=0.0)
    assert found.verdict == "open"
    assert len(found.open_regions) == 1
    assert check(found.certificate).verdict == "open"
