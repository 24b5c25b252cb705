"""Steady sliding in a history, at two speeds and there and back: Q/P is mu(v).

Once everything slips alike each point moves with the top, so that its speed is that of the top.
"""

from a04_speed_solved_statically import OfSpeed, in_numbers
from bodies import block, moves, on_floor, ratio

from dolfinx_contact import Frictionless
from dolfinx_contact.evolution import QuasiStatic


def attack(case):
    law = OfSpeed(0.5, 0.1, 2.0)
    for speed in (1.0, -3.0):
        body = block(case.comm, (2, 1), cell="quadrilateral")
        moves(body, 0.0, -0.01)
        on_floor(body, Frictionless())[0].solve()
        problem, contact = on_floor(body, law)
        evolution = QuasiStatic(problem, lambda t, v=speed, b=body: moves(b, v * t, -0.01))
        history = evolution.run([0.05 * k for k in range(10)], sudden=float("inf"))
        found = ratio(history.steps[-1].result.tables[contact.name])
        case.equal(f"Q/P at {speed}", found, in_numbers(law, abs(speed)) * (1 if speed > 0 else -1))
