"""The viscosity of a bond on a path by arc length becomes one after the path was made.

Without it the bonds of a block that is lifted break at the closed form sqrt(w C) of the traction;
a path knows no time, so that with it there is no answer.
"""

import numpy as np
from bodies import block, moves, on_floor

import ufl
from dolfinx import fem

from dolfinx_contact import RCCM, ParametricContact
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength


def _lifted(case, then):
    body = block(case.comm, (1, 1), cell="quadrilateral")
    moves(body, 0.0, 0.0)
    viscosity = fem.Constant(body.domain, 0.0)
    problem, contact = on_floor(body, RCCM(100.0, 100.0, 0.01, 0.0, viscosity))
    gamma = fem.Constant(body.domain, 0.0)
    lift = ufl.as_vector((0.0, gamma))
    system = ParametricContact(problem, gamma, driven=[(body.moved, lift)])
    path = ArcLength(system)
    viscosity.value = then
    history = path.run(gamma_range=(0.0, 0.005), control=StepControl(maximum=0.2))
    peak = max(np.max(-s.result.tables[contact.name].rn_adh) for s in history.steps)
    case.equal("load", history.steps[-1].gamma, 0.005)
    # elastic: springs of the interface and of the body in series
    case.equal("traction", peak / 0.5, 0.005 / (1 / 100.0 + 1 / 1000.0))


def attack(case):
    _lifted(case, 1.0)


def honest(case):
    _lifted(case, 0.0)
