"""One row of cells between a held top and the floor, which friction holds everywhere: u = 0.

A body force presses and drags it; every algorithm has to give the forces of the nodes on the floor,
half of the whole load (P1 on one row of equal cells: by hand), the rest is the top's.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials


def stuck(case, units, algorithms, cells=(4, 1), cell="quadrilateral", force=(0.3, -1.0)):
    dim = len(cells)
    size = (1.0,) * (dim - 1) + (0.25,)
    for young, scale in units:
        body = block(case.comm, cells, tuple(scale * s for s in size), cell)
        steel = materials.LinearElastic.from_young(young, 0.3)
        load = young / scale * 1e-3 * np.array(force)
        energy = steel.energy(body.u) * ufl.dx
        energy -= ufl.dot(fem.Constant(body.domain, load), body.u) * ufl.dx
        floor = HalfSpace((0,) * dim, (0,) * (dim - 1) + (1,))
        contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.5))
        problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
        half = -load * scale**dim * np.prod(size) / 2
        for algorithm in algorithms:
            body.u.x.array[:] = 0.0
            result = problem.solve(algorithm=algorithm)
            case.equal(f"{algorithm}: force", result.resultants["contact"], half, 1e-6)
            case.true(f"{algorithm}: sticks", set(result.tables["contact"].letters) == {"k"})
            moved = np.abs(body.u.x.array).max(initial=0.0)
            case.true(f"{algorithm}: moved by {moved}", moved <= 1e-10 * scale)


METHODS = ("newton", "lemke", "gauss-seidel", "interior-point")


def attack(case):
    stuck(case, [(210e9, 1e-3), (1e-9, 1e9)], METHODS)


def honest(case):
    stuck(case, [(1000.0, 1.0)], METHODS)
