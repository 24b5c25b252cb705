"""The density, a Constant, is four times as large from half the time on, by ``load(t)``.

A free body under a uniform force: its velocity is the integral of force over density. Honest is a
load that sets the same value at every time.
"""

from flying import flying

from dolfinx import fem

from dolfinx_contact.evolution import NSCD


def speed(case, later):
    body = flying(case.comm, (0.0, 2.0))
    density = fem.Constant(body.u.function_space.mesh, 1.0)

    def load(t):
        density.value = later if t > 0.5 else 1.0

    NSCD(body.problem, density, dt=0.1, load=load, velocity=body.velocity, mass="consistent").run(
        [0.0, 0.5, 1.0]
    )
    case.equal("velocity", body.mean(body.velocity), [0.0, 2.0 * (0.5 + 0.5 / later)])


def attack(case):
    speed(case, 4.0)


def honest(case):
    speed(case, 1.0)
