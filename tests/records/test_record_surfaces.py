"""Records hold the outer surface of bodies, and can be looked at without the problem."""

from mpi4py import MPI

import numpy as np
import pytest
from support import recorded_evolution
from support.recorded_run import moved_block, record, resume

from dolfinx_contact.records import BranchRecord, EvolutionRecord, read_journal

COMM = MPI.COMM_WORLD
KEPT = {"surface_displacement": True}
#: Vertices, facets of the boundary (in 2D cells), and facets of the contact face.
SIZES = {"tri": (25, 32, 4), "quad": (25, 16, 4), "tet": (26, 48, 8), "hex": (26, 24, 4)}


def nodal_values(u):
    """Displacement at all nodes of all ranks, by place."""
    V = u.function_space
    x = V.tabulate_dof_coordinates()
    values = u.x.array.reshape(len(x), -1)
    parts = COMM.allgather((x, values))
    return {
        tuple(place): value
        for places, found in parts
        for place, value in zip(np.round(places, 9) + 0.0, found, strict=True)
    }


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("cell", "degree"),
    [
        *(
            pytest.param(*case, marks=pytest.mark.long)
            for case in [("tri", 2), ("quad", 1), ("hex", 2), ("tet", 2)]
        ),
        *(("tri", 1), ("quad", 2), ("tet", 1), ("hex", 1)),
    ],
)
@pytest.mark.verifies(
    "records of branches",
    reference="closed form: displacements that were prescribed",
    aspects=(
        "2D",
        "3D",
        "branches",
        "records",
    ),
)
def test_record_keeps_the_displacement_of_every_point(cell, degree, folder):
    n = 4 if cell in ("tri", "quad") else 2
    options = {"cell": cell, "degree": degree, "n": n}
    system, functionals = moved_block(COMM, **options)
    record(system, functionals, folder, every=2, max_steps=3, **KEPT)
    journal = read_journal(folder)
    surface = journal.surface()
    vertices, cells, facets = SIZES[cell]
    dim = 2 if n == 4 else 3
    assert (surface.x.shape, len(surface.cells)) == ((vertices, 3), cells)
    assert (np.diff(surface.nodes) > 0).all()
    assert list(surface.contact) == ["contact"]
    assert surface.opposite == {}
    assert len(surface.contact["contact"]) == facets == len(surface.obstacles["contact"])
    np.testing.assert_allclose(surface.x[surface.contact["contact"], dim - 1], 0, atol=1e-12)
    top = np.isclose(surface.x[:, dim - 1], 1)
    x = surface.x[top]
    for index, entry in enumerate(journal.entries()):
        state = journal.surface_at(index)
        assert state.u.dtype == np.float32
        gamma = entry.gamma
        down = -0.02 * gamma * (1 + 0.1 * x[:, 0] + 0.037 * x[:, dim - 2])
        np.testing.assert_allclose(state.u[top, 0], 0.02 * gamma**2, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(state.u[top, dim - 1], down, rtol=1e-6, atol=1e-12)
        floor, moved, normals = state.obstacles["contact"]
        assert floor.dtype == np.float64
        np.testing.assert_allclose(floor[:, dim - 1], -0.002, atol=1e-9)
        np.testing.assert_array_equal(moved, 0)
        np.testing.assert_allclose(abs(normals[:, dim - 1]), 1)
    with BranchRecord(folder, system, functionals, resume=True) as kept:
        for index in (0, 2):
            point, _ = kept.state(0, index)
            system.result_at(point)
            every = nodal_values(system.problem.u)
            wanted = [every[tuple(place)] for place in np.round(surface.x, 9) + 0.0]
            found = kept.journal.surface_at(index).u
            np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-9)


@pytest.mark.ranks(2)
def test_record_keeps_the_order_of_vertices_on_other_ranks(folder):
    """A record continuing on one rank has the vertices in the order in which it began."""
    record(*moved_block(COMM), folder / "parts", max_steps=3, **KEPT)
    if COMM.rank == 0:
        alone = MPI.COMM_SELF
        before = (folder / "parts" / "surface.npz").read_bytes()
        resume(folder / "parts", *moved_block(alone), max_steps=6)
        assert (folder / "parts" / "surface.npz").read_bytes() == before
        record(*moved_block(alone), folder / "whole", max_steps=6, **KEPT)
        parts, whole = (read_journal(folder / name) for name in ("parts", "whole"))
        a, b = (journal.surface() for journal in (parts, whole))
        np.testing.assert_array_equal(a.nodes, b.nodes)
        np.testing.assert_allclose(a.x, b.x, atol=1e-15)
        rows = [{tuple(sorted(row)) for row in part.cells.tolist()} for part in (a, b)]
        assert rows[0] == rows[1]
        assert len(parts.entries()) == len(whole.entries()) == 7
        for index in range(7):
            c, d = (journal.surface_at(index) for journal in (parts, whole))
            np.testing.assert_allclose(c.u, d.u, rtol=1e-5, atol=1e-9)
            np.testing.assert_allclose(
                c.obstacles["contact"], d.obstacles["contact"], rtol=1e-5, atol=1e-9
            )
    COMM.barrier()


def same_table(found, table):
    """Return whether columns of a record equal a `ContactTable` exactly."""
    for name, values in found.items():
        wanted = (
            table.internal[name.removeprefix("internal.")]
            if name.startswith("internal.")
            else getattr(table, name)
        )
        assert values.dtype == wanted.dtype, name
        np.testing.assert_array_equal(values, wanted, err_msg=name)
    assert {"x", "un", "ut", "force", "pressure", "shear", "letters"} <= set(found)


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "records of branches",
    "records of histories",
    "records of motions",
    reference="itself: the tables of the run",
    aspects=("records",),
)
def test_record_keeps_tables_exactly(folder):
    """Tables of branches, steps and motions are stored exactly."""
    system, functionals = moved_block(COMM)
    record(system, functionals, folder / "branch", every=2, max_steps=3, **KEPT)
    journal = read_journal(folder / "branch")
    with BranchRecord(folder / "branch", system, functionals, resume=True) as kept:
        for index in (0, 2):
            point, _ = kept.state(0, index)
            (table,) = system.result_at(point).tables.values()
            found = journal.surface_at(index).tables["contact"]
            assert "".join(found["letters"]) == journal.entries()[index].status
            same_table(found, table)
    for name in ("pair", "moving"):
        evolution = getattr(recorded_evolution, name)(COMM)
        with EvolutionRecord(folder / name, evolution, **KEPT) as kept:
            history = evolution.run([0.0, 0.25, 0.5], record=kept)
        journal = read_journal(folder / name)
        for index, step in enumerate(history.steps, 1):
            found = journal.surface_at(index).tables
            assert list(found) == list(step.result.tables)
            for surface, table in step.result.tables.items():
                same_table(found[surface], table)


def test_unreadable_surfaces_are_refused(folder):
    system, functionals = moved_block(COMM)
    record(system, functionals, folder / "none", max_steps=2)
    record(system, functionals, folder / "all", max_steps=2, **KEPT)
    none = read_journal(folder / "none")
    assert len(none.surface().cells) == 16
    assert not (folder / "none" / "surface").exists()
    with pytest.raises(ValueError, match="record with surface_displacement=True"):
        none.surface_at(1)
    journal = read_journal(folder / "all")
    with pytest.raises(ValueError, match="points 0 to 2 are recorded, not 3"):
        journal.surface_at(3)
    with pytest.raises(ValueError, match="no branch 5 was recorded"):
        journal.surface_at(0, 5)
    COMM.barrier()
    if COMM.rank == 0:
        file = folder / "all" / "surface" / "branch_0000_point_000001.npz"
        content = file.read_bytes()
        middle = len(content) // 2
        for broken in (
            content[:middle],
            content[: middle - 40] + b"x" * 80 + content[middle + 40 :],
        ):
            file.write_bytes(broken)
            with pytest.raises(ValueError, match="is damaged"):
                journal.surface_at(1)
        file.unlink()
        with pytest.raises(ValueError, match="is missing"):
            journal.surface_at(1)
        (folder / "all" / "surface.npz").unlink()
        with pytest.raises(ValueError, match="is missing"):
            journal.surface()
    COMM.barrier()
