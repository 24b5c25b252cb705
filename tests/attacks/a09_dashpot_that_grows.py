"""A coefficient of damping, a vector Constant, is changed in one component by ``load(t)``.

A free body in a fluid: every component of its velocity decays by the integral of its coefficient
over the density. Honest are coefficients that stay.
"""

import numpy as np
from flying import flying

import ufl
from dolfinx import fem

from dolfinx_contact.evolution import NSCD


def decay(case, later):
    body = flying(case.comm, (0.0, 0.0))
    V = body.u.function_space
    c = fem.Constant(V.mesh, (1.0, 2.0))
    body.velocity.interpolate(lambda x: np.stack([1.0 + 0 * x[0], 2.0 + 0 * x[0]]))
    w = ufl.TestFunction(V)
    damping = sum(c[k] * body.velocity[k] * w[k] for k in range(2)) * ufl.dx

    def load(t):
        c.value[1] = later if t > 0.5 else 2.0

    NSCD(
        body.problem,
        1.0,
        dt=0.05,
        load=load,
        velocity=body.velocity,
        damping=damping,
        mass="consistent",
    ).run([0.0, 0.5, 1.0])
    expected = [np.exp(-1.0), 2 * np.exp(-1.0 - 0.5 * later)]
    case.equal("velocity", body.mean(body.velocity), expected, 5e-3)


def attack(case):
    decay(case, 6.0)


def honest(case):
    decay(case, 2.0)
