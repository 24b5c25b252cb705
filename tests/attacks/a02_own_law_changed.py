"""A law of one's own that is no frozen dataclass gets another coefficient after it was compiled.

Q/P of a dragged body is the coefficient. The law in the surface is asked, and the one given.
"""

from dataclasses import dataclass
from typing import Any

from bodies import block, moves, on_floor, ratio, refused

from dolfinx_contact.laws import FrictionLaw


@dataclass(frozen=True)
class Graded(FrictionLaw):
    """Friction of two factors."""

    factor: Any
    other: Any

    def bound(self, a, p):
        return self.factor * self.other * p


def attack(case):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    moves(body, 0.05, -0.01)
    given = Graded(0.2, 1.0)
    problem, contact = on_floor(body, given)
    case.equal("Q/P", ratio(problem.solve().tables[contact.name]), 0.2)
    contact.law.other.value = 1.5
    case.equal("Q/P", ratio(problem.solve().tables[contact.name]), 0.3)
    words = refused(lambda: setattr(contact.law, "factor", 0.4))
    case.true("another factor is refused", "value" in words)
    words = refused(lambda: setattr(given, "factor", 0.4))
    case.true("one of the law that was given too", words)
    contact.law.factor.value = 0.1
    case.equal("Q/P", ratio(problem.solve().tables[contact.name]), 0.15)
