"""Laws that know the length of a step, put on a path by arc length, where time means nothing.

Their statements at rest are known: a viscous bond answers as one without viscosity if the path is
slow; a path that gives anything else must not be given.
"""

from dataclasses import dataclass
from typing import Any

from bodies import springs

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, HalfSpace, ParametricContact
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength
from dolfinx_contact.laws import FrictionLaw


@dataclass(frozen=True)
class OfSpeed(FrictionLaw):
    """Friction 0.5 at rest, which grows with the speed."""

    rest: Any

    def bound(self, a, p):
        speed = ufl.conditional(ufl.gt(a.step, 0.0), (a.slid - a.slid_before) / a.step, 0.0)
        return (self.rest + speed) * p


def attack(case):
    body, energy = springs(case.comm, [[10.0, 0.0], [0.0, 10.0]], cells=(1, 1))
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=OfSpeed(0.5))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    gamma = fem.Constant(body.domain, 0.0)
    driven = [(body.moved, ufl.as_vector((gamma, -0.01)))]
    system = ParametricContact(problem, gamma, driven=driven)
    system.set_parameter(0.0)
    problem.solve()
    path = ArcLength(system).run(gamma_range=(0.0, 0.02), control=StepControl(maximum=0.2))
    shear = path.steps[-1].result.resultants["contact"][0]
    case.equal("shear", shear, -0.05)
