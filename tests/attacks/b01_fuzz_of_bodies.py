"""Bodies of one to three rows under random loads and friction to 20, by Lemke's method.

What it finds must satisfy the law and the balance of the reduced problem, which are written out.
"""

import numpy as np
from b01_fuzz_of_lemke import violation
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials


def attack(case):
    rng = np.random.default_rng(7)
    for rows in (1, 2, 3):
        body = block(case.comm, (3, rows), (1.0, 0.2 * rows), "quadrilateral")
        young = fem.Constant(body.domain, 1.0)
        load = fem.Constant(body.domain, (0.0, 0.0))
        steel = materials.LinearElastic.from_young(young, 0.3)
        energy = steel.energy(body.u) * ufl.dx - ufl.dot(load, body.u) * ufl.dx
        floor = HalfSpace((0, 0), (0, 1))
        contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.1))
        problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
        for _ in range(4):
            friction = float(rng.choice([0.2, 1.7, 20.0]))
            contact.law.friction.value = friction
            young.value = 10.0 ** rng.uniform(-6, 6)
            load.value[:] = rng.standard_normal(2)
            body.moved.x.array[:] = 0.0
            table = problem.solve(algorithm="lemke").tables["contact"]
            reduced = problem.reduced()
            p = np.asarray(reduced.p).ravel()
            a = np.empty(2 * len(table.un))
            a[0::2] = table.ut[:, 0]
            a[1::2] = table.un
            F = np.full(len(table.un), friction)
            error = violation(np.asarray(reduced.S), p, F, a)
            case.true(f"{rows} rows, F = {friction}: violation {error}", error < 1e-6)
