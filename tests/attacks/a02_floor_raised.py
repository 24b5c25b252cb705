"""A floor is raised by changing the array that it was given, its own numbers, or a Constant.

The arrays that were given are copied, so that the first changes nothing. With nu = 0 the pressure
is E times the strain.
"""

import numpy as np
from bodies import block, moves, on_floor, refused

from dolfinx import fem

from dolfinx_contact import Frictionless, HalfSpace


def attack(case):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    moves(body, 0.0, -0.01)
    at = np.zeros(2)
    floor = HalfSpace(point=at, normal=(0.0, 1.0))
    problem, contact = on_floor(body, Frictionless(), obstacle=floor)
    case.equal("force", problem.solve().resultants[contact.name][1], 10.0)
    at[1] = 0.02
    case.equal("an array changed", problem.solve().resultants[contact.name][1], 10.0)
    words = refused(lambda: setattr(floor, "point", np.array((0.0, 0.02))))
    case.true("another point is refused", "Constant" in words)
    words = refused(lambda: setattr(contact, "obstacle", HalfSpace((0.0, 0.02), (0.0, 1.0))))
    case.true("another obstacle is refused", "obstacle" in words)
    case.equal("as it was", problem.solve().resultants[contact.name][1], 10.0)


def honest(case):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    moves(body, 0.0, -0.01)
    at = fem.Constant(body.domain, (0.0, 0.0))
    floor = HalfSpace(point=at, normal=(0.0, 1.0))
    problem, contact = on_floor(body, Frictionless(), obstacle=floor)
    for height in (0.0, 0.02, -0.005, -0.02, 0.01):
        at.value[1] = height
        force = problem.solve().resultants[contact.name][1]
        case.equal(f"force at {height}", force, max(0.0, 1000.0 * (0.01 + height)))
