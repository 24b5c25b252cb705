"""A density, P1, that is negative in a corner, with a positive mass in all.

A kinetic energy is never negative, whatever the velocity: here that of the corner alone.
"""

import numpy as np
from flying import flying

from dolfinx import fem

from dolfinx_contact.evolution import NSCD


def attack(case):
    body = flying(case.comm, (0.0, 0.0), (3, 3))
    density = fem.Function(fem.functionspace(body.u.function_space.mesh, ("Lagrange", 1)))
    density.interpolate(lambda x: 4.0 * (x[0] + x[1]) - 1.5)
    body.velocity.interpolate(lambda x: np.stack([np.maximum(0.3 - x[0] - x[1], 0.0), 0 * x[0]]))
    history = NSCD(body.problem, density, dt=0.01, velocity=body.velocity, mass="consistent").run(
        [0.0, 0.02]
    )
    case.true("the energy at the start is not negative", history.energies.at_start >= 0)
    case.true("the energy is not negative", history.energies.kinetic >= 0)
