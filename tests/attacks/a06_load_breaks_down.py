"""A load that is nan, or raises, from some time on: the evolution ends, at the last state it had.

Until then the state is known: pressed by 1 at F = 0.5 with stiffness 2 the point slips from 0.25
on.
"""

import numpy as np
from bodies import free_point, moves, one_point

from dolfinx_contact import ContactProblem, ContactSurface, ConvergenceError, Coulomb, HalfSpace
from dolfinx_contact.evolution import NoContinuation, QuasiStatic


def attack(case):
    for broken in (np.nan, np.inf, ArithmeticError("no load")):
        body, energy = one_point(case.comm, [[2.0, 0.0], [0.0, 1.0]])
        floor = HalfSpace((0, 0), (0, 1))
        contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.5))
        problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)

        def load(t, body=body, broken=broken):
            if t > 0.61 and isinstance(broken, Exception) and body.domain.comm.rank == 0:
                raise broken
            moves(body, t if t <= 0.61 else float("nan"), -1.0)

        load(0.0)
        problem.solve()
        seen = []
        try:
            QuasiStatic(problem, load).run([0.0, 0.3, 0.6, 0.9], observer=seen.append)
        except (NoContinuation, ConvergenceError) as error:
            case.true("claims no nonexistence", "no solution continues" not in str(error))
        except (ValueError, ArithmeticError):
            pass
        else:
            case.true("raises", False)
        case.equal("steps", [s.time for s in seen], [0.3, 0.6])
        table = problem.table(contact)
        case.equal("slip", table.ut[free_point(table), 0], 0.35)
