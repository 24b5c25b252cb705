"""A rigid body that goes as prescribed by Constants pushes a spring with a mass, in small steps.

One point that sticks to the pusher goes as the pusher goes: gap zero, and the force is that of the
spring (the point has no mass in contact, by the mass that is redistributed). The pusher leaves at a
known time, and comes back.
"""

import numpy as np
from bodies import free_point, one_point

from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, RigidBody
from dolfinx_contact.evolution import NSCD


def attack(case):
    body, energy = one_point(case.comm, [[2.0, 0.0], [0.0, 3.0]])
    height = fem.Constant(body.domain, 0.0)
    pusher = RigidBody(
        HalfSpace((0, 0), (0, 1)),
        about=(0, 0),
        motion={"y": height},
        held=["x", "rz"],
        name="pusher",
    )
    contact = ContactSurface(body.u, body.bottom, obstacle=pusher, law=Frictionless())
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs[:1])

    def load(t):
        height.value = 0.1 * np.sin(t)

    motion = NSCD(problem, density=1e-9, dt=0.05, load=load)
    history = motion.run([0.0, 1.0, 3.0])
    force = []
    for step in history.steps:
        if step.time > 3.0:
            continue
        table = step.result.tables["contact"]
        k = free_point(table)
        case.equal(f"gap at {step.time}", table.un[k], 0.0, 1e-9)
        force.append(step.result.rigid_bodies["pusher"].displacement[1] - 0.1 * np.sin(step.time))
    case.equal("motion of the pusher", np.abs(force).max(), 0.0, 1e-12)
    case.equal("steps", len(history.steps), 60)
