"""Two-parameter families of plane problems, solved by enumeration."""

import itertools

import numpy as np

from dolfinx_contact.analysis.family import ContactFamily, Frame


def enumerated(family, mu, gammas):
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
