"""A material that is stiffer in compression: its energy has a kink at u = 0 in every cell.

Pressed by d against the floor the column answers with E_c d, pulled by a load on its lower face
it gives way by q / E_t. With E_c = E_t, the twin, the same words are those of a linear body.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace


def solved(case, compressed, pulled):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    eps = ufl.sym(ufl.grad(body.u))
    squares = sum(
        compressed * ufl.min_value(eps[i, i], 0.0) ** 2
        + pulled * ufl.max_value(eps[i, i], 0.0) ** 2
        for i in range(2)
    )
    density = squares / 2 + (compressed + pulled) / 2 * eps[0, 1] ** 2
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[1], 1e-6), 1.0, 0.0)
    q = fem.Constant(body.domain, 0.0)
    energy = density * ufl.dx + q * body.u[1] * lower * ufl.ds
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.01 + 0 * x[0]]))
    pressed = problem.solve().resultants["contact"][1]
    body.moved.interpolate(lambda x: np.stack([0 * x[0], 0.1 + 0 * x[0]]))
    q.value = 5.0
    hanging = problem.solve().tables["contact"].un
    case.equal("pressed", pressed, 0.01 * compressed, 1e-6)
    case.equal("hanging", hanging, np.full(3, 0.1 - 5.0 / pulled), 1e-6)


def attack(case):
    solved(case, 1000.0, 400.0)


def honest(case):
    solved(case, 500.0, 500.0)
