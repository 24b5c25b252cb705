"""A block is moved by four of its widths along one wide cell of the lower block.

The way is less than half of the master's facet. The force keeps its size; where it acts has to go
with the block, which shows in the moment of the reactions at the foot.
"""

import numpy as np
from a03_off_the_edge import doubted, pressed
from bodies import two_blocks

import ufl
from dolfinx import fem, la

from dolfinx_contact import materials


def foot_centre(both):
    """Where the vertical reactions at the foot act along x, by nodal forces of the bulk."""
    energy = materials.LinearElastic.from_young(1.0, 0.0).energy(both.u) * ufl.dx
    form = fem.form(ufl.derivative(energy, both.u, ufl.TestFunction(both.V)))
    forces = fem.assemble_vector(form)
    forces.scatter_reverse(la.InsertMode.add)
    owned = both.V.dofmap.index_map.size_local
    x = both.V.tabulate_dof_coordinates()[:owned]
    r = np.where(np.isclose(x[:, 1], -0.5), forces.array.reshape(-1, 2)[:owned, 1], 0.0)
    total = both.domain.comm.allreduce(np.array([r @ x[:, 0], r.sum()]))
    return total[0] / total[1]


def put(case, way, at):
    both = two_blocks(case.comm, (2, 1), (1, 1), wide=(0.0, 10.0), at=at)
    result = pressed(both, way).solve()
    return result, foot_centre(both)


def attack(case):
    _, expected = put(case, 0.0, 5.0)
    result, found = put(case, 4.0, 1.0)
    case.equal("centre of the reactions at the foot", found, expected, 0.05)
    doubted(case, result)


def honest(case):
    _, expected = put(case, 0.0, 1.001)
    result, found = put(case, 0.001, 1.0)
    case.equal("centre of the reactions at the foot", found, expected, 1e-2)
    case.true("nothing is said", not case.warnings and not result.doubts)
