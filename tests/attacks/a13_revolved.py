"""Stresses of a body of revolution of two materials, core and shell, and of one of them alone.

With nu = 0 a cylinder pressed by 1 % carries E times that along the axis in core and shell, and
nothing around it.
"""

from a13_two_columns import GLASS, STEEL, columns, compared, on_floor, one_is_refused

import ufl

from dolfinx_contact import materials


def attack(case):
    body, tags = columns(case.comm, cell="quadrilateral")
    dx = ufl.Measure("dx", body.domain, subdomain_data=tags)
    core = materials.Axisymmetric(STEEL)
    shell = materials.Axisymmetric(GLASS)
    bulk = core.energy(body.u) * dx(1) + shell.energy(body.u) * dx(2)
    problem = on_floor(body, bulk, axisymmetric=True)
    both = {1: core.full_stress(body.u), 2: shell.full_stress(body.u)}
    compared(case, problem, both, -10.0, -30.0)
    one_is_refused(case, problem, shell.full_stress(body.u))
