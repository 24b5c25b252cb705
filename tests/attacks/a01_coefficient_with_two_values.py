"""Young's modulus is 1000 where a temperature is positive and 500 elsewhere, which changes.

A bulk that is linear in u, though conditionals are in it: with no lateral strain each half of the
column carries E d / 2. The twin has a conditional of the place alone and is proved to be unique.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials


def problem_of(case, hot):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.01 + 0 * x[0]]))
    young = ufl.conditional(hot(body), 1000.0, 500.0)
    steel = materials.LinearElastic.from_young(young, 0.0)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    return ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)


def attack(case):
    fields = []

    def hot(body):
        fields.append(fem.Function(fem.functionspace(body.domain, ("Lagrange", 1))))
        return ufl.gt(fields[0], 0.0)

    problem = problem_of(case, hot)
    for value, young in ((1.0, 1000.0), (-1.0, 500.0), (1e-12, 1000.0)):
        fields[0].x.array[:] = value
        case.equal(f"force at {value}", problem.solve().resultants["contact"][1], 0.01 * young)


def honest(case):
    problem = problem_of(case, lambda b: ufl.lt(ufl.SpatialCoordinate(b.domain)[0], 0.5))
    result = problem.solve()
    case.equal("force", result.resultants["contact"][1], 7.5, 0.02)
    case.true("the only solution", result.unique == "proved")
