"""A block whose load, obstacle or displacement follows the parameter gamma."""

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.materials import LinearElastic
from support.blocks import box, facets

COMM = MPI.COMM_WORLD


def driven_block(kind, cell="quad", n=4, material=None, comm=COMM):
    """A block whose parameter is of the given kind, with the starting value of gamma."""
    domain = box(comm, n, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    top = fem.Function(V)
    gamma = fem.Constant(domain, 0.5)
    x = ufl.SpatialCoordinate(domain)
    energy = (material or LinearElastic.from_young(1000.0, 0.3)).energy(u) * ufl.dx
    friction = 0.3
    point = fem.Constant(domain, (0.0,) * dim)
    driven = []
    move = ufl.as_vector([0.004, *[0.0] * (dim - 2), -0.01 - 0.001 * x[0]])
    if kind == "load":
        energy -= gamma**2 * ufl.dot(ufl.as_vector([3.0, *[0.0] * (dim - 2), -2.0]), u) * ufl.dx
    elif kind == "friction":
        friction = 0.2 * gamma
    elif kind == "obstacle":
        point = ufl.as_vector([*[0.0] * (dim - 1), 0.005 * gamma])
    elif kind == "dirichlet":
        move = ufl.sin(gamma) * move
        driven = [(top, move)]
    points = V.element.interpolation_points
    points = points() if callable(points) else points
    top.interpolate(fem.Expression(move, points))
    held = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
    surface = ContactSurface(
        u,
        facets(domain, dim - 1, 0.0),
        obstacle=HalfSpace(point, np.eye(dim)[-1]),
        law=Coulomb(friction),
    )
    problem = ContactProblem(energy, u, [surface], bcs=[fem.dirichletbc(top, held)])
    return ParametricContact(problem, gamma, driven=driven)
