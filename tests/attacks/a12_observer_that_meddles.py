"""An observer that solves, moves the body and changes statuses at every point.

What it does is lost at the next point, so that the branch, and what a second observer reads
before it, are those of the closed form.
"""

import numpy as np
from a12_point_stands import Reader, compared, lowered

from dolfinx_contact import Coulomb
from dolfinx_contact.continuation import Observer, Observers, follow


class Meddler(Observer):
    """Leaves another state than it found."""

    def __init__(self, body, problem, contact):
        self.body = body
        self.problem = problem
        self.contact = contact

    def step(self, step, state):
        if step.index == 2:
            self.problem.solve()
        self.body.u.x.array[:] = 0.5
        self.body.moved.x.array[:] = -0.3
        self.contact.multiplier.x.array[:] = 7.0


def attack(case):
    for route in ("pivoting", "steps"):
        body, problem, contact, gamma, system = lowered(case, Coulomb(0.3))
        reader = Reader(body, problem, contact, gamma)
        branch = follow(
            system,
            system.create_vector(),
            0.0,
            gamma_range=(0.0, 1.0),
            observer=Observers(reader, Meddler(body, problem, contact)),
            route=route,
        )
        compared(case, reader)
        forces = [np.sum(system.result_at(p).tables[contact.name].rn) for p in branch.points]
        case.equal("forces afterwards", forces, reader.column("force"))
