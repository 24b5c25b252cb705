"""A bar on a bond that snaps back."""

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    RCCM,
    ContactProblem,
    ContactSurface,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD


C = 100.0


W = 1.0


def bar(k, n=8, *, law=None, free=False, comm=COMM):
    """A bar of stiffness k C on a bond; gamma moves its end; it may bend if it is free."""
    corners = [[0.0, 0.0], [0.05, 1.0]]
    domain = mesh.create_rectangle(comm, corners, [1, n], mesh.CellType.quadrilateral)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    gamma = fem.Constant(domain, 0.0)
    top = fem.Function(V)
    end = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 1.0))
    sides = V.sub(0)
    every = np.arange(sides.dofmap.index_map.size_local + sides.dofmap.index_map.num_ghosts)
    still = fem.dirichletbc(fem.Constant(domain, 0.0), 2 * every.astype(np.int32), sides)
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
    law = law or RCCM(C, C, W)
    surface = ContactSurface(u, below, obstacle=HalfSpace((0, 0), (0, 1)), law=law)
    energy = LinearElastic.from_young(k * C, 0.0).energy(u) * ufl.dx
    bcs = [fem.dirichletbc(top, end), *[still][free:]]
    problem = ContactProblem(energy, u, [surface], bcs=bcs)
    return ParametricContact(problem, gamma, driven=[(top, ufl.as_vector((0.0, gamma)))])
