"""Both bodies are carried a hundred widths away together, and pressed by what they were before.

Nothing slides, nothing turns: the force is that without the way, and nothing is to be said. The
motion of both is affine as well where they are sheared together along the interface.
"""

import numpy as np
from a03_off_the_edge import pressed
from bodies import two_blocks

from dolfinx_contact import Coulomb


def attack(case):
    for way in ((100.0, -70.0), (0.0, 1e4)):
        both = two_blocks(case.comm)
        problem = pressed(both, 0.0, 0.0, law=Coulomb(0.5))
        for function, down in ((both.top, 0.02), (both.foot, 0.0)):
            function.interpolate(
                lambda x, d=down, w=way: np.stack([w[0] + 0 * x[0], w[1] - d + 0 * x[0]])
            )
        result = problem.solve()
        case.equal("force", result.resultants["contact"][1], 0.02 / 1.5, 1e-6)
        case.true("nothing is said", not case.warnings and not result.doubts)
