"""The step of a motion is set after it was made; in the twin its weight is changed.

A block falls freely: after the time t its mean velocity is -g t, whatever the step.
"""

import numpy as np
from bodies import block, refused

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials
from dolfinx_contact.evolution import NSCD


def falling(case):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    weight = fem.Constant(body.domain, (0.0, -10.0))
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    floor = HalfSpace(point=(0.0, -5.0), normal=(0.0, 1.0))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    bulk = steel.energy(body.u) * ufl.dx - ufl.dot(weight, body.u) * ufl.dx
    problem = ContactProblem(bulk, body.u, [contact])
    density = fem.Constant(body.domain, 1.0)
    return body, weight, density, NSCD(problem, density, dt=0.01, mass="lumped")


def speed(case, body, motion):
    form = fem.form(motion.velocity[1] * ufl.dx)
    return case.comm.allreduce(fem.assemble_scalar(form))


def attack(case):
    body, _weight, _density, motion = falling(case)
    motion.run([0.0, 0.02])
    case.equal("speed", speed(case, body, motion), -0.2)
    for name, value in (("dt", 0.005), ("theta", 1.0), ("damping", (1.0, 0.0)), ("density", 2.0)):
        words = refused(lambda name=name, value=value: setattr(motion, name, value))
        case.true(f"another {name} is refused", words)
    history = motion.run([0.02, 0.04])
    case.equal("steps", np.diff([0.02] + [s.time for s in history.steps]), [0.01] * 2)
    case.equal("speed", speed(case, body, motion), -0.4)


def honest(case):
    body, weight, _density, motion = falling(case)
    motion.run([0.0, 0.02])
    weight.value[1] = -20.0
    motion.run([0.02, 0.04])
    case.equal("speed", speed(case, body, motion), -0.6)
