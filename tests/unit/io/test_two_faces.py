"""Both faces of a pair: the pressure, and the balance of forces between them."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import facets
from support.pairs import pressed_blocks as pressed

from dolfinx import fem

COMM = MPI.COMM_WORLD

MODULUS = 1000.0 * 0.7 / (1.3 * 0.4)  # of uniaxial strain
#: Cell, cells along the lower and the upper body, degree, method.
CASES = [
    ("tri", 3, 3, 1, "nodal"),
    ("quad", 2, 2, 2, "integral"),
    ("quad", 5, 3, 1, "nodal"),  # a mortar
    ("tet", 2, 2, 1, "mixed"),
    ("tet", 2, 2, 2, "integral"),
    ("hex", 2, 3, 1, "nodal"),
    ("tet", 2, 3, 1, "nodal"),
]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.verifies(
    "matching meshes",
    "mortar",
    reference="closed form: uniaxial strain",
    aspects=(
        "2D",
        "3D",
        "pairs",
    ),
)
def test_uniform_pressure_is_exact_on_both_faces(case):
    """At all nodes of the slave, and as a force on the unit area of the master."""
    problem = pressed(*case)
    pair = problem.surfaces[0]
    result = problem.solve()
    wanted = 0.01 * MODULUS
    pressure = problem.contact_fields(pair)["pressure"].x.array
    np.testing.assert_allclose(pressure, wanted, rtol=1e-10)
    down = np.zeros(pair.dim)
    down[-1] = -wanted
    np.testing.assert_allclose(result.pairs["contact"].master, down, atol=1e-10 * wanted)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("case", CASES)
@pytest.mark.verifies(
    "balance of forces",
    reference="theorem: both faces push each other alike",
    aspects=(
        "2D",
        "3D",
        "pairs",
    ),
)
def test_forces_and_moments_between_two_faces_balance(case):
    """With pressure and shear: between the faces, and of their moments."""
    problem = pressed(*case, friction=0.25)
    pair = problem.surfaces[0]
    result = problem.solve()
    found = result.pairs["contact"]
    assert abs(found.slave[0]) > 0.1 * abs(found.slave[-1])
    assert found.imbalance < 1e-12
    assert found.moment < 1e-12
    size = np.linalg.norm(found.slave)
    np.testing.assert_allclose(found.slave, result.resultants["contact"], atol=1e-12 * size)
    np.testing.assert_allclose(found.master, -found.slave, atol=1e-12 * size)
    # What holds the lower block is the only other force on it.
    V = problem.V
    below = fem.locate_dofs_topological(V, pair.dim - 1, facets(V.mesh, pair.dim - 1, 0.0))
    n = V.dofmap.index_map.size_local
    reactions = problem.evaluate().reactions.reshape(-1, pair.dim)[below[below < n]]
    held_by = COMM.allreduce(reactions.sum(axis=0))
    np.testing.assert_allclose(found.master + held_by, 0.0, atol=1e-9 * size)
    assert result.summary()["pairs"]["contact"]["master"] == found.master.tolist()
