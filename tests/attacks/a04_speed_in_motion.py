"""Friction of the speed in a motion with inertia, against the mean speed of each step.

At every point that slips |rt| = mu(v) rn, with v the slip of the step over its length.
"""

import numpy as np
from a04_speed_solved_statically import OfSpeed, in_numbers
from bodies import block, moves, on_floor

from dolfinx_contact import Frictionless
from dolfinx_contact.evolution import NSCD


def attack(case):
    law = OfSpeed(0.5, 0.1, 2.0)
    body = block(case.comm, (2, 1), cell="quadrilateral")
    moves(body, 0.0, -0.01)
    on_floor(body, Frictionless())[0].solve()
    problem, contact = on_floor(body, law)
    motion = NSCD(
        problem,
        1e-3,
        dt=0.02,
        load=lambda t: moves(body, t, -0.01),
        scheme="theta-euler",
        theta=1.0,
    )
    slipped = 0
    for step in motion.run([0.0, 0.2]).steps:
        table = step.result.tables[contact.name]
        slips = (table.letters == "+") | (table.letters == "-")
        slipped += int(np.sum(slips))
        speed = np.abs(table.increment[slips, 0]) / 0.02
        shear = np.abs(table.rt[slips, 0])
        case.equal(f"shear at {step.time}", shear, in_numbers(law, speed) * table.rn[slips])
    case.true("points slipped", slipped > 10)
