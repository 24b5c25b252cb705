"""Reduced problems in space that tests of proofs share, and their solutions found otherwise."""

import numpy as np

from dolfinx_contact.proofs import ReducedProblem
from dolfinx_contact.proofs.starts import many_solutions


def random_stiffness(n, rng, condition=10.0):
    """Return a symmetric positive definite stiffness of n points."""
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


def at_a_border(rng, off=0.0):
    """A problem made for a state with one point or more at a border, or ``off`` beside it.

    Returns:
        The problem and the state (m, 6).
    """
    n = int(rng.integers(1, 5))
    S = random_stiffness(n, rng) if rng.random() < 0.5 else coupled(n, rng)
    friction = np.full(n, np.exp(rng.uniform(np.log(0.1), np.log(3))))
    a, r = np.zeros((n, 3)), np.zeros((n, 3))
    kinds = rng.integers(3, size=n)  # open, stick, slip
    for i, kind in enumerate(kinds):
        e = np.append(_direction(rng), 0.0)
        if kind == 0:
            a[i] = rng.normal(size=3)
            a[i, 2] = rng.uniform(0.2, 1)
        else:
            r[i, 2] = rng.uniform(0.2, 1)
            r[i] -= friction[i] * r[i, 2] * e * (1 if kind == 2 else rng.uniform(0, 0.9))
            a[i] = e * rng.uniform(0.2, 1) * (kind == 2)
    at_border = rng.random(n) < 0.5
    at_border[rng.integers(n)] = True
    for i in np.flatnonzero(at_border):
        if kinds[i] == 0:
            a[i, 2] = off  # open, about to close
        elif kinds[i] == 1:
            e = np.append(_direction(rng), 0.0)
            r[i] = friction[i] * r[i, 2] * (1 - off) * e + [0, 0, r[i, 2]]  # about to slip
        elif rng.random() < 0.5:
            a[i] *= off / np.linalg.norm(a[i])  # slip that begins
        else:
            r[i] *= off / r[i, 2]  # slip, about to open
    p = (S @ a.reshape(-1)) - r.reshape(-1)
    return ReducedProblem(S, p, friction), np.hstack([a, r])


def _direction(rng):
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def on_a_continuum(rng):
    """All points slip against x, with a critical friction: a line of solutions.

    The y components are by themselves. With S_xx v = F S_zx v the slips v may be added.

    Returns:
        The problem, and two states (m, 6) of the line.
    """
    while True:
        n = int(rng.integers(1, 4))
        flat = random_stiffness(n, rng, 20.0)[: 2 * n, : 2 * n]
        ratios, vectors = np.linalg.eig(np.linalg.solve(flat[:n, :n], flat[n:, :n]))
        real = np.flatnonzero((np.abs(ratios.imag) < 1e-12) & (ratios.real > 0.1))
        if len(real):
            break
    k = rng.choice(real)
    F, v = 1 / ratios[k].real, vectors[:, k].real
    S = np.zeros((3 * n, 3 * n))
    planar = np.concatenate([3 * np.arange(n), 3 * np.arange(n) + 2])
    S[np.ix_(planar, planar)] = flat
    S[np.ix_(3 * np.arange(n) + 1, 3 * np.arange(n) + 1)] = random_stiffness(n, rng, 3.0)[:n, :n]
    turn = np.linalg.qr(rng.normal(size=(2, 2)))[0]
    axes = np.kron(np.eye(n), np.block([[turn, np.zeros((2, 1))], [np.zeros((1, 2)), 1.0]]))
    s, rn = rng.uniform(0.5, 1, n), rng.uniform(0.5, 1, n)
    change = flat[n:, :n] @ v
    part = 0.3 / max(np.abs(v).max(), np.abs(change).max())
    states = []
    for t in (0.0, part):
        a = np.zeros((n, 3))
        r = np.zeros((n, 3))
        a[:, 0] = -(s - t * v)
        r[:, 2] = rn + t * change
        r[:, 0] = F * r[:, 2]
        states.append(np.hstack([(axes @ x.reshape(-1)).reshape(-1, 3) for x in (a, r)]))
    a, r = states[0][:, :3].reshape(-1), states[0][:, 3:].reshape(-1)
    S = axes @ S @ axes.T
    S = (S + S.T) / 2
    return ReducedProblem(S, S @ a - r, np.full(n, F)), states


def is_solved(problem, state):
    """Whether equilibrium and the laws hold, to round-off."""
    a, r = state[:, :3], state[:, 3:]
    size = 1e-12 * (1 + np.abs(state).max())
    left = problem.S @ a.reshape(-1) - r.reshape(-1) - problem.p
    cone = problem.friction * r[:, 2] - np.linalg.norm(r[:, :2], axis=1)
    slip = np.linalg.norm(a[:, :2], axis=1)
    power = (a[:, :2] * r[:, :2]).sum(axis=1) + problem.friction * r[:, 2] * slip
    signs = min(a[:, 2].min(), r[:, 2].min(), cone.min())
    worst = max(np.abs(left).max() / (1 + np.abs(problem.S).max()), np.abs(power).max())
    return bool(max(worst, -signs, np.abs(a[:, 2] * r[:, 2]).max()) < 100 * size)
