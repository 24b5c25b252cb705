"""A point in 3D whose top goes round in a square and a loop, under a pressure that changes.

The spring is isotropic, so that a step is a return to the disc of friction along the radius: twenty
lines of numpy are the right answer, state, force and dissipated energy.
"""

import numpy as np
from bodies import free_point, moves, one_point

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.evolution import QuasiStatic

KT = 2.0
KN = 3.0
F = 0.4


def top(t):
    sides = np.array([[0, 0, -1], [1, 0, -1], [1, 1, -2], [-1, 1, -1], [-1, -1, -0.5], [1, 0, -1]])
    k = min(int(t), len(sides) - 2)
    return sides[k] + (t - k) * (sides[k + 1] - sides[k])


def attack(case):
    body, energy = one_point(case.comm, np.diag([KT, KT, KN]), 3)
    floor = HalfSpace((0, 0, 0), (0, 0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(F))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    times = np.linspace(0.0, 5.0, 16)
    moves(body, *top(0.0))
    problem.solve()
    evolution = QuasiStatic(problem, lambda t: moves(body, *top(t)))
    histories = [
        evolution.run(part, sudden=np.inf) for part in (times[:7], times[6:11], times[10:])
    ]
    slip = np.zeros(2)
    dissipated = 0.0
    for step in [s for h in histories for s in h.steps]:
        U = top(step.time)
        pull = KT * (U[:2] - slip)
        bound = -F * KN * U[2]
        size = np.linalg.norm(pull)
        if size > bound:
            way = (size - bound) / KT * pull / size
            slip = slip + way
            dissipated += bound * np.linalg.norm(way)
        table = step.result.tables["contact"]
        k = free_point(table)
        case.equal(f"slip at {step.time}", table.ut[k][:2], slip, 1e-6)
        case.equal(f"force at {step.time}", table.force[k], [*(-KT * (U[:2] - slip)), -KN * U[2]])
        case.equal(f"dissipated at {step.time}", step.energies.dissipated, dissipated, 1e-6)
    case.equal("steps", len([s for h in histories for s in h.steps]), 15)
