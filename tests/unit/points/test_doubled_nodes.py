"""Tables, records and resumed branches where several nodes are at one place."""

import gc

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import box, facets

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, ParametricContact
from dolfinx_contact.io import write_contact_table
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import crack

COMM = MPI.COMM_WORLD


def branched(comm, n=6, *, slave="5_opposite", method="nodal"):
    """A block with a crack across it and an arm from there to its top, whose sides part with gamma.

    At the end of the arm two nodes above the crack face one below; the left part is pressed and
    dragged, the right one lifted.
    """
    domain = box(comm, n, "quad")
    domain.topology.create_entities(1)
    flat = mesh.locate_entities(domain, 1, lambda x: np.isclose(x[1], 0.5))
    arm = mesh.locate_entities(domain, 1, lambda x: np.isclose(x[0], 0.5) & (x[1] > 0.5 - 1e-9))
    every = [flat, arm, facets(domain, 1, 0.0), facets(domain, 1, 1.0)]
    values = np.repeat(np.array([5, 6, 1, 4], dtype=np.int32), [len(f) for f in every])
    order = np.argsort(np.concatenate(every))
    tags = mesh.meshtags(domain, 1, np.concatenate(every)[order], values[order])
    body = crack(domain, [5, 6], facet_tags=tags)
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    top = fem.Function(V)
    gamma = fem.Constant(body.mesh, 0.0)
    x = ufl.SpatialCoordinate(body.mesh)
    left = ufl.conditional(ufl.lt(x[0], 0.49), 1.0, 0.0)
    way = ufl.as_vector([-0.04 * left * gamma, 0.02 * gamma * (1 - left) - 0.02 * left])
    still = fem.locate_dofs_topological(V, 1, body.facet_tags.find(1))
    moved = fem.locate_dofs_topological(V, 1, body.facet_tags.find(4))
    # The two nodes at the middle of the top are free.
    middle = np.isclose(V.tabulate_dof_coordinates()[moved, 0], 0.5)
    bcs = [fem.dirichletbc(np.zeros(2), still, V), fem.dirichletbc(top, moved[~middle])]
    master = {"5_opposite": 5}[slave]
    pair = ContactPair(u, body, slave=slave, master=master, law=Coulomb(0.3), method=method)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [pair], bcs=bcs)
    return ParametricContact(problem, gamma, driven=[(top, way)])


def force(problem):
    return float(problem.table(problem.surfaces[0]).rt.sum())


def doubled(table):
    """The rows of the two points at the end of the arm."""
    return np.flatnonzero(np.isclose(table.x[:, 0], 0.5) & np.isclose(table.x[:, 1], 0.5))


def alone(make):
    """What rank 0 makes by itself; on every rank."""
    gc.collect()  # what other ranks have a part in goes now: they wait below
    return COMM.bcast(make(MPI.COMM_SELF) if COMM.rank == 0 else None)


def columns(system):
    """The table at the end of the branch."""
    t = system.problem.table(system.problem.surfaces[0])
    return {k: getattr(t, k) for k in ("x", "un", "ut", "force", "pressure", "letters")}


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize("method", ["nodal", "integral"])
@pytest.mark.verifies(
    "cracks",
    "matching meshes",
    reference="itself: the solve on one rank",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_tables_do_not_depend_on_ranks(method, folder):
    def found(comm):
        system = branched(comm, method=method)
        system.set_parameter(1.0)
        result = system.problem.solve()
        write_contact_table(comm, folder / str(comm.size), result.tables.values())
        return columns(system)

    for size in {1, COMM.size}:
        if COMM.rank == 0:
            (folder / str(size)).mkdir()
    COMM.barrier()
    single = alone(found)
    several = found(COMM)
    np.testing.assert_array_equal(single["letters"], several["letters"])
    for key in ("x", "un", "ut", "force", "pressure"):
        scale = np.abs(single[key]).max()
        np.testing.assert_allclose(several[key], single[key], atol=1e-9 * scale, err_msg=key)
    rows = [(folder / str(n) / "contact.csv").read_text().splitlines() for n in (1, COMM.size)]
    words = [[line.split(",")[16] for line in lines] for lines in rows]
    assert words[0] == words[1]
    assert len(several["x"]) == (8 if method == "nodal" else 2 * 6)


@pytest.mark.ranks(2)
def test_two_points_at_one_place_differ():
    system = branched(COMM)
    system.set_parameter(1.0)
    table = system.problem.solve().tables["contact"]
    a, b = doubled(table)
    np.testing.assert_array_equal(table.x[a], table.x[b])
    assert table.letters[a] != table.letters[b]
    assert np.linalg.norm(table.ut[a] - table.ut[b]) > 1e-3
