"""A body of a nanometre, in metres: the displacements that its top is held with, 1e-11, are
mirrored between a killed history and its resumption. They are those of one component.

The right answer is the history of the second script, never killed.
"""

from bodies import block
from recorded import compare, resumed

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import QuasiStatic

SIZE = 1e-9
TIMES = (0.0, 1.0, 2.0, 3.0)


def make(comm, left, right):
    body = block(comm, (4, 2), (SIZE, SIZE), "quadrilateral")
    down = body.V.sub(1)
    part = body.V.sub(1).collapse()[0]
    profile = fem.Function(part)
    profile.interpolate(lambda x: -0.02 * (left * SIZE + (right - left) * x[0]))
    sides = fem.Constant(body.domain, 0.0)
    bcs = [
        fem.dirichletbc(profile, fem.locate_dofs_topological((down, part), 1, body.top), down),
        fem.dirichletbc(
            sides, fem.locate_dofs_topological(body.V.sub(0), 1, body.top), body.V.sub(0)
        ),
    ]
    steel = materials.LinearElastic.from_young(1e9, 0.2)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=bcs)

    def load(t):
        sides.value = 0.006 * SIZE * t

    load(0.0)
    problem.solve()
    return QuasiStatic(problem, load)


def attack(case):
    found = resumed(
        case.comm,
        lambda: make(case.comm, 0.5, 1.0),
        lambda: make(case.comm, 1.0, 0.5),
        TIMES,
    )
    compare(case, found, make(case.comm, 1.0, 0.5).run(TIMES))
