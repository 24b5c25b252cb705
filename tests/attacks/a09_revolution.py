"""A body of revolution in free flight: a ring of inner radius 1, outer radius 2 and height 1.

Its kinetic energy is half its whole mass, rho pi (4 - 1), times the velocity's square, and the
velocity force over density times time. The problem weights the energy by 2 pi r.
"""

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials
from dolfinx_contact.evolution import NSCD


def attack(case):
    domain = mesh.create_rectangle(
        case.comm, [(1.0, 0.0), (2.0, 1.0)], (3, 2), mesh.CellType.quadrilateral
    )
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    velocity = fem.Function(V)
    bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
    steel = materials.Axisymmetric(materials.LinearElastic.from_young(1e4, 0.2))
    force = fem.Constant(domain, (0.0, 2.0))
    energy = steel.energy(u) * ufl.dx - ufl.dot(force, u) * ufl.dx
    floor = HalfSpace(point=(0.0, -100.0), normal=(0.0, 1.0))
    contact = ContactSurface(u, bottom, obstacle=floor, law=Frictionless(), axisymmetric=True)
    problem = ContactProblem(energy, u, [contact])
    motion = NSCD(problem, 3.0, dt=0.1, velocity=velocity, mass="consistent")
    history = motion.run([0.0, 1.0])
    speed = 2.0 / 3.0
    case.equal("velocity", velocity.x.array[1::2], speed + 0 * velocity.x.array[1::2], 1e-6)
    case.equal("kinetic energy", history.energies.kinetic, 0.5 * 9.0 * np.pi * speed**2, 1e-6)
