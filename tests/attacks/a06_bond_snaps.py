"""A bond on a soft spring snaps in a history, on a stiff one it does not.

It holds up to U = u0 (1 + 1/K); beyond, K < 3, the opening is the other root of U = u + u0^4/(K
u^3). The energies close: the work is stored, damaged and lost in the jump.
"""

import numpy as np
from bodies import free_point, moves, one_point

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace
from dolfinx_contact.evolution import NoContinuation, QuasiStatic

C = 100.0
WORK = 1.0
U0 = 0.1


def pulled(case, K, times, at_jump):
    body, energy = one_point(case.comm, [[50.0, 0.0], [0.0, K * C / 2]])
    floor = HalfSpace((0, 0), (0, 1))
    law = RCCM(C, 0.0, WORK)
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=law)
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    evolution = QuasiStatic(problem, lambda t: moves(body, 0.0, t))
    return evolution.run(times, at_jump=at_jump, shortest=1e-4)


def opening(K, U):
    if U <= U0 * (1 + 1 / K):
        return U * K / (K + 1)
    return max(r.real for r in np.roots([1.0, -U, 0, 0, U0**4 / K]) if abs(r.imag) < 1e-9)


def compared(case, K, history):
    for step in history.steps:
        table = step.result.tables["contact"]
        u = opening(K, step.time)
        case.equal(f"opening at {step.time}", table.un[free_point(table)], u, 1e-4)


def attack(case):
    K = 0.5
    history = pulled(case, K, [0.0, 0.2, 0.5], "jump")
    case.equal("jumps", [s.time for s in history.steps if s.jump], [0.3], 1e-3)
    compared(case, K, history)
    try:
        pulled(case, K, [0.0, 0.2, 0.5], "raise")
    except NoContinuation as error:
        case.equal("ends", error.history.time, 0.3, 1e-3)
    else:
        case.true("raises", False)


def honest(case):
    K = 5.0
    history = pulled(case, K, [0.0, 0.08, 0.16, 0.24, 0.4], "raise")
    compared(case, K, history)
