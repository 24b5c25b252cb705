"""A box with a branched crack, where several nodes share a place."""

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, ParametricContact
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import crack
from support.blocks import box, facets


def branched(comm, n=6, *, slave="5_opposite", method="nodal"):
    """A block with a crack across it and an arm from there to its top, whose sides part with gamma.

    At the end of the arm two nodes above the crack face one below; the left part is pressed and
    dragged, the right one lifted.
    """
    domain = box(comm, n, "quad")
    domain.topology.create_entities(1)
    flat = mesh.locate_entities(domain, 1, lambda x: np.isclose(x[1], 0.5))
    arm = mesh.locate_entities(domain, 1, lambda x: np.isclose(x[0], 0.5) & (x[1] > 0.5 - 1e-9))
    every = [flat, arm, facets(domain, 1, 0.0), facets(domain, 1, 1.0)]
    values = np.repeat(np.array([5, 6, 1, 4], dtype=np.int32), [len(f) for f in every])
    order = np.argsort(np.concatenate(every))
    tags = mesh.meshtags(domain, 1, np.concatenate(every)[order], values[order])
    body = crack(domain, [5, 6], facet_tags=tags)
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    top = fem.Function(V)
    gamma = fem.Constant(body.mesh, 0.0)
    x = ufl.SpatialCoordinate(body.mesh)
    left = ufl.conditional(ufl.lt(x[0], 0.49), 1.0, 0.0)
    way = ufl.as_vector([-0.04 * left * gamma, 0.02 * gamma * (1 - left) - 0.02 * left])
    still = fem.locate_dofs_topological(V, 1, body.facet_tags.find(1))
    moved = fem.locate_dofs_topological(V, 1, body.facet_tags.find(4))
    # The two nodes at the middle of the top are free.
    middle = np.isclose(V.tabulate_dof_coordinates()[moved, 0], 0.5)
    bcs = [fem.dirichletbc(np.zeros(2), still, V), fem.dirichletbc(top, moved[~middle])]
    master = {"5_opposite": 5}[slave]
    pair = ContactPair(u, body, slave=slave, master=master, law=Coulomb(0.3), method=method)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [pair], bcs=bcs)
    return ParametricContact(problem, gamma, driven=[(top, way)])


def force(problem):
    return float(problem.table(problem.surfaces[0]).rt.sum())
