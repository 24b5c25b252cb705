"""Bonds with friction that break slowly, one after the other: a history of long steps, or short.

Cohesion softer than the body: nothing jumps, so that long and short steps end in the same state
up to the length of a step, and bonds that only ever open know no step length at all.
"""

import numpy as np
from bodies import block, moves

import ufl

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace, materials
from dolfinx_contact.evolution import QuasiStatic


def attack(case):
    ends = []
    for steps in (1, 6):
        body = block(case.comm, (3, 1), (1.0, 0.5), "quadrilateral")
        steel = materials.LinearElastic.from_young(500.0, 0.3)
        floor = HalfSpace((0, 0), (0, 1))
        law = RCCM(20.0, 20.0, 0.02, 0.5)
        contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=law)
        energy = steel.energy(body.u) * ufl.dx
        problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)

        def load(t, body=body):
            moves(body, 0.0, 0.2 * t)

        history = QuasiStatic(problem, load).run(np.linspace(0.0, 1.0, steps + 1), sudden=np.inf)
        case.true("no jump", not any(s.jump for s in history.steps))
        table = history.steps[-1].result.tables["contact"]
        ends.append((table.un, table.beta, history.energies.damage))
    case.equal("gaps", ends[0][0], ends[1][0], 1e-3)
    case.equal("intensities", ends[0][1], ends[1][1], 1e-3)
    case.true("damaged", ends[1][1].max() < 0.5)
