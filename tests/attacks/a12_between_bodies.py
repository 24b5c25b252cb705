"""An observer of a branch of two bodies that slide on each other: force, gap and way.

Blocks of the heights 1 and 1/2 with nu = 0 come together by 0.01 gamma and then slide: the pressure
is E/1.5 times what is beyond the gap of 0.004, at every point as it is told of.
"""

from mpi4py import MPI

import numpy as np
from bodies import two_blocks

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, ParametricContact, materials
from dolfinx_contact.continuation import Observer, follow


class _Forces(Observer):
    def __init__(self, problem, pair, moved):
        self.problem = problem
        self.pair = pair
        self.moved = moved
        self.seen = []

    def step(self, step, state):
        table = self.problem.table(self.pair)
        comm = self.problem.u.function_space.mesh.comm
        lowest = comm.allreduce(float(np.min(self.moved.x.array)), op=MPI.MIN)
        self.seen.append((step.point.gamma, np.sum(table.rn), np.min(table.un), lowest))


def attack(case):
    both = two_blocks(case.comm, (2, 1), (2, 1))
    u = both.u
    moved = both.top
    pair = ContactPair(u, both.slave, master_facets=both.master, law=Coulomb(0.2), gap=0.004)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    problem = ContactProblem(steel.energy(u) * ufl.dx, u, [pair], bcs=both.bcs)
    gamma = fem.Constant(both.domain, 0.0)
    system = ParametricContact(
        problem, gamma, driven=[(moved, ufl.as_vector((0.03 * gamma, -0.01 * gamma)))]
    )
    forces = _Forces(problem, pair, moved)
    branch = follow(system, system.create_vector(), 0.0, gamma_range=(0.0, 1.0), observer=forces)
    seen = np.array(forces.seen)
    depth = 0.01 * seen[:, 0] - 0.004
    case.equal("points", seen[:, 0], [p.gamma for p in branch.points])
    case.equal("the end", seen[-1, 0], 1.0)
    case.equal("way", seen[:, 3], -0.01 * seen[:, 0])
    case.equal("force", seen[:, 1], 1000.0 / 1.5 * np.maximum(depth, 0.0))
    case.equal("gap", seen[:, 2], np.maximum(-depth, 0.0))
