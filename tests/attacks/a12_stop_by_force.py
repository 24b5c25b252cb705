"""A branch is stopped where the contact force, read from the problem, is beyond a number.

With nu = 0 the force is E (0.01 gamma - 0.004), so that gamma is known at the first such point.
"""

import numpy as np
from a12_point_stands import lowered

from dolfinx_contact import Coulomb
from dolfinx_contact.continuation import StepControl, follow


def _stopped(case, most):
    _body, problem, contact, _gamma, system = lowered(case, Coulomb(0.3))

    def stop(step):
        force = float(np.sum(problem.table(contact).rn))
        return f"the force is {force}" if force > most else ""

    control = StepControl(maximum=0.05)
    branch = follow(
        system,
        system.create_vector(),
        0.0,
        gamma_range=(0.0, 1.0),
        stop=stop,
        control=control,
        route="steps",
    )
    gammas = np.array([p.gamma for p in branch.points])
    forces = 1000.0 * np.maximum(0.01 * gammas - 0.004, 0.0)
    case.true("the last is beyond", forces[-1] > most)
    case.true("none before is", np.all(forces[:-1] <= most))
    case.equal("its force", np.sum(problem.table(contact).rn), forces[-1])


def attack(case):
    _stopped(case, 3.0)
    _stopped(case, 0.0)


def honest(case):
    _stopped(case, 3.0)
