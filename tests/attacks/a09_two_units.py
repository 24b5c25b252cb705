"""A block that meets a floor, with damping and friction, in metres and kilograms and in nanometres
and nanograms (seconds stay): all lengths are 1e9 times as large, masses 1e12.

Displacements scale with the length, contact forces with mass times length.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import NSCD


def meet(comm, length, mass):
    body = block(comm, (2, 2), (length, length), "quadrilateral")
    # Of unit thickness: density is mass / length^2, modulus mass, force mass / length.
    steel = materials.LinearElastic.from_young(1000.0 * mass, 0.2)
    force = fem.Constant(body.domain, (0.0, -10.0 * mass / length))
    energy = steel.energy(body.u) * ufl.dx - ufl.dot(force, body.u) * ufl.dx
    floor = HalfSpace(point=(0.0, -0.002 * length), normal=(0.0, 1.0))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(energy, body.u, [contact])
    velocity = fem.Function(body.V)
    velocity.interpolate(lambda x: length * np.stack([0.1 + 0 * x[0], -0.3 + 0 * x[0]]))
    motion = NSCD(problem, mass / length**2, dt=0.005, velocity=velocity, damping=(1.0, 1e-4))
    last = motion.run([0.0, 0.04]).steps[-1]
    table = last.result.tables["contact"]
    forces = np.column_stack([table.rn, table.rt]) / mass / length
    return forces, body.u.x.array / length, last.energies.kinetic / mass / length**2


def attack(case):
    expected = meet(case.comm, 1.0, 1.0)
    found = meet(case.comm, 1e9, 1e12)
    for what, a, b in zip(
        ("forces", "displacements", "kinetic energy"), found, expected, strict=True
    ):
        case.equal(what, a, b, 1e-6)
    case.true("they touch", np.max(expected[0]) > 0)
