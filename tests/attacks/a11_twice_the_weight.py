"""The weight twice, its root, and its inverse.

With nu = 0 the force is E d pi (2^2 - 1^2): integrals over 2 pi r that vary like r or 1/r where the
material does not are refused; of a constant factor that is missing a warning is
all that can be had.
"""

import numpy as np
from rings import RIGHT, ring

import ufl

from dolfinx_contact.materials import circumference


def told(case):
    """How often the package has warned so far, on all ranks."""
    return case.comm.allreduce(len(case.warnings))


def settled(case, name, form):
    """A form whose weight is wrong: refused, or warned of by itself, or the right force."""
    heard = told(case)
    try:
        found = ring(case, form)
    except ValueError:
        found = RIGHT
    if told(case) == heard:
        case.equal(name, found, RIGHT)
    else:
        said = case.comm.bcast(case.warnings[-1] if case.comm.rank == 0 else "")
        case.true("the warning says of what", "2 pi r" in said)


def attack(case):
    forms = {
        "twice": lambda psi, b: psi * circumference(b.domain) ** 2 * ufl.dx,
        "a root": lambda psi, b: psi * ufl.sqrt(circumference(b.domain)) * ufl.dx,
        "the inverse": lambda psi, b: psi / circumference(b.domain) * ufl.dx,
    }
    for name, form in forms.items():
        settled(case, name, form)


def honest(case):
    def written_out(psi, body):
        x = ufl.SpatialCoordinate(body.domain)
        return psi * (x[0] * np.pi + np.pi * x[0]) * ufl.dx

    case.equal("x pi + pi x", ring(case, written_out), RIGHT)
