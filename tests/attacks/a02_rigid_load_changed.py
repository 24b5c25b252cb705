"""The load of a rigid plate is changed in the dictionary that it was given, or in the plate.

The plate presses a block that stands on what holds it: the contact force is the load.
"""

import numpy as np
from bodies import block, refused

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Frictionless,
    HalfSpace,
    RigidBody,
    materials,
)


def _pressed(body, load):
    plate = RigidBody(
        HalfSpace(point=(0.5, 0.0), normal=(0.0, 1.0)),
        about=(0.5, 0.0),
        load=load,
        held=["x", "rz"],
        name="plate",
    )
    contact = ContactSurface(body.u, body.bottom, obstacle=plate, law=Frictionless())
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)
    return plate, problem


def attack(case):
    given = {"y": 5.0}
    plate, problem = _pressed(block(case.comm, (2, 1), cell="quadrilateral"), given)
    case.equal("force", problem.solve().resultants["contact"][1], 5.0)
    given["y"] = 7.0
    case.equal("what was given", problem.solve().resultants["contact"][1], 5.0)
    words = refused(lambda: setattr(plate, "load", {"y": 10.0}))
    case.true("another load is refused", "Constant" in words)


def honest(case):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    load = fem.Constant(body.domain, 5.0)
    _plate, problem = _pressed(body, {"y": 2.0 * load})
    for force in (5.0, 1.0, 8.0):
        load.value = force
        result = problem.solve()
        moved = result.rigid_bodies["plate"].displacement
        case.equal(f"force under {force}", result.resultants["contact"][1], 2 * force)
        case.equal("way", np.asarray(moved)[1], 2 * force / 1000.0)
