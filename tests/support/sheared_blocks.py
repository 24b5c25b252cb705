"""A block in simple shear on a compliant surface."""

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    HalfSpace,
)
from dolfinx_contact.materials import LinearElastic
from support.blocks import box, facets
from support.pairs import displacement

COMM = MPI.COMM_WORLD


def rollers(u, *axes_and_values):
    """Normal displacements of planes that are held at 0."""
    V = u.function_space
    return [
        fem.dirichletbc(
            0.0,
            fem.locate_dofs_topological(
                V.sub(i), V.mesh.topology.dim - 1, facets(V.mesh, i, value)
            ),
            V.sub(i),
        )
        for i, value in axes_and_values
    ]


def sheared_block(law, dim, cell, s, pressed, shear):
    """A block in simple shear, nu = 0; normal displacements are known but at the floor."""
    domain = box(COMM, 2, cell)
    u = displacement(domain)
    up = dim - 1
    V = u.function_space
    floor = HalfSpace(np.zeros(dim), np.eye(dim)[-1])
    surface = ContactSurface(u, facets(domain, up, 0.0), obstacle=floor, law=law)
    held = fem.Function(V)
    normal = fem.Function(V.sub(up).collapse()[0])
    held.x.array.reshape(-1, dim)[:] = [s, *[0.0] * (dim - 2), -pressed]
    normal.interpolate(lambda x: -pressed * x[up])
    above = fem.locate_dofs_geometrical((V.sub(up), normal.function_space), lambda x: x[up] > 1e-9)
    ends = [
        fem.dirichletbc(normal, above, V.sub(up)),
        fem.dirichletbc(held, fem.locate_dofs_topological(V, up, facets(domain, up, 1.0))),
        *rollers(u, *[(1, y) for y in (0.0, 1.0) if dim == 3]),
    ]
    aside = ufl.FacetNormal(domain)[0] * shear * u[up] * ufl.ds
    energy = LinearElastic.from_young(1000.0, 0.0).energy(u) * ufl.dx - aside
    options = {"snes_rtol": 1e-13}
    return ContactProblem(energy, u, [surface], bcs=ends, petsc_options=options)
