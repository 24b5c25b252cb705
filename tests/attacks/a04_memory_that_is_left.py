"""After a history the memory is taken off a surface, and the law of the speed solved statically.

With the memory of the last step Q/P is mu(v), without it there is no speed but 0.
"""

from a04_speed_solved_statically import OfSpeed, in_numbers
from bodies import block, moves, on_floor, ratio

from dolfinx_contact import Frictionless
from dolfinx_contact.evolution import QuasiStatic


def attack(case):
    law = OfSpeed(0.5, 0.1, 2.0)
    body = block(case.comm, (2, 1), cell="quadrilateral")
    moves(body, 0.0, -0.01)
    on_floor(body, Frictionless())[0].solve()
    problem, contact = on_floor(body, law)
    evolution = QuasiStatic(problem, lambda t: moves(body, t, -0.01))
    last = evolution.run([0.05 * k for k in range(13)], sudden=float("inf")).steps[-1]
    case.equal("Q/P", ratio(last.result.tables[contact.name]), in_numbers(law, 1.0))
    contact.memory = None
    moves(body, 0.3, -0.01)
    case.equal("Q/P at rest", ratio(problem.solve().tables[contact.name]), 0.5)
