"""A bar of one cell between a pusher and a held top, in a motion of many steps: against a statics.

With hardly any mass a motion is a sequence of equilibria: at every time the force on a rigid pusher
is E (nu = 0) times its way, as long as it presses, and zero after.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    RigidBody,
    materials,
)
from dolfinx_contact.evolution import NSCD


def attack(case):
    body = block(case.comm, (1, 1), cell="quadrilateral")
    steel = materials.LinearElastic.from_young(100.0, 0.0)
    height = fem.Constant(body.domain, 0.0)
    pusher = RigidBody(
        HalfSpace((0, 0), (0, 1)), about=(0.5, 0.0), motion={"y": height}, held=["x", "rz"]
    )
    contact = ContactSurface(body.u, body.bottom, obstacle=pusher, law=Coulomb(0.3))
    energy = steel.energy(body.u) * ufl.dx
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)

    def load(t):
        height.value = 0.05 * np.sin(3 * t)

    motion = NSCD(problem, density=1e-8, dt=0.02, load=load, scheme="theta-euler", theta=1.0)
    history = motion.run([0.0, 0.6])
    for step in history.steps[::5]:
        force = step.result.resultants["contact"]
        case.equal(f"force at {step.time}", force, [0.0, 5.0 * np.sin(3 * step.time)], 1e-3)
    case.equal("steps", len(history.steps), 30)
