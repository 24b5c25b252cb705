"""Cracks that cross: groups of their own for the arms, or a refusal that says so."""

from mpi4py import MPI

import numpy as np
import pytest

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import crack

COMM = MPI.COMM_WORLD
NEAR = 1e-9


def crossing(groups):
    """A square with a crack along each axis; ``groups`` are tags of the arms right, left, up, down.

    Returns:
        The body in which the crack is, and the tags.
    """
    domain = mesh.create_rectangle(
        COMM, [[-1.0, -1.0], [1.0, 1.0]], [8, 8], mesh.CellType.quadrilateral
    )
    domain.topology.create_entities(1)
    at, values = [], []
    for tag, (axis, sense) in zip(groups, [(0, 1), (0, -1), (1, 1), (1, -1)], strict=False):

        def arm(x, axis=axis, sense=sense):
            along, across = sense * x[axis], np.abs(x[1 - axis])
            return (across < NEAR) & (along > -NEAR) & (along < 0.5 + NEAR)

        found = mesh.locate_entities(domain, 1, arm)
        at.append(found)
        values.append(np.full(len(found), tag, dtype=np.int32))
    facets = np.concatenate(at)
    order = np.argsort(facets)
    tags = mesh.meshtags(domain, 1, facets[order], np.concatenate(values)[order])
    chosen = list(dict.fromkeys(groups))
    return crack(domain, chosen, facet_tags=tags), chosen


def squeezed(groups):
    """The square under displacements -x/100 of its sides, and the error of what it answers."""
    body, chosen = crossing(groups)
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u, given = fem.Function(V), fem.Function(V)
    pairs = [
        ContactPair(u, body, slave=t, master=f"{t}_opposite", law=Coulomb(0.5), name=f"arm {t}")
        for t in chosen
    ]
    given.interpolate(lambda x: -0.01 * x[:2])
    sides = fem.locate_dofs_geometrical(V, lambda x: np.isclose(np.abs(x[:2]).max(axis=0), 1.0))
    energy = LinearElastic.from_young(100.0, 0.3).energy(u) * ufl.dx
    return ContactProblem(energy, u, pairs, bcs=[fem.dirichletbc(given, sides)]), given


@pytest.mark.parametrize("groups", [(1, 1, 2), (1, 1, 2, 2)], ids=["T", "X"])
def test_two_groups_are_refused(groups):
    with pytest.raises(ValueError, match=r"where cracks cross.*each arm needs a group of its own"):
        squeezed(groups)


@pytest.mark.chatty
@pytest.mark.parametrize("groups", [(1, 2, 3), (1, 2, 3, 4)], ids=["T", "X"])
def test_closed_arms_carry_uniform_compression(groups, caplog):
    """A patch test, but for the split of the reactions at the crossing, which is said."""
    problem, given = squeezed(groups)
    said = any("share nodes" in record.getMessage() for record in caplog.records)
    assert said == (COMM.rank == 0)
    result = problem.solve()
    error = np.abs(problem.u.x.array - given.x.array).max(initial=0.0)
    assert COMM.allreduce(error, op=MPI.MAX) < 1e-12
    pressure = 0.01 * 100.0 / ((1 + 0.3) * (1 - 2 * 0.3))
    for table in result.tables.values():
        # At the crossing, and where the arm ends, pressures are others.
        inside = (np.abs(table.x[:, :2]).max(axis=1) > 0.1) & (table.rn > 0)
        assert inside.sum() == 1
        np.testing.assert_allclose(table.pressure[inside], pressure, rtol=1e-9)
