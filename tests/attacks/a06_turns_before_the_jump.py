"""The load comes to the very border of a jump and turns back; or stays there; or grazes it twice.

S = [[1, -1.5], [-1.5, 4]], top aside by 1, F = 1: up to the lift 0.2 the point sticks, and so it
does when the load falls again (another solution slips, 5 per lift that falls). "No solution
continues" is false at every time.
"""

from bodies import free_point, moves, one_point

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.evolution import NoContinuation, QuasiStatic


def grazed(case, lift, times, **options):
    body, energy = one_point(case.comm, [[1.0, -1.5], [-1.5, 4.0]])
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(1.0))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    moves(body, 1.0, lift(times[0]))
    problem.solve()
    evolution = QuasiStatic(problem, lambda t: moves(body, 1.0, lift(t)))
    try:
        history = evolution.run(times, **options)
    except NoContinuation as error:
        case.true(f"goes on: {error}", False)
        return
    case.equal("time", history.time, times[-1])
    case.equal("jumps", sum(s.jump for s in history.steps), 0)
    table = history.steps[-1].result.tables["contact"]
    k = free_point(table)
    U = lift(times[-1])
    u = table.ut[k, 0]
    if table.letters[k] == "k":
        case.equal("sticks", u, 0.0)
    case.equal("normal force", table.force[k, 1], 1.5 * (1 - u) - 4 * U, 1e-6)
    case.true("no jump to a free state", table.un[k] < 1e-9)


def attack(case):
    grazed(case, lambda t: 0.2 - abs(t - 1), [0.0, 1.0, 2.0])
    grazed(case, lambda t: 0.2 - abs(t - 1), [0.0, 0.7, 1.3, 2.0])
    grazed(case, lambda t: min(t - 0.8, 0.2 * (1 - 1e-9)), [0.0, 0.5, 1.0, 1.5, 2.0])
    grazed(case, lambda t: 0.2 * (1 - 1e-7) - 0.1 * abs(abs(t - 2) - 1), [0.0, 1.0, 2.0, 3.0, 4.0])


def honest(case):
    grazed(case, lambda t: -0.1 - abs(t - 1), [0.0, 1.0, 2.0])
