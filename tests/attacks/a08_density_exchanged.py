"""A heavy and a light half change sides between a killed motion and its resumption.

The right answer is the motion of the second script, never killed.
"""

import numpy as np
from bodies import block
from recorded import compare, resumed

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import NSCD

TIMES = (0.0, 0.02, 0.04, 0.06)


def make(comm, heavy):
    body = block(comm, (4, 2), cell="quadrilateral")
    density = fem.Function(fem.functionspace(body.domain, ("DG", 0)))
    density.interpolate(lambda x: 1.0 + 4.0 * (np.abs(x[0] - heavy) < 0.5))
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    force = fem.Constant(body.domain, (30.0, -100.0))
    energy = steel.energy(body.u) * ufl.dx - ufl.dot(force, body.u) * ufl.dx
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    return NSCD(problem, density, dt=0.02)


def history(case, first, second):
    found = resumed(
        case.comm, lambda: make(case.comm, first), lambda: make(case.comm, second), TIMES
    )
    expected = make(case.comm, second).run(TIMES)
    compare(case, found, expected)
    case.equal("kinetic energy", found.energies.kinetic, expected.energies.kinetic)


def attack(case):
    history(case, 0.0, 1.0)


def honest(case):
    history(case, 0.0, 0.0)
