"""A cube is twisted by 45 degrees about its vertical axis on a cube of the same width.

Without transverse contraction and friction the displacement of the top is that of the whole cube.
Of a square turned on another an octagon of 2 (sqrt(2) - 1) = 0.83 is carried, so that the force is
less than the whole. Normals do not turn. The twin twists by 0.2 degrees.
"""

import numpy as np
from a03_off_the_edge import doubted, pressed
from bodies import two_blocks


def put(case, degrees, press):
    both = two_blocks(case.comm, (2, 2, 1), (3, 3, 1), cell="hexahedron")
    problem = pressed(both, 0.0)
    c = np.cos(np.radians(degrees))
    s = np.sin(np.radians(degrees))

    def top(x):
        a = x[0] - 0.5
        b = x[1] - 0.5
        return np.stack([c * a - s * b - a, s * a + c * b - b, -press + 0 * a])

    both.top.interpolate(top)
    result = problem.solve()
    return result, result.resultants["contact"][2] / (press / 1.5)


def attack(case):
    result, share = put(case, 45.0, 0.02)
    case.true(f"less than the whole is carried, not {share}", share < 0.97)
    doubted(case, result)


def honest(case):
    result, share = put(case, 0.2, 0.0002)
    case.equal("the whole is carried", share, 1.0, 1e-3)
    case.true("nothing is said", not case.warnings and not result.doubts)
