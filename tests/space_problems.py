"""Reduced problems in space that tests of proofs share, and their solutions found otherwise."""

import numpy as np

from dolfinx_contact.analysis import ReducedProblem
from dolfinx_contact.analysis.space.starts import many_solutions


def random_stiffness(n, rng, condition=10.0):
    """Of n points, symmetric and positive definite."""
    Q = np.linalg.qr(rng.normal(size=(3 * n, 3 * n)))[0]
    values = np.exp(rng.uniform(0, np.log(condition), 3 * n))
    return (Q * values) @ Q.T


def coupled(n, rng):
    """Stiffness of points whose slips lift them: several solutions are likely."""
    C = np.zeros((3 * n, 3 * n))
    for i in range(n):
        c = rng.normal(size=2)
        c *= rng.uniform(0.5, 0.95) / np.linalg.norm(c)
        C[3 * i : 3 * i + 2, 3 * i + 2] = c
        C[3 * i + 2, 3 * i : 3 * i + 2] = c
    S = C + np.eye(3 * n) + 0.1 * random_stiffness(n, rng, 3.0)
    return S + max(0.0, 0.05 - np.linalg.eigvalsh(S)[0]) * np.eye(3 * n)


def random_problem(rng, *, mixed=False, most=5):
    """One to ``most`` points; mixed, some without friction, some with a bound given in advance."""
    n = int(rng.integers(1, most + 1))
    if rng.random() < 0.5:
        S = random_stiffness(n, rng, 10 ** rng.uniform(0.5, 2))
        p = rng.normal(size=3 * n)
    else:
        S = coupled(n, rng)
        p = rng.normal(size=3 * n) - np.tile([0, 0, 0.5], n)
    friction = np.full(n, np.exp(rng.uniform(np.log(0.1), np.log(5))))
    bound = np.zeros(n)
    if mixed:
        kind = rng.random(n)
        friction = np.exp(rng.uniform(np.log(0.3), np.log(5), n)) * (kind > 0.4)
        bound = np.where(kind < 0.2, rng.uniform(0, 1, n), 0.0)
    return ReducedProblem(S, p, friction, bound)


def two_far_nodes(rng):
    """Two points that do not see each other, with up to nine solutions."""
    S = np.zeros((6, 6))
    p = np.zeros(6)
    for i in (0, 1):
        part = slice(3 * i, 3 * i + 3)
        S[part, part] = [[2.0, 0.0, 1.0], [0.0, 2.0, 0.0], [1.0, 0.0, 2.0]]
        p[part] = np.array([-2.5, 0.1, -1.0]) * rng.uniform(0.95, 1.05)
    return ReducedProblem(S, p, np.full(2, 3.0))


def one_node(rng):
    """S, p and F of one point."""
    friction = float(np.exp(rng.uniform(np.log(0.1), np.log(10))))
    c = rng.normal(size=2)
    c *= rng.uniform(0, 0.97) / np.linalg.norm(c)
    turn = np.linalg.qr(rng.normal(size=(2, 2)))[0]
    A = turn @ np.diag([1.0, rng.uniform(0.3, 3)]) @ turn.T
    S = np.zeros((3, 3))
    S[:2, :2] = A
    S[:2, 2] = S[2, :2] = np.linalg.cholesky(A) @ c
    S[2, 2] = 1.0
    kind = rng.integers(3)
    p = rng.normal(size=3)
    if kind == 1:
        p[2] = rng.uniform(-0.3, 0.3)
    elif kind == 2:  # where there may be several
        p = np.append(-c * rng.uniform(0.1, 3) + 0.05 * rng.normal(size=2), 0.3 * rng.normal())
    return S, p, friction


def in_closed_form(S, p, friction):
    """All solutions of one point: letters, and states (6,).

    A slip s e has (S_tt + F (e k^T)) s e = p_t + F p_n e with k = S_nt, and rn = s k.e - p_n.
    Without s this is a trigonometric polynomial of the angle of e of degree two: a quartic.
    """
    A, k, pt, pn = S[:2, :2], S[2, :2], p[:2], p[2]
    J = np.array([[0.0, -1.0], [1.0, 0.0]])

    def residual(angle):
        e = np.array([np.cos(angle), np.sin(angle)])
        across = J @ e
        return (
            pt @ (J @ A @ e) + friction * (k @ e) * (pt @ across) - friction * pn * (across @ A @ e)
        )

    c = np.fft.fft([residual(t) for t in 2 * np.pi * np.arange(5) / 5]) / 5
    roots = np.roots([c[2], c[1], c[0], c[-1], c[-2]])
    found = []
    for angle in np.angle(roots[np.abs(np.abs(roots) - 1) < 1e-7]):
        e = np.array([np.cos(angle), np.sin(angle)])
        s = (pt @ e + friction * pn) / (e @ A @ e + friction * (k @ e))
        rn = s * (k @ e) - pn
        if s > 0 and rn > 0:
            found.append(("s", np.concatenate([s * e, [0.0], -friction * rn * e, [rn]])))
    a = np.linalg.solve(S, p)
    if a[2] > 0:
        found.append(("o", np.concatenate([a, np.zeros(3)])))
    if -pn > 0 and np.hypot(*pt) < -friction * pn:
        found.append(("k", np.concatenate([np.zeros(3), -p])))
    return found


def by_newton(problem, number, rng):
    """States (m, 6) of the solutions that Newton's method finds from so many starts."""
    length, force = problem.units
    found = many_solutions(problem.scaled, number, rng)
    return [np.hstack([a * length, r * force]) for a, r in found]


def is_among(state, proved):
    """Whether a state is one of those proved, or at a border."""
    size = 1e-5 * (1 + np.abs(state).max())
    return any(np.abs(state - s.state).max() < size for s in (*proved.solutions, *proved.border))
