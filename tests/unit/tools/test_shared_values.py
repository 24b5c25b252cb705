"""What ranks share: values at common places, and sums and extremes of a few numbers."""

from mpi4py import MPI

import numpy as np
import pytest

from dolfinx import fem, mesh

from dolfinx_contact._shared import SharedValues, anywhere, largest, total


def _cells_of_a_square():
    domain = mesh.create_unit_square(MPI.COMM_WORLD, 5, 4)
    V = fem.functionspace(domain, ("Lagrange", 1))
    owned = domain.topology.index_map(2).size_local
    return V, V.dofmap.list[:owned]


@pytest.mark.ranks(2, 3)
def test_sums_over_ranks():
    """Each cell adds a third of its area at its corners: integrals of the hats, ghosts included."""
    V, cells = _cells_of_a_square()
    shared = SharedValues(V.dofmap.index_map)
    area = 1 / 40
    for shape in ((), (2,), (2, 3)):
        factor = 1.0 + np.arange(np.prod(shape, dtype=int)).reshape(shape)
        parts = np.full((*cells.shape, *shape), area / 3) * factor
        found = shared.sums(cells, parts)
        x = V.tabulate_dof_coordinates()
        ends_x = np.isclose(x[:, 0], 0) | np.isclose(x[:, 0], 1)
        ends_y = np.isclose(x[:, 1], 0) | np.isclose(x[:, 1], 1)
        around = np.where(ends_x & ends_y, 0, np.where(ends_x | ends_y, 3, 6))
        # Diagonals of the square start and end at two of its corners.
        along = np.isclose(x[:, 0], x[:, 1])
        around = np.where(ends_x & ends_y, np.where(along, 2, 1), around)
        expected = around.reshape(-1, *[1] * len(shape)) * (area / 3) * factor
        np.testing.assert_allclose(found, expected, rtol=1e-13)


@pytest.mark.ranks(2)
def test_values_from_owners():
    """Ghosts have what their owners have; values are kept when others are asked for."""
    V, _ = _cells_of_a_square()
    index_map = V.dofmap.index_map
    shared = SharedValues(index_map)
    n = index_map.size_local
    size = n + index_map.num_ghosts
    numbers = index_map.local_to_global(np.arange(size, dtype=np.int32)).astype(float)
    expected = np.column_stack([numbers, numbers**2])
    values = expected.copy()
    values[n:] = np.nan
    found = shared.from_owners(values)
    again = shared.from_owners(2 * values[:n])
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(again, 2 * expected)
    np.testing.assert_array_equal(shared.zeros(2).array, 0.0)
    np.testing.assert_array_equal(again, 2 * expected)
    assert shared.from_owners(np.zeros((n, 0))).shape == (size, 0)


@pytest.mark.ranks(2, 3)
def test_a_few_numbers_of_all_ranks():
    """Sums and extremes keep shapes; what is no number on one rank is none on any.

    Ranks that have nothing may have integers, as NumPy counts it.
    """
    comm = MPI.COMM_WORLD
    r = comm.rank
    n = comm.size
    whole = n * (n - 1) // 2
    mine = np.arange(6).reshape(3, 2)
    for values in (mine, mine.T, mine[0, 1]):
        found = total(comm, values + r)
        np.testing.assert_array_equal(found, n * values + whole)
        assert found.shape == values.shape
        assert found.dtype == np.float64
    nothing = np.bincount(np.zeros(0, dtype=int), np.zeros(0), 2)
    found = total(comm, nothing if r == 0 else np.array([0.5, 0.25]))
    np.testing.assert_array_equal(found, (n - 1) * np.array([0.5, 0.25]))
    np.testing.assert_array_equal(total(comm, np.zeros((0, 2))), np.zeros((0, 2)))
    np.testing.assert_array_equal(largest(comm, [[r, -r], [r % 2, -1]]), [[n - 1, 0], [n > 1, -1]])
    for rank in range(n):
        found = largest(comm, [np.nan if r == rank else 1.0, r, -np.inf])
        np.testing.assert_array_equal(found, [np.nan, n - 1, -np.inf])
    assert anywhere(comm, r == n - 1, False, r == 0) == [True, False, True]
    assert anywhere(comm) == []
