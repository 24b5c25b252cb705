"""gamma is the height of the obstacle and the load of a rigid plate, not Dirichlet data.

A floor that rises by 0.01 gamma presses a block that is held above, E times that; a plate that is
pressed by 10 gamma moves by that over E. Both stand in the problem when an observer is told.
"""

import numpy as np
from bodies import block, moves, on_floor

from dolfinx import fem

from dolfinx_contact import Frictionless, HalfSpace, LevelSet, ParametricContact, RigidBody
from dolfinx_contact.continuation import Observer, follow


class _Forces(Observer):
    def __init__(self, problem, contact, body):
        self.problem = problem
        self.contact = contact
        self.body = body
        self.seen = []

    def step(self, step, state):
        table = self.problem.table(self.contact)
        foot = self.body.comm.allreduce(_highest(self.body.u, self.body.bottom))
        self.seen.append((step.point.gamma, np.sum(table.rn), np.max(np.abs(table.un)), foot))


def _highest(u, bottom):
    V = u.function_space
    dofs = fem.locate_dofs_topological(V, 1, bottom)
    mine = dofs[dofs < V.dofmap.index_map.size_local]
    return float(np.sum(u.x.array.reshape(-1, 2)[mine, 1]))


def _seen(case, kind):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    body.comm = case.comm
    moves(body, 0.0, 0.0)
    gamma = fem.Constant(body.domain, 0.0)
    if kind == "floor":
        obstacle = LevelSet(lambda x: x[1] - 0.01 * gamma)
    else:
        obstacle = RigidBody(
            HalfSpace(point=(0.5, 0.0), normal=(0.0, 1.0)),
            about=(0.5, 0.0),
            load={"y": 10.0 * gamma},
            held=["x", "rz"],
            name="plate",
        )
    problem, contact = on_floor(body, Frictionless(), obstacle=obstacle)
    system = ParametricContact(problem, gamma)
    forces = _Forces(problem, contact, body)
    system.set_parameter(0.2)
    problem.solve()
    x = system.create_vector()
    problem.write(x)
    follow(system, x, 0.2, gamma_range=(0.2, 1.0), observer=forces, max_steps=60)
    return np.array(forces.seen)


def attack(case):
    for kind in ("floor", "plate"):
        seen = _seen(case, kind)
        gammas = seen[:, 0]
        case.equal(f"the end ({kind})", gammas[-1], 1.0)
        case.equal(f"force ({kind})", seen[:, 1], 10.0 * gammas)
        case.equal(f"foot ({kind})", seen[:, 3], 3 * 0.01 * gammas)
        case.equal(f"gap ({kind})", 1e3 * seen[:, 2], 0.0 * gammas, 1e-6)
