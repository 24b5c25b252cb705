"""The weight is the radius alone, far from the axis and in a mesh with one column of cells.

With nu = 0 the force is E d times pi (2^2 - 1^2), or pi (101^2 - 100^2) far from the axis; the twin
writes 2 pi x[0] out.
"""

import numpy as np
from rings import RIGHT, ring

import ufl


def alone(psi, body):
    return psi * ufl.SpatialCoordinate(body.domain)[0] * ufl.dx


def attack(case):
    for cells in ((1, 2), (2, 2)):
        try:
            found = ring(case, alone, cells=cells)
        except ValueError as error:
            case.true("the refusal names x[0]", "x[0]" in str(error) or "2 pi" in str(error))
            continue
        case.equal("force", found, RIGHT)


def honest(case):
    def weighted(psi, body):
        return 2 * np.pi * ufl.SpatialCoordinate(body.domain)[0] * psi * ufl.dx

    case.equal("force", ring(case, weighted), RIGHT)
