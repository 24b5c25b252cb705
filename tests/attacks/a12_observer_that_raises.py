"""An observer raises on every rank in the middle of a branch; then the same is followed anew.

The second branch has the closed form at every point, and the Functions hold one point of the
branch: force and way of the top fit each other.
"""

import numpy as np
from a12_point_stands import Reader, compared, lowered

from dolfinx_contact import Coulomb
from dolfinx_contact.continuation import Observer, Observers, follow


class _Stopped(Exception):
    pass


class _Raises(Observer):
    def __init__(self):
        self.end_seen = False

    def step(self, step, state):
        if step.index == 2:
            raise _Stopped

    def end(self, ended):
        self.end_seen = True


def attack(case):
    body, problem, contact, gamma, system = lowered(case, Coulomb(0.3))
    reader = Reader(body, problem, contact, gamma)
    try:
        follow(
            system,
            system.create_vector(),
            0.0,
            gamma_range=(0.0, 1.0),
            observer=Observers(reader, _Raises()),
        )
    except _Stopped:
        pass
    else:
        case.true("the exception ends the run", False)
    case.equal("points told of", len(reader.seen), 3)
    compared(case, reader)
    again = Reader(body, problem, contact, gamma)
    follow(system, system.create_vector(), 0.0, gamma_range=(0.0, 1.0), observer=again)
    compared(case, again)
    table = problem.table(contact)
    case.equal("force at the end", np.sum(table.rn), 6.0)
