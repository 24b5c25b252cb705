"""Quasi-static histories of a dragged block and of the node of Klarbring."""

from mpi4py import MPI

import numpy as np
from cases._triangle import element

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
)
from dolfinx_contact.materials import LinearElastic
from support.blocks import box, facets

COMM = MPI.COMM_WORLD


def dragged(
    cell="quad", n=4, *, method=None, degree=1, obstacle=None, energy=None, r=None, law=None
):
    """A block on a floor, friction 0.3, and the Function by which its top moves."""
    domain = box(COMM, n, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    top = fem.Function(V)
    held = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
    surface = ContactSurface(
        u,
        facets(domain, dim - 1, 0.0),
        obstacle=obstacle(domain) if obstacle else HalfSpace(np.zeros(dim), np.eye(dim)[-1]),
        law=law(domain) if law else Coulomb(0.3),
        method=method,
    )
    density = (energy or LinearElastic.from_young(1000.0, 0.3)).energy(u)
    bcs = [fem.dirichletbc(top, held)]
    return ContactProblem(density * ufl.dx, u, [surface], bcs=bcs, r=r), top


def put(top, motion):
    top.x.array[:] = np.tile(motion, len(top.x.array) // len(motion))


def cycle(top):
    """A load: down in the first unit of time, then to the right and back in two each."""

    def load(t):
        motion = np.zeros(top.function_space.mesh.geometry.dim)
        motion[0] = 0.012 * np.interp(t, [1, 3, 5], [0, 1, -1])
        motion[-1] = -0.01 * min(t, 1.0)
        put(top, motion)

    return load


def klarbring():
    """The node with kt = kn = 2, k = 1 and friction 3, under (-g, -1); its Constant g."""
    system = element((1.0, 1.0), 3.0, 1.0, (-2.0, 0.0), (0.0, -2.0))
    return system.problem, system.constant
