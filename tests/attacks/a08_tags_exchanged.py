"""The tags of two sides with different loads are exchanged between a killed history and its
resumption: form, Constants and number of facets stay.

The right answer is the history of the second script, never killed.
"""

import numpy as np
from bodies import block
from recorded import compare, resumed

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import QuasiStatic

TIMES = (0.0, 1.0, 2.0, 3.0)


def make(comm, left, right):
    body = block(comm, (4, 2), cell="quadrilateral")
    sides = [
        mesh.locate_entities_boundary(body.domain, 1, lambda x, at=at: np.isclose(x[0], at))
        for at in (0.0, 1.0)
    ]
    facets = np.concatenate(sides).astype(np.int32)
    values = np.repeat([left, right], [len(s) for s in sides]).astype(np.int32)
    order = np.argsort(facets)
    tags = mesh.meshtags(body.domain, 1, facets[order], values[order])
    ds = ufl.Measure("ds", body.domain, subdomain_data=tags)
    push = fem.Constant(body.domain, (0.0, 0.0))
    pull = fem.Constant(body.domain, (0.0, 0.0))
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    energy = steel.energy(body.u) * ufl.dx
    energy -= ufl.dot(push, body.u) * ds(1) + ufl.dot(pull, body.u) * ds(2)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)

    def load(t):
        push.value[:] = 5.0 * t, -20.0 * t
        pull.value[:] = -2.0 * t, -5.0 * t

    return QuasiStatic(problem, load)


def attack(case):
    found = resumed(case.comm, lambda: make(case.comm, 1, 2), lambda: make(case.comm, 2, 1), TIMES)
    compare(case, found, make(case.comm, 2, 1).run(TIMES))
