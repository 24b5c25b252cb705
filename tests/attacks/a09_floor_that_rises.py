"""A floor rises with a steady speed under a body at rest: its point is an array with a Constant in
it, which ``load(t)`` changes.

The body, without weight, is hit and thrown up: it leaves with the momentum of the contact
impulses, and never lies below the floor. Honest is a point that is one vector Constant.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials
from dolfinx_contact.evolution import NSCD


def rise(case, point, height):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    floor = HalfSpace(point=point(body.domain), normal=(0.0, 1.0))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact])

    def load(t):
        height(0.5 * t)

    lowest = []

    def look(step):
        x = body.V.tabulate_dof_coordinates()[:, 1]
        above = x + body.u.x.array[1::2] - 0.5 * step.time
        lowest.append(np.min(above, initial=1.0))

    motion = NSCD(problem, 1.0, dt=0.01, load=load, mass="redistributed")
    history = motion.run([0.0, 0.05], observer=look)
    worst = min(min(parts) for parts in case.comm.allgather(lowest))
    case.equal("lowest point over the floor", min(worst, 0.0), 0.0, 1e-8)
    push = sum(0.01 * s.result.resultants["contact"][1] for s in history.steps)
    case.true("the floor pushes", push > 0.01)


def attack(case):
    parts = []

    def point(domain):
        parts.append(fem.Constant(domain, 0.0))
        return np.array([0.0, parts[0]])

    def height(value):
        parts[0].value = value

    rise(case, point, height)


def honest(case):
    parts = []

    def point(domain):
        parts.append(fem.Constant(domain, (0.0, 0.0)))
        return parts[0]

    def height(value):
        parts[0].value[1] = value

    rise(case, point, height)
