"""One material whose modulus jumps with the place: by a condition, or a Function.

The columns carry 10 and 30, in every point of every cell, those at the interface too. In the twin
the modulus is a Function that is constant in each cell.
"""

from a13_two_columns import columns, compared, on_floor

import ufl
from dolfinx import fem

from dolfinx_contact import materials


def attack(case):
    body, _tags = columns(case.comm, cell="quadrilateral")
    x = ufl.SpatialCoordinate(body.domain)
    young = ufl.conditional(ufl.lt(x[0], 0.5), 1000.0, 3000.0)
    material = materials.LinearElastic.from_young(young, 0.0)
    problem = on_floor(body, material.energy(body.u) * ufl.dx)
    compared(case, problem, material.full_stress(body.u), -10.0, -30.0)
    case.warned("stress|jump|vert")


def honest(case):
    body, tags = columns(case.comm, cell="quadrilateral")
    young = fem.Function(fem.functionspace(body.domain, ("DG", 0)))
    young.interpolate(lambda x: 1000.0 + 2000.0 * (x[0] > 0.5))
    material = materials.LinearElastic.from_young(young, 0.0)
    dx = ufl.Measure("dx", body.domain, subdomain_data=tags)
    for bulk in (
        material.energy(body.u) * ufl.dx,
        material.energy(body.u) * dx(1) + material.energy(body.u) * dx(2),
    ):
        problem = on_floor(body, bulk)
        compared(case, problem, material.full_stress(body.u), -10.0, -30.0)
