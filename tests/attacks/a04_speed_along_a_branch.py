"""Friction of the speed along a branch, and in a search for all solutions.

A branch knows no time: Q/P of its end, where the top has been dragged far, is that at rest.
"""

from a04_speed_solved_statically import OfSpeed, OfSpeedOrRest
from bodies import block, moves, on_floor, ratio, refused

import ufl
from dolfinx import fem

from dolfinx_contact import ParametricContact
from dolfinx_contact.continuation import find_solutions, follow


def _compared(case, law):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    moves(body, 0.05, -0.01)
    at_rest, _ = on_floor(body, OfSpeedOrRest(0.5, 0.1, 0.02))
    at_rest.solve()
    problem, contact = on_floor(body, law)
    problem.restore(at_rest.snapshot())
    gamma = fem.Constant(body.domain, 1.0)
    way = ufl.as_vector((0.05 * gamma, -0.01))
    system = ParametricContact(problem, gamma, driven=[(body.moved, way)])
    x = system.create_vector()
    problem.write(x)
    branch = follow(system, x, 1.0, gamma_range=(0.9, 1.0), direction="decreasing", max_steps=5)
    for point in branch.points:
        case.equal("Q/P", ratio(system.result_at(point).tables[contact.name]), 0.5)


def attack(case):
    law = OfSpeed(0.5, 0.1, 0.02)
    words = refused(lambda: _compared(case, law))
    case.true("a branch is refused, and how to do it said", "step" in words)
    body = block(case.comm, (2, 1), cell="quadrilateral")
    moves(body, 0.05, -0.01)
    problem, contact = on_floor(body, law)
    system = ParametricContact(problem, fem.Constant(body.domain, 1.0))
    found = find_solutions(system, [system.create_vector()], 1.0, proof_seconds=1.0)
    for point in found.points(system):
        case.equal("Q/P found", ratio(system.result_at(point).tables[contact.name]), 0.5)


def honest(case):
    _compared(case, OfSpeedOrRest(0.5, 0.1, 0.02))
