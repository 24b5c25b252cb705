"""Crossing cracks against an assembly in numpy: equilibrium and contact law from displacements."""

from mpi4py import MPI

import numpy as np
import pytest

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import crack

YOUNG = 100.0
POISSON = 0.3
REACH = 0.5


def cross(cells, friction, strain):
    """Displace the edges of a square [-1, 1]^2 with a cross of cracks, a group for each arm.

    Returns:
        Coordinates and displacements of the nodes, and the nodes of the triangles.
    """
    comm = MPI.COMM_SELF
    square = mesh.create_rectangle(comm, [(-1, -1), (1, 1)], [cells, cells])
    square.topology.create_entities(1)
    arms = []
    for axis, sense in ((0, -1), (1, -1), (1, 1), (0, 1)):

        def arm(x, axis=axis, sense=sense):
            along = sense * x[axis]
            return (np.abs(x[1 - axis]) < 1e-9) & (along > -1e-9) & (along < REACH + 1e-9)

        arms.append(mesh.locate_entities(square, 1, arm))
    facets = np.concatenate(arms)
    values = np.repeat(np.arange(1, 5, dtype=np.int32), [len(each) for each in arms])
    order = np.argsort(facets)
    tags = mesh.meshtags(square, 1, facets[order], values[order])
    body = crack(square, [1, 2, 3, 4], facet_tags=tags)
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    edges = fem.locate_dofs_geometrical(V, lambda x: np.isclose(np.abs(x).max(axis=0), 1.0))
    far = fem.Function(V)
    far.interpolate(lambda x: strain @ x[:2])
    law = Coulomb(friction)
    pairs = [
        ContactPair(u, body, slave=i, master=f"{i}_opposite", law=law, name=f"arm {i}")
        for i in range(1, 5)
    ]
    energy = LinearElastic.from_young(YOUNG, POISSON).energy(u) * ufl.dx
    ContactProblem(energy, u, pairs, bcs=[fem.dirichletbc(far, edges)]).solve()
    return V.tabulate_dof_coordinates()[:, :2], u.x.array.reshape(-1, 2), V.dofmap.list


def forces(x, u, triangles):
    """Return the forces holding the nodes of linear triangles, shape (nodes, 2)."""
    lame = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    shear = YOUNG / (2 * (1 + POISSON))
    result = np.zeros_like(x)
    for nodes in triangles:
        edges = np.vstack([np.ones(3), x[nodes].T])
        gradients = np.linalg.inv(edges)[:, 1:]
        area = abs(np.linalg.det(edges)) / 2
        gradient = u[nodes].T @ gradients
        strain = (gradient + gradient.T) / 2
        stress = lame * np.trace(strain) * np.eye(2) + 2 * shear * strain
        result[nodes] += area * gradients @ stress
    return result


def sides(x, triangles, place):
    """Return the nodes at a place by the quadrant of the middles of their triangles."""
    by_quadrant = {}
    for node in np.flatnonzero(np.linalg.norm(x - place, axis=1) < 1e-9):
        middles = x[triangles[(triangles == node).any(axis=1)]].mean(axis=1)
        for middle in middles:
            by_quadrant[bool(middle[0] > 0), bool(middle[1] > 0)] = node
    return by_quadrant


@pytest.mark.parametrize("friction", [0.0, 0.1])
@pytest.mark.parametrize(
    "strain",
    [((-0.01, 0.02), (0.0, -0.02)), ((0.01, 0.01), (0.01, -0.02))],
    ids=["pressed", "open"],
)
@pytest.mark.verifies(
    "cracks that cross", reference="independent code: assembly in numpy", aspects=("2D", "pairs")
)
def test_displacements_satisfy_equilibrium_and_the_contact_law(strain, friction):
    cells = 16
    x, u, triangles = cross(cells, friction, np.array(strain))
    f = forces(x, u, triangles)
    small = 1e-9 * np.abs(f).max()
    inside = np.abs(x).max(axis=1) < 1 - 1e-9
    on_crack = (np.abs(x).min(axis=1) < 1e-9) & (np.abs(x).max(axis=1) < REACH - 1e-9)
    np.testing.assert_allclose(f[inside & ~on_crack], 0.0, atol=small)
    h = 2 / cells
    largest = np.abs(u).max()
    carrying = slipping = opened = 0
    for axis in (0, 1):
        for along in np.arange(-REACH + h, REACH - h / 2, h):
            place = np.zeros(2)
            place[axis] = along
            nodes = sides(x, triangles, place)
            if abs(along) < 1e-9:
                corners = list(nodes.values())
                assert len(set(corners)) == 4
                np.testing.assert_allclose(f[corners].sum(axis=0), 0.0, atol=small)
                continue
            low, high = (
                nodes[(along > 0, side) if axis == 0 else (side, along > 0)]
                for side in (False, True)
            )
            np.testing.assert_allclose(f[low] + f[high], 0.0, atol=small)
            normal, tangent = f[high][[1 - axis, axis]]
            gap, slip = (u[high] - u[low])[[1 - axis, axis]]
            assert normal >= -small
            assert abs(tangent) <= friction * normal + small
            if abs(along) < 1.5 * h:
                continue  # these nodes satisfy the law in the mean with the crossing
            assert gap >= -1e-9 * largest
            assert min(gap / largest, normal / np.abs(f).max()) < 1e-9
            if abs(slip) > 1e-9 * largest:
                assert tangent == pytest.approx(-friction * normal * np.sign(slip), abs=small)
                slipping += normal > small
            carrying += normal > small
            opened += gap > 1e-9 * largest
    assert carrying
    assert slipping
    assert opened or strain[0][0] < 0
