"""Friction of the speed below a compliance of the surface, solved statically, with any algorithm.

Q/P of what slips is the coefficient at rest.
"""

from a04_speed_solved_statically import OfSpeed, OfSpeedOrRest, dragged
from bodies import ratio

from dolfinx_contact import NormalCompliance


def _compared(case, law):
    _body, problem, contact = dragged(case, NormalCompliance(1e5, friction=law))
    case.equal("Q/P", ratio(problem.solve().tables[contact.name]), 0.5)


def attack(case):
    _compared(case, OfSpeed(0.5, 0.1, 0.02))


def honest(case):
    _compared(case, OfSpeedOrRest(0.5, 0.1, 0.02))
