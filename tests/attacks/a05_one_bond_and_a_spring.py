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

C = 100.0
WORK = 1.0
U0 = np.sqrt(WORK / C)


def bonded(case, K, lift=lambda gamma: gamma):
    """The path of a point on a bond of stiffness C, lifted by a spring of K times that."""
    body, energy = one_point(case.comm, [[50.0, 0.0], [0.0, K * C / 2]])
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=RCCM(C, 0.0, WORK))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    gamma = fem.Constant(body.domain, 0.0)
    driven = [(body.moved, ufl.as_vector((0, lift(gamma))))]
    return ArcLength(ParametricContact(problem, gamma, driven=driven))


def folded(case, K, longest):
    for maximum in longest:
        path = bonded(case, K)
        control = StepControl(initial=maximum / 2, maximum=maximum)
        history = path.run(gamma_range=(0.0, 8 * U0), control=control)
        expected = [U0 * (1 + 1 / K), 4 / 3 * U0 * (3 / K) ** 0.25]
        case.unpromised(f"not complete: {history.reason}", not history.complete)
        folds = [step.gamma for step in history.folds]
        case.equal(f"folds with steps up to {maximum}", folds, expected, 1e-5)


def attack(case):
    folded(case, 0.5, (0.3, 0.05))


def honest(case):
    folded(case, 0.5, (0.02,))
