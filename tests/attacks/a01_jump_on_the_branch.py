"""Data that jump at gamma = 1 beside a part that is affine: no branch leads over the jump.

The top comes down by 0.01 gamma, and by 0.004 more from gamma = 1 on; or a rigid floor comes up so;
or the load grows so. Points beyond 1 of a branch must be solutions there, R = E times the way, or
the branch ends with its reason. In the twin the data have no jump.
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
from dolfinx_contact.continuation import StepControl, follow


def followed(case, way, number, kind):
    body = block(case.comm, (1, 1))
    gamma = fem.Constant(body.domain, 0.5)
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[1], 1e-6), 1.0, 0.0)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    if kind == "floor":
        floor = RigidBody(floor, about=(0.5, 0.0), held=["x", "rz"], motion={"y": way(gamma)})
    energy = steel.energy(body.u) * ufl.dx
    if kind == "load":
        energy += 1000.0 * way(gamma) * lower * body.u[1] * ufl.ds
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    driven = [(body.moved, ufl.as_vector((0.0, -way(gamma))))] if kind == "top" else []
    system = ParametricContact(problem, gamma, driven=driven)
    system.set_parameter(0.5)
    problem.solve()
    start = system.create_vector()
    problem.write(start)
    control = StepControl(minimum=0.02, corrections=4)
    branch = follow(system, start, 0.5, gamma_range=(0.5, 1.6), control=control)
    case.true(f"the branch gets to the jump, {kind}", branch.points[-1].gamma > 0.9)
    for point in branch.points:
        force = system.result_at(point).resultants["contact"][1]
        case.equal(f"force at {point.gamma:.9f}, {kind}", force, 1000.0 * number(point.gamma))


def attack(case):
    for kind in ("top", "floor", "load"):
        try:
            followed(
                case,
                lambda g: 0.01 * g + ufl.conditional(ufl.ge(g, 1.0), 0.004, 0.0),
                lambda g: 0.01 * g + (0.004 if g >= 1 else 0.0),
                kind,
            )
        except ValueError as error:
            case.true(f"{kind}: the refusal speaks of gamma: {error}", "gamma" in str(error))


def honest(case):
    for kind in ("top", "floor", "load"):
        followed(case, lambda g: 0.01 * g, lambda g: 0.01 * g, kind)
