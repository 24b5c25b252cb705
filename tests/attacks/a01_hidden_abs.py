"""|u_x| written as a square root, as a maximum and as a sum of positive parts.

None of the three has ``abs`` in it. A face that is held with 20 and pulled with 5 stays where it
is. The twin has abs(u_x)**2, which is u_x^2: a spring of stiffness 2k beside a pull of 5 on
a face that is otherwise held by the same energy without contact.
"""

import numpy as np
from bodies import block

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials


def slips(case, term):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.01 + 0 * x[0]]))
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[1], 1e-6), 1.0, 0.0)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    energy = steel.energy(body.u) * ufl.dx + lower * (term(body.u) - 5 * body.u[0]) * ufl.ds
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    return problem.solve().tables["contact"].ut[:, 0]


def refused(case, term):
    try:
        found = slips(case, term)
    except ValueError as error:
        return str(error)
    case.equal("slip", found, np.zeros(3), 1e-9)
    return ""


def attack(case):
    ways = (
        lambda u: 20 * ufl.sqrt(u[0] ** 2),
        lambda u: 20 * ufl.max_value(u[0], -u[0]),
        lambda u: 20 * (ufl.max_value(u[0], 0) - ufl.min_value(u[0], 0)),
    )
    said = [refused(case, way) for way in ways]
    case.true("each is refused, or held", len(said) == 3)


def honest(case):
    found = slips(case, lambda u: 20 * abs(u[0]) ** 2)
    case.equal("slip", found, slips(case, lambda u: 20 * u[0] ** 2), 1e-9)
