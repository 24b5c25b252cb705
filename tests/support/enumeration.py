"""All solutions and events of small plane problems by enumeration of the statuses."""

import itertools

import numpy as np

from dolfinx_contact.analysis.family import ContactFamily, Frame


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


def events_by_enumeration(family, mu, gammas):
    """Codes and gamma of all borders with a state at mu, by trying all."""
    found = {}
    for i in range(family.points):
        for codes in itertools.product(range(4), repeat=family.points):
            for border in (4, 5, 6, 7):
                new = np.array(codes, dtype=np.int8)
                new[i] = border
                frame = Frame(family, new)
                if frame.is_inside(mu) and gammas[0] < frame.gamma(mu) < gammas[1]:
                    found[new.tobytes()] = frame
    return found


def random_family(seed, m=2):
    random = np.random.default_rng(seed)
    R = random.standard_normal((2 * m, 2 * m))
    S = R @ R.T + 0.3 * np.eye(2 * m)
    p, q = random.standard_normal((2, 2 * m))
    return ContactFamily(S, p, q, np.zeros(2 * m), np.zeros(m), np.ones(m))


def holds(family, codes, mu, gamma):
    """Whether a piece holds a solution."""
    A, E = family.columns(codes)
    w = family.state(codes, np.linalg.solve(A + mu * E, family.p + gamma * family.q), mu)
    slacks = [
        (C_0 + mu * C_1) @ w[i]
        for i, code in enumerate(codes)
        for C_0, C_1, _ in family.inequalities(i, int(code))
    ]
    return min(slacks) > 0
