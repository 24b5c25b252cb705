"""Rules that UFL estimates for energies in large strains."""

from mpi4py import MPI

import numpy as np
import pytest
from blocks import box, facets

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.materials import LinearElastic, NeoHookean, lame

COMM = MPI.COMM_WORLD
RUBBER = NeoHookean(*lame(1.0, 0.3))


def pressed(cell, degree, material, metadata):
    """A block that is pressed and dragged, its problem."""
    domain = box(COMM, 2, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    moved = np.append(np.full(dim - 1, 0.05), -0.1)
    held = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
    floor = HalfSpace(np.zeros(dim), np.eye(dim)[-1])
    surface = ContactSurface(u, facets(domain, dim - 1, 0.0), obstacle=floor, law=Coulomb(0.3))
    energy = material.energy(u) * ufl.dx(metadata=metadata)
    return ContactProblem(energy, u, [surface], bcs=[fem.dirichletbc(moved, held, V)])


@pytest.mark.parametrize(
    ("cell", "degree", "usual", "points"),
    [("hex", 1, 3, 8), pytest.param("tet", 2, 4, 14, marks=pytest.mark.long)],
)
def test_an_estimate_that_is_dear(cell, degree, usual, points, caplog):
    """It is warned of, with what to write instead, which changes forces by less than 2e-5."""
    estimated = pressed(cell, degree, RUBBER, {})
    asked = f'"quadrature_degree": {usual}' + "}) there are " + f"{points},"
    words = [r.getMessage() for r in caplog.records if "UFL estimates" in r.getMessage()]
    assert len(words) == (COMM.rank == 0)
    assert all(asked in each for each in words)
    caplog.clear()
    named = pressed(cell, degree, RUBBER, {"quadrature_degree": usual})
    assert "UFL estimates" not in caplog.text
    forces = [p.solve().tables["contact"].rn.sum() for p in (estimated, named)]
    assert forces[1] == pytest.approx(forces[0], rel=2e-5)
    assert forces[1] != forces[0]


@pytest.mark.parametrize(
    ("cell", "degree", "material"),
    [("tet", 1, RUBBER), ("tri", 2, RUBBER), ("hex", 1, LinearElastic(1.0, 1.0))],
)
def test_estimates_that_will_do(cell, degree, material, caplog):
    pressed(cell, degree, material, {})
    assert "UFL estimates" not in caplog.text


@pytest.mark.parametrize(
    ("metadata", "dear"),
    [
        ({"quadrature_rule": "default"}, True),
        ({"quadrature_degree": -1}, True),
        ({"quadrature_rule": "vertex"}, False),
    ],
)
def test_rules_without_a_degree(metadata, dear, caplog):
    """A rule alone does not name one; -1 is an estimate."""
    pressed("hex", 1, RUBBER, metadata)
    assert ("UFL estimates" in caplog.text) == (dear and COMM.rank == 0)
