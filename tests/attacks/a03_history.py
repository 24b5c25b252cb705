"""A history that moves a block off the one below in steps of a fifth of a facet each.

No single step is large. At the end there is nothing below, and the force is zero; a run says once
that the sliding is not small any more.
"""

import numpy as np
from a03_off_the_edge import doubted, pressed
from bodies import two_blocks

from dolfinx_contact import Coulomb
from dolfinx_contact.evolution import QuasiStatic


def run(case, end, steps):
    both = two_blocks(case.comm, (2, 1), (4, 1))
    problem = pressed(both, 0.0, 0.0, law=Coulomb(0.2))

    def load(t):
        both.top.interpolate(lambda x: np.stack([t + 0 * x[0], -0.001 + 0 * x[0]]))

    load(0.0)
    problem.solve()
    history = QuasiStatic(problem, load).run(np.linspace(0.0, end, steps + 1))
    return history.steps[-1].result


def attack(case):
    result = run(case, 1.2, 24)
    case.equal("force", result.resultants["contact"], [0.0, 0.0], 1e-9)
    doubted(case, result)
    said = sum("contact" in w for w in case.warnings)
    if said > 1:
        raise AssertionError(f"said {said} times")


def honest(case):
    result = run(case, 0.004, 2)
    case.equal("two springs in a row", result.resultants["contact"][1], 0.001 / 1.5, 0.02)
    case.true("nothing is said", not case.warnings)
