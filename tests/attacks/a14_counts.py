"""Reduced problems by random numbers, of units from 1e-9 to 1e9: are all solutions proved?

The right answer is an enumeration of all 4^m statuses in numpy, from the law alone: S a = r + p
with a = (ut, un) and r = (rt, rn), point by point.
"""

import itertools

import numpy as np

from dolfinx_contact.analysis import ReducedProblem, check, prove_solutions


def enumerated(S, p, F):
    """All solutions: ``(letters, a)``, by trying every status of every point."""
    m = len(F)
    found = []
    for letters in itertools.product("ok+-", repeat=m):
        # Unknown: a (2 m,) and r (2 m,).
        A = np.zeros((4 * m, 4 * m))
        b = np.zeros(4 * m)
        A[: 2 * m, : 2 * m] = S
        A[: 2 * m, 2 * m :] = -np.eye(2 * m)
        b[: 2 * m] = p
        for i, letter in enumerate(letters):
            row = 2 * m + 2 * i
            t = 2 * i
            n = 2 * i + 1
            A[row + 1, 2 * m + n if letter == "o" else n] = 1
            if letter == "k":
                A[row, t] = 1
            else:
                A[row, 2 * m + t] = 1
                A[row, 2 * m + n] = {"o": 0, "+": F[i], "-": -F[i]}[letter]
        # Lengths and forces are of different sizes in small and large units.
        scale = np.ones(4 * m)
        scale[: 2 * m] = 1 / np.abs(np.diag(S)).max()
        A = A * scale
        size = np.abs(A).max(axis=1)
        A = A / size[:, None]
        b = b / size
        if abs(np.linalg.det(A)) < 1e-12:
            continue
        x = np.linalg.solve(A, b) * scale
        a = x[: 2 * m].reshape(m, 2)
        r = x[2 * m :].reshape(m, 2)
        if all(_holds(c, a[i], r[i], F[i]) for i, c in enumerate(letters)):
            found.append(("".join(letters), a))
    return found


def _holds(letter, a, r, F):
    if letter == "o":
        return a[1] >= 0
    if letter == "k":
        return abs(r[0]) <= F * r[1]
    return r[1] >= 0 and (a[0] >= 0 if letter == "+" else a[0] <= 0)


def random_problem(seed, m=2, friction=2.0):
    """S, p and F of a body that is pressed, with much friction and so often several solutions."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((2 * m, 2 * m))
    S = A @ A.T + 0.05 * np.eye(2 * m)
    S = (S + S.T) / 2
    p = rng.standard_normal(2 * m)
    p[1::2] -= 0.5
    return S, p, np.full(m, friction)


def counts(seeds, units):
    """Numbers of solutions that are proved and of those enumerated, and the states of both."""
    proved = []
    expected = []
    for seed in seeds:
        S, p, F = random_problem(seed)
        for unit in units:
            problem = ReducedProblem(S * unit, p * unit, F)
            answer = prove_solutions(problem, proof_seconds=5.0)
            again = check(answer.certificate)
            complete = answer.verdict == "complete" and again.verdict == "complete"
            proved.append(len(answer.solutions) if complete else -1)
            expected.append(len(enumerated(S, p, F)))
    return proved, expected


def attack(case):
    proved, expected = counts(range(8), (1e-9, 1.0, 1e9))
    case.equal("number of solutions", proved, expected, 0.0)
    case.true("some problem has several solutions", max(expected) > 1)


def honest(case):
    proved, expected = counts(range(20, 28), (1.0,))
    case.equal("number of solutions", proved, expected, 0.0)
