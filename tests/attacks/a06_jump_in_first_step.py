"""One point with friction above kt/|c| is lifted through its jump in one step, or after one other.

The point of a06_jump_of_friction: at the lift 0.2 it jumps open, from (0, 0) to slip 1 and gap 0.2.
Steps that may be no shorter than they are hold no jump where the point only begins to slip.
"""

from a06_jump_of_friction import made
from bodies import free_point

from dolfinx_contact.evolution import NoContinuation


def attack(case):
    for times in ([-1.0, 1.0], [-1.0, -0.8, 1.0], [-1.0, -0.5, 1.0], [-1.0, 0.0, 1.0]):
        history = made(case, 1.0).run(times, at_jump="jump")
        leaps = [s for s in history.steps if s.jump]
        case.equal("jumps", len(leaps), 1)
        case.equal("found", leaps[0].time, 0.2, 1e-3)
        try:
            made(case, 1.0).run(times)
        except NoContinuation as error:
            case.equal("where it ends", error.history.time, 0.2, 1e-3)
        else:
            case.true("raises", False)


def honest(case):
    times = [-1.0, -0.2, 0.1, 0.3, 1.0]
    history = made(case, 0.6).run(times, shortest=0.3)
    case.equal("times", [s.time for s in history.steps], times[1:])
    case.equal("jumps", sum(s.jump for s in history.steps), 0)
    table = history.steps[-1].result.tables["contact"]
    case.equal("slip", table.ut[free_point(table), 0], 1.0)
