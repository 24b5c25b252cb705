"""The lift rises and falls over gamma: 1 - |gamma - 1|, a kink, and gamma (2 - gamma), smooth.

Damage begins at the opening u0; the bond keeps what it had at the largest lift, U = u + u0^4/(K
u^3) there (K = 4: no snap-back), and the body is at its place again at gamma = 2.
"""

import numpy as np
from a05_one_bond_and_a_spring import U0, bonded
from bodies import free_point

from dolfinx_contact.continuation import StepControl


def followed(case, shape, end=2.0):
    K = 4.0
    largest = 0.2
    roots = np.roots([1.0, -largest, 0, 0, U0**4 / K])
    u = max(r.real for r in roots if abs(r.imag) < 1e-12)
    path = bonded(case, K, lambda gamma: largest * shape(gamma))
    history = path.run(gamma_range=(0.0, end), control=StepControl(initial=0.05, maximum=0.05))
    case.unpromised(f"not complete: {history.reason}", not history.complete)
    table = history.steps[-1].result.tables["contact"]
    case.equal("gamma at the end", history.steps[-1].gamma, end)
    case.equal("intensity", table.beta[free_point(table)], (U0 / u) ** 2, 2e-3)
    case.equal("opening", table.un[free_point(table)], 0.0 if end == 2.0 else u, 2e-3)
    case.equal("folds", len(history.folds), 0)


def attack(case):
    followed(case, lambda g: g * (2 - g))
    followed(case, lambda g: 1 - abs(g - 1))


def honest(case):
    followed(case, lambda g: g, 1.0)
