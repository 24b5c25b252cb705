"""Functions by input cells: written on some ranks in either format, read on others."""

from mpi4py import MPI

import numpy as np
import pytest
from test_disk import fails, full
from test_evolution_record import CASES, Stop, record, require_same, stopping
from test_packaging import missing

import basix.ufl
from dolfinx import fem, mesh

from dolfinx_contact.records import EvolutionRecord, read_journal
from dolfinx_contact.records.checkpoint_files import (
    checkpoint_format,
    read_checkpoint,
    write_checkpoint,
)
from dolfinx_contact.records.checkpoints import Checkpoints

COMM = MPI.COMM_WORLD
CELLS = {
    "triangle": mesh.CellType.triangle,
    "quadrilateral": mesh.CellType.quadrilateral,
    "tetrahedron": mesh.CellType.tetrahedron,
    "hexahedron": mesh.CellType.hexahedron,
}


def functions(comm, cell, *, zero=False):
    """Functions of several elements on a mesh of these ranks, by name."""
    kind = CELLS[cell]
    if kind in (mesh.CellType.triangle, mesh.CellType.quadrilateral):
        domain = mesh.create_unit_square(comm, 4, 3, kind)
    else:
        domain = mesh.create_unit_cube(comm, 3, 2, 2, kind)
    dim = domain.geometry.dim
    elements = {
        "linear": ("Lagrange", 1, (dim,)),
        "quadratic": ("Lagrange", 2, (dim,)),
        "cubic": ("Lagrange", 3),
        "cellwise": ("DG", 0),
        "stress": ("DG", 1, (3, 3)),
        "points": basix.ufl.quadrature_element(cell, degree=2, scheme="default"),
    }
    if cell in ("triangle", "tetrahedron"):
        elements["edges"] = ("N1curl", 2)
    made = {}
    for name, element in elements.items():
        f = fem.Function(fem.functionspace(domain, element), name=name)
        size = int(np.prod(f.function_space.value_shape))

        def values(x, size=size):
            found = [np.sin(3 * x[0] + i) * (1 + x[1]) + x[2] for i in range(size)]
            return np.array(found) if size > 1 else found[0]

        if not zero:
            f.interpolate(values)
            f.x.scatter_forward()
        made[name] = f
    return made


def require_equal(found, wanted):
    for name, f in found.items():
        np.testing.assert_allclose(
            f.x.array, wanted[name].x.array, rtol=0, atol=1e-13, err_msg=name
        )


@pytest.mark.each_value
@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("format", ["bp", "npy"])
@pytest.mark.verifies(
    "checkpoints",
    reference="itself: the Functions that were written, on other ranks",
    aspects=(
        "2D",
        "3D",
        "records",
    ),
)
def test_on_any_ranks(cell, format, folder):
    """Written on all ranks, read on one; and the other way round."""
    if format == "bp" and checkpoint_format(COMM) != "bp":
        pytest.skip("adios4dolfinx is not installed")
    write_checkpoint(folder / "all", functions(COMM, cell), format)
    if COMM.rank == 0:
        write_checkpoint(folder / "one", functions(MPI.COMM_SELF, cell), format)
    COMM.barrier()
    found = functions(MPI.COMM_SELF, cell, zero=True)
    if COMM.rank == 0:
        read_checkpoint(folder / "all", found)
        require_equal(found, functions(MPI.COMM_SELF, cell))
    for name in ("all", "one"):
        found = functions(COMM, cell, zero=True)
        read_checkpoint(folder / name, found)
        require_equal(found, functions(COMM, cell))


@pytest.mark.parametrize("absent", ["adios4dolfinx", "adios2"])
def test_without_adios_the_other_format_is_written(monkeypatch, absent):
    """If any rank lacks it, or what it needs."""
    if COMM.rank == COMM.size - 1:
        missing(monkeypatch, "adios4dolfinx", absent)
    assert checkpoint_format(COMM) == "npy"


def test_a_checkpoint_of_adios_without_it_is_refused_by_name(folder, monkeypatch):
    pytest.importorskip("adios4dolfinx")
    write_checkpoint(folder / "x", functions(COMM, "triangle"), "bp")
    missing(monkeypatch, "adios4dolfinx")
    with pytest.raises(ModuleNotFoundError, match="x is in the format bp of ADIOS2, and adios4"):
        read_checkpoint(folder / "x", functions(COMM, "triangle", zero=True))


@pytest.mark.long
def test_a_record_goes_on_in_another_format(folder, monkeypatch):
    """Begun without ADIOS2 and resumed with it where it is: sessions name their formats."""
    here = checkpoint_format(COMM)
    with monkeypatch.context() as patch:
        patch.setattr("dolfinx_contact.records.checkpoints.checkpoint_format", lambda _: "npy")
        record(CASES["pair"](COMM), folder / "whole")
        with pytest.raises(Stop):
            record(CASES["pair"](COMM), folder / "parts", observer=stopping(3))
    with EvolutionRecord(folder / "parts", CASES["pair"](COMM), resume=True) as kept:
        assert kept.go_on().complete
    sessions = read_journal(folder / "parts").sessions
    assert [s["checkpoints"] for s in sessions] == ["npy", here]
    require_same(folder / "parts", folder / "whole")


@pytest.mark.verifies(
    "checkpoints",
    "records of histories",
    reference="itself: the run on another number of ranks",
    aspects=(
        "2D",
        "pairs",
        "records",
    ),
)
def test_resumed_on_one_rank_and_on_all(folder, monkeypatch):
    """Written on all ranks but one, without ADIOS2."""
    monkeypatch.setattr("dolfinx_contact.records.checkpoints.checkpoint_format", lambda _: "npy")
    few = COMM.Split(int(COMM.rank >= max(COMM.size - 1, 1)), COMM.rank)
    for where in ("one", "all"):
        if COMM.rank < max(COMM.size - 1, 1):
            with pytest.raises(Stop):
                record(CASES["pair"](few), folder / where, observer=stopping(3))
        COMM.barrier()
    few.Free()
    assert list((folder / "all/checkpoints/state_000003").glob("*_0.npy"))
    if COMM.rank == 0:
        with EvolutionRecord(folder / "one", CASES["pair"](MPI.COMM_SELF), resume=True) as kept:
            assert kept.go_on().complete
    with EvolutionRecord(folder / "all", CASES["pair"](COMM), resume=True) as kept:
        assert kept.go_on().complete
    one, every = (read_journal(folder / where).rows() for where in ("one", "all"))
    assert [row["status"] for row in one] == [row["status"] for row in every]
    assert len(one) > 4


def test_a_full_disk(folder, monkeypatch):
    """``OSError`` with path and reason on every rank; a record keeps what it had."""
    many = functions(COMM, "triangle")
    with full(1500), fails(folder / "x/stress.npy"):
        write_checkpoint(folder / "x", {"stress": many["stress"]}, "npy")
    monkeypatch.setattr("dolfinx_contact.records.checkpoints.checkpoint_format", lambda _: "npy")
    checkpoints = Checkpoints(folder / "kept", CASES["pair"](COMM).problem)
    monkeypatch.setattr("dolfinx_contact.records.checkpoints.reserve", lambda *_: None)
    with full(1500), fails(folder / "kept/state"):
        checkpoints.write("state", {}, functions={"stress": many["stress"]})
    assert not any((folder / "kept").iterdir())
