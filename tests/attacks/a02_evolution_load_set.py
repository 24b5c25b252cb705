"""The load of an evolution is set anew between two runs, which is allowed.

The second load slides back; the third presses more. Q/P is +-F where all slips, P is E times the
way of the top.
"""

import numpy as np
from bodies import block, moves, on_floor, ratio

from dolfinx_contact import Coulomb
from dolfinx_contact.evolution import QuasiStatic


def attack(case):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    moves(body, 0.0, -0.01)
    problem, contact = on_floor(body, Coulomb(0.2))
    problem.solve()
    evolution = QuasiStatic(problem, lambda t: moves(body, 0.05 * t, -0.01))
    step = evolution.run([0.0, 0.5, 1.0]).steps[-1]
    case.equal("Q/P", ratio(step.result.tables[contact.name]), 0.2)
    evolution.load = lambda t: moves(body, 0.05 * (2.0 - t), -0.01)
    step = evolution.run([1.0, 1.5, 2.0]).steps[-1]
    case.equal("Q/P back", ratio(step.result.tables[contact.name]), -0.2)
    evolution.load = lambda t: moves(body, 0.05 * (2.0 - t), -0.01 * (t - 1.0))
    contact.law.friction.value = 0.4
    step = evolution.run([2.0, 2.5, 3.0]).steps[-1]
    case.equal("Q/P of more friction", ratio(step.result.tables[contact.name]), -0.4)
    case.equal("P", np.sum(step.result.tables[contact.name].rn), 20.0)
