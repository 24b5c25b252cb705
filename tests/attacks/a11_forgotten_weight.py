"""A ring in compression whose energy has no weight at all, as a form and as its derivative.

With nu = 0 the force is E d times the area pi (2^2 - 1^2); the twin has the weight, in its
residual.
"""

from rings import RIGHT, ring

import ufl

from dolfinx_contact.materials import circumference


def attack(case):
    case.equal("force", ring(case, lambda psi, body: psi * ufl.dx), RIGHT)


def honest(case):
    def residual(psi, body):
        return ufl.derivative(psi * circumference(body.domain) * ufl.dx, body.u)

    case.equal("force", ring(case, residual), RIGHT)
