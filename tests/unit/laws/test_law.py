"""The contact rows against the law written independently in numpy, and their derivative."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import KINDS, block, randomise, remainders

from dolfinx_contact import Coulomb, Frictionless, HalfSpace, Sphere, Tresca
from dolfinx_contact.laws import LawAtPoints, PointData, status
from dolfinx_contact.materials import CiarletGeymonat, NeoHookean, StVenantKirchhoff

COMM = MPI.COMM_WORLD
LAWS = [Frictionless(), Coulomb(3.0), Tresca(3.0)]


def project(vectors, radius):
    size = np.linalg.norm(vectors, axis=1)
    return vectors * np.minimum(1.0, radius / np.where(size > 0, size, 1.0))[:, None]


@pytest.mark.ranks(2)
@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
@pytest.mark.parametrize(("dim", "cell"), KINDS)
@pytest.mark.verifies(
    "Coulomb",
    "Signorini",
    "Tresca",
    "nodal contact",
    reference="independent code: the law of Alart and Curnier in numpy",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_nodal_rows_are_alart_curnier(dim, cell, law):
    normal = np.array([0.3, 0.2, 1.0])[-dim:]
    friction = 1.5 if dim == 2 else 3.0  # so that all statuses occur
    if isinstance(law, Coulomb):
        law = Coulomb(friction)
    plane = HalfSpace(0.01 * np.ones(dim), normal)
    problem = block(n=24 if dim == 2 else 6, cell=cell, law=law, obstacle=plane, r=70.0)
    (surface,) = problem.surfaces
    x = randomise(problem, 0, 0.02, 10.0)
    b = problem.create_vector()
    state = problem.residual(x, b)
    n = surface.points.number
    rows = problem.equations.unknowns.blocks(b)[1].reshape(n, dim)

    # The law, from nothing but the nodal values and the definition of the obstacle.
    nodes = surface.points.vertex_nodes[:n]
    u = problem.u.x.array.reshape(-1, dim)[nodes]
    multiplier = surface.multiplier.x.array.reshape(-1, dim)[:n]
    position = problem.V.tabulate_dof_coordinates()[nodes][:, :dim]
    out = normal / np.linalg.norm(normal)
    gap = (position + u - 0.01) @ out
    tangential = u - np.outer(u @ out, out)
    pressure = np.maximum(0.0, multiplier @ out - 70 * gap)
    shear = multiplier - np.outer(multiplier @ out, out) - 70 * tangential
    radius = {Frictionless: 0 * pressure, Coulomb: friction * pressure, Tresca: 3.0 + 0 * pressure}
    answer = np.outer(pressure, out) + project(shear, radius[type(law)])
    expected = (multiplier - answer) * surface.points.geometry.vertex_areas[:n, None]
    np.testing.assert_allclose(rows, expected, atol=1e-13 * 10)

    # Nothing above held by chance.
    letters = "".join(problem.comm.allgather("".join(status.letters(dim)[state.statuses[0]])))
    assert set(letters) & set("oKPMS")
    if isinstance(law, Coulomb):
        assert {"o", "k"} < set(letters)


@pytest.mark.parametrize(
    ("cell", "method", "degree", "multiplier_degree"),
    [
        ("tri", "nodal", 1, 1),
        ("quad", "mixed", 1, 1),
        ("tri", "integral", 1, 1),
        ("quad", "integral", 2, 1),
        ("tri", "integral", 2, 2),
    ],
)
def test_a_piece_of_a_linear_bulk_in_2d_is_affine(cell, method, degree, multiplier_degree):
    obstacle = Sphere((0.5, -1.99), 2.0)
    problem = block(
        cell=cell, degree=degree, method=method, multiplier_degree=multiplier_degree,
        obstacle=obstacle,
    )  # fmt: skip
    x = randomise(problem, 1, 0.01, 10.0)
    assert remainders(problem, x, 2).max() < 1e-12


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize(
    ("cell", "degree", "material"),
    [
        ("tet", 1, None),
        ("hex", 1, NeoHookean(600.0, 400.0)),
        ("tet", 2, StVenantKirchhoff(600.0, 400.0)),
        ("tri", 1, CiarletGeymonat(600.0, 400.0, 100.0)),
    ],
)
@pytest.mark.verifies(
    "hyperelastic bodies",
    reference="differences: Taylor remainders of second order",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_the_jacobian_passes_taylors_test(cell, degree, material):
    problem = block(n=2, cell=cell, degree=degree, material=material)
    x = randomise(problem, 1, 0.01, 10.0)
    sizes = remainders(problem, x, 2)
    rates = np.log2(sizes[:-1] / sizes[1:])
    assert sizes[-1] > 1e-12  # else the test would say nothing
    np.testing.assert_allclose(rates, 2.0, atol=0.15)


def asked(law, dim, p, s):
    """Statuses of points with augmented pressures and shears, by letters."""
    n = len(p)
    normals = np.tile(-np.eye(dim)[-1], (n, 1))
    traction = np.zeros((n, dim))
    traction[:, 0] = s
    traction[:, -1] = p
    fields = {name: np.full(n, value) for name, value in law.given.items()}
    known = LawAtPoints(law, dim, n, COMM)
    found = known(np.zeros((n, dim)), traction, PointData(normals, np.zeros(n), np.ones(n), fields))
    return "".join(status.letters(dim)[found.required])


@pytest.mark.ranks(2)
def test_laws_are_classified():
    p = np.array([-1.0, 0.0, 2.0, 2.0, 2.0])
    s = np.array([0.1, 0.0, 0.5, 0.7, -0.7])
    assert asked(Coulomb(0.3), 2, p, s) == "ook-+"
    assert asked(Coulomb(0.3), 3, p, s) == "ookss"
    # Tresca grips open points as well.
    assert asked(Tresca(0.6), 2, p, s) == "KKk-+"
    assert asked(Tresca(0.05), 2, p, s) == "MKk-+".replace("k", "-")
    # Nothing is held where the disc is a point.
    assert asked(Frictionless(), 2, p, 0 * s) == "oo+++"
    assert asked(Coulomb(0.0), 2, p, 0 * s) == "oo+++"
