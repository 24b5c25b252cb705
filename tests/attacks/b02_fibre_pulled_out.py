"""A fibre pressed on a matrix it is bonded to, pulled out by a few long steps.

However the bonds break, at the end the shear of each node is that of its way: (1 - beta) mu p +
beta^2 C u with beta = w/(C u^2), by hand; the pull is their sum, but for the node that the pull
holds. The free end hangs behind by what they stretch.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace
from dolfinx_contact.evolution import QuasiStatic


def pulled(case, n, young, work, times, at_jump, unit=1.0):
    """Forces in `unit`."""
    body = block(case.comm, (n, 1), (1.0, 0.05), "quadrilateral")
    u = body.u
    ky = 10.0 * unit
    press = 0.02
    mu = 0.5
    young = young * unit
    work = work * unit
    energy = young / 2 * u[0].dx(0) ** 2 / 0.05 + 5e3 * young / 2 * u[0].dx(1) ** 2
    energy += ky * 0.05 / 2 * (u[1].dx(1) ** 2)
    across, along = (body.V.sub(i) for i in (1, 0))
    end = mesh.locate_entities_boundary(body.domain, 1, lambda x: np.isclose(x[0], 1.0))
    down, pull = (fem.Constant(body.domain, 0.0) for _ in range(2))
    bcs = [
        fem.dirichletbc(down, fem.locate_dofs_topological(across, 1, body.top), across),
        fem.dirichletbc(pull, fem.locate_dofs_topological(along, 1, end), along),
    ]
    floor = HalfSpace((0, 0), (0, 1))
    law = RCCM(100.0 * unit, 100.0 * unit, work, mu)
    contact = ContactSurface(u, body.bottom, obstacle=floor, law=law)
    problem = ContactProblem(energy * ufl.dx, u, [contact], bcs=bcs)
    down.value = -press
    problem.solve()

    def load(t):
        pull.value = t

    history = QuasiStatic(problem, load).run(times, at_jump=at_jump)
    last = history.steps[-1]
    table = last.result.tables["contact"]
    p = ky * press
    case.equal("time", history.time, times[-1])
    free = ~np.isclose(table.x[:, 0], 1.0)
    way = table.ut[free, 0]
    beta = work / (100.0 * unit * way**2)
    shear = (1 - beta) * mu * p + beta**2 * 100.0 * unit * way
    case.equal("intensity", table.beta[free], beta, 1e-5)
    case.equal("shear", table.force[free, 0] / table.area[free], -shear, 1e-4)
    case.equal("pull", last.result.support[0], shear @ table.area[free], 1e-4)
    case.equal("lag of the free end", times[-1] - table.ut[0, 0], shear.mean() / (2 * young), 4e-2)
    case.equal("pressure", table.pressure, p + 0 * table.pressure, 1e-6)


def attack(case):
    pulled(case, 8, 2.0, 0.5, [0.0, 0.05, 0.2, 0.5, 1.0], "jump")
    pulled(case, 6, 200.0, 0.5, [0.0, 0.5, 1.0], "jump", 1e9)


def honest(case):
    pulled(case, 4, 200.0, 0.01, np.linspace(0.0, 0.2, 9), "jump")
