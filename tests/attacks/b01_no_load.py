"""No load at all, a load of round-off, and a load that comes and goes, with every algorithm.

Nothing moves and nothing is pressed; or what the load by itself gives, half of its resultant on
one row.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials

ALGORITHMS = ("newton", "lemke", "gauss-seidel", "interior-point", "tresca", "uzawa")


def loaded(case, loads, algorithms):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    steel = materials.LinearElastic.from_young(1000.0, 0.3)
    load = fem.Constant(body.domain, (0.0, 0.0))
    energy = steel.energy(body.u) * ufl.dx - ufl.dot(load, body.u) * ufl.dx
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.5))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    for size in loads:
        load.value[:] = 0.2 * size, -size
        for algorithm in algorithms:
            result = problem.solve(algorithm=algorithm)
            right = np.array([-0.1 * size, 0.5 * size])
            what = f"{algorithm} under {size}"
            case.equal(what, result.resultants["contact"] / (size or 1.0), right / (size or 1.0))


def attack(case):
    loaded(case, (0.0, 1.0, 0.0, 1e-14, 1.0), ALGORITHMS)


def honest(case):
    loaded(case, (1.0, 2.0), ALGORITHMS)
