"""Columns of several stiffnesses K C on bonds of their own come off one after the other.

Each holds up to U = u0 (1 + 1/K), and snaps there if K < 3. A mean over all of them hardly shows
it, and steps are as long as from one to the next. The honest twin has stiff columns alone.
"""

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.meshing import join

C = 100.0
WORK = 1.0
U0 = 0.1


def face(domain, height):
    return mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], height))


def pulled(case, ratios, times):
    line = np.linspace(0.0, 1.0, 2)
    both = join(
        [
            create_grid(case.comm, (line + 2 * i, line), mesh.CellType.quadrilateral)
            for i in range(len(ratios))
        ]
    )
    V = fem.functionspace(both.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    top = fem.Constant(both.mesh, np.zeros(2))
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(u, face(both.mesh, 0.0), obstacle=floor, law=RCCM(C, C, WORK))
    dx = ufl.Measure("dx", both.mesh, subdomain_data=both.cell_tags)
    square = ufl.inner(ufl.grad(u), ufl.grad(u)) / 2
    energy = sum(K * C * square * dx(i) for i, K in enumerate(ratios, 1))
    held = fem.dirichletbc(top, fem.locate_dofs_topological(V, 1, face(both.mesh, 1.0)), V)
    problem = ContactProblem(energy, u, [contact], bcs=[held])

    def load(time):
        top.value[1] = time * U0

    return QuasiStatic(problem, load).run(times, at_jump="jump")


def opening(K, U):
    if U <= 1 + 1 / K:
        return U * K / (K + 1)
    return max(r.real for r in np.roots([1.0, -U, 0, 0, 1 / K]) if abs(r.imag) < 1e-9)


def compared(case, ratios, history):
    for step in history.steps:
        table = step.result.tables["contact"]
        found = table.un[np.argsort(table.x[:, 0])][::2] / U0
        exact = [opening(K, step.time) for K in ratios]
        case.equal(f"openings at {step.time}", found, exact, 1e-3)


def attack(case):
    ratios = (1.0, 0.5, 2.0, 0.7)
    history = pulled(case, ratios, np.linspace(0.0, 3.5, 8))
    jumps = [step.time for step in history.steps if step.jump]
    case.equal("jumps", jumps, sorted(1 + 1 / K for K in ratios), 1e-3)
    compared(case, ratios, history)


def honest(case):
    ratios = (4.0, 6.0, 5.0)
    history = pulled(case, ratios, np.linspace(0.0, 2.0, 6))
    case.true("no jump", not any(step.jump for step in history.steps))
    compared(case, ratios, history)
