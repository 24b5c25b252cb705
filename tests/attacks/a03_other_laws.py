"""Laws that carry something across a gap, moved off the face below: bonds, bounds, springs.

Bonds that are drawn apart (RCCM), shear at open points (Tresca), pressure by penetration: with
nothing below there is no force, whatever the law.
"""

import numpy as np
from a03_off_the_edge import doubted, pressed
from bodies import two_blocks

from dolfinx_contact import RCCM, NormalCompliance, Tresca


def attack(case):
    for law, press in (
        (NormalCompliance(1.0), 0.02),
        (Tresca(0.01), -0.02),
        (RCCM(1.0, 1.0, 100.0, 0.0, 0.0), -0.02),
    ):
        both = two_blocks(case.comm, (2, 1), (3, 1))
        result = pressed(both, 2.0, press, law=law).solve()
        case.equal(f"force, {type(law).__name__}", result.resultants["contact"], np.zeros(2), 1e-9)
        doubted(case, result)
