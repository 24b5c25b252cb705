"""One point with friction above kt/|c| is lifted: at 0.2 no solution continues, and it jumps open.

S = [[1, -1.5], [-1.5, 4]], the top aside by 1, lifted from -1 to 1, F = 1: by hand the point
sticks up to the lift 0.2; the slip that leads on there turns the load back. Above 0.2 it hangs
free, gap = lift and slip = 1. With F = 0.5 it slips from -0.5 on, twice as fast as the lift, and
nothing jumps.
"""

from bodies import free_point, moves, one_point

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.evolution import NoContinuation, QuasiStatic


def made(case, friction):
    body, energy = one_point(case.comm, [[1.0, -1.5], [-1.5, 4.0]])
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(friction))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    moves(body, 1.0, -1.0)
    problem.solve()
    return QuasiStatic(problem, lambda t: moves(body, 1.0, t))


def lifted(case, friction, at_jump, jumps):
    history = made(case, friction).run([-1.0, -0.6, -0.2, 0.15, 0.5, 1.0], at_jump=at_jump)
    table = history.steps[-1].result.tables["contact"]
    k = free_point(table)
    case.equal("time", history.time, 1.0)
    case.equal("gap and slip", [table.un[k], table.ut[k, 0]], [1.0, 1.0])
    leaps = [s for s in history.steps if s.jump]
    case.equal("jumps", len(leaps), len(jumps))
    for leap, time in zip(leaps, jumps, strict=True):
        case.true("begins before", leap.start <= time + 1e-9)
        case.true("ends behind", leap.time >= time - 1e-9)
        case.equal("found", leap.time, time, 1e-3)
    for step in history.steps:
        if friction == 0.5 and -0.5 < step.time < 0:
            case.equal("slip", step.result.tables["contact"].ut[k, 0], 2 * (step.time + 0.5))


def attack(case):
    lifted(case, 1.0, "jump", [0.2])
    try:
        made(case, 1.0).run([-1.0, 0.0, 1.0])
    except NoContinuation as error:
        case.equal("where it ends", error.history.time, 0.2, 1e-4)
        case.true("says that it is proved", "no solution continues" in str(error))
    else:
        case.true("raises", False)


def honest(case):
    lifted(case, 0.5, "raise", [])
