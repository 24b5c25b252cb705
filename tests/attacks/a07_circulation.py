"""A body on springs with a force that circulates, c (-u_y, u_x): flutter, against a closed form.

Translations: rho lambda^2 + d lambda + k +- i c = 0, all exact motions. Undamped they grow
for every c; a damping d holds them as long as d^2 k > rho c^2. The stiffness is positive
definite (k > 0), so that no count of its negative eigenvalues shows this.
"""

import numpy as np
from a07_springs import floating

import ufl

from dolfinx_contact.analysis import stability_at_rest


def put(case, k, c, d, rho):
    def force(u, v):
        turned = ufl.as_vector((-u[1], u[0]))
        return k * ufl.dot(u, v) - c * ufl.dot(turned, v)

    body, problem = floating(case.comm, force)
    problem.solve()
    trial = ufl.TrialFunction(body.V)
    test = ufl.TestFunction(body.V)
    damping = d * ufl.dot(trial, test) * ufl.dx if d else 0.0
    answer = stability_at_rest(problem, density=rho, damping=damping)
    roots = np.concatenate([np.roots([rho, d, k + s * 1j * c]) for s in (1, -1)])
    fastest = roots[np.argmax(roots.real)]
    if fastest.real > 1e-9:
        case.true(f"unstable, not {answer.label}", answer.label == "unstable")
        case.equal("growth", answer.growth, fastest.real)
        case.equal("frequency", abs(answer.frequency), abs(fastest.imag))
    else:
        case.true(f"stable, not {answer.label}: {answer.reason}", answer.label == "stable")


def attack(case):
    put(case, 0.5, 0.2, 0.0, 2.0)
    put(case, 0.5, 0.2, 0.1, 2.0)


def honest(case):
    put(case, 0.5, 0.2, 0.9, 2.0)
