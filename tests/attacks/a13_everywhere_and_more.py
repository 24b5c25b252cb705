"""A material everywhere and a second one on top of it in some cells: `dx` and `dx(2)`.

In the right column the stresses are those of both, 10 + 30. Tags given as pairs, dx((1, 2)), say
the same. One material's stress is not that of the bulk.
"""

from a13_two_columns import GLASS, STEEL, columns, compared, on_floor, one_is_refused

import ufl


def attack(case):
    body, tags = columns(case.comm, cell="quadrilateral")
    dx = ufl.Measure("dx", body.domain, subdomain_data=tags)
    steel = STEEL.full_stress(body.u)
    glass = GLASS.full_stress(body.u)
    energies = STEEL.energy(body.u), GLASS.energy(body.u)
    for bulk in (
        energies[0] * dx((1, 2)) + energies[1] * dx(2),
        energies[0] * dx + energies[1] * dx(2),
    ):
        problem = on_floor(body, bulk)
        compared(case, problem, {1: steel, 2: steel + glass}, -10.0, -40.0)
    one_is_refused(case, problem, steel)
