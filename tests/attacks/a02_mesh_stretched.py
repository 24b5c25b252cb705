"""The mesh is stretched sideways after the problem was made, and once after a solve.

A block pressed by a strain of 1 % has a force of E times 1 % of its width, 10 and then 20.
"""

from bodies import block, moves, on_floor

from dolfinx_contact import Frictionless


def attack(case):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    moves(body, 0.0, -0.01)
    problem, contact = on_floor(body, Frictionless())
    case.equal("force", problem.solve().resultants[contact.name][1], 10.0)
    body.domain.geometry.x[:, 0] *= 2.0
    result = problem.solve()
    case.equal("force on the wide block", result.resultants[contact.name][1], 20.0)
    case.equal("pressure", result.tables[contact.name].pressure, [10.0, 10.0, 10.0])
    case.warned("mesh|coordinates|geometry")
