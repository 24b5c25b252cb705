"""Dry friction 20 on the lower face, put into the energy as 20 |u_x|, against a pull of 5.

The answer is that of the theory of friction: a face that is held with 20 and pulled with 5 stays
where it is, and with nothing else to move it the whole body does. The twin has |x - 1/2| in the
energy, a function of the place alone, whose integral is 1/4.
"""

import numpy as np
from bodies import block

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials


def solved(case, term):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.01 + 0 * x[0]]))
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[1], 1e-6), 1.0, 0.0)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    energy = steel.energy(body.u) * ufl.dx + lower * term(body.u, x) * ufl.ds
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    return problem.solve()


def attack(case):
    result = solved(case, lambda u, x: 20 * abs(u[0]) - 5 * u[0])
    case.equal("slip", result.tables["contact"].ut[:, 0], np.zeros(3), 1e-9)


def honest(case):
    result = solved(case, lambda u, x: 8 * abs(x[0] - 0.5) * u[1])
    case.equal("force", result.resultants["contact"][1], 10.0 + 2.0)
