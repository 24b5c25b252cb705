"""The script that resumes a killed motion sets neither the velocity nor the displacement of the
start: they are in the record. The answer is that of the motion never killed.
"""

import numpy as np
from bodies import block
from recorded import compare, resumed

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import NSCD

TIMES = (0.0, 0.02, 0.04, 0.06)


def make(comm, thrown):
    body = block(comm, (4, 2), cell="quadrilateral")
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    force = fem.Constant(body.domain, (0.0, 0.0))
    energy = steel.energy(body.u) * ufl.dx - ufl.dot(force, body.u) * ufl.dx
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(energy, body.u, [contact])
    velocity = fem.Function(body.V)
    if thrown:
        velocity.interpolate(lambda x: np.stack([0.3 + 0 * x[0], -1.0 + 0 * x[0]]))
        body.u.interpolate(lambda x: np.stack([0 * x[0], 0.01 + 0 * x[0]]))
    return NSCD(problem, 1.0, dt=0.02, velocity=velocity, mass="consistent")


def attack(case):
    found = resumed(case.comm, lambda: make(case.comm, True), lambda: make(case.comm, False), TIMES)
    expected = make(case.comm, True).run(TIMES)
    compare(case, found, expected)
    case.equal("kinetic energy", found.energies.kinetic, expected.energies.kinetic)
