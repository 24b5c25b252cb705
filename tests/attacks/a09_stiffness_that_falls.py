"""Young's modulus, a Constant, falls to a third by ``load(t)`` in a motion, with Rayleigh's damping
of the stiffness; in the twin without any.

The right answer is a motion in two pieces: a second problem, of the lower stiffness, goes on from
displacement and velocity at the end of the first.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials
from dolfinx_contact.evolution import NSCD

TIMES = (0.0, 0.04, 0.08)


def motion(comm, later, b, start=None, velocity=None, at=0.0):
    body = block(comm, (2, 2), cell="quadrilateral")
    young = fem.Constant(body.domain, 300.0 if at else 900.0)
    force = fem.Constant(body.domain, (20.0, 0.0))
    steel = materials.LinearElastic.from_young(young, 0.2)
    energy = steel.energy(body.u) * ufl.dx - ufl.dot(force, body.u) * ufl.dx
    floor = HalfSpace(point=(0.0, -1.0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    v = fem.Function(body.V)
    if start is not None:
        body.u.x.array[:] = start
        v.x.array[:] = velocity

    def load(t):
        young.value = later if t > TIMES[1] + 1e-9 else (300.0 if at else 900.0)

    made = NSCD(
        problem, 1.0, dt=0.01, load=load, velocity=v, theta=1.0, mass="lumped", damping=(0.0, b)
    )
    return made, body.u, v


def compare(case, b):
    made, u, v = motion(case.comm, 300.0, b)
    made.run(TIMES)
    first, u1, v1 = motion(case.comm, 900.0, b)
    first.run(TIMES[:2])
    second, u2, v2 = motion(case.comm, 300.0, b, u1.x.array, v1.x.array, at=TIMES[1])
    second.run(TIMES[1:])
    case.equal("displacement", *(np.linalg.norm(x.x.array) for x in (u, u2)), 1e-6)
    case.equal("displacements", u.x.array, u2.x.array)
    case.equal("velocities", v.x.array, v2.x.array)


def attack(case):
    compare(case, 0.01)


def honest(case):
    compare(case, 0.0)
