"""The weight twice, its root, and its inverse.

With nu = 0 the force is E d pi (2^2 - 1^2): integrals over 2 pi r that vary like r or 1/r where the
material does not are refused; of a constant factor that is missing a warning is
all that can be had.
"""

from functools import partial

import numpy as np
from rings import RIGHT, ring, settled

import ufl

from dolfinx_contact.materials import circumference


def attack(case):
    forms = {
        "twice": lambda psi, b: psi * circumference(b.domain) ** 2 * ufl.dx,
        "a root": lambda psi, b: psi * ufl.sqrt(circumference(b.domain)) * ufl.dx,
        "the inverse": lambda psi, b: psi / circumference(b.domain) * ufl.dx,
    }
    for name, form in forms.items():
        settled(case, name, partial(ring, case, form))


def honest(case):
    def written_out(psi, body):
        x = ufl.SpatialCoordinate(body.domain)
        return psi * (x[0] * np.pi + np.pi * x[0]) * ufl.dx

    case.equal("x pi + pi x", ring(case, written_out), RIGHT)
