"""An interface whose shear grows with the speed, statically and in a history.

Phi = mu p v + c v^2/2: at rest Q/P = mu, in steady sliding Q = mu P + c v A.
"""

from dataclasses import dataclass
from typing import Any

from bodies import block, moves, on_floor, ratio

from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.laws import Interface


@dataclass(frozen=True)
class Drag(Interface):
    """Coulomb's friction and a viscous film."""

    friction: Any
    film: Any
    needs_time = ("film",)

    def energy(self, state):
        return 0.0 * state.opening**2

    def dissipation(self, rates, state):
        return self.friction * state.pressure * rates.slip + self.film / 2 * rates.slip**2


def attack(case):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    moves(body, 0.05, -0.01)
    problem, contact = on_floor(body, Drag(0.2, 3.0))
    case.equal("Q/P at rest", ratio(problem.solve().tables[contact.name]), 0.2)
    evolution = QuasiStatic(problem, lambda t: moves(body, 0.05 + t, -0.01))
    last = evolution.run([0.05 * k for k in range(12)], sudden=float("inf")).steps[-1]
    case.equal("Q/P", ratio(last.result.tables[contact.name]), 0.2 + 3.0 / 10.0)
