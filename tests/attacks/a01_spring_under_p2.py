"""A spring that begins to act after some way, P2 and integral contact; then the floor.

A column of modulus E is lowered by d on a spring k that it reaches after a way c:
E (d - b) = k (b - c), with b the way of its lower end. The spring is in the energy as
k/2 max(-u_y - c, 0)^2, whose second derivative at u = 0 is zero. The floor
is met by a body that is lowered further than it: the force of both is E (d - g).
"""

from a01_one_sided_spring import C, D, E, K, solved

import ufl


def attack(case):
    kind = {"cells": (2, 1), "cell": "quadrilateral", "degree": 2}
    result = solved(case, lambda w: ufl.max_value(-w - C, 0.0), -0.003, **kind)
    case.equal("force", result.resultants["contact"][1], E * (D - 0.003) - K * (0.003 - C), 1e-6)
