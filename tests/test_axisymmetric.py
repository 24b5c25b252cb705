"""Bodies of revolution: areas, patch tests, closed forms, what is refused."""

from mpi4py import MPI

import numpy as np
import pytest
from blocks import box, facets

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Frictionless,
    HalfSpace,
)
from dolfinx_contact.materials import Axisymmetric, LinearElastic, circumference

COMM = MPI.COMM_WORLD
STEEL = Axisymmetric(LinearElastic.from_young(1000.0, 0.3))
FLOOR = HalfSpace((0.0, 0.0), (0.0, 1.0))
KINDS = [
    *(("tri", 1, "nodal"), ("quad", 1, "nodal"), ("tri", 1, "mixed"), ("quad", 1, "mixed")),
    *(("tri", 1, "integral"), ("quad", 2, "integral"), ("tri", 2, "integral")),
]


def held(V, i, domain, axis, place, value):
    dofs = fem.locate_dofs_topological(V.sub(i), 1, facets(domain, axis, place))
    return fem.dirichletbc(value, dofs, V.sub(i))


def disc(n=5, cell="tri", degree=1, method="nodal", *, size=1.0, modulus=1.0, law=None, shape=None):
    """A disc of unit radius and height pressed by 0.01, free to widen."""
    domain = box(COMM, n, cell)
    x = domain.geometry.x
    x[:, 0] = x[:, 0] ** 1.3
    x[:, 1] += 0.1 * np.sin(3 * x[:, 0]) * x[:, 1] * (1 - x[:, 1])
    x *= size
    V = fem.functionspace(domain, ("Lagrange", degree, (2,)))
    u = fem.Function(V)
    given = dict(obstacle=shape or FLOOR, law=law or Frictionless(), method=method)
    surface = ContactSurface(u, facets(domain, 1, 0.0), axisymmetric=True, **given)
    material = Axisymmetric(LinearElastic.from_young(1000.0 * modulus, 0.3))
    energy = material.energy(u) * circumference(domain) * ufl.dx
    bcs = [held(V, 1, domain, 1, size, -0.01 * size)]
    return ContactProblem(energy, u, [surface], bcs=bcs, petsc_options={"snes_rtol": 1e-12})


@pytest.mark.parametrize(("cell", "degree", "method"), KINDS)
def test_uniform_pressure_on_a_disc(cell, degree, method):
    """Exact to round-off: pressure, areas, forces of the circumference, hoop strain, energy."""
    problem = disc(5, cell, degree, method)
    result = problem.solve()
    table = result.tables["contact"]
    assert table.area.sum() == pytest.approx(np.pi, rel=1e-12)
    assert (table.area > 0).all()
    np.testing.assert_allclose(table.pressure, 10.0, rtol=1e-9)
    np.testing.assert_allclose(result.resultants["contact"], [0.0, 10.0 * np.pi], rtol=1e-9)
    np.testing.assert_allclose(result.support, [0.0, -10.0 * np.pi], rtol=1e-9)
    np.testing.assert_allclose(result.external, 0.0, atol=1e-9)
    assert result.imbalance < 1e-10
    assert result.energies["bulk"] == pytest.approx(0.05 * np.pi, rel=1e-9)
    x = problem.V.tabulate_dof_coordinates()
    u = problem.u.x.array.reshape(-1, 2)
    np.testing.assert_allclose(u[:, 0], 0.003 * x[:, 0], atol=1e-11)
