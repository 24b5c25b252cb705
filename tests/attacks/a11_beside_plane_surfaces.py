"""A bulk with a hoop strain beside a plane surface; a plane bulk beside an axisymmetric one.

The force of a body of revolution is E d pi (2^2 - 1^2). A plane body with the plane bulk, the twin,
has E d times 1 for its width and unit thickness.
"""

import numpy as np
from rings import RIGHT, ring

import ufl

from dolfinx_contact.materials import circumference


def attack(case):
    def weight(psi, body):
        return psi * circumference(body.domain) * ufl.dx

    def hoop_of_my_own(psi, body):
        u = body.u
        x = ufl.SpatialCoordinate(body.domain)
        eps = ufl.sym(ufl.grad(u))
        return 500.0 * (ufl.inner(eps, eps) + (u[0] / x[0]) ** 2) * 2 * np.pi * x[0] * ufl.dx

    ways = (
        ("the package's", weight, None, False),
        ("by hand", hoop_of_my_own, None, False),
        ("plane", lambda psi, body: psi * ufl.dx, lambda steel: steel, True),
    )
    for name, form, material, axisymmetric in ways:
        try:
            found = ring(case, form, material, axisymmetric)
        except ValueError:
            found = RIGHT
        case.equal(name, found, RIGHT)
    case.equal("by hand, where it fits", ring(case, hoop_of_my_own), RIGHT)


def honest(case):
    found = ring(case, lambda psi, body: psi * ufl.dx, lambda steel: steel, False)
    case.equal("force of a plane body", found, 10.0)
