"""A field of dashpots in a UFL form is mirrored between a killed motion and its resumption.

The right answer is the motion of the second script, never killed.
"""

from bodies import block
from recorded import compare, resumed

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import NSCD

TIMES = (0.0, 0.02, 0.04, 0.06)


def make(comm, left, right):
    body = block(comm, (4, 2), cell="quadrilateral")
    dashpot = fem.Function(fem.functionspace(body.domain, ("Lagrange", 1)))
    dashpot.interpolate(lambda x: left + (right - left) * x[0])
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    force = fem.Constant(body.domain, (30.0, -100.0))
    energy = steel.energy(body.u) * ufl.dx - ufl.dot(force, body.u) * ufl.dx
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    velocity = fem.Function(body.V)
    damping = dashpot * ufl.dot(velocity, ufl.TestFunction(body.V)) * ufl.dx
    return NSCD(problem, 1.0, dt=0.02, velocity=velocity, damping=damping)


def attack(case):
    found = resumed(
        case.comm, lambda: make(case.comm, 0.0, 80.0), lambda: make(case.comm, 80.0, 0.0), TIMES
    )
    expected = make(case.comm, 80.0, 0.0).run(TIMES)
    compare(case, found, expected)
    case.equal("damped", found.energies.damping, expected.energies.damping)
