"""Lumped and redistributed masses of a P2 triangle mesh, of which row sums are zero at corners.

A free body under a uniform force falls by f t^2 / 2, and its kinetic energy is the force's work.
"""

from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials
from dolfinx_contact.evolution import NSCD


def attack(case):
    for mass in ("lumped", "redistributed"):
        body = block(case.comm, (2, 2), degree=2)
        force = fem.Constant(body.domain, (0.0, -2.0))
        steel = materials.LinearElastic.from_young(1000.0, 0.2)
        energy = steel.energy(body.u) * ufl.dx - ufl.dot(force, body.u) * ufl.dx
        floor = HalfSpace(point=(0.0, -100.0), normal=(0.0, 1.0))
        contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
        problem = ContactProblem(energy, body.u, [contact])
        history = NSCD(problem, 1.0, dt=0.1, mass=mass).run([0.0, 0.5])
        case.warned("mass")
        fell = fem.assemble_scalar(fem.form(body.u[1] * ufl.dx))
        case.equal(f"fall, {mass}", case.comm.allreduce(fell), -0.25, 0.01)
        case.equal(f"kinetic energy, {mass}", history.energies.kinetic, 0.5, 0.02)
