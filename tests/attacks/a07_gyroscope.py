"""Springs drive a body away, but gyroscopic forces g (-v_y, v_x) hold it.

Translations: rho lambda^2 +- i g lambda - c = 0, on the imaginary axis where g^2 > 4 rho c. So it
does not leave in the linearised motion with the damping form that was given, though the stiffness
is indefinite; with less g it does, with a growth in closed form. All other motions are looked at in
numpy.
"""

from mpi4py import MPI

import numpy as np
import scipy.linalg
from a07_springs import floating
from bodies import dense

import ufl

from dolfinx_contact.analysis import stability_at_rest


def driven(u, v, c):
    """Springs that drive away, and others that hold the body against turning."""
    turned = u[1].dx(0) - u[0].dx(1)
    return -c * ufl.dot(u, v) + 5.0 * turned * (v[1].dx(0) - v[0].dx(1))


def gyroscope(body, g):
    trial = ufl.TrialFunction(body.V)
    test = ufl.TestFunction(body.V)
    return g * ufl.dot(ufl.as_vector((-trial[1], trial[0])), test) * ufl.dx


def attack(case):
    c = 0.2
    rho = 2.0
    for g in (2.0, 0.8):
        body, problem = floating(case.comm, lambda u, v: driven(u, v, c))
        problem.solve()
        answer = stability_at_rest(problem, density=rho, damping=gyroscope(body, g))
        own, same = floating(MPI.COMM_SELF, lambda u, v: driven(u, v, c))
        K = own_stiffness(own, c)
        trial = ufl.TrialFunction(own.V)
        test = ufl.TestFunction(own.V)
        M = dense(rho * ufl.dot(trial, test) * ufl.dx)
        grows = growth_of(M, dense(gyroscope(own, g)), K)
        same.destroy()
        if grows > 1e-6:
            case.true(f"unstable, not {answer.label}", answer.label == "unstable")
            case.equal("growth", answer.growth, grows)
            exact = np.roots([rho, 1j * g, -c]).real.max()
            case.equal("closed form", grows, exact)
        else:
            case.true(f"not unstable: {answer.reason}", answer.label != "unstable")


def own_stiffness(own, c):
    trial = ufl.TrialFunction(own.V)
    test = ufl.TestFunction(own.V)
    E = ufl.sym(ufl.grad(trial))
    stress = ufl.tr(E) * ufl.Identity(2) + 2 * E
    form = ufl.inner(stress, ufl.sym(ufl.grad(test))) + driven(trial, test, c)
    return dense(form * ufl.dx)


def growth_of(M, C, K):
    """Largest real part of the eigenvalues of lambda^2 M + lambda C + K."""
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    return scipy.linalg.eigvals(A).real.max()
