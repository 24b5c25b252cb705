"""The lower face falls off beyond a kink, and a block is moved to where it is far below.

The block is pressed by 0.02, the face is 0.15 below it there at least: the force is zero. Where the
block comes from both faces are planes on each other.
"""

import numpy as np
from a03_off_the_edge import doubted, pressed
from bodies import two_blocks


def attack(case):
    both = two_blocks(case.comm, (2, 1), (12, 1), wide=(0.0, 3.0))
    x = both.domain.geometry.x
    on_top = (np.abs(x[:, 1]) < 1e-12) & (x[:, 0] > 1.0)
    x[on_top, 1] -= 0.3 * (x[on_top, 0] - 1.0)
    result = pressed(both, 1.5).solve()
    case.equal("force", result.resultants["contact"], [0.0, 0.0])
    doubted(case, result)
