"""The lift rises and falls over gamma: 1 - |gamma - 1|, a kink, and gamma (2 - gamma), smooth.

Damage begins at the opening u0; the bond keeps what it had at the largest lift, U = u + u0^4/(K
u^3) there (K = 4: no snap-back), and the body is at its place again at gamma = 2.
"""

import numpy as np
from bodies import free_point, one_point

import ufl
from dolfinx import fem

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace, ParametricContact
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength


def followed(case, shape, end=2.0):
    C = 100.0
    work = 1.0
    K = 4.0
    largest = 0.2
    u0 = np.sqrt(work / C)
    roots = np.roots([1.0, -largest, 0, 0, u0**4 / K])
    u = max(r.real for r in roots if abs(r.imag) < 1e-12)
    body, energy = one_point(case.comm, [[50.0, 0.0], [0.0, K * C / 2]])
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=RCCM(C, 0.0, work))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    gamma = fem.Constant(body.domain, 0.0)
    driven = [(body.moved, ufl.as_vector((0, largest * shape(gamma))))]
    path = ArcLength(ParametricContact(problem, gamma, driven=driven))
    history = path.run((0.0, end), control=StepControl(initial=0.05, maximum=0.05))
    case.unpromised(f"not complete: {history.reason}", not history.complete)
    table = history.steps[-1].result.tables["contact"]
    case.equal("gamma at the end", history.steps[-1].gamma, end)
    case.equal("intensity", table.beta[free_point(table)], (u0 / u) ** 2, 2e-3)
    case.equal("opening", table.un[free_point(table)], 0.0 if end == 2.0 else u, 2e-3)
    case.equal("folds", len(history.folds), 0)


def attack(case):
    followed(case, lambda g: g * (2 - g))
    followed(case, lambda g: 1 - abs(g - 1))


def honest(case):
    followed(case, lambda g: g, 1.0)
