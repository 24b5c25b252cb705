"""Rigid punches on an elastic block."""

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    RigidBody,
    materials,
)
from support.blocks import box, facets

COMM = MPI.COMM_WORLD


def block(
    obstacle,
    dim=2,
    n=4,
    law=None,
    *,
    method=None,
    degree=1,
    comm=COMM,
    size=1.0,
    young=1000.0,
    where=None,
    more=(),
    hyper=False,
    options=None,
):
    """A block held at its bottom, with contact on its top (or on ``where``: (obstacle, facets))."""
    domain = box(comm, n, "tri" if dim == 2 else "tet", size=size)
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    low = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 0.0))
    parts = where(domain) if where else [(obstacle, facets(domain, dim - 1, size))]
    surfaces = [
        ContactSurface(u, f, obstacle=o, law=law or Coulomb(0.3), method=method, name=f"top {i}")
        for i, (o, f) in enumerate(parts)
    ]
    material = materials.LinearElastic.from_young(young, 0.3)
    if hyper:
        material = materials.NeoHookean(600.0, 400.0)
    bcs = [fem.dirichletbc(np.zeros(dim), low, V), *(bc(V) for bc in more)]
    return ContactProblem(material.energy(u) * ufl.dx, u, surfaces, bcs=bcs, petsc_options=options)


def punch(dim=2, size=1.0, **given):
    """A flat punch on the top of the block, about the middle of its face."""
    up = np.eye(dim)[-1]
    middle = size * (0.5 * np.ones(dim) + 0.5 * up)
    return RigidBody(HalfSpace(size * up, -up), about=middle, name="punch", **given)
