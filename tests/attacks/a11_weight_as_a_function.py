"""The weight as a Function: 2 pi r, which is right, r, and r squared; and as Constants beside r.

With nu = 0 the force is E d pi (2^2 - 1^2). A Function shows nothing in its form, so
that a refusal or a warning is all that can be had where it is another one.
"""

from functools import partial

import numpy as np
from rings import RIGHT, ring, settled

import ufl
from dolfinx import fem

from dolfinx_contact.materials import circumference


def of_function(case, value, degree=1):
    def weighted(psi, body):
        weight = fem.Function(fem.functionspace(body.domain, ("Lagrange", degree)))
        weight.interpolate(lambda x: value(x[0]))
        return psi * weight * ufl.dx

    return ring(case, weighted)


def attack(case):
    case.equal("2 pi r as a Function", of_function(case, lambda r: 2 * np.pi * r), RIGHT)
    powers = {
        "r": lambda r: r,
        "r squared": lambda r: r**2,
        "2 pi r squared": lambda r: 2 * np.pi * r**2,
        "none": lambda r: 1 + 0 * r,
    }
    for name, value in powers.items():
        settled(case, name, partial(of_function, case, value, 2))


def honest(case):
    def weighted(psi, body):
        return sum(psi * part * circumference(body.domain) * ufl.dx for part in (0.25, 0.75))

    case.equal("force", ring(case, weighted), RIGHT)
