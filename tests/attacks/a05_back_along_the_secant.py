"""A half broken bond is unloaded by a later run, back to a pressed body, and loaded again.

Unloading goes along the secant: the opening is U k/(k + beta^2 C), zero at U = 0; pressed by U < 0
the force is -k U whatever the bond is. Loaded again, damage goes on where it stopped.
"""

import numpy as np
from a05_one_bond_and_a_spring import U0, C, bonded
from bodies import free_point

from dolfinx_contact.continuation import StepControl


def opening(lift, K):
    roots = np.roots([1.0, -lift, 0, 0, U0**4 / K])
    return max(r.real for r in roots if abs(r.imag) < 1e-12)


def attack(case):
    K = 4.0
    path = bonded(case, K)
    control = StepControl(initial=0.05, maximum=0.1)
    path.run(gamma_range=(-0.1, 0.2), control=control)
    beta = (U0 / opening(0.2, K)) ** 2
    back = path.run(gamma_range=(-0.1, 0.2), direction="back", control=control)
    for step in back.steps:
        table = step.result.tables["contact"]
        u = max(step.gamma, 0.0) * K / (K + beta**2)
        case.equal(f"opening at {step.gamma}", table.un[free_point(table)], u, 1e-4)
    case.equal("gamma", back.steps[-1].gamma, -0.1)
    case.equal("intensity", table.beta[free_point(table)], beta, 1e-4)
    case.equal("pressure", table.pressure[free_point(table)], 0.1 * K * C, 1e-6)
    again = path.run(gamma_range=(-0.1, 0.3), direction="back", control=control)
    table = again.steps[-1].result.tables["contact"]
    case.equal("gamma again", again.steps[-1].gamma, 0.3)
    case.equal("opening again", table.un[free_point(table)], opening(0.3, K), 1e-4)
    case.equal("no folds", len(back.folds) + len(again.folds), 0)
