"""Laws in which the static step loses its sign: |step|, its square, a root, a maximum.

With |step| = 1 the whole slip would pass for a speed. At rest Q/P is the static coefficient.
"""

from dataclasses import dataclass

from a04_speed_solved_statically import OfSpeed, dragged
from bodies import ratio

import ufl


@dataclass(frozen=True)
class Squared(OfSpeed):
    """Takes the root of a square."""

    def bound(self, a, p):
        return self.at_speed((a.slid - a.slid_before) / ufl.sqrt(a.step**2)) * p


@dataclass(frozen=True)
class AtLeast(OfSpeed):
    """Cuts small steps off."""

    def bound(self, a, p):
        return self.at_speed((a.slid - a.slid_before) / ufl.max_value(a.step, 0.01)) * p


@dataclass(frozen=True)
class ByJumps(OfSpeed):
    """Takes the speed from the jump and the one before."""

    def bound(self, a, p):
        moved = a.jump - a.before
        slip = moved - ufl.dot(moved, a.n) * a.n
        return self.at_speed(ufl.sqrt(ufl.dot(slip, slip) + 1e-30) / abs(a.step)) * p


def attack(case):
    for law in (Squared, AtLeast, ByJumps):
        try:
            _body, problem, contact = dragged(case, law(0.5, 0.1, 0.02))
            found = ratio(problem.solve().tables[contact.name])
        except ValueError as error:
            case.true("the refusal names the step", "step" in str(error))
        else:
            case.equal(f"Q/P of {law.__name__}", found, 0.5)
