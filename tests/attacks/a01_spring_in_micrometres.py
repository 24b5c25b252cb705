"""The one-sided spring in a body of a micrometre, in SI units, tetrahedra.

A column of modulus E is lowered by d on a spring k that it reaches after a way c:
E (d - b) = k (b - c), with b the way of its lower end. The spring is in the energy as
k/2 max(-u_y - c, 0)^2, whose second derivative at u = 0 is zero. In the twin
it acts at once.
"""

import numpy as np
from bodies import block

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials

E = 2e11
K = 6e17
C = 2e-9
D = 1e-8
SIZE = 1e-6


def solved(case, way, floor_at=-1.0):
    body = block(case.comm, (1, 1, 1), size=(SIZE,) * 3, cell="tetrahedron", degree=1)
    body.moved.interpolate(lambda x: np.stack([0 * x[0]] * 2 + [-D + 0 * x[0]]))
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[2], 1e-6 * SIZE), 1.0, 0.0)
    steel = materials.LinearElastic.from_young(E, 0.0)
    energy = steel.energy(body.u) * ufl.dx + lower * K / 2 * way(body.u[2]) ** 2 * ufl.ds
    floor = HalfSpace(point=(0,) * 2 + (floor_at * SIZE,), normal=(0,) * 2 + (1,))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless(), method=None)
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    return problem.solve()


def ways(case, way):
    return (1e-6 - solved(case, way).tables["contact"].un) / 1e-9


def attack(case):
    found = ways(case, lambda w: ufl.max_value(-w - C, 0.0))
    b = (E * D + K * C * SIZE) / (E + K * SIZE)
    case.equal("way in nanometres", found, np.full(len(found), b / 1e-9), 1e-5)


def honest(case):
    found = ways(case, lambda w: w)
    b = E * D / (E + K * SIZE)
    case.equal("way in nanometres", found, np.full(len(found), b / 1e-9), 1e-5)
