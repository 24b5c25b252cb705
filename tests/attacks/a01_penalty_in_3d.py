"""A floor by penalty that the energy sees at the displaced place, max(-(z + u_z) - c, 0)^2.

E (d - b) = k (b - c): the column of hexahedra is lowered by d. The friction floor lies below
and is met in a second solve of the same problem, where its Constant has come up.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials


def attack(case):
    E = 1000.0
    K = 4000.0
    C = 0.001
    D = 0.01
    body = block(case.comm, (1, 1, 2), size=(1.0, 1.0, 1.0))
    body.moved.interpolate(lambda x: np.stack([0 * x[0], 0 * x[0], -D + 0 * x[0]]))
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[2], 1e-6), 1.0, 0.0)
    depth = ufl.max_value(-(x[2] + body.u[2]) - C, 0.0)
    steel = materials.LinearElastic.from_young(E, 0.0)
    energy = steel.energy(body.u) * ufl.dx + lower * K / 2 * depth**2 * ufl.ds
    at = fem.Constant(body.domain, (0.0, 0.0, -1.0))
    contact = ContactSurface(
        body.u, body.bottom, obstacle=HalfSpace(at, (0, 0, 1)), law=Coulomb(0.3)
    )
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    b = (E * D + K * C) / (E + K)
    case.equal("way", 1.0 - problem.solve().tables["contact"].un, np.full(4, b), 1e-7)
    at.value[2] = -0.002
    force = problem.solve().resultants["contact"][2]
    case.equal("force", force, E * (D - 0.002) - K * (0.002 - C), 1e-6)
