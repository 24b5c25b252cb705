"""An evolution begun with a state that is no solution under the load at its first time.

The state in the Functions is that of another load (the top aside by 1, slipped by 0.75); taken
for the start, a top that stays at 0 has the slip of 0.25 to the other side. Begun with the state
of its own load, nothing slips.
"""

from bodies import free_point, moves, one_point

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.evolution import QuasiStatic


def begun(case, aside, slip):
    body, energy = one_point(case.comm, [[2.0, 0.0], [0.0, 1.0]])
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.5))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    moves(body, aside, -1.0)
    problem.solve()
    moves(body, 0.0, -1.0)
    evolution = QuasiStatic(problem, lambda t: moves(body, 0.1 * t, -1.0))
    history = evolution.run([0.0, 0.5, 1.0])
    case.warned("start of the evolution is no solution")
    table = history.steps[-1].result.tables["contact"]
    k = free_point(table)
    case.equal("slip", table.ut[k, 0], slip)
    case.equal("shear", table.force[k, 0], -2 * (0.1 - slip))


def attack(case):
    begun(case, 1.0, 0.0)


def honest(case):
    begun(case, 0.0, 0.0)
