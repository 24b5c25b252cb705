"""All solutions at gamma = 2 under a load that jumps from 1 to 3 at gamma = 1.

The forces are E d plus the load, and where ``complete`` is claimed there is one. The load is in
a vector Constant, which changes after construction, times the step.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Frictionless,
    HalfSpace,
    ParametricContact,
    materials,
)
from dolfinx_contact.continuation import explore, find_solutions


def attack(case):
    body = block(case.comm, (2, 1))
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.01 + 0 * x[0]]))
    gamma = fem.Constant(body.domain, 0.0)
    force = fem.Constant(body.domain, (0.0, 7.0))
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[1], 1e-6), 1.0, 0.0)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    step = ufl.conditional(ufl.lt(gamma, 1.0), 1.0, 3.0)
    load = step * ufl.dot(force, body.u) * lower * ufl.ds
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(steel.energy(body.u) * ufl.dx + load, body.u, [contact], bcs=body.bcs)
    system = ParametricContact(problem, gamma)
    force.value[1] = 1.0
    problem.solve()
    start = system.create_vector()
    problem.write(start)
    for at, expected in ((0.5, 11.0), (2.0, 13.0)):
        found = find_solutions(system, [start], at, lengths=(0.5,), max_iterations=20)
        forces = [
            system.result_at(p).resultants["contact"][1] for p in found.points(system, found.found)
        ]
        case.equal(f"forces at {at}", forces, [expected])
    system.set_parameter(0.0)
    diagram = explore(system, [(start, 0.0)], gamma_range=(0.0, 2.0))
    ends = [b.points[-1] for b in diagram.branches if b.points[-1].gamma > 1.99]
    forces = [system.result_at(p).resultants["contact"][1] for p in ends]
    case.unpromised("the diagram is not complete", not diagram.complete)
    case.equal("explored to 2", forces, [13.0])
