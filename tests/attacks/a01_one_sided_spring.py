"""A spring that begins to act after some way, mixed contact, triangles.

A column of modulus E is lowered by d on a spring k that it reaches after a way c:
E (d - b) = k (b - c), with b the way of its lower end. The spring is in the energy as
k/2 max(-u_y - c, 0)^2, whose second derivative at u = 0 is zero. In the twin it acts at
once, k/2 u_y^2, and the answer is proved to be the only one.
"""

import numpy as np
from bodies import block

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials

E = 1000.0
K = 3000.0
C = 0.002
D = 0.01


def solved(case, way, floor_at=-1.0, cells=(2, 2), **kind):
    body = block(case.comm, cells, **kind)
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -D + 0 * x[0]]))
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[1], 1e-6), 1.0, 0.0)
    steel = materials.LinearElastic.from_young(E, 0.0)
    energy = steel.energy(body.u) * ufl.dx + lower * K / 2 * way(body.u[1]) ** 2 * ufl.ds
    floor = HalfSpace(point=(0, floor_at), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless(), method=None)
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    return problem.solve()


def attack(case):
    result = solved(case, lambda w: ufl.max_value(-w - C, 0.0))
    b = (E * D + K * C) / (E + K)
    case.equal("gap", result.tables["contact"].un, np.full(3, 1.0 - b), 1e-9)
    case.equal("way", 1.0 - result.tables["contact"].un, np.full(3, b), 1e-7)


def honest(case):
    result = solved(case, lambda w: w)
    b = E * D / (E + K)
    case.equal("way", 1.0 - result.tables["contact"].un, np.full(3, b), 1e-7)
    case.true("the only solution", result.unique == "proved")
