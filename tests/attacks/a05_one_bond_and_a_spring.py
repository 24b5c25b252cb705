"""A bond in series with a spring, followed with longest steps far above the default.

u_tot turns at u0 (1 + 1/K), where damage begins, and at 4/3 u0 (3/K)^(1/4), with u0 = (w/C)^(1/2)
and K the stiffness of the spring over that of the bond (by hand: w = C u0^2, beta = (u0/u)^2).
A path that claims to be complete has both folds, whatever the longest step is.
"""

import numpy as np
from bodies import one_point

import ufl
from dolfinx import fem

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace, ParametricContact
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength


def folded(case, K, longest):
    C = 100.0
    work = 1.0
    u0 = np.sqrt(work / C)
    for maximum in longest:
        body, energy = one_point(case.comm, [[50.0, 0.0], [0.0, K * C / 2]])
        law = RCCM(C, 0.0, work)
        floor = HalfSpace((0, 0), (0, 1))
        contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=law)
        problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
        gamma = fem.Constant(body.domain, 0.0)
        driven = [(body.moved, ufl.as_vector((0, gamma)))]
        path = ArcLength(ParametricContact(problem, gamma, driven=driven))
        control = StepControl(initial=maximum / 2, maximum=maximum)
        history = path.run((0.0, 8 * u0), control=control)
        expected = [u0 * (1 + 1 / K), 4 / 3 * u0 * (3 / K) ** 0.25]
        case.unpromised(f"not complete: {history.reason}", not history.complete)
        folds = [step.gamma for step in history.folds]
        case.equal(f"folds with steps up to {maximum}", folds, expected, 1e-5)


def attack(case):
    folded(case, 0.5, (0.3, 0.05))


def honest(case):
    folded(case, 0.5, (0.02,))
