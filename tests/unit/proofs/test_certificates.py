"""Proofs of what all solutions are, against the enumeration of all statuses."""

import copy
import itertools

from mpi4py import MPI

import numpy as np
import pytest

from dolfinx_contact.algorithms import coulomb_by_lemke
from dolfinx_contact.analysis import (
    Certificate,
    InvalidCertificate,
    ReducedProblem,
    check,
    prove_solutions,
)
from dolfinx_contact.analysis.candidates import candidates, within
from dolfinx_contact.analysis.check_proof import StatusRegion, differences, solve_piece

serial = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="the same on every rank")
pytestmark = serial


def enumerated(S, p, F):
    """Statuses of all solutions, by solving 4^m pieces; whether one is near a border."""
    m = len(F)
    every = np.array(list(itertools.product(range(4), repeat=m)))
    found = []
    near = False
    for codes in np.array_split(every, max(1, len(every) // 1024)):
        A = np.zeros((len(codes), 2 * m, 2 * m))
        for i in range(m):
            opened, stuck, slips = (np.flatnonzero(b) for b in _kinds(codes[:, i]))
            A[opened, :, 2 * i : 2 * i + 2] = S[:, 2 * i : 2 * i + 2]
            A[stuck, 2 * i, 2 * i] = A[stuck, 2 * i + 1, 2 * i + 1] = -1
            A[slips, :, 2 * i] = S[:, 2 * i]
            A[slips, 2 * i + 1, 2 * i + 1] = -1
            A[slips, 2 * i, 2 * i + 1] = np.where(codes[slips, i] == 2, F[i], -F[i])
        z = np.linalg.solve(A, np.broadcast_to(p[:, None], (len(codes), 2 * m, 1)))
        x, y = np.moveaxis(z.reshape(len(codes), m, 2), 2, 0)
        slip = np.where(F > 0, np.where(codes == 2, x, -x), 1.0)
        closed = np.where(codes == 1, F * y - np.abs(x), np.minimum(y, slip))
        worst = np.where(codes == 0, y, closed)
        holds = (worst >= -1e-9).all(axis=1)
        near |= bool((np.abs(worst[holds]) < 1e-9).any())
        found += [tuple(c) for c in codes[holds] if not any((F == 0) & (c % 2 == 1))]
    return sorted(found), near


def _kinds(codes):
    return codes == 0, codes == 1, codes >= 2


def random_problem(rng, *, most=6, rounded=False):
    m = int(rng.integers(1, most + 1))
    kind = rng.integers(3)
    G = rng.standard_normal((2 * m, 2 * m))
    S = G @ G.T + 0.05 * np.eye(2 * m) if kind == 0 else G @ G.T / m + 0.5 * np.eye(2 * m)
    if kind == 2:
        apart = np.abs(np.subtract.outer(np.arange(m), np.arange(m)))
        S = np.kron(np.exp(-apart), np.array([[2.0, 0.8], [0.8, 1.7]]))
    p = rng.standard_normal(2 * m)
    friction = rng.uniform(0, 4, m) * (rng.random(m) < 0.9)
    return (S + S.T) / 2, np.round(p) if rounded else p, friction


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
def test_random_problems():
    """100 problems: what is proved is what the enumeration finds."""
    verdicts = compare(0, 100)
    assert sum(v == "complete" for v, _ in verdicts) > 95
    assert any(count == 3 for _, count in verdicts)


@pytest.mark.long
def test_many_random_problems():
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


def test_multipliers_exclude_no_solution():
    """Any vector of multipliers is sound; those that separate exclude something."""
    rng = np.random.default_rng(6)
    excluded = 0
    for problem, pieces in several(10):
        region = StatusRegion.whole(problem)
        n = len(problem.p)
        vectors = [*rng.standard_normal((20, n)), *np.eye(n), *-np.eye(n)]
        vectors += [np.linalg.solve(problem.S, v) for v in vectors]
        for y in vectors:
            out = region.excluded(y)
            excluded += out.sum()
            for q in pieces:
                assert not out[np.arange(problem.points), q.codes].any()
            for slot, point in itertools.product((0, 1, 2), range(problem.points)):
                most = region.most(y, slot, point)
                values = [(q.ut.value, -q.ut.value, q.un.value)[slot][point] for q in pieces]
                assert most >= max(values) - 1e-12
    assert excluded > 10


def test_inequalities_of_differences_hold():
    """For every two solutions, on all sets of statuses that hold the one and let the other be."""
    rng = np.random.default_rng(7)
    rows = 0
    for problem, pieces in several(12):
        ub = StatusRegion.whole(problem).ub
        for b, a in itertools.permutations(pieces, 2):
            for _ in range(6):
                allowed = problem.statuses & rng.integers(0, 16, problem.points)
                allowed |= 1 << a.codes.astype(int)
                d = differences(b, allowed, ub)
                if d is None:
                    continue
                away = np.stack([a.ut.value - b.ut.value, a.un.value - b.un.value], 1)
                v = away.reshape(-1)[d.unknown]
                assert np.abs(np.delete(away.reshape(-1), d.unknown)).max(initial=0) < 1e-12
                f = d.R @ v
                assert np.abs(f[d.equal]).max(initial=0) < 1e-11
                F = problem.friction[d.unknown // 2]
                for turn in (-1, -0.4, 0, 0.7, 1):
                    theta = np.where(d.tilted, turn / np.where(F > 0, F, 1), 0)
                    left = 1 - F * np.abs(theta)
                    value = v * (f + theta * (d.T @ v)) + left * (d.k1 * v**2 + d.k2 * f**2)
                    assert value[~d.equal].max(initial=0) < 1e-11
                    rows += (~d.equal).sum()
    assert rows > 500


def test_data_with_errors():
    """What is proved for data with errors holds for all data within them."""
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


def test_what_is_printed():
    """How many solutions, whether they are all, what is open; of one node that has three."""
    S = np.array([[2.0, 1.0], [1.0, 2.0]])
    three = prove_solutions(ReducedProblem(S, np.array([-2.5, -1.0]), np.array([3.0])))
    steps = len(three.certificate.steps)
    words = "3 solutions, proved to be all there are"
    assert str(three).startswith(f"{words} (a proof of {steps} step")
    assert str(three).endswith(f"{three.seconds:.2g} s)")
    assert three.seconds > 0
    assert str(check(three.certificate)) == words
    assert str(three.certificate) == (
        f"a proof of {steps} step{'s' * (steps != 1)} about 1 contact point, to be checked"
    )
    rest = prove_solutions(ReducedProblem(S, np.zeros(2), np.array([3.0])))
    assert str(rest).startswith("1 solution, proved to be all there are (")
    rng = np.random.default_rng(3)
    open_one = prove_solutions(ReducedProblem(*random_problem(rng, most=6)), proof_seconds=0.0)
    regions = len(open_one.open_regions)
    if regions:
        assert f"not decided: {regions} set" in str(open_one)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e12])
def test_units_do_not_matter(scale):
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
def test_a_bound_given_in_advance_has_one_solution():
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


def test_no_load():
    """Nothing but rest, where every point is at every border; little load is no such thing."""
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


def test_a_search_that_is_cut_short_says_so():
    rng = np.random.default_rng(11)
    G = rng.standard_normal((24, 24))
    problem = ReducedProblem(G @ G.T + np.eye(24), rng.standard_normal(24), np.full(12, 4.0))
    found = prove_solutions(problem, proof_seconds=0.0)
    assert found.verdict == "open"
    assert len(found.open_regions) == 1
    assert check(found.certificate).verdict == "open"


def lifted_by_slips(rng, n):
    """Points whose slips lift them, pulled that way: there are many solutions."""
    S = np.zeros((2 * n, 2 * n))
    p = np.zeros(2 * n)
    for i in range(n):
        k = rng.uniform(0.4, 0.9) * rng.choice([-1, 1])
        S[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[1, k], [k, 1]]
        p[2 * i] = -np.sign(k) * rng.uniform(0.3, 2.5) + 0.2 * rng.normal()
        p[2 * i + 1] = -rng.uniform(0.1, 1)
    G = rng.normal(size=(2 * n, 2 * n))
    return S + 0.1 * G @ G.T / (2 * n), p, np.full(n, rng.uniform(2, 5))


@pytest.mark.long
@pytest.mark.verifies(
    "certificates",
    reference="enumeration: all statuses of random problems",
    aspects=("2D",),
    alone=True,
)
def test_solutions_in_regions_that_are_left_open():
    """Without time for a proof starts find nearly all, where those of a search find a third."""
    rng = np.random.default_rng(0)
    counts = np.zeros(3, dtype=int)
    for _ in range(5):
        S, p, F = lifted_by_slips(rng, 5)
        problem = ReducedProblem(S, p, F)
        known, _ = enumerated(S, p, F)
        found = prove_solutions(problem, proof_seconds=0.0)
        assert found.verdict == "open"
        assert set(statuses(found.solutions)) <= set(known)
        assert len(set(statuses(found.solutions))) == len(found.solutions)
        scaled = problem.scaled
        plain = candidates(scaled, scaled.statuses, [], np.random.default_rng(0), 12)
        pieces = {tuple(codes): solve_piece(scaled, codes) for codes in plain}
        inside = sum(q is not None and q.verdict == "inside" for q in pieces.values())
        counts += [len(known), len(found.solutions), inside]
    print(counts)
    assert counts[0] >= counts[1] > counts[2] > 0


def test_starts_within_regions():
    """They have statuses that the regions allow, all of them, and no region is left out."""
    regions = [np.array([0b0001, 0b1010]), np.array([0b1100, 0b0001]), np.array([0b0010, 0b0100])]
    drawn = {tuple(map(int, s)) for s in within(regions, 60, np.random.default_rng(0))}
    assert drawn == {(0, 1), (0, 3), (2, 0), (3, 0), (1, 2)}
    few = {tuple(map(int, s)) for s in within(regions, 3, np.random.default_rng(0))}
    assert len(few) == 3


@pytest.mark.ranks(2)
def test_the_progress_of_a_proof(capsys):
    rng = np.random.default_rng(11)
    G = rng.standard_normal((24, 24))
    problem = ReducedProblem(G @ G.T + np.eye(24), rng.standard_normal(24), np.full(12, 4.0))
    shown = {}
    for progress in (True, False):
        prove_solutions(problem, proof_seconds=0.2, progress=progress)
        shown[progress] = capsys.readouterr().err
    assert shown[True].startswith("proof of all solutions: ")
    assert not shown[False]
    for word in ("yes", print):
        with pytest.raises(ValueError, match="progress must be True, False or None"):
            prove_solutions(problem, progress=word)


@pytest.fixture(scope="module")
def proof():
    """A proof with exclusions and a uniqueness after a branch."""
    rng = np.random.default_rng(12)
    while True:
        S, p, F = random_problem(rng)
        found = prove_solutions(ReducedProblem(S, p, F))
        if {"exclude", "only", "branch"} <= {s["do"] for s in found.certificate.steps}:
            return found


@pytest.mark.ranks(2)
def test_certificates_are_stored(proof, tmp_path):
    proof.certificate.save(tmp_path / "proof.npz")
    again = Certificate.load(tmp_path / "proof.npz")
    assert again.steps == proof.certificate.steps
    checked = check(again)
    assert checked.verdict == "complete"
    assert statuses(checked.inside) == statuses(proof.solutions)
    np.savez(tmp_path / "other.npz", S=np.eye(2))
    with pytest.raises(ValueError, match="no certificate"):
        Certificate.load(tmp_path / "other.npz")


def _tampered(certificate):
    """What cannot be a proof any more."""

    def changed(kind, change):
        other = copy.deepcopy(certificate)
        change(other, next(s for s in other.steps if s["do"] == kind))
        return other

    def put(name, value):
        return lambda _, step: step.__setitem__(name, value)

    yield "a vector", changed("exclude", lambda c, s: c.vectors.__setitem__(s["y"], -c.vectors[0]))
    yield "no number", changed("exclude", lambda c, s: c.vectors[s["y"]].fill(np.nan))
    yield "what is excluded", changed("exclude", lambda _, s: s["what"].append([0, 1]))
    yield "no such vector", changed("exclude", put("y", 10**6))
    yield "statuses left out", changed("branch", lambda _, s: s["parts"].pop())
    yield "a weight below 0", changed("only", lambda _, s: s["weights"].__setitem__(0, -1.0))
    yield "weights", changed("only", lambda _, s: put("weights", [1e-9] * len(s["weights"]))(_, s))
    yield "theta", changed("only", lambda _, s: put("theta", [1e9] * len(s["theta"]))(_, s))
    yield "mu", changed("only", put("mu", float("nan")))
    yield "statuses", changed("only", lambda _, s: s["codes"].__setitem__(0, 9))
    yield "fewer statuses", changed("only", lambda _, s: s["codes"].pop())
    yield "another step", changed("only", put("do", "trust me"))
    yield "no number of a point", changed("branch", put("point", "0"))
    yield "rest", changed("branch", put("do", "rest"))
    fewer = copy.deepcopy(certificate)
    more = copy.deepcopy(certificate)
    fewer.steps.pop()
    more.steps.append({"do": "open"})
    yield "missing steps", fewer
    yield "more steps", more
    big = copy.deepcopy(certificate)
    big.steps = [{"do": "empty", "y": 0}]
    yield "an empty problem", big


def test_tampered_certificates_are_refused(proof):
    count = 0
    for what, tampered in _tampered(proof.certificate):
        try:
            check(tampered)
        except InvalidCertificate:
            pass
        else:
            pytest.fail(f"taken in spite of {what}")
        count += 1
    assert count == 17


def test_a_proof_of_another_problem_is_none(proof):
    """With another load, or errors of it, the steps prove nothing."""
    given = proof.certificate.problem
    for p, dp in ((-given.p, None), (given.p, np.full_like(given.p, 10.0))):
        other = ReducedProblem(given.S, p, given.friction, None, None, dp)
        moved = Certificate(other, proof.certificate.steps, proof.certificate.vectors)
        with pytest.raises(InvalidCertificate):
            check(moved)


@pytest.mark.ranks(2)
def test_bad_input():
    S = np.eye(2)
    p = np.zeros(2)
    F = np.array([0.3])
    for bad, what in (
        ((S, np.zeros(3), F), "shape"),
        ((S, np.array([np.nan, 0.0]), F), "not finite"),
        ((S, p, -F), "negative"),
        ((S, p, F, np.array([1.0])), "either a coefficient"),
        ((-S, p, F), "positive definite"),
        ((S, p, F, None, np.full((2, 2), 0.6)), "positive definite"),
    ):
        with pytest.raises(ValueError, match=what):
            ReducedProblem(*bad)
    with pytest.raises(ValueError, match="statuses of 1 points"):
        prove_solutions(ReducedProblem(S, p, F), known=[np.array([0, 0])])
