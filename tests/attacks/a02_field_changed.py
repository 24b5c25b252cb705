"""Fields of friction change by their values between solves: integral contact of degree 2, units.

The whole Q is the sum of coefficient times normal force; the body has sides of 1e-6.
"""

import numpy as np
from bodies import block, moves, on_floor

from dolfinx import fem

from dolfinx_contact import Coulomb


def attack(case):
    body = block(case.comm, (2, 1), (1e-6, 1e-6), cell="quadrilateral", degree=2)
    moves(body, 1e-7, -1e-8)
    Q = fem.functionspace(body.domain, ("Lagrange", 1))
    field = fem.Function(Q)
    share = fem.Constant(body.domain, 1.0)
    problem, contact = on_floor(body, Coulomb(field * share), young=2e11)
    for a, b, c in ((0.1, 0.0, 1.0), (0.1, 0.3, 1.0), (0.2, -0.1, 0.5)):
        field.interpolate(lambda x, a=a, b=b: a + b * x[0] * 1e6)
        share.value = c
        table = problem.solve().tables[contact.name]
        friction = c * (a + b * table.x[:, 0] * 1e6)
        case.equal("Q", np.sum(table.rt[:, 0]), -np.sum(friction * table.rn))
        case.true("all of it slips", np.all(table.letters == "+"))
