"""A half broken bond is unloaded by a later run, back to a pressed body, and loaded again.

Unloading goes along the secant: the opening is U k/(k + beta^2 C), zero at U = 0; pressed by U < 0
the force is -k U whatever the bond is. Loaded again, damage goes on where it stopped.
"""

import numpy as np
from bodies import free_point, one_point

import ufl
from dolfinx import fem

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace, ParametricContact
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength


def opening(lift, K, u0):
    roots = np.roots([1.0, -lift, 0, 0, u0**4 / K])
    return max(r.real for r in roots if abs(r.imag) < 1e-12)


def attack(case):
    C = 100.0
    work = 1.0
    K = 4.0
    u0 = np.sqrt(work / C)
    body, energy = one_point(case.comm, [[50.0, 0.0], [0.0, K * C / 2]])
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=RCCM(C, 0.0, work))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    gamma = fem.Constant(body.domain, 0.0)
    driven = [(body.moved, ufl.as_vector((0, gamma)))]
    path = ArcLength(ParametricContact(problem, gamma, driven=driven))
    control = StepControl(initial=0.05, maximum=0.1)
    path.run((-0.1, 0.2), control=control)
    beta = (u0 / opening(0.2, K, u0)) ** 2
    back = path.run((-0.1, 0.2), direction="back", control=control)
    for step in back.steps:
        table = step.result.tables["contact"]
        u = max(step.gamma, 0.0) * K / (K + beta**2)
        case.equal(f"opening at {step.gamma}", table.un[free_point(table)], u, 1e-4)
    case.equal("gamma", back.steps[-1].gamma, -0.1)
    case.equal("intensity", table.beta[free_point(table)], beta, 1e-4)
    case.equal("pressure", table.pressure[free_point(table)], 0.1 * K * C, 1e-6)
    again = path.run((-0.1, 0.3), direction="back", control=control)
    table = again.steps[-1].result.tables["contact"]
    case.equal("gamma again", again.steps[-1].gamma, 0.3)
    case.equal("opening again", table.un[free_point(table)], opening(0.3, K, u0), 1e-4)
    case.equal("no folds", len(back.folds) + len(again.folds), 0)
