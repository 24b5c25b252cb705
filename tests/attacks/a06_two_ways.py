"""Where the load turns back at the border of slip, two evolutions lead on: one sticks, one slips.

S = [[1, -1.5], [-1.5, 4]], top aside by 1, F = 1, lifted to 0.2 and let down to 0.1: by hand the
point sticks (ut = 0), or slips by 5 (0.2 - lift) with the normal force 3.5 lift. What slips may
stick again where a step begins, since the force of a stuck point grows by 4, its shear by 1.5:
three ends by 0.1.
"""

import numpy as np
from bodies import free_point, moves, one_point

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.evolution import QuasiStatic


def attack(case):
    body, energy = one_point(case.comm, [[1.0, -1.5], [-1.5, 4.0]])
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(1.0))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    moves(body, 1.0, 0.0)
    problem.solve()
    evolution = QuasiStatic(problem, lambda t: moves(body, 1.0, 0.2 - abs(t - 0.2)))
    history = evolution.run([0.0, 0.1, 0.2, 0.25, 0.3], rays=True, follow_rays=True)
    ends = [history, *history.others]
    case.equal("ways at the turn", history.at(0.25).directions, 2)
    found = []
    for one in ends:
        table = one.steps[-1].result.tables["contact"]
        k = free_point(table)
        found.append([table.ut[k, 0], table.force[k, 1]])
    found = np.array(sorted(found))
    case.equal("slips and forces", found, [[0.0, 1.1], [0.25, 0.725], [0.5, 0.35]], 1e-6)
