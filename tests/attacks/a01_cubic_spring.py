"""A spring whose force is k b |b|: at u = 0 neither stiffness nor force, and no kink either.

E (d - b) = k b |b|: a quadratic equation. The column is lifted as well as lowered, so that both
signs of u are met.
"""

import numpy as np
from bodies import block

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials


def attack(case):
    E = 1000.0
    K = 2e5
    body = block(case.comm, (2, 2), cell="quadrilateral")
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[1], 1e-6), 1.0, 0.0)
    steel = materials.LinearElastic.from_young(E, 0.0)
    energy = steel.energy(body.u) * ufl.dx + lower * K / 3 * abs(body.u[1]) ** 3 * ufl.ds
    floor = HalfSpace(point=(0, -1.0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    for d in (-0.01, 0.02):
        body.moved.interpolate(lambda x, d=d: np.stack([0 * x[0], d + 0 * x[0]]))
        b = np.sign(d) * (-E + np.sqrt(E**2 + 4 * K * E * abs(d))) / (2 * K)
        found = problem.solve().tables["contact"].un - 1.0
        case.equal(f"way at {d}", found, np.full(3, b), 1e-6)
