"""The inner nodes of the mesh lie a fifth of a cell to the other side when a killed history is
resumed; boundary, numbers of cells and all data are the same.

The right answer is the history of the second script, never killed.
"""

import numpy as np
from bodies import block
from recorded import TIMES, WAY, compare, resumed

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import QuasiStatic


def make(comm, aside):
    body = block(comm, (4, 2), cell="quadrilateral")
    x = body.domain.geometry.x
    inner = np.all((x[:, :2] > 1e-9) & (x[:, :2] < 1 - 1e-9), axis=1)
    x[inner, 0] += aside
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)

    def load(t):
        x, y = (np.interp(t, TIMES, WAY[:, k]) for k in range(2))
        body.moved.interpolate(lambda p: np.stack([x + 0 * p[0], y + 0 * p[0]]))

    return QuasiStatic(problem, load)


def attack(case):
    found = resumed(case.comm, lambda: make(case.comm, 0.05), lambda: make(case.comm, -0.05), TIMES)
    compare(case, found, make(case.comm, -0.05).run(TIMES))
