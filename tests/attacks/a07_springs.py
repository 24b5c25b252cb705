"""A body that floats on springs, a force k u per volume: they hold it, or drive it away.

Translations are exact motions: rho lambda^2 = -k, so that with k < 0 the body leaves with growth
sqrt(-k / rho), with all contact points open, or frictionless and pressed along the other direction.
No contact point is at a border. Also in units of 1e-9 and 1e9.
"""

import numpy as np
from bodies import block

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.analysis import stability_at_rest


def floating(comm, force, *, height=-1.0, length=1.0, stress=1.0, cells=(2, 2)):
    """A free body above a floor; ``force`` of u and a test function adds to its residual."""
    body = block(comm, cells, (length,) * len(cells))
    dim = len(cells)
    test = ufl.TestFunction(body.V)
    energy = materials.LinearElastic(stress, stress).energy(body.u) * ufl.dx
    bulk = ufl.derivative(energy, body.u, test) + force(body.u, test) * ufl.dx
    point = np.zeros(dim)
    normal = np.zeros(dim)
    point[-1] = height * length
    normal[-1] = 1.0
    floor = HalfSpace(point, normal)
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.5))
    return body, ContactProblem(bulk, body.u, [contact])


def put(case, k, rho=1.0, length=1.0, stress=1.0, cells=(2, 2)):
    own = k * stress / length**2  # of the size of the elastic forces
    _, problem = floating(
        case.comm, lambda u, v: own * ufl.dot(u, v), length=length, stress=stress, cells=cells
    )
    result = problem.solve()
    case.true("all open", set(result.tables["contact"].status) == {"o"})
    answer = stability_at_rest(problem, density=rho)
    if k < 0:
        case.equal("growth", answer.growth, np.sqrt(-own / rho))
        case.true(f"unstable, not {answer.label}", answer.label == "unstable")
    else:
        case.true(f"stable, not {answer.label}", answer.label == "stable")


def attack(case):
    put(case, -0.3)
    put(case, -0.3, 7.8e3, 1e-9, 1e9)
    put(case, -0.05, 1e-9, 1e9, 1e-9)
    put(case, -0.2, 3.0, 1e-3, 1e11, (1, 1, 2))


def honest(case):
    put(case, 0.3)
    put(case, 0.3, 7.8e3, 1e-9, 1e9)
