"""Affine pieces, their rays, and branches by pivoting, for few contact points without a mesh.

The reference solves every combination of statuses with the rows of Coulomb's law written out:
w = (ut, un, rt, rn) at every point, S a - r = p + gamma q.
"""

import itertools
from dataclasses import replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from support.textbook import coulomb_system

from dolfinx_contact.continuation import Ending, Piece, System
from dolfinx_contact.continuation.cone_rays import AffineRay, outgoing
from dolfinx_contact.continuation.observer import Observer
from dolfinx_contact.continuation.pivoting import Pivoting
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK

# Rows that vanish and rows that are not negative, by status.
UT, UN, RT, RN = np.eye(4)


def rows(code, F):
    """Return the rows that vanish and the rows that are not negative for a status."""
    return {
        OPEN: ([RT, RN], [UN]),
        STICK: ([UT, UN], [RN, F * RN + RT, F * RN - RT]),
        PLUS: ([RT + F * RN, UN], [UT, RN]),
        MINUS: ([RT - F * RN, UN], [-UT, RN]),
    }[code]


class Oracle:
    """Contact points with Coulomb's law, solved by enumerating all statuses."""

    def __init__(self, S, load, rate, F):
        self.S, self.load, self.rate, self.F = (np.asarray(v, float) for v in (S, load, rate, F))
        self.m = len(self.S) // 2
        self.all = [
            np.array(c, dtype=np.int8)
            for c in itertools.product((OPEN, STICK, PLUS, MINUS), repeat=self.m)
        ]

    @property
    def system(self):
        return coulomb_system(self.S, self.load, self.rate, float(self.F), r=0.7)

    def matrix(self, codes):
        """Matrix of the equations and of the rows that vanish, for w point by point."""
        m = self.m
        A = np.zeros((4 * m, m, 4))
        A[: 2 * m, :, :2] = self.S.reshape(2 * m, m, 2)
        A[: 2 * m].reshape(m, 2, m, 4)[np.arange(m), :, np.arange(m), 2:] = -np.eye(2)
        for i, code in enumerate(codes):
            A[2 * m + 2 * i : 2 * m + 2 * i + 2, i] = rows(code, self.F)[0]
        return A.reshape(4 * m, 4 * m)

    def sign(self, codes):
        """Sign of the determinant, with displacements before forces."""
        order = np.arange(4 * self.m).reshape(self.m, 2, 2).transpose(1, 0, 2).reshape(-1)
        return np.sign(np.linalg.det(self.matrix(codes)[:, order]))

    def state(self, codes, p):
        return np.linalg.solve(self.matrix(codes), np.append(p, np.zeros(2 * self.m))).reshape(
            self.m, 4
        )

    def slacks(self, codes, w):
        """Statuses of every point."""
        return [np.array(rows(c, self.F)[1]) @ v for c, v in zip(codes, w, strict=True)]

    def holds(self, codes, w, tolerance):
        off = max(
            np.abs(np.array(rows(c, self.F)[0]) @ v).max() for c, v in zip(codes, w, strict=True)
        )
        least = min(s.min() for s in self.slacks(codes, w))
        return off <= tolerance and least >= -tolerance

    def solutions(self, gamma):
        """All solutions (codes, w) at gamma."""
        found = ((c, self.state(c, self.load + gamma * self.rate)) for c in self.all)
        return [(c, w) for c, w in found if self.holds(c, w, 1e-12)]

    def rays(self, w, tolerance=1e-9):
        """All rays (codes, dw, dgamma) out of w on regular pieces."""
        found = []
        for codes in self.all:
            if not self.holds(codes, w, tolerance):
                continue
            at_border = [np.abs(s) <= tolerance for s in self.slacks(codes, w)]
            for sense in (1.0, -1.0):
                dw = self.state(codes, sense * self.rate)
                slopes = self.slacks(codes, dw)
                if all((s[b] >= -1e-12).all() for s, b in zip(slopes, at_border, strict=True)):
                    found.append((codes, dw, sense))
        return found


def directions(rays):
    """Sorted (dgamma, dw) without repetitions."""
    every = sorted((rate, *np.round(dw.reshape(-1), 7) + 0.0) for dw, rate in rays)
    return np.array([k for k, _ in itertools.groupby(every)])


def random_oracle(seed, m=2, F=2.0):
    """Random stiffness with strong coupling, so that branches turn."""
    random = np.random.default_rng(seed)
    A = random.standard_normal((2 * m, 2 * m))
    S = A @ A.T + 0.3 * np.eye(2 * m)
    return Oracle(S, random.standard_normal(2 * m), random.standard_normal(2 * m), F)


def meeting(seed, m, F):
    """An oracle and a state at which pieces meet, with one point for each kind of state."""
    oracle = random_oracle(seed, m, F)
    kinds = [
        (0.0, 0.0, -F * 0.5, 0.5),  # stick that is about to slip
        (0.0, 0.0, 0.0, 0.0),  # all
        (0.3, 0.0, -F * 0.7, 0.7),  # slip
        (0.2, 0.0, 0.0, 0.0),  # slip that is about to open
        (-0.1, 0.4, 0.0, 0.0),  # open
    ]
    w = np.array([kinds[(seed + i) % len(kinds)] for i in range(m)])
    load = oracle.S @ w[:, :2].reshape(-1) - w[:, 2:].reshape(-1)
    return Oracle(oracle.S, load, oracle.rate, F), w


@pytest.mark.parametrize("seed", range(10))
def test_all_rays_out_of_a_kink_are_listed(seed):
    """Enumeration finds all rays, and a known ray once."""
    oracle, w = meeting(seed, 3, (0.4, 2.5)[seed % 2])
    expected = oracle.rays(w)
    cone = oracle.system.tangent_cone(w, 1e-10)
    known = [AffineRay(c, dw, rate) for c, dw, rate in expected[:1]]
    found = outgoing(cone, known)
    np.testing.assert_allclose(
        directions((r.direction, r.rate) for r in found.rays),
        directions((dw, rate) for _, dw, rate in expected),
        atol=1e-6,
    )
    pieces = {c.tobytes() for c in oracle.all if oracle.holds(c, w, 1e-9)}
    assert found.complete
    assert found.continua == ()
    assert found.method == f"enumeration of {len(pieces)} pieces"
    for r in found.rays:
        assert r.codes.tobytes() in pieces
        assert oracle.holds(r.codes, w + 1e-6 * r.direction, 1e-9)


class FewPoints(System):
    """Contact points as a system and as its condensed form; one more unknown is 2 + 3 gamma."""

    exact = True
    guided = False
    always_solvable = False
    is_piecewise_affine = True

    def __init__(self, oracle, proof=None):
        self.comm = MPI.COMM_SELF
        self.oracle = oracle
        self.system = oracle.system
        self._proof = proof
        self.asked = []

    def create_vector(self):
        return PETSc.Vec().createSeq(4 * self.oracle.m + 1, comm=self.comm)

    def metric(self, x, out):
        x.copy(out)

    def piece_at(self, x, gamma):
        return Piece(self.system.classify(self.contract(x)))

    def prove_rays(self, condensed, cone, known):
        self.asked.append((condensed, cone, known))
        return self._proof

    def codes(self, piece):
        return piece.codes

    def piece(self, codes):
        return Piece(codes)

    def point(self, i):
        return 5, 10 + i

    def contract(self, x):
        return x.array_r[:-1].reshape(-1, 4).copy()

    def expand(self, w, gamma, x):
        x.array[:] = np.append(w, 2.0 + 3.0 * gamma)

    def pivoting(self, gamma_scale=1.0):
        return Pivoting(self, self, gamma_scale=gamma_scale)

    def vector(self, w, gamma):
        x = self.create_vector()
        self.expand(w, gamma, x)
        return x


def numbers(points, y):
    x, gamma = y.array_r[:-1], y.array_r[-1]
    assert x[-1] == pytest.approx(2.0 + 3.0 * gamma, abs=1e-9)
    return x[:-1].reshape(points.oracle.m, 4), gamma


def ray_of(oracle, before, after):
    """The ray from a point of a branch to the next: statuses, dw / |dgamma|, sign of dgamma."""
    (w, gamma), (w_1, gamma_1) = before, after
    middle = (w + w_1) / 2
    (codes,) = (
        c for c, v in oracle.solutions((gamma + gamma_1) / 2) if np.abs(v - middle).max() < 1e-9
    )
    return codes, (w_1 - w) / abs(gamma_1 - gamma), np.sign(gamma_1 - gamma)


class Known(Observer):
    """Stores the state of the continuation at every point."""

    def __init__(self):
        self.states = []

    def step(self, step, state):
        self.states.append(state)


RANGE = (-3.0, 4.0)
BRANCHES = {
    "one point": (1, 3.0),
    "little friction": (2, 0.5),
    "two points": (2, 2.0),
    "loops": (2, 6.0),
    "three points": (3, 3.0),
}


def started(name, seed, which=0, gamma=0.0, **options):
    """A random system, and a branch from one of its solutions at gamma."""
    oracle = random_oracle(seed, *BRANCHES[name])
    points = FewPoints(oracle)
    solutions = oracle.solutions(gamma)
    pivoting = points.pivoting(0.5)
    start = pivoting.start(points.vector(solutions[which][1], gamma), gamma, **options)
    return oracle, points, pivoting, start


@pytest.mark.parametrize("direction", ["increasing", "decreasing"])
@pytest.mark.parametrize("name", BRANCHES)
def test_segments_of_pivoting_consist_of_solutions(name, direction):
    """Every segment consists of solutions and ends at the first border of its piece."""
    kinds = set()
    for seed in range(6):
        oracle, points, pivoting, start = started(name, seed, -1, direction=direction)
        known = Known()
        branch = pivoting.run(start, gamma_range=RANGE, record=known)
        at = [numbers(points, p.y) for p in branch.points]
        rays = [ray_of(oracle, a, c) for a, c in itertools.pairwise(at)]
        assert rays[0][2] == (1.0 if direction == "increasing" else -1.0)
        assert (start.step, start.gamma) == (0.0, 0.0)
        largest = 0.0
        scale = None
        for i, p in enumerate(branch.points):
            w, gamma = at[i]
            assert p.gamma == gamma
            assert p.corrections == 0
            largest = max(largest, np.abs(w).max())
            assert known.states[i].largest_distance == pytest.approx(largest, rel=1e-12)
            assert known.states[i].index == i
            codes, dw, sense = rays[min(i, len(rays) - 1)]
            # The tangent: of length 1, half of which is that of x at the start.
            assert p.piece.codes.tolist() == codes.tolist()
            along = np.append(dw, (3.0 * sense, sense))
            if scale is None:
                scale = 0.25 * (along[:-1] @ along[:-1])
            length = np.sqrt(0.5 * along[:-1] @ along[:-1] / scale + 0.5 / 0.25)
            if i < len(rays) or branch.ending is Ending.REACHED:
                np.testing.assert_allclose(p.tangent.array_r, along / length, atol=1e-8)
            assert known.states[i].x_scale == pytest.approx(scale, rel=1e-8)
            if i > 0 and p is not start:
                assert p.step == pytest.approx(abs(gamma - at[i - 1][1]), rel=1e-9)
        last = len(at) - 1
        if branch.ending is Ending.REACHED:
            assert at[-1][1] == RANGE[int(rays[-1][2] > 0)]
        else:
            assert branch.ending is Ending.CLOSED
            assert branch.points[-1] is branch.points[0]
        assert [s.index for s in branch.special] == list(range(1, last))
        for s in branch.special:
            p = branch.points[s.index]
            kinds.add(s.kind)
            assert (s.y, s.gamma, s.smooth, s.located) == (p.y, p.gamma, False, True)
            (old, _, came), (new, _, goes) = rays[s.index - 1 : s.index + 1]
            (i,) = np.flatnonzero(old != new)
            (change,) = s.changes
            assert (change.rank, change.point) == (5, 10 + i)
            assert (change.before, change.after) == (old[i], new[i])
            assert s.kind == ("event" if came == goes else "fold")
            assert s.parity == oracle.sign(old) * came * oracle.sign(new) * goes == 1
            assert (s.others, s.incoming, s.onwards, s.complete) == ((), None, None, False)
        # Between vertices the statuses that hold do not end; at them they do.
        for (codes, dw, _), (w, _), (w_1, _) in zip(rays, at, at[1:], strict=False):
            assert oracle.holds(codes, (w + w_1) / 2, 1e-9)
            if w_1 is not at[-1][0]:
                assert not oracle.holds(codes, w_1 + 1e-4 * dw, 1e-9)
    assert kinds <= {"event", "fold"}


def test_branch_lists_its_states_at_a_gamma():
    """All points of a branch with folds at one gamma, vertices included."""
    most = 0
    for seed in range(6):
        oracle, points, pivoting, start = started("loops", seed, -1)
        branch = pivoting.run(start, gamma_range=RANGE)
        gammas = np.array([p.gamma for p in branch.points])
        for gamma in (*np.linspace(-2.9, 3.9, 15), *gammas):
            found = pivoting.at(branch, gamma)
            before, after = gammas[:-1] - gamma, gammas[1:] - gamma
            number = int((before * after < 0).sum() + (gammas == gamma).sum())
            assert len(found) == number
            states = [w for _, w in oracle.solutions(gamma)]
            for p in found:
                w, there = numbers(points, p.y)
                assert p.gamma == there == gamma
                assert min(np.abs(w - v).max() for v in states) < 1e-9
                assert oracle.holds(p.piece.codes, w, 1e-9)
            most = max(most, len(found))
    assert most > 1


def two_of_a_kind(F=3.0, load=(0.0, -1.0), rate=(1.0, 0.3)):
    """Two independent copies of a point with S = [[2, 1], [1, 2]]."""
    S = np.kron(np.eye(2), [[2.0, 1.0], [1.0, 2.0]])
    return Oracle(S, np.tile(load, 2), np.tile(rate, 2), F)


def out_of(pivoting, point):
    """The ray by which a branch leaves a point: dw and dgamma."""
    _, ray = pivoting.state(point)
    return ray.direction, ray.rate


def cosine(a, b):
    return np.sum(a * b) / np.sqrt(np.sum(a * a) * np.sum(b * b))


@pytest.mark.parametrize("direction", ["increasing", "decreasing"])
@pytest.mark.parametrize(
    ("F", "load", "rate", "kinds"),
    [
        (3.0, (-2.5, -1.0), (0.3, 1.0), {("fold", 1), ("bifurcation", 3)}),
        (0.3, (0.0, -1.0), (1.0, 0.3), {("event", 1)}),
    ],
)
def test_branches_meet_where_two_points_change_at_once(F, load, rate, kinds, direction):
    """All rays are found; the branch keeps the sense of gamma, or continues straight."""
    oracle = two_of_a_kind(F, load, rate)
    points = FewPoints(oracle)
    pivoting = points.pivoting(2.0)
    seen = set()
    for _, w in oracle.solutions(0.0):
        start = pivoting.start(points.vector(w, 0.0), 0.0, direction=direction)
        branch = pivoting.run(start, gamma_range=(-6.0, 6.0))
        at = [numbers(points, p.y) for p in branch.points]
        assert branch.ending is Ending.REACHED
        for s in branch.special:
            v, _gamma = at[s.index]
            before, after = (ray_of(oracle, *at[s.index - k : s.index - k + 2]) for k in (1, 0))
            both = np.count_nonzero(before[0] != after[0])
            assert len(s.changes) == both
            every = oracle.rays(v)
            back = -before[1], -before[2]
            others = [
                (dw, sense)
                for _, dw, sense in every
                if not (sense == back[1] and np.abs(dw - back[0]).max() < 1e-7)
            ]
            assert len(others) == len(every) - 1
            best = max(others, key=lambda r: (r[1] == before[2], cosine(r[0], before[1])))
            np.testing.assert_allclose(after[1], best[0], atol=1e-8)
            seen.add((s.kind, len(others)))
            if len(others) == 1:
                assert s.kind == ("event" if after[2] == before[2] else "fold")
                assert (s.others, s.incoming, s.onwards) == ((), None, None)
                continue
            assert (s.kind, s.complete) == ("bifurcation", True)
            assert s.method == f"enumeration of {s.method.split()[2]} pieces"
            sign = oracle.sign(before[0]) * before[2] * oracle.sign(after[0]) * after[2]
            assert s.parity == sign
            # The rays as tangents, of what comes in and of all that goes out.
            rays = [
                (np.append(dw, (3 * g, g)), r) for (dw, g), r in zip(others, others, strict=True)
            ]
            tangents = [s.onwards.tangent, *(r.tangent for r in s.others)]
            assert len(tangents) == len(rays)
            for t in tangents:
                same = [r for along, r in rays if cosine(along, t.array_r) > 1 - 1e-12]
                assert len(same) == 1
                assert pivoting.bordered.inner(t, t) == pytest.approx(1.0, rel=1e-12)
            came = np.append(before[1], (3 * before[2], before[2]))
            assert cosine(came, s.incoming.tangent.array_r) > 1 - 1e-12
            assert s.incoming.piece.codes.tolist() == before[0].tolist()
            assert s.onwards.piece.codes.tolist() == after[0].tolist()
            # They are all followed on their own pieces, and the way back is one of all.
            for ray in s.others:
                off = pivoting.branch_off(s, ray)
                found_w, found_ray = pivoting.state(off)
                np.testing.assert_allclose(found_w, v, atol=1e-12)
                assert any(
                    found_ray.rate == g and np.abs(found_ray.direction - dw).max() < 1e-8
                    for dw, g in others
                )
            there = pivoting.rays_at(branch.points[s.index])
            assert len(there.rays) == len(every)
            assert there.complete
            found = directions(out_of(pivoting, p) for p in there.rays)
            np.testing.assert_allclose(found, directions((dw, g) for _, dw, g in every), atol=1e-6)
    assert seen == kinds


@pytest.mark.parametrize(
    ("load", "rate", "vertices"),
    [
        ((0.0, -1.0), (1.0, 0.0), [(-2.0, MINUS, 0), (-2.0, OPEN, -1), (-8.0, OPEN, -1)]),
        ((-1.0, -1.0), (1.0, 0.0), [(-1.0, MINUS, 0), (-1.0, OPEN, -1), (-8.0, OPEN, -1)]),
        ((-1.0, -1.0), (0.0, -1.0), [(-0.5, MINUS, 0), (-0.5, OPEN, -1), (-8.0, OPEN, -1)]),
        ((-1.0, -1.0), (-1.0, 0.0), [(-3.0, PLUS, -1), (-8.0, PLUS, -1)]),
        ((-1.0, -1.0), (-1.0, -1.0), [(-1.0, OPEN, -1), (-8.0, OPEN, -1)]),
    ],
)
def test_point_slips_under_constant_load_at_the_critical_friction(load, rate, vertices):
    """At the critical F = kt / k = 2 a point slips under constant load until it opens."""
    points = FewPoints(Oracle([[2.0, 1.0], [1.0, 2.0]], load, rate, 2.0))
    pivoting = points.pivoting()
    x = points.vector(np.zeros((1, 4)), 0.0)
    start = pivoting.start(x, 0.0, direction="decreasing")
    known = Known()
    branch = pivoting.run(start, gamma_range=(-8.0, 8.0), record=known)
    found = [(p.gamma, p.piece.codes[0], pivoting.state(p)[1].rate) for p in branch.points]
    np.testing.assert_allclose(found, [(0.0, STICK, -1.0), *vertices], atol=1e-12)
    assert branch.ending is Ending.REACHED
    for s, before, after in zip(branch.special, found, found[1:], strict=False):
        still = before[2] == 0 or after[2] == 0
        assert (s.kind, s.parity) == ("event", 0 if still else 1)
        assert s.method == ("enumeration of 2 pieces" if still else "")
        assert s.complete is still
        assert (s.others, s.incoming, s.onwards) == ((), None, None)


def test_a_branch_ends_where_its_range_does():
    """The end may be a vertex, which is then no special point."""
    points = FewPoints(Oracle([[2.0, 1.0], [1.0, 2.0]], (0.0, -1.0), (1.0, 0.0), 0.5))
    pivoting = points.pivoting()
    x = points.vector(np.zeros((1, 4)), 0.0)
    for direction, end in (("increasing", 0.5), ("decreasing", -0.5)):
        start = pivoting.start(x, 0.0, direction=direction)
        branch = pivoting.run(start, gamma_range=(-0.5, 0.5))
        assert branch.ending is Ending.REACHED
        assert ([p.gamma for p in branch.points], branch.special) == ([0.0, end], [])


# -- what is found --------------------------------------------------------------------------------


def condensed(S, load, rate, friction):
    return coulomb_system(S, load, rate, friction, r=0.5)


def random_stiffness(random, m):
    A = random.standard_normal((2 * m, 2 * m))
    return A @ A.T + 0.1 * np.eye(2 * m)


def described(found, number):
    """Return the senses of gamma along rays, and the statuses of the first points."""
    return sorted((r.rate, "".join("ok+-"[c] for c in r.codes[:number])) for r in found.rays)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.verifies(
    "rays out of a kink",
    reference="enumeration: the rays of all pieces",
    aspects=("2D",),
    alone=True,
)
def test_unfolding_finds_what_enumeration_proves(seed):
    """Random stiffness, load and friction: both methods find the rays of three points.

    Six uncoupled points, with one status for each sense of gamma, add no rays. With them there are
    too many pieces to enumerate.
    """
    random = np.random.default_rng(seed)
    S = np.eye(18)
    S[:6, :6] = random_stiffness(random, 3)
    rate = random.standard_normal(18)
    friction = random.uniform(0.2, 6.0)
    proved = outgoing(condensed(S[:6, :6], np.zeros(6), rate[:6], friction))
    assert proved.complete
    assert len(proved.rays) % 2 == 0  # what comes in goes out
    unfolded = outgoing(condensed(S, np.zeros(18), rate, friction))
    assert not unfolded.complete
    assert unfolded.method.endswith("unfoldings of 9 points")
    assert described(unfolded, 3) == described(proved, 3)


@pytest.mark.verifies(
    "rays out of a kink", reference="closed form: the rays of one node", aspects=("2D",), alone=True
)
def test_one_point_has_three_rays_in_its_closed_form_range():
    """kt = kn = 2, k = 1, F = 3 > kt / k: three rays iff -F |pn| < pt < -(kt / k) |pn|, pn < 0."""
    S = np.array([[2.0, 1.0], [1.0, 2.0]])
    for pt, expected in ((-2.5, {"o", "k", "-"}), (-1.5, {"k"}), (-3.5, {"o"})):
        found = outgoing(condensed(S, np.zeros(2), [pt, -1.0], 3.0))
        assert {letter for rate, letter in described(found, 1) if rate == 1} == expected
    exact = {"o": np.linalg.solve(S, [-2.5, -1]), "k": np.zeros(2), "-": np.array([-0.5, 0.0])}
    found = outgoing(condensed(S, np.zeros(2), [-2.5, -1.0], 3.0))
    for ray in found.rays:
        if ray.rate == 1:
            np.testing.assert_allclose(
                ray.direction[0, :2], exact["ok+-"[ray.codes[0]]], atol=1e-12
            )


def test_rays_at_constant_gamma_are_the_kernel_in_both_senses():
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


def test_signs_of_determinants_agree_with_the_law():
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
