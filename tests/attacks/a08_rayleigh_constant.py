"""The factor of Rayleigh's damping, a Constant, is another when a killed motion is resumed; honest
is the same value.

The right answer is the motion of the second script, never killed.
"""

from bodies import block
from recorded import compare, resumed

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import NSCD

TIMES = (0.0, 0.02, 0.04, 0.06)


def make(comm, factor):
    body = block(comm, (2, 2), cell="quadrilateral")
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    force = fem.Constant(body.domain, (30.0, -100.0))
    energy = steel.energy(body.u) * ufl.dx - ufl.dot(force, body.u) * ufl.dx
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    return NSCD(problem, 1.0, dt=0.02, damping=(fem.Constant(body.domain, factor), 0.0))


def history(case, first, second):
    found = resumed(
        case.comm, lambda: make(case.comm, first), lambda: make(case.comm, second), TIMES
    )
    expected = make(case.comm, second).run(TIMES)
    compare(case, found, expected)
    case.equal("damped", found.energies.damping, expected.energies.damping)


def attack(case):
    history(case, 5.0, 50.0)


def honest(case):
    history(case, 5.0, 5.0)
