"""Rayleigh's damping of the mass by a Constant that ``load(t)`` switches on at half the time.

A free body: its velocity stays, then decays by exp(-a t).
"""

import numpy as np
from flying import flying

from dolfinx import fem

from dolfinx_contact.evolution import NSCD


def attack(case):
    body = flying(case.comm, (0.0, 0.0))
    a = fem.Constant(body.u.function_space.mesh, 0.0)
    body.velocity.interpolate(lambda x: np.stack([1.0 + 0 * x[0], 0 * x[0]]))

    def load(t):
        a.value = 2.0 if t > 0.5 else 0.0

    NSCD(
        body.problem,
        1.0,
        dt=0.05,
        load=load,
        velocity=body.velocity,
        damping=(a, 0.0),
        mass="consistent",
    ).run([0.0, 0.5, 1.0])
    case.equal("velocity", body.mean(body.velocity), [np.exp(-1.0), 0.0], 5e-3)
