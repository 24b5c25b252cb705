"""Tables, records and resumed branches where several nodes are at one place."""

import gc

from mpi4py import MPI

import numpy as np
import pytest
from support.doubled import branched

from dolfinx_contact.io import write_contact_table

COMM = MPI.COMM_WORLD


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
