"""What a branch drives is replaced after the system was made: list, parameter, and array.

With nu = 0 the force is E times the way of the top.
"""

from bodies import block, moves, on_floor, refused

import ufl
from dolfinx import fem

from dolfinx_contact import Frictionless, ParametricContact
from dolfinx_contact.continuation import follow


def attack(case):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    moves(body, 0.0, -0.01)
    problem, contact = on_floor(body, Frictionless())
    gamma = fem.Constant(body.domain, 0.0)
    driven = [(body.moved, ufl.as_vector((0.0, -0.01 - 0.01 * gamma)))]
    system = ParametricContact(problem, gamma, driven=driven)
    problem.solve()
    x = system.create_vector()
    problem.write(x)
    driven[0] = (body.moved, ufl.as_vector((0.0, -0.01 - 0.04 * gamma)))
    branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0))
    force = system.result_at(branch.points[-1]).resultants[contact.name][1]
    case.equal("force by the list that was given", force, 20.0)
    for name, value in (("driven", driven), ("gamma", fem.Constant(body.domain, 1.0))):
        words = refused(lambda name=name, value=value: setattr(system, name, value))
        case.true(f"another {name} is refused", words)
