"""The classical algorithms take a linear body; one with a one-sided spring is not, in any of them.

E (d - g) = k (g - c) + R on a floor at -g: the force R of every algorithm is that, or it is refused
or not solved. ``reduced`` and the twin: a spring that acts at once, R = E (d - g) - k g.
"""

import numpy as np
from bodies import block

import ufl

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    ConvergenceError,
    Coulomb,
    HalfSpace,
    materials,
)

E = 1000.0
K = 1000.0
C = 0.002
D = 0.01
G = 0.003


def forces(case, way, refusals):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -D + 0 * x[0]]))
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[1], 1e-6), 1.0, 0.0)
    steel = materials.LinearElastic.from_young(E, 0.0)
    energy = steel.energy(body.u) * ufl.dx + lower * K / 2 * way(body.u[1]) ** 2 * ufl.ds
    floor = HalfSpace(point=(0, -G), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.2))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    found = []
    for name in ("newton", "lemke", "gauss-seidel", "uzawa", "tresca", "interior-point"):
        body.u.x.array[:] = 0.0
        try:
            found.append(problem.solve(algorithm=name).resultants["contact"][1])
        except refusals:
            continue
    return found


def attack(case):
    found = forces(case, lambda w: ufl.max_value(-w - C, 0.0), (ValueError, ConvergenceError))
    case.true("Newton's method at least", len(found) > 0)
    case.equal("forces", found, np.full(len(found), E * (D - G) - K * (G - C)), 1e-5)


def honest(case):
    found = forces(case, lambda w: w, ConvergenceError)
    case.true("several algorithms", len(found) > 3)
    case.equal("forces", found, np.full(len(found), E * (D - G) - K * G), 1e-5)
