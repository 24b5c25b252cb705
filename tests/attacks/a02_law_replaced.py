"""Another law is put on a surface between two solves, the most natural study of friction.

The top is dragged so far that the whole bottom slips: Q/P is the coefficient of friction.
"""

from bodies import block, moves, on_floor, ratio

from dolfinx_contact import Coulomb


def _dragged(case):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    moves(body, 0.05, -0.01)
    return on_floor(body, Coulomb(0.1))


def attack(case):
    problem, contact = _dragged(case)
    for friction in (0.1, 0.2, 0.3):
        contact.law = Coulomb(friction)
        case.equal(f"Q/P at {friction}", ratio(problem.solve().tables[contact.name]), friction)


def honest(case):
    problem, contact = _dragged(case)
    for friction in (0.1, 0.3, 0.2):
        contact.law.friction.value = friction
        case.equal(f"Q/P at {friction}", ratio(problem.solve().tables[contact.name]), friction)
