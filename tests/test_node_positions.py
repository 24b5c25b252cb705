"""The places of nodes, which are kept while a mesh stays as it is."""

import gc

from mpi4py import MPI

import numpy as np
import pytest

from dolfinx import fem, mesh

from dolfinx_contact import _mesh_mark
from dolfinx_contact._mesh_mark import node_positions


def space(n=3, degree=1):
    domain = mesh.create_unit_square(MPI.COMM_WORLD, n, n)
    return fem.functionspace(domain, ("Lagrange", degree, (2,)))


@pytest.mark.parametrize("degree", [1, 2])
def test_nodes_that_move(degree):
    """They are found again where the mesh has moved, and only there."""
    V = space(degree=degree)
    first = node_positions(V)
    assert np.array_equal(first, V.tabulate_dof_coordinates())
    assert node_positions(V) is first
    V.mesh.geometry.x[:, 1] *= 2.0
    moved = node_positions(V)
    assert np.array_equal(moved, V.tabulate_dof_coordinates())
    assert not np.array_equal(moved, first) or not len(first)
    with pytest.raises(ValueError, match="read-only"):
        moved += 1.0


def test_each_space_has_its_own():
    """Also one that comes where another was, and nothing is kept of those that are gone."""
    gc.collect()
    before = len(_mesh_mark._places)
    for n in range(2, 12):
        V = space(n, degree=1 + n % 2)
        W = fem.functionspace(V.mesh, ("Lagrange", 2 - n % 2))
        for here in (V, W, V):
            assert np.array_equal(node_positions(here), here.tabulate_dof_coordinates())
    del V, W, here
    gc.collect()
    assert len(_mesh_mark._places) <= before
