"""One row of which friction, a field, holds one half and lets the other go, mirrored and not.

Mirrored data have mirrored answers, and a node without friction has no shear; by every algorithm
the same.
"""

from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials


def attack(case):
    tables = []
    for mirror in (False, True):
        body = block(case.comm, (4, 1), (1.0, 0.25), "quadrilateral")
        Q = fem.functionspace(body.domain, ("Lagrange", 1))
        friction = fem.Function(Q)
        left = (lambda x: 20.0 * (x[0] > 0.4)) if mirror else (lambda x: 20.0 * (x[0] < 0.6))
        friction.interpolate(left)
        steel = materials.LinearElastic.from_young(1e3, 0.3)
        load = fem.Constant(body.domain, (-0.5 if mirror else 0.5, -1.0))
        energy = steel.energy(body.u) * ufl.dx - ufl.dot(load, body.u) * ufl.dx
        floor = HalfSpace((0, 0), (0, 1))
        contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(friction))
        problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
        for algorithm in ("newton", "lemke", "gauss-seidel", "interior-point"):
            body.u.x.array[:] = 0.0
            tables.append(problem.solve(algorithm=algorithm).tables["contact"])
    one = tables[0]
    case.true("half slips", set(one.letters[3:]) == {"+"} and set(one.letters[:3]) == {"k"})
    case.equal("no friction there", one.force[3:, 0], [0.0, 0.0], 1e-9)
    for k, table in enumerate(tables[1:4]):
        case.equal(f"algorithm {k}", table.force, one.force, 1e-6)
    for k, table in enumerate(tables[4:]):
        case.equal(f"mirrored {k}", table.force[::-1] * [-1, 1], one.force, 1e-6)
