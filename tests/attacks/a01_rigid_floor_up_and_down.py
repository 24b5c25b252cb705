"""A rigid floor that rises with gamma and sinks again, by its motion; and one under a load.

Against a column that is held on top the force is E times the way 0.01 (1 - |gamma - 1|), or the
load 5 min(gamma, 1); in the twin the motion is 0.01 gamma.
"""

from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Frictionless,
    HalfSpace,
    ParametricContact,
    RigidBody,
    materials,
)
from dolfinx_contact.continuation import StepControl, find_solutions, follow


def forces(case, components):
    body = block(case.comm, (1, 1))
    gamma = fem.Constant(body.domain, 0.5)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    floor = RigidBody(
        HalfSpace(point=(0, 0), normal=(0, 1)),
        about=(0.5, 0.0),
        held=["x", "rz"],
        **components(gamma),
    )
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)
    system = ParametricContact(problem, gamma)
    problem.solve()
    start = system.create_vector()
    problem.write(start)
    found = find_solutions(system, [start], 1.6, lengths=(0.5,), max_iterations=20)
    there = [
        system.result_at(p).resultants["contact"][1] for p in found.points(system, found.found)
    ]
    system.set_parameter(0.5)
    control = StepControl(minimum=1e-6, corrections=4)
    last = follow(system, start, 0.5, gamma_range=(0.5, 1.8), control=control).points[-1]
    case.equal("where the branch ends", last.gamma, 1.8)
    return there, system.result_at(last).resultants["contact"][1]


def attack(case):
    there, end = forces(case, lambda g: {"motion": {"y": 0.01 * (1 - abs(g - 1))}})
    case.equal("found at 1.6, by motion", there, [4.0])
    case.equal("followed to 1.8, by motion", end, 2.0)
    there, end = forces(case, lambda g: {"load": {"y": 5 * ufl.min_value(g, 1.0)}})
    case.equal("found at 1.6, by load", there, [5.0])
    case.equal("followed to 1.8, by load", end, 5.0)


def honest(case):
    there, end = forces(case, lambda g: {"motion": {"y": 0.01 * g}})
    case.equal("found at 1.6, by motion", there, [16.0])
    case.equal("followed to 1.8, by motion", end, 18.0)
