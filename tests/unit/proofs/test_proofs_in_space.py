"""All solutions of reduced problems in space: proofs and the checker."""

import numpy as np
import pytest
from support.space_problems import (
    at_a_border,
    by_newton,
    in_closed_form,
    is_among,
    is_solved,
    on_a_continuum,
    one_node,
    random_problem,
    random_stiffness,
    two_far_nodes,
)

from dolfinx_contact.proofs import (
    Certificate,
    InvalidCertificate,
    ReducedProblem,
    check,
    prove_solutions,
)
from dolfinx_contact.proofs.check_proof import (
    IN_SLIP,
)


@pytest.mark.parametrize("number", [60, pytest.param(4000, marks=pytest.mark.long)])
@pytest.mark.verifies(
    "certificates",
    reference="closed form: a quartic for the slips of one node",
    aspects=("3D", "proofs"),
    alone=True,
)
def test_all_solutions_of_a_node_in_space_are_proved(number):
    rng = np.random.default_rng(0)
    several = 0
    for k in range(number):
        S, p, friction = one_node(rng)
        found = prove_solutions(ReducedProblem(S, p, np.array([friction])))
        expected = in_closed_form(S, p, friction)
        assert found.verdict == "complete", k
        assert len(found.solutions) == len(expected), k
        for letter, state in expected:
            near = [s for s in found.solutions if np.abs(s.state[0] - state).max() < 1e-8]
            assert len(near) == 1, k
            assert "oks"[near[0].codes[0]] == letter, k
            assert (np.abs(near[0].state[0] - state) <= near[0].away[0] + 1e-9).all(), k
        several += len(expected) > 1
    assert several >= number // 100


def three_solutions():
    """One node whose slip lifts it: open, stick and slip."""
    S = np.array([[2.0, 0.0, 1.0], [0.0, 2.0, 0.0], [1.0, 0.0, 2.0]])
    return ReducedProblem(S, np.array([-2.5, 0.1, -1.0]), np.array([3.0]))


@pytest.mark.parametrize(
    ("number", "starts", "mixed"),
    [
        (7, 200, False),
        (12, 400, True),
        pytest.param(400, 5000, False, marks=pytest.mark.long),
        pytest.param(400, 5000, True, marks=pytest.mark.long),
    ],
)
@pytest.mark.verifies(
    "certificates",
    reference="itself: Newton's method from thousands of starts",
    aspects=("3D", "proofs"),
)
def test_no_solution_is_excluded(number, starts, mixed):
    rng = np.random.default_rng(1)
    complete = 0
    for k in range(number):
        problem = random_problem(rng, mixed=mixed)
        if k % 6 == 0 and not mixed:
            problem = two_far_nodes(rng)
        found = prove_solutions(problem, proof_seconds=20)
        assert check(found.certificate).verdict == found.verdict
        complete += found.verdict == "complete"
        for state in by_newton(problem, starts, rng):
            assert found.verdict == "open" or is_among(state, found), k
    assert complete >= 0.95 * number


@pytest.mark.parametrize(
    ("number", "starts"), [(10, 100), pytest.param(120, 5000, marks=pytest.mark.long)]
)
@pytest.mark.verifies(
    "certificates",
    reference="closed form: problems made for states at borders, and for lines of solutions",
    aspects=("3D", "proofs"),
    alone=True,
)
def test_no_proof_is_false_at_borders_and_continua(number, starts):
    """No proof claims one solution on a line of solutions, or is missing a state."""
    rng = np.random.default_rng(12)
    verdicts = []
    for k in range(number):
        family = k % 5
        if family in (0, 1):  # a line of solutions, and one that is off by 1e-6
            problem, states = on_a_continuum(rng)
            if family == 1:
                p = problem.p + 1e-6 * rng.normal(size=len(problem.p))
                problem, states = ReducedProblem(problem.S, p, problem.friction), []
        else:
            problem, state = at_a_border(rng, (0.0, 1e-13, 1e-7)[family - 2])
            states = [state]
        assert all(is_solved(problem, state) for state in states), k
        found = prove_solutions(problem, proof_seconds=20)
        assert check(found.certificate).verdict == found.verdict
        assert family != 0 or found.verdict == "open", k
        assert family != 2 or found.verdict != "complete", k
        for state in (*states, *by_newton(problem, starts, rng)):
            assert found.verdict == "open" or is_among(state, found), k
        verdicts.append((family, found.verdict))
    print({v: verdicts.count(v) for v in sorted(set(verdicts))})
    assert sum(v == "complete" for family, v in verdicts if family == 4) > 0.15 * number


def test_decoupled_nodes_have_nine_proved_solutions():
    """Three solutions each: nine, with two different slips among the statuses."""
    found = prove_solutions(two_far_nodes(np.random.default_rng(2)))
    assert found.verdict == "complete"
    words = sorted("".join("oks"[c] for c in s.codes) for s in found.solutions)
    assert words == sorted(a + b for a in "oks" for b in "oks")


# -- parts of the checker --------------------------------------------------------------------------


def several(number, seed=3, mixed=False):
    """Scaled problems with solutions, as states (m, 6)."""
    rng = np.random.default_rng(seed)
    while number:
        problem = two_far_nodes(rng) if number % 3 == 0 and not mixed else None
        problem = (problem or random_problem(rng, mixed=mixed)).scaled
        states = by_newton(problem, 100, rng)
        if states:
            yield problem, states, rng
            number -= 1


# -- degenerate problems, data with errors ---------------------------------------------------------

NODE = np.array([[2.0, 0.0, 0.5], [0.0, 2.0, 0.0], [0.5, 0.0, 1.0]])


def test_borders_are_named():
    """A shear that is the friction exactly; beside it one status is proved."""
    found = prove_solutions(ReducedProblem(NODE, np.array([0.5, 0.0, -1.0]), np.array([0.5])))
    assert found.verdict == "degenerate"
    assert found.solutions == ()
    assert {int(s.codes[0]) for s in found.border} == {1, 2}
    for off, code in ((1e-6, 2), (-1e-6, 1)):
        p = np.array([0.5 + off, 0.0, -1.0])
        (only,) = prove_solutions(ReducedProblem(NODE, p, np.array([0.5]))).solutions
        assert only.codes[0] == code


def test_a_continuum_is_left_open_with_a_reason():
    """F k = k_t against the slip and a load on the line: infinitely many slips along -x."""
    k = 0.8
    S = np.array([[1.0, 0.0, k], [0.0, 1.0, 0.0], [k, 0.0, 1.0]])
    friction = np.array([1 / k])
    found = prove_solutions(ReducedProblem(S, np.array([-0.5 / k, 0.0, -0.5]), friction))
    assert found.verdict == "open"
    assert not found.solutions
    assert {int(s.codes[0]) for s in found.border} == {0, 1}
    assert all("continuum" in region.why for region in found.open_regions)
    assert all(region.statuses[0] == 4 for region in found.open_regions)
    assert "a continuum or a border may be there" in str(found)
    ends = np.concatenate([r.cells.ends[r.cells.kind == IN_SLIP] for r in found.open_regions])
    assert np.abs(ends - 2.0).max() < 1e-3


def test_rest_in_space_is_the_only_solution_without_load():
    found = prove_solutions(ReducedProblem(NODE, np.zeros(3), np.array([0.5])))
    assert found.verdict == "complete"
    assert not found.solutions[0].state.any()


def test_a_search_in_space_that_is_cut_short_says_so():
    rng = np.random.default_rng(5)
    problem = ReducedProblem(random_stiffness(10, rng), rng.normal(size=30), np.full(10, 5.0))
    found = prove_solutions(problem, proof_seconds=1.0)
    assert found.verdict == "open"
    assert found.seconds < 6.0
    assert "time is over" in str(found)
    assert check(found.certificate).verdict == "open"


@pytest.mark.verifies(
    "certificates",
    reference="theorem: one solution under a bound given in advance",
    aspects=("3D", "proofs"),
    alone=True,
)
def test_trescas_law_in_space_has_one_proved_solution():
    rng = np.random.default_rng(6)
    for _ in range(20):
        n = int(rng.integers(1, 5))
        bound = rng.uniform(0, 1, n) * (rng.random(n) < 0.8)
        p = rng.normal(size=3 * n)
        problem = ReducedProblem(random_stiffness(n, rng), p, np.zeros(n), bound)
        found = prove_solutions(problem)
        assert found.verdict == "complete"
        (one,) = found.solutions
        (state,) = by_newton(problem, 20, rng)
        assert np.abs(one.state - state).max() < 1e-7


@pytest.mark.parametrize("tries", [2, pytest.param(5, marks=pytest.mark.long)])
def test_a_proof_in_space_holds_for_all_data_within_their_errors(tries):
    """Solutions of all problems within the errors are within the bounds of the solutions."""
    rng = np.random.default_rng(7)
    for problem in (three_solutions(), two_far_nodes(rng)):
        S_error, p_error = 1e-6 * np.abs(problem.S), 1e-6 * np.ones_like(problem.p)
        found = prove_solutions(
            ReducedProblem(problem.S, problem.p, problem.friction, None, S_error, p_error)
        )
        assert found.verdict == "complete"
        for _ in range(tries):
            half = np.triu(rng.choice([-1.0, 1.0], problem.S.shape))
            signs = half + np.triu(half, 1).T
            S = problem.S + signs * S_error
            p = problem.p + rng.choice([-1.0, 1.0], len(problem.p)) * p_error
            other = prove_solutions(ReducedProblem(S, p, problem.friction))
            assert len(other.solutions) == len(found.solutions)
            for s in other.solutions:
                fits = [(np.abs(s.state - t.state) <= t.away).all() for t in found.solutions]
                assert sum(fits) == 1


def test_prove_solutions_in_space_refuses_known_states():
    problem = three_solutions()
    with pytest.raises(ValueError, match="known must be states"):
        prove_solutions(problem, known=[np.zeros((1, 4))])
    with pytest.raises(ValueError, match="known must be states"):
        prove_solutions(problem, known=[np.full((1, 6), np.nan)])
    with pytest.raises(ValueError, match="not positive definite"):
        ReducedProblem(-problem.S, problem.p, problem.friction)


def test_known_solutions_shorten_the_search():
    problem = two_far_nodes(np.random.default_rng(9))
    found = prove_solutions(problem)
    again = prove_solutions(problem, known=[s.state for s in found.solutions])
    assert again.verdict == "complete"
    assert len(again.solutions) == len(found.solutions)


# -- records ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def proofs():
    """Proofs that together hold every kind of step."""
    rng = np.random.default_rng(10)
    found = [prove_solutions(p).certificate for p in (three_solutions(), two_far_nodes(rng))]
    kinds = {"exclude", "bound", "halve", "branch", "only", "leaf", "empty"}
    known = {step["do"] for c in found for step in c.steps}
    while not kinds <= known:
        S, p, friction = one_node(rng) if rng.random() < 0.3 else (None, None, None)
        problem = random_problem(rng) if S is None else ReducedProblem(S, p, np.array([friction]))
        F = 2.5 * problem.friction
        new = prove_solutions(ReducedProblem(problem.S, problem.p, F), proof_seconds=5).certificate
        of_these = {step["do"] for step in new.steps}
        if not of_these <= known and "open" not in of_these:
            found.append(new)
            known |= of_these
    return found


def says(proved):
    """Statuses, normal forces and their errors, of the solutions, sorted."""
    return sorted(
        (s.codes.tolist(), float(s.state[:, 5].sum()), float(s.away[:, 5].sum()) + 1e-12)
        for s in proved.inside
    )


def test_stored_proofs_are_read_unchanged(proofs, tmp_path):
    """A stored proof is read unchanged and does not prove other data."""
    for proof in proofs:
        proof.save(tmp_path / "proof.npz")
        again = Certificate.load(tmp_path / "proof.npz")
        assert says(check(again)) == says(check(proof))
        p = again.problem
        other = ReducedProblem(p.S, p.p + 0.3 * np.abs(p.p).max(), p.friction)
        with pytest.raises(InvalidCertificate):
            check(Certificate(other, again.steps, again.vectors))


def test_a_proof_of_the_plane_is_none_in_space(proofs):
    """Steps of the other dimension are refused, in words."""
    flat = ReducedProblem(
        np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-2.5, -1.0]), np.array([3.0])
    )
    with pytest.raises(InvalidCertificate):
        check(Certificate(flat, proofs[0].steps, proofs[0].vectors))
    with pytest.raises(InvalidCertificate):
        check(Certificate(three_solutions(), prove_solutions(flat).certificate.steps, []))


def test_starts_find_all_solutions_in_open_regions_in_space():
    """Without time for a proof starts find all nine, each once, and the laws hold."""
    problem = two_far_nodes(np.random.default_rng(2))
    found = prove_solutions(problem, proof_seconds=0.0)
    assert found.verdict == "open"
    words = sorted("".join("oks"[c] for c in s.codes) for s in found.solutions)
    assert words == sorted(a + b for a in "oks" for b in "oks")
    assert all(is_solved(problem, s.state) for s in found.solutions)
    assert check(found.certificate).verdict == "open"
