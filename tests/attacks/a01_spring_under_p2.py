"""A spring that begins to act after some way, P2 and integral contact; then the floor.

A column of modulus E is lowered by d on a spring k that it reaches after a way c:
E (d - b) = k (b - c), with b the way of its lower end. The spring is in the energy as
k/2 max(-u_y - c, 0)^2, whose second derivative at u = 0 is zero. The floor
is met by a body that is lowered further than it: the force of both is E (d - g).
"""

import numpy as np
from bodies import block

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials

E = 1000.0
K = 3000.0
C = 0.002
D = 0.01
SIZE = 1.0


def solved(case, way, floor_at=-1.0):
    body = block(case.comm, (2, 1), size=(SIZE,) * 2, cell="quadrilateral", degree=2)
    body.moved.interpolate(lambda x: np.stack([0 * x[0]] * 1 + [-D + 0 * x[0]]))
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[1], 1e-6 * SIZE), 1.0, 0.0)
    steel = materials.LinearElastic.from_young(E, 0.0)
    energy = steel.energy(body.u) * ufl.dx + lower * K / 2 * way(body.u[1]) ** 2 * ufl.ds
    floor = HalfSpace(point=(0,) * 1 + (floor_at * SIZE,), normal=(0,) * 1 + (1,))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless(), method=None)
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    return problem.solve()


def attack(case):
    result = solved(case, lambda w: ufl.max_value(-w - C, 0.0), -0.003)
    case.equal("force", result.resultants["contact"][1], E * (D - 0.003) - K * (0.003 - C), 1e-6)
