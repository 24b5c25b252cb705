"""The density, an expression of a vector Constant, gets another value after the motion was made
and before it runs, as in a loop over a parameter.

A free body under a uniform force: its velocity is force times time over density. Honest is the
same loop with a motion made for every density.
"""

from flying import flying

from dolfinx import fem

from dolfinx_contact.evolution import NSCD


def attack(case):
    body = flying(case.comm, (0.0, 2.0))
    parts = fem.Constant(body.u.function_space.mesh, (1.0, 0.0))
    motion = NSCD(
        body.problem, parts[0] + parts[1], dt=0.25, velocity=body.velocity, mass="consistent"
    )
    parts.value[1] = 3.0
    motion.run([0.0, 1.0])
    case.equal("velocity", body.mean(body.velocity), [0.0, 0.5])


def honest(case):
    found = []
    for more in (0.0, 3.0):
        body = flying(case.comm, (0.0, 2.0))
        parts = fem.Constant(body.u.function_space.mesh, (1.0, more))
        motion = NSCD(
            body.problem, parts[0] + parts[1], dt=0.25, velocity=body.velocity, mass="consistent"
        )
        motion.run([0.0, 1.0])
        found.append(body.mean(body.velocity)[1])
    case.equal("velocities", found, [2.0, 0.5])
