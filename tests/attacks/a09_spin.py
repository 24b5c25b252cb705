"""A free square of four cells spins, slowly, with the default mass.

Its kinetic energy is that of a square: rho omega^2 / 12, and stays.
"""

import numpy as np
from flying import flying

from dolfinx_contact.evolution import NSCD


def attack(case):
    body = flying(case.comm, (0.0, 0.0), young=1e4)
    omega = 0.01
    body.velocity.interpolate(lambda x: omega * np.stack([0.5 - x[1], x[0] - 0.5]))
    history = NSCD(body.problem, 1.0, dt=0.01, velocity=body.velocity).run([0.0, 0.05])
    case.warned("mass")
    expected = omega**2 / 12
    case.equal("kinetic energy at the start", history.energies.at_start, expected, 0.02)
    case.equal("kinetic energy", history.energies.kinetic, expected, 0.02)
