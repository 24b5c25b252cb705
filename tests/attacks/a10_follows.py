"""A bulk that is a residual with a stiffness that is not symmetric, as a load that follows.

Its tangent has S_nt that is not the transpose of S_tn; numpy takes the one from tangential slips to
normal forces. A body that took the transpose, or the symmetric part, would have other numbers.
"""

from mpi4py import MPI

import numpy as np
from a10_all_listed import compare, expected, leaning, made
from bodies import dense

import ufl

from dolfinx_contact.analysis import critical_friction


def residual(body, trial):
    """Elasticity and a force per volume that turns with the displacement."""
    test = ufl.TestFunction(body.V)
    E = ufl.sym(ufl.grad(trial))
    stress = ufl.tr(E) * ufl.Identity(2) + 2 * E
    inner = ufl.inner(stress, ufl.sym(ufl.grad(test))) * ufl.dx
    turned = ufl.as_vector((-2.0 * trial[1], 0.5 * trial[0].dx(1)))
    return inner - ufl.dot(turned, test) * ufl.dx


def attack(case):
    for offset in (0.5, -0.5):
        body = leaning(case.comm, offset, (3, 3))
        problem = made(body, residual(body, body.u))
        own = leaning(MPI.COMM_SELF, offset, (3, 3))
        K = dense(residual(own, ufl.TrialFunction(own.V)))
        case.true("not symmetric", np.abs(K - K.T).max() > 1e-3)
        compare(case, critical_friction(problem), expected(K, own.V, 1.0))
