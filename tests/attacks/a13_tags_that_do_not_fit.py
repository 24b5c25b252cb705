"""Stresses by tags of which one is missing, is none of the bulk, or is no tag.

Each is refused, or right: 10 and 30 in the two columns.
"""

from a13_two_columns import GLASS, STEEL, columns, compared, on_floor

import ufl


def attack(case):
    body, tags = columns(case.comm, cell="quadrilateral")
    dx = ufl.Measure("dx", body.domain, subdomain_data=tags)
    problem = on_floor(body, STEEL.energy(body.u) * dx(1) + GLASS.energy(body.u) * dx(2))
    steel = STEEL.full_stress(body.u)
    glass = GLASS.full_stress(body.u)
    tried = (
        {1: steel},
        {2: glass},
        {1: steel, 2: glass, 7: glass},
        {2: steel, 3: glass},
        {"1": steel, "2": glass},
        {1.0: steel, 2.5: glass},
        {},
        glass,
        steel + glass,
    )
    for stress in tried:
        try:
            compared(case, problem, stress, -10.0, -30.0)
        except ValueError as error:
            case.true("the refusal speaks of tags", "tag" in str(error))
