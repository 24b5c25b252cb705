"""TODO."""

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
)
from dolfinx_contact.materials import LinearElastic
from support.blocks import box, facets

COMM = MPI.COMM_WORLD


def block(
    cell="quad",
    n=1,
    *,
    comm=COMM,
    material=None,
    weight=0.0,
    friction=0.0,
    degree=1,
    height=0.0,
    held=None,
    size=1.0,
):
    """A block over a floor, with the Function on its top if that is held."""
    domain = box(comm, n, cell, size=size)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    up = np.eye(dim)[-1]
    material = material or LinearElastic.from_young(1000.0, 0.3)
    surface = ContactSurface(
        u,
        facets(domain, dim - 1, 0.0),
        obstacle=HalfSpace(-height * up, up),
        law=Coulomb(friction) if friction else Frictionless(),
    )
    pull = fem.Constant(domain, float(weight)) * u[dim - 1] * ufl.dx
    bcs = []
    if held is not None:
        top = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, size))
        held = fem.Function(V)
        bcs = [fem.dirichletbc(held, top)]
    return ContactProblem(material.energy(u) * ufl.dx + pull, u, [surface], bcs=bcs), held
