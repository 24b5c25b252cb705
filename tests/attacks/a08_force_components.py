"""The components of a vector field of forces are exchanged between a killed history and its
resumption: f = t (g(x), g(1 - x)) becomes t (g(1 - x), g(x)), which has the same norms.

The right answer is the history of the second script, never killed. The force is a Function of
three directions in space, on hexahedra.
"""

import numpy as np
from bodies import block
from recorded import compare, resumed

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import QuasiStatic

TIMES = (0.0, 1.0, 2.0, 3.0)


def make(comm, order):
    body = block(comm, (2, 1, 1), (1.0, 0.5, 0.5))
    force = fem.Function(body.V)
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    energy = steel.energy(body.u) * ufl.dx - ufl.dot(force, body.u) * ufl.dx
    floor = HalfSpace(point=(0, 0, 0), normal=(0, 0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)

    def load(t):
        parts = [60.0, 30.0]
        force.interpolate(
            lambda x: -t * np.stack([(parts[k] if k < 2 else 60.0) * (0.2 + x[0]) for k in order])
        )

    return QuasiStatic(problem, load)


def attack(case):
    first = (0, 1, 2)
    second = (1, 0, 2)
    found = resumed(
        case.comm, lambda: make(case.comm, first), lambda: make(case.comm, second), TIMES
    )
    compare(case, found, make(case.comm, second).run(TIMES))
