"""An observer of a branch of two bodies that slide on each other: force, gap and way.

Blocks of the height 1 with nu = 0 come together by 0.01 gamma and then slide: the pressure is
E/2 times what is beyond the gap of 0.004, at every point as it is told of.
"""

from mpi4py import MPI

import numpy as np
from bodies import block

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, materials, meshing
from dolfinx_contact.continuation import Observer, follow
from dolfinx_contact.parametric import ParametricContact


class _Forces(Observer):
    def __init__(self, problem, pair, moved):
        self.problem, self.pair, self.moved = problem, pair, moved
        self.seen = []

    def point(self, branch, index, point, special, stepping):
        table = self.problem.table(self.pair)
        comm = self.problem.u.function_space.mesh.comm
        lowest = comm.allreduce(float(np.min(self.moved.x.array)), op=MPI.MIN)
        self.seen.append((point.gamma, np.sum(table.rn), np.min(table.un), lowest))


def attack(case):
    upper = block(case.comm, (2, 1), cell="quadrilateral")
    lower = block(case.comm, (2, 1), cell="quadrilateral")
    upper.domain.geometry.x[:, 1] += 1.0
    both = meshing.join([upper.domain, lower.domain])
    domain = both.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, moved = fem.Function(V), fem.Function(V)
    domain.topology.create_connectivity(1, 2)
    to_cells = domain.topology.connectivity(1, 2)

    def face(height, tag):
        facets = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], height))
        mine = set(both.cell_tags.find(tag))
        return np.array([f for f in facets if to_cells.links(f)[0] in mine], dtype=np.int32)

    pair = ContactPair(u, face(1.0, 1), master_facets=face(1.0, 2), law=Coulomb(0.2), gap=0.004)
    held = [
        fem.dirichletbc(moved, fem.locate_dofs_topological(V, 1, face(2.0, 1))),
        fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, face(0.0, 2)), V),
    ]
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    problem = ContactProblem(steel.energy(u) * ufl.dx, u, [pair], bcs=held)
    gamma = fem.Constant(domain, 0.0)
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
    case.equal("force", seen[:, 1], 500.0 * np.maximum(depth, 0.0))
    case.equal("gap", seen[:, 2], np.maximum(-depth, 0.0))
