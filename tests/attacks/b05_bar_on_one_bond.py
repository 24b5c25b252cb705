"""An elastic bar on bonds of RCCM that all snap at once, with jumps taken.

A bar of stiffness E/h per area, nu = 0: up to U = u0 (1 + 1/K) the bond holds, beyond, the
opening is the other root of U = u + u0^4/(K u^3); a state exists after the jump, and the
evolution goes on.
"""

import numpy as np
from bodies import block, moves

import ufl

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace, materials
from dolfinx_contact.evolution import QuasiStatic

C = 100.0
WORK = 1.0
U0 = 0.1


def pulled(case, K, cells, cell, times):
    dim = len(cells)
    body = block(case.comm, cells, (1.0,) * dim, cell)
    steel = materials.LinearElastic.from_young(K * C, 0.0)
    floor = HalfSpace((0,) * dim, (0,) * (dim - 1) + (1,))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=RCCM(C, 0.0, WORK))
    energy = steel.energy(body.u) * ufl.dx
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    evolution = QuasiStatic(problem, lambda t: moves(body, *(0.0,) * (dim - 1), t))
    history = evolution.run(times, at_jump="jump")
    case.equal("last time", history.time, times[-1])
    case.true("a jump" if K < 3 else "no jump", any(s.jump for s in history.steps) == (K < 3))
    U = times[-1]
    u = max(r.real for r in np.roots([1.0, -U, 0, 0, U0**4 / K]) if abs(r.imag) < 1e-9)
    table = history.steps[-1].result.tables["contact"]
    case.equal("opening", table.un.mean(), u, 1e-4)


def attack(case):
    pulled(case, 0.5, (1, 1), "quadrilateral", [0.0, 0.1, 0.2, 0.29, 0.5])
    pulled(case, 1.0, (1, 1, 1), None, [0.0, 0.1, 0.15, 0.4])


def honest(case):
    pulled(case, 6.0, (1, 1), "quadrilateral", [0.0, 0.05, 0.1, 0.15, 0.2, 0.3])
