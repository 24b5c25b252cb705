"""Bodies that contact holds everywhere: the right answer is u = 0, and displacements are round-off.

One row of cells is clamped above and rests below on what it sticks to; the forces are those of the
loads on the lower nodes.
"""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import CELLS, facets

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, Tresca
from dolfinx_contact.algorithms import InteriorPoint, Lemke, ProjectedGradient, Uzawa
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD
ALGORITHMS = (
    "newton",
    "lemke",
    "gauss-seidel",
    "sor",
    "interior-point",
    "projected-gradient",
    "tresca",
    "penalty",
)
#: Stiffness, size and strain of the load.
UNITS = (100.0, 1.0, 0.01), (1e11, 1e-3, 1e-6), (1e-9, 1e9, 1e-3), (1e9, 1e-9, 1.0)


def one_row(cell="tri", n=4, *, young=100.0, size=1.0, strain=0.01, law=None, push=None):
    """A row of cells, and the forces that its lower nodes are to carry (dim,)."""
    dim = 2 if cell in ("tri", "quad") else 3
    if dim == 2:
        domain = mesh.create_unit_square(COMM, n, 1, CELLS[cell])
    else:
        domain = mesh.create_unit_cube(COMM, n, n, 1, CELLS[cell])
    below, above = (facets(domain, dim - 1, at) for at in (0.0, 1.0))
    domain.geometry.x[:] *= size
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    push = (0.3, *[0.0] * (dim - 2), -1.0) if push is None else push
    load = fem.Constant(domain, strain * young / size * np.array(push))
    surface = ContactSurface(
        u,
        below,
        obstacle=HalfSpace(np.zeros(dim), np.eye(dim)[-1]),
        law=law or Coulomb(20.0),
    )
    energy = LinearElastic.from_young(young, 0.3).energy(u) - ufl.dot(load, u)
    held = fem.locate_dofs_topological(V, dim - 1, above)
    bcs = [fem.dirichletbc(np.zeros(dim), held, V)]
    return ContactProblem(energy * ufl.dx, u, [surface], bcs=bcs), -0.5 * load.value * size**dim


def check(problem, carried, algorithm):
    result = problem.solve(algorithm=algorithm)
    total = result.resultants["contact"]
    size = np.abs(carried).max()
    # Of nodes that are clamped beside none: half of the body's weight is on the lower ones.
    np.testing.assert_allclose(total, carried, rtol=0, atol=1e-6 * size)
    assert set(result.tables["contact"].status) == {"k"}
    assert result.kkt_violation < 1e-6
    assert result.imbalance < 1e-6
    return result


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.verifies(
    "Newton's method",
    "Lemke",
    "Gauss-Seidel",
    "SOR",
    "interior point",
    "projected gradient",
    "Tresca's fixed point",
    "penalty",
    "units",
    reference="closed form: contact forces are the loads on the lower nodes",
    aspects=("2D",),
)
def test_every_algorithm(algorithm):
    for young, size, strain in UNITS:
        check(*one_row(young=young, size=size, strain=strain), algorithm)


@pytest.mark.parametrize("algorithm", ["newton", "gauss-seidel", "interior-point"])
@pytest.mark.parametrize("cell", ["quad", "hex"])
def test_other_cells(cell, algorithm):
    check(*one_row(cell, 3), algorithm)


@pytest.mark.parametrize("algorithm", ["newton", "lemke", "gauss-seidel", "interior-point"])
def test_one_node_that_is_not_clamped(algorithm):
    """All nodes but two are clamped, which is one cell; and bounds that are given in advance."""
    check(*one_row("tri", 1), algorithm)
    check(*one_row("quad", 1, law=Coulomb(0.5)), algorithm)


def test_a_given_bound():
    for algorithm in ("newton", "gauss-seidel", "interior-point"):
        check(*one_row(law=Tresca(1e3)), algorithm)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_without_a_load(algorithm):
    problem, _ = one_row(push=(0.0, 0.0))
    result = problem.solve(algorithm=algorithm)
    assert np.abs(problem.u.x.array).max(initial=0.0) == 0.0
    np.testing.assert_array_equal(result.tables["contact"].force, 0.0)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    "algorithm", [Lemke(), InteriorPoint(), ProjectedGradient(), Uzawa(on="points")]
)
def test_on_the_points(algorithm):
    """Forces as they must be, the scale of lengths being that of the body without contact."""
    problem, carried = one_row()
    points = problem.reduced()
    outcome = algorithm.run(points)
    assert outcome.converged, outcome.reason
    np.testing.assert_allclose(outcome.r[:, -1].sum(), carried[-1], rtol=1e-6)
    assert np.abs(outcome.a).max() < 1e-8 * np.abs(points.free).max()
