"""A free body of two triangles falls under a uniform force, with the default mass.

It must fall by f t^2 / 2 without turning. Honest is the same body with the consistent mass.
"""

import numpy as np
from flying import flying

from dolfinx_contact.evolution import NSCD


def fall(case, mass):
    body = flying(case.comm, (0.0, -2.0), (1, 1), "triangle", young=1e5)
    NSCD(body.problem, 1.0, dt=0.1, velocity=body.velocity, mass=mass).run([0.0, 1.0])
    case.warned("mass|turn")
    case.equal("fall", body.mean(body.u), [0.0, -1.0], 0.01)
    x = body.u.function_space.tabulate_dof_coordinates()
    u = body.u.x.array.reshape(-1, 2)
    sides = [
        np.concatenate(case.comm.allgather(u[np.isclose(x[:, 0], at), 1])) for at in (0.0, 1.0)
    ]
    case.equal("turn", np.mean(sides[1]) - np.mean(sides[0]), 0.0, 0.01)


def attack(case):
    fall(case, "redistributed")


def honest(case):
    fall(case, "consistent")
