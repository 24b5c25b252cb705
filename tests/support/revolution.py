"""Discs of revolution on a floor."""

from mpi4py import MPI

import numpy as np
import pytest

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Frictionless,
    HalfSpace,
)
from dolfinx_contact.materials import (
    Axisymmetric,
    LinearElastic,
)
from support.blocks import box, facets

COMM = MPI.COMM_WORLD


FLOOR = HalfSpace((0.0, 0.0), (0.0, 1.0))


def held(V, i, domain, axis, place, value):
    dofs = fem.locate_dofs_topological(V.sub(i), 1, facets(domain, axis, place))
    return fem.dirichletbc(value, dofs, V.sub(i))


def section(n=5, cell="tri", size=1.0):
    """Of a disc of unit radius and height, cells of all shapes."""
    domain = box(COMM, n, cell)
    x = domain.geometry.x
    x[:, 0] = x[:, 0] ** 1.3
    x[:, 1] += 0.1 * np.sin(3 * x[:, 0]) * x[:, 1] * (1 - x[:, 1])
    x *= size
    return domain


def disc(
    domain, degree=1, method="nodal", *, size=1.0, modulus=1.0, law=None, lid=None, options=None
):
    """A disc on a floor, pressed by a hundredth of its height, free to widen."""
    V = fem.functionspace(domain, ("Lagrange", degree, (2,)))
    u = fem.Function(V)
    given = dict(obstacle=FLOOR, law=law or Frictionless(), method=method, axisymmetric=True)
    surface = ContactSurface(u, facets(domain, 1, 0.0), **given)
    material = Axisymmetric(LinearElastic.from_young(1000.0 * modulus, 0.3))
    energy = material.energy(u) * ufl.dx
    bcs = [held(V, 1, domain, 1, size, -0.01 * size if lid is None else lid)]
    options = {"snes_rtol": 1e-12} | (options or {})
    return ContactProblem(energy, u, [surface], bcs=bcs, petsc_options=options)


def refused(reason, make):
    with pytest.raises(ValueError, match=reason):
        make()
