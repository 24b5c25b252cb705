"""A path with a snap-back run in parts, whose ranges end just before and just after a fold.

The second fold of the bond, 4/3 u0 (3/K)^(1/4), lies below the end of the first range; the first
one, u0 (1 + 1/K), just above the end of the second run's.
"""

import numpy as np
from bodies import free_point, one_point

import ufl
from dolfinx import fem

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace, ParametricContact
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength


def attack(case):
    C = 100.0
    work = 1.0
    K = 0.5
    u0 = np.sqrt(work / C)
    folds = [u0 * (1 + 1 / K), 4 / 3 * u0 * (3 / K) ** 0.25]
    body, energy = one_point(case.comm, [[50.0, 0.0], [0.0, K * C / 2]])
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=RCCM(C, 0.0, work))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    gamma = fem.Constant(body.domain, 0.0)
    driven = [(body.moved, ufl.as_vector((0, gamma)))]
    path = ArcLength(ParametricContact(problem, gamma, driven=driven))
    control = StepControl(initial=0.05, maximum=0.1)
    found = []
    for end in (0.5 * folds[0], folds[0] * (1 - 1e-4), folds[0] * (1 + 1e-4), 0.6):
        history = path.run((0.0, end), control=control)
        case.unpromised(f"not complete: {history.reason}", not history.complete)
        found += [p.gamma for p in history.folds]
    case.equal("folds", found, folds, 1e-5)
    case.equal("gamma", history.steps[-1].gamma, 0.6)
    table = history.steps[-1].result.tables["contact"]
    u = max(r.real for r in np.roots([1.0, -0.6, 0, 0, u0**4 / K]) if abs(r.imag) < 1e-12)
    case.equal("opening", table.un[free_point(table)], u, 1e-5)
