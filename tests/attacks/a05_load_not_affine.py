"""The lift of a softening bond is gamma^2, or exp(gamma) - 1: folds come where it has the values.

The bond turns at the lifts a + s/k and a + b.
"""

import numpy as np
from bodies import free_point, one_point

import ufl
from dolfinx import fem

from dolfinx_contact import (
    BilinearCohesive,
    ContactProblem,
    ContactSurface,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength

S = 2.0
A = 0.01
B = 0.02
K = 40.0


def followed(case, lift, inverse):
    body, energy = one_point(case.comm, [[K / 2, 0.0], [0.0, K / 2]])
    law = BilinearCohesive(S, A, B)
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=law)
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    gamma = fem.Constant(body.domain, 0.0)
    driven = [(body.moved, ufl.as_vector((0, lift(gamma))))]
    path = ArcLength(ParametricContact(problem, gamma, driven=driven))
    control = StepControl(initial=0.05, maximum=0.1)
    history = path.run(gamma_range=(0.0, inverse(0.1)), control=control)
    case.unpromised(f"not complete: {history.reason}", not history.complete)
    expected = [inverse(A + S / K), inverse(A + B)]
    case.equal("folds", [p.gamma for p in history.folds], expected, 1e-6)
    table = history.steps[-1].result.tables["contact"]
    case.equal("opening at the end", table.un[free_point(table)], 0.1)


def attack(case):
    followed(case, lambda g: g**2, np.sqrt)
    followed(case, lambda g: ufl.exp(g) - 1, np.log1p)
