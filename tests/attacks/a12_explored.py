"""`explore` tells an observer of the points of several branches, from two starts.

Each is compared with the closed form of a block that comes down on a floor; afterwards the
problem stands as it did before.
"""

import numpy as np
from a12_point_stands import Reader, compared, lowered

from dolfinx_contact import Coulomb
from dolfinx_contact.continuation import explore


def attack(case):
    body, problem, contact, gamma, system = lowered(case, Coulomb(0.3))
    system.set_parameter(0.7)
    problem.solve()
    x = system.create_vector()
    problem.write(x)
    before = body.u.x.array.copy()
    moved = body.moved.x.array.copy()
    reader = Reader(body, problem, contact, gamma)
    starts = [(x, 0.7), (system.create_vector(), 0.0)]
    diagram = explore(system, starts, gamma_range=(0.0, 1.0), observer=reader, max_branches=6)
    told = sorted(reader.column("gamma"))
    points = sorted(p.gamma for edge in diagram.edges for p in edge.branch.points)
    case.true("every point was told of", set(np.round(points, 9)) <= set(np.round(told, 9)))
    compared(case, reader)
    case.equal("u as before", body.u.x.array, before)
    case.equal("the top as before", body.moved.x.array, moved)
    case.equal("gamma as before", float(gamma.value), 0.7)
