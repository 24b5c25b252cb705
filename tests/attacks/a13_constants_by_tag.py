"""Two materials that differ in their Constants alone, over two tags; in the twin, in nothing.

The stress by one of them is wrong in the other column once the Constants differ. In the twin one
material stands over both tags, and a weight over one of them, which is no stress.
"""

from a13_two_columns import STEEL, columns, compared, on_floor, one_is_refused

import ufl
from dolfinx import fem

from dolfinx_contact import materials


def attack(case):
    body, tags = columns(case.comm, cell="quadrilateral")
    dx = ufl.Measure("dx", body.domain, subdomain_data=tags)
    moduli = [fem.Constant(body.domain, 1000.0) for _ in range(2)]
    left, right = (materials.LinearElastic.from_young(m, 0.0) for m in moduli)
    problem = on_floor(body, left.energy(body.u) * dx(1) + right.energy(body.u) * dx(2))
    moduli[1].value = 3000.0
    problem.solve()
    both = {1: left.full_stress(body.u), 2: right.full_stress(body.u)}
    compared(case, problem, both, -10.0, -30.0)
    one_is_refused(case, problem, left.full_stress(body.u))


def honest(case):
    body, tags = columns(case.comm, cell="quadrilateral")
    dx = ufl.Measure("dx", body.domain, subdomain_data=tags)
    weight = fem.Constant(body.domain, (0.0, 0.0))
    bulk = STEEL.energy(body.u) * (dx(1) + dx(2)) - ufl.dot(weight, body.u) * dx(2)
    compared(case, on_floor(body, bulk), STEEL.full_stress(body.u), -10.0, -10.0)
