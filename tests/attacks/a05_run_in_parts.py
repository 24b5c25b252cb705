"""A path with a snap-back run in parts, whose ranges end just before and just after a fold.

The second fold of the bond, 4/3 u0 (3/K)^(1/4), lies below the end of the first range; the first
one, u0 (1 + 1/K), just above the end of the second run's.
"""

import numpy as np
from a05_one_bond_and_a_spring import U0, bonded
from bodies import free_point

from dolfinx_contact.continuation import StepControl


def attack(case):
    K = 0.5
    folds = [U0 * (1 + 1 / K), 4 / 3 * U0 * (3 / K) ** 0.25]
    path = bonded(case, K)
    control = StepControl(initial=0.05, maximum=0.1)
    found = []
    for end in (0.5 * folds[0], folds[0] * (1 - 1e-4), folds[0] * (1 + 1e-4), 0.6):
        history = path.run(gamma_range=(0.0, end), control=control)
        case.unpromised(f"not complete: {history.reason}", not history.complete)
        found += [p.gamma for p in history.folds]
    case.equal("folds", found, folds, 1e-5)
    case.equal("gamma", history.steps[-1].gamma, 0.6)
    table = history.steps[-1].result.tables["contact"]
    u = max(r.real for r in np.roots([1.0, -0.6, 0, 0, U0**4 / K]) if abs(r.imag) < 1e-12)
    case.equal("opening", table.un[free_point(table)], u, 1e-5)
