"""Laws that say by other words than > 0 what holds without a step; each is right or refused.

Where no step is known nothing moves: Q/P is the static coefficient.
"""

from dataclasses import dataclass

from a04_speed_solved_statically import OfSpeed, dragged
from bodies import ratio

import ufl


@dataclass(frozen=True)
class Below(OfSpeed):
    """Compares with < 0, in the branch that is not taken divides."""

    def bound(self, a, p):
        moved = a.slid - a.slid_before
        return self.at_speed(ufl.conditional(ufl.lt(a.step, 0.0), 0.0, moved / a.step)) * p


@dataclass(frozen=True)
class AboveMinusTwo(OfSpeed):
    """Compares with a number below 0, which does not tell a law at rest from a history."""

    def bound(self, a, p):
        moved = a.slid - a.slid_before
        v = ufl.conditional(ufl.gt(a.step, -2.0), abs(moved / a.step), 0.0)
        return self.at_speed(v) * p


@dataclass(frozen=True)
class Scaled(OfSpeed):
    """Compares twice the step with a field of the law."""

    def bound(self, a, p):
        moved = a.slid - a.slid_before
        v = ufl.conditional(ufl.gt(2.0 * a.step + self.scale, 1.0), moved / a.step, moved)
        return self.at_speed(v) * p


def attack(case):
    for law in (Below, AboveMinusTwo, Scaled):
        try:
            _body, problem, contact = dragged(case, law(0.5, 0.1, 0.02))
            found = ratio(problem.solve().tables[contact.name])
        except ValueError as error:
            case.true("the refusal names the step", "step" in str(error))
        else:
            case.equal(f"Q/P of {law.__name__}", found, 0.5)
