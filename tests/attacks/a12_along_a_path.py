"""Observers of a path by arc length and of a history read problem and surface at every point.

A bonded block is lifted: the traction of springs of bond and body in series is a closed form, and
the bond stands intact until it reaches sqrt(w C).
"""

import numpy as np
from bodies import block, moves, on_floor

import ufl
from dolfinx import fem

from dolfinx_contact import RCCM, ParametricContact
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength, QuasiStatic


def attack(case):
    body = block(case.comm, (1, 1), cell="quadrilateral")
    problem, contact = on_floor(body, RCCM(100.0, 100.0, 0.01))
    gamma = fem.Constant(body.domain, 0.0)
    lift = ufl.as_vector((0.0, gamma))
    system = ParametricContact(problem, gamma, driven=[(body.moved, lift)])
    seen = []

    def path_observer(step):
        table = problem.table(contact)
        seen.append((step.gamma, float(gamma.value), np.sum(table.rn_adh), np.min(table.beta)))

    path = ArcLength(system)
    path.run(gamma_range=(0.0, 0.005), observer=path_observer, control=StepControl(maximum=0.2))
    seen = np.array(seen)
    case.equal("gamma", seen[:, 1], seen[:, 0])
    case.equal("traction", -seen[:, 2], seen[:, 0] / (1 / 100.0 + 1 / 1000.0))
    case.equal("bond", seen[:, 3], np.ones(len(seen)))

    body = block(case.comm, (1, 1), cell="quadrilateral")
    problem, contact = on_floor(body, RCCM(100.0, 100.0, 0.01))
    told = []

    def observer(step):
        table = problem.table(contact)
        told.append((step.time, np.sum(table.rn_adh), np.min(table.beta), np.max(table.un)))

    evolution = QuasiStatic(problem, lambda t: moves(body, 0.0, 0.005 * t))
    evolution.run([0.0, 0.4, 1.0], observer=observer)
    told = np.array(told)
    case.equal("traction in time", -told[:, 1], 0.005 * told[:, 0] / (1 / 100.0 + 1 / 1000.0))
    case.equal("bond in time", told[:, 2], np.ones(len(told)))
    case.equal("opening", 100.0 * told[:, 3], -told[:, 1])
