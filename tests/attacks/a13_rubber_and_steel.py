"""A hyperelastic material beside a linear one, as an energy and as a residual.

Parts that are given as lists of cells are right too, or refused with the way to do it.

With lambda = 0 a neo-Hookean column keeps its width under uniaxial strain: the Cauchy stress at the
stretch s is mu (s^2 - 1)/s, beside E (s - 1).
"""

import numpy as np
from a13_two_columns import STEEL, columns, compared, on_floor, one_is_refused

import ufl

from dolfinx_contact import materials


def attack(case):
    body, tags = columns(case.comm, cell="quadrilateral")
    size = body.domain.topology.index_map(2).size_local
    lists = []
    for tag in (1, 2):
        mine = tags.find(tag)
        lists.append((tag, np.sort(mine[mine < size])))
    by_lists = ufl.Measure("dx", body.domain, subdomain_data=lists)
    dx = ufl.Measure("dx", body.domain, subdomain_data=tags)
    rubber = materials.NeoHookean(0.0, 500.0)
    energy = STEEL.energy(body.u) * dx(1) + rubber.energy(body.u) * dx(2)
    residual = ufl.derivative(energy, body.u, ufl.TestFunction(body.V))
    both = {1: STEEL.full_stress(body.u), 2: rubber.full_stress(body.u)}
    s = 0.99
    for bulk in (energy, residual):
        problem = on_floor(body, bulk)
        compared(case, problem, both, 1000.0 * (s - 1.0), 500.0 * (s**2 - 1.0) / s)
    problem = on_floor(
        body, STEEL.energy(body.u) * by_lists(1) + rubber.energy(body.u) * by_lists(2)
    )
    try:
        compared(case, problem, both, 1000.0 * (s - 1.0), 500.0 * (s**2 - 1.0) / s)
    except ValueError as error:
        case.true("the refusal says how", "subdomain_data=cell_tags" in str(error))
    one_is_refused(case, problem, rubber.full_stress(body.u))
