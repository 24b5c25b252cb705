"""Friction of the distance slipped: statically of the whole slip, in a history of all the way.

Q is the sum over points of mu(slip) times the normal force; there and back the way is summed up
from the increments of the tables.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from bodies import block, moves, on_floor

import ufl

from dolfinx_contact import Frictionless
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.laws import FrictionLaw


@dataclass(frozen=True)
class Worn(FrictionLaw):
    """Friction that falls with the distance slipped."""

    static: Any
    kinetic: Any
    distance: Any

    def bound(self, a, p):
        fade = ufl.exp(-a.slid / self.distance)
        return (self.kinetic + (self.static - self.kinetic) * fade) * p


def _mu(way):
    return 0.1 + 0.4 * np.exp(-way / 0.1)


def attack(case):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    moves(body, 0.06, -0.01)
    problem, contact = on_floor(body, Worn(0.5, 0.1, 0.1))
    table = problem.solve().tables[contact.name]
    slip = table.ut[:, 0]
    case.true("it slips", np.all(table.letters == "+"))
    case.equal("Q at rest", table.rt[:, 0], -_mu(slip) * table.rn)

    moves(body, 0.0, -0.01)
    body.u.x.array[:] = 0.0
    on_floor(body, Frictionless())[0].solve()
    problem, contact = on_floor(body, Worn(0.5, 0.1, 0.1))
    evolution = QuasiStatic(problem, lambda t: moves(body, min(t, 0.2 - t), -0.01))
    way = 0.0
    for step in evolution.run(np.linspace(0.0, 0.2, 9), sudden=float("inf")).steps:
        table = step.result.tables[contact.name]
        way = way + np.abs(table.increment[:, 0])
        if set(table.status) <= set("+-"):
            force = np.where(table.letters == "+", -1.0, 1.0) * _mu(way) * table.rn
            case.equal(f"Q at {step.time}", table.rt[:, 0], force)
    case.true("it slips back", set(table.status) == {"-"})
