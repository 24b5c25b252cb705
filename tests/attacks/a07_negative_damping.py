"""Springs hold a body, but its damping is negative: it feeds every motion, and the body leaves.

rho lambda^2 - d lambda + k = 0: growth d / (2 rho) where it oscillates, as every mode does with a
damping that is like the mass. The stiffness is positive definite, and says nothing.
"""

from a07_springs import floating

import ufl

from dolfinx_contact.analysis import stability_at_rest


def attack(case):
    k = 0.5
    rho = 2.0
    for d in (0.3, 0.05):
        body, problem = floating(case.comm, lambda u, v: k * ufl.dot(u, v))
        problem.solve()
        trial = ufl.TrialFunction(body.V)
        test = ufl.TestFunction(body.V)
        form = -d * ufl.dot(trial, test) * ufl.dx
        answer = stability_at_rest(problem, density=rho, damping=form)
        case.true(f"unstable, not {answer.label}", answer.label == "unstable")
        case.equal("growth", answer.growth, d / (2 * rho))


def honest(case):
    k = 0.5
    rho = 2.0
    d = 0.3
    body, problem = floating(case.comm, lambda u, v: k * ufl.dot(u, v))
    problem.solve()
    trial = ufl.TrialFunction(body.V)
    test = ufl.TestFunction(body.V)
    form = d * ufl.dot(trial, test) * ufl.dx
    answer = stability_at_rest(problem, density=rho, damping=form)
    case.true(f"stable, not {answer.label}", answer.label == "stable")
