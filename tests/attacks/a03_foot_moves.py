"""The lower block is drawn away from below the upper one, by its foot.

Nothing of the slave moves. After two widths the force is zero; also of P2 quadrilaterals and the
integral method, and of tetrahedra.
"""

import numpy as np
from a03_off_the_edge import doubted, pressed
from bodies import two_blocks


def put(case, upper=(2, 1), lower=(3, 1), **more):
    both = two_blocks(case.comm, upper, lower, **more)
    problem = pressed(both, 0.0)
    dim = both.domain.geometry.dim
    both.foot.interpolate(
        lambda x: np.stack([-2.0 + 0 * x[0], *[0.0 * x[0] for _ in range(dim - 1)]])
    )
    result = problem.solve()
    case.equal("force", result.resultants["contact"], np.zeros(dim))
    doubted(case, result)


def attack(case):
    put(case)
    put(case, degree=2)
    put(case, (1, 1, 1), (2, 1, 1), cell="tetrahedron")
