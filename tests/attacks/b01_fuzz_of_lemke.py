"""Lemke's method on random points: F to 20, the condition of S to 1e6, units of 1e-9 and 1e9.

What it finds must satisfy the law; the law is written out here, in numpy.
"""

import numpy as np

from dolfinx_contact.algorithms import Lemke, PointProblem


def violation(S, p, F, a):
    """Worst violation of the static law by the displacements a, relative. u_n = gap >= 0."""
    r = S @ a - p
    ut = a[0::2]
    un = a[1::2]
    rt = r[0::2]
    rn = r[1::2]
    force = np.abs(p).max()
    length = np.abs(np.linalg.solve(S, p)).max()
    gap = max((-un).max() / length, (-rn).max() / force, np.abs(un * rn).max() / force / length)
    cone = ((np.abs(rt) - F * rn) / force).max()
    slips = np.abs(np.abs(ut) * (F * rn) + ut * rt) / force / length
    return max(gap, cone, slips.max())


def attack(case):
    rng = np.random.default_rng(1)
    worst = 0.0
    unsolved = 0
    for k in range(150):
        n = int(rng.integers(1, 9))
        Q = np.linalg.qr(rng.standard_normal((2 * n, 2 * n)))[0]
        S = Q @ np.diag(10.0 ** rng.uniform(0, [1, 3, 6][k % 3], 2 * n)) @ Q.T
        unit = 10.0 ** rng.choice([-9, 0, 9])
        length = 10.0 ** rng.choice([-9, 0, 9])
        S = (S + S.T) / 2 * unit / length
        p = rng.standard_normal(2 * n) * unit
        F = rng.choice([0.0, 0.3, 2.0, 20.0], n)
        outcome = Lemke().run(PointProblem(S, p, F))
        if not outcome.converged:
            unsolved += 1
            continue
        worst = max(worst, violation(S, p, F, outcome.a.ravel()))
    case.equal("not solved", unsolved, 0)
    case.true(f"violation {worst}", worst < 1e-6)
