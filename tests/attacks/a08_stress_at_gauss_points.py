"""An initial stress in Gauss points changes sign inside every cell, between a killed history and
its resumption: s_xx = 400 (y - y_c), y_c of the middle of the cell, whose mean and root mean square
in every cell stay.

The right answer is the history of the second script, never killed.
"""

import numpy as np
from bodies import block
from recorded import TIMES, WAY, compare, resumed

import basix.ufl
import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import QuasiStatic


def make(comm, sign):
    body = block(comm, (4, 2), cell="quadrilateral")
    points = basix.ufl.quadrature_element("quadrilateral", degree=2)
    stress = fem.Function(fem.functionspace(body.domain, points))
    stress.interpolate(lambda x: sign * 400.0 * (x[1] - 0.25 - 0.5 * (x[1] > 0.5)))
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    dx = ufl.dx(metadata={"quadrature_degree": 2, "quadrature_scheme": "default"})
    energy = steel.energy(body.u) * dx + stress * body.u[0].dx(0) * dx
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)

    def load(t):
        x, y = (np.interp(t, TIMES, WAY[:, k]) for k in range(2))
        body.moved.interpolate(lambda p: np.stack([x + 0 * p[0], y + 0 * p[0]]))

    load(0.0)
    problem.solve()
    return QuasiStatic(problem, load)


def attack(case):
    found = resumed(case.comm, lambda: make(case.comm, 1.0), lambda: make(case.comm, -1.0), TIMES)
    compare(case, found, make(case.comm, -1.0).run(TIMES))
