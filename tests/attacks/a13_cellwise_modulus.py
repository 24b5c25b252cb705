"""One stress by a modulus that is constant in each cell, beside a bulk of two tags.

The bulk has 1000 in the left column and 3000 in the right. In the attack the Function has them
exchanged, so that 30 and 10 would be drawn where 10 and 30 are; in the twin it has them right.
"""

from a13_two_columns import GLASS, STEEL, columns, compared, on_floor

import ufl
from dolfinx import fem

from dolfinx_contact import materials


def _drawn(case, left, right):
    body, tags = columns(case.comm, cell="quadrilateral")
    dx = ufl.Measure("dx", body.domain, subdomain_data=tags)
    problem = on_floor(body, STEEL.energy(body.u) * dx(1) + GLASS.energy(body.u) * dx(2))
    young = fem.Function(fem.functionspace(body.domain, ("DG", 0)))
    young.interpolate(lambda x: left + (right - left) * (x[0] > 0.5))
    material = materials.LinearElastic.from_young(young, 0.0)
    compared(case, problem, material.full_stress(body.u), -10.0, -30.0)


def attack(case):
    _drawn(case, 3000.0, 1000.0)
    case.warned("stress.*(forces|bulk)")


def honest(case):
    _drawn(case, 1000.0, 3000.0)
