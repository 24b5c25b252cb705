"""A wind c (v - w) whose velocity w, a Function, is turned round by ``load(t)``.

Every free body follows it: v' = (c / rho) (w - v), here by implicit Euler's rule (theta = 1) in
numpy. The wind is a load and may change in time.
"""

import numpy as np
from flying import flying

import ufl
from dolfinx import fem

from dolfinx_contact.evolution import NSCD


def attack(case):
    body = flying(case.comm, (0.0, 0.0))
    V = body.u.function_space
    wind = fem.Function(V)
    damping = 2.0 * ufl.dot(body.velocity - wind, ufl.TestFunction(V)) * ufl.dx

    def load(t):
        towards = 1.0 if t < 0.5 + 1e-9 else -3.0
        wind.interpolate(lambda x: np.stack([towards + 0 * x[0], 0 * x[0]]))

    history = NSCD(
        body.problem,
        1.0,
        dt=0.1,
        load=load,
        velocity=body.velocity,
        damping=damping,
        theta=1.0,
        mass="consistent",
    ).run([0.0, 0.5, 1.0])
    end = 0.0
    for towards in [1.0] * 5 + [-3.0] * 5:
        end = (end + 0.2 * towards) / 1.2
    case.equal("velocity", body.mean(body.velocity), [end, 0.0])
    case.equal("kinetic energy", history.energies.kinetic, end**2 / 2)
