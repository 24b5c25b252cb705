"""The point about which a rigid floor tilts is another when a killed history is resumed: a number,
in no form. Its rotation is prescribed.

The right answer is the history of the second script, never killed.
"""

import numpy as np
from bodies import block
from recorded import compare, resumed

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
from dolfinx_contact.evolution import QuasiStatic

TIMES = (0.0, 1.0, 2.0, 3.0)


def make(comm, about):
    body = block(comm, (4, 2), cell="quadrilateral")
    tilt = fem.Constant(body.domain, 0.0)
    floor = RigidBody(
        HalfSpace(point=(0, 0), normal=(0, 1)),
        about=about,
        motion={"rz": tilt},
        held=["x", "y"],
    )
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)

    def load(t):
        tilt.value = 0.005 * t
        body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.01 * t + 0 * x[0]]))

    return QuasiStatic(problem, load)


def attack(case):
    found = resumed(
        case.comm,
        lambda: make(case.comm, (0.0, 0.0)),
        lambda: make(case.comm, (1.0, 0.0)),
        TIMES,
    )
    compare(case, found, make(case.comm, (1.0, 0.0)).run(TIMES))
