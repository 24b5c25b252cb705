"""The load itself leaps in time: what follows is known, and is no loss of a solution.

The top is aside by 0.1, from t = 0.5 on by 1: with the stiffness 2, pressed by 1 at F = 0.5 the
point sticks before, and has slipped by 0.75 after. An error that says no solution continues is
false.
"""

import re

from bodies import free_point, moves, one_point

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.evolution import NoContinuation, QuasiStatic


def attack(case):
    for at_jump in ("raise", "stop", "jump"):
        body, energy = one_point(case.comm, [[2.0, 0.0], [0.0, 1.0]])
        floor = HalfSpace((0, 0), (0, 1))
        contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.5))
        problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)

        def load(t, body=body):
            moves(body, 0.1 * t if t < 0.5 else 1.0, -1.0)

        load(0.0)
        problem.solve()
        try:
            history = QuasiStatic(problem, load).run([0.0, 0.2, 0.4, 0.6, 0.8], at_jump=at_jump)
            reason = history.reason
        except NoContinuation as error:
            history = error.history
            reason = str(error)
        case.true(f"no false proof: {reason}", not re.search("no solution continues", reason))
        for step in history.steps:
            table = step.result.tables["contact"]
            slip = 0.75 if step.time >= 0.5 else 0.0
            case.equal(f"slip at {step.time}", table.ut[free_point(table), 0], slip)
        case.unpromised(f"not complete: {reason}", not history.complete)
        case.equal("end", history.time, 0.8)
