"""Friction of the speed, solved statically by other algorithms, in 3D: Uzawa's and penalisation.

Q/P of what slips is the coefficient at rest.
"""

from a04_speed_solved_statically import OfSpeed
from bodies import block, moves, on_floor, ratio

from dolfinx_contact import algorithms


def attack(case):
    body = block(case.comm, (1, 1, 1), (1.0, 1.0, 1.0))
    moves(body, 0.05, 0.0, -0.01)
    problem, contact = on_floor(body, OfSpeed(0.5, 0.1, 0.02))
    for algorithm in (algorithms.Uzawa(), algorithms.Penalty()):
        try:
            found = ratio(problem.solve(algorithm=algorithm).tables[contact.name])
        except ValueError as error:
            case.true("the refusal names the step", "step" in str(error))
        else:
            case.equal("Q/P", found, 0.5, 1e-3)
