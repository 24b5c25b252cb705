"""A modulus that varies with the radius, as E / r, and as E r: legal with the weight.

With nu = 0 the force is d times the integral of E(r) 2 pi r: 2 pi E for E / r. Without the
weight the energy of the material E r looks like that of a constant one with r alone. The twin is
E / r and E r with the weight.
"""

import numpy as np
from rings import ring

import ufl
from dolfinx import fem

from dolfinx_contact import materials
from dolfinx_contact.materials import circumference


def graded(case, modulus, weight):
    def material(steel):
        return materials.Axisymmetric(steel)

    def weighted(psi, body):
        young = fem.Function(fem.functionspace(body.domain, ("DG", 0)))
        young.interpolate(lambda x: modulus(x[0]))
        return young * psi * weight(body.domain) * ufl.dx

    return ring(case, weighted, material, cells=(4, 1))


def areas(modulus):
    edges = np.linspace(1.0, 2.0, 5)
    middles = (edges[1:] + edges[:-1]) / 2
    return 10.0 * np.pi * np.sum(np.diff(edges**2) * modulus(middles))


def attack(case):
    found = graded(case, lambda r: r, lambda domain: 1.0)
    case.equal("force", found, areas(lambda r: r))
    case.warned("2 pi|circumference|weight")


def honest(case):
    found = graded(case, lambda r: 1 / r, circumference)
    case.equal("force of E / r", found, areas(lambda r: 1 / r))
    found = graded(case, lambda r: r, circumference)
    case.equal("force of E r", found, areas(lambda r: r))
