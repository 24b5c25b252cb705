"""A motion with impacts is resumed with another coefficient of restitution and another length of
step, plain numbers of the motion.

The right answer is the motion of the second script, never killed.
"""

from bodies import block
from recorded import compare, resumed

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import NSCD

TIMES = (0.0, 0.04, 0.08, 0.12)


def make(comm, restitution):
    body = block(comm, (4, 2), cell="quadrilateral")
    force = fem.Constant(body.domain, (30.0, -100.0))
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    energy = steel.energy(body.u) * ufl.dx - ufl.dot(force, body.u) * ufl.dx
    floor = HalfSpace(point=(0, -0.005), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    return NSCD(problem, 1.0, dt=0.02, level="velocity", mass="lumped", restitution=restitution)


def attack(case):
    found = resumed(case.comm, lambda: make(case.comm, 0.9), lambda: make(case.comm, 0.1), TIMES)
    compare(case, found, make(case.comm, 0.1).run(TIMES))
