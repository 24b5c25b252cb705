"""Friction that falls with the speed, solved without a history.

At rest the speed is 0 and so Q/P of a body that slips is the static coefficient. The law that
does not say so is refused; in the twin it compares the step with 0.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from bodies import block, moves, on_floor, ratio

import ufl

from dolfinx_contact.laws import FrictionLaw


@dataclass(frozen=True)
class OfSpeed(FrictionLaw):
    """Friction that falls with the speed of the slip, and takes the step for known."""

    static: Any
    kinetic: Any
    scale: Any

    def bound(self, a, p):
        return self.at_speed((a.slid - a.slid_before) / a.step) * p

    def at_speed(self, v):
        """The coefficient."""
        return self.kinetic + (self.static - self.kinetic) * ufl.exp(-v / self.scale)


@dataclass(frozen=True)
class OfSpeedOrRest(OfSpeed):
    """The same, which says that nothing moves where no step is known."""

    def bound(self, a, p):
        moved = a.slid - a.slid_before
        return self.at_speed(ufl.conditional(ufl.gt(a.step, 0.0), moved / a.step, 0.0)) * p


def in_numbers(law, v):
    """The coefficient of a law of numbers."""
    return law.kinetic + (law.static - law.kinetic) * np.exp(-v / law.scale)


def dragged(case, law, **options):
    """A block whose top is dragged so far that its bottom slips; its problem and surface."""
    body = block(case.comm, (2, 1), cell="quadrilateral")
    moves(body, 0.05, -0.01)
    problem, contact = on_floor(body, law, **options)
    return body, problem, contact


def _compared(case, law):
    _body, problem, contact = dragged(case, law)
    case.equal("Q/P", ratio(problem.solve().tables[contact.name]), 0.5)


def attack(case):
    _compared(case, OfSpeed(0.5, 0.1, 0.02))


def honest(case):
    _compared(case, OfSpeedOrRest(0.5, 0.1, 0.02))
