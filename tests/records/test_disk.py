"""Full disks, things in the way, locks, and ranks that lose mpirun: OSError everywhere, no harm."""

import errno
import os
import resource
import signal
import subprocess
import time
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from support import recorded_evolution, recorded_path
from support.blocks import block
from support.recorded_run import moved_block, record, record_in

from dolfinx_contact.continuation import BranchStep, Observer, StepControl
from dolfinx_contact.io import write_contact_table, write_fields, write_summary
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.records import (
    BranchRecord,
    EvolutionRecord,
    PathRecord,
    journal_file,
    read_journal,
    write_series,
)
from dolfinx_contact.records.journal import FILE_NAME

COMM = MPI.COMM_WORLD
TREE = Path(__file__).resolve().parents[2]
MATERIAL = LinearElastic.from_young(1000.0, 0.3)
pytestmark = pytest.mark.usefixtures("nothing_hangs")


@contextmanager
def full(size):
    """A disk on which no file may be larger than ``size`` bytes."""
    COMM.barrier()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def contents(folder):
    """Files below a folder, hidden ones too; the same on every rank."""
    found = None
    if COMM.rank == 0:
        paths = sorted(p for p in folder.rglob("*") if p.is_file() or not any(p.iterdir()))
        found = {str(p.relative_to(folder)): p.is_file() and p.read_bytes() for p in paths}
    return COMM.bcast(found)


@contextmanager
def fails(path, number=errno.EFBIG):
    """``OSError`` on every rank, the same, with the path and the reason."""
    with pytest.raises(OSError, match=os.strerror(number)) as info:
        yield
    assert info.value.errno == number
    assert info.value.filename == str(path)
    assert len(set(COMM.allgather(str(info.value)))) == 1


def on_root(do):
    if COMM.rank == 0:
        do()
    COMM.barrier()


# -- fields ----------------------------------------------------------------------------------------


#: On a full disk, ADIOS2 makes ranks wait for each other.
FORMATS = ["vtx", "vtk"] if COMM.size == 1 else ["vtk"]


@pytest.mark.ranks(2)
@pytest.mark.parametrize("format", FORMATS)
def test_full_disk_keeps_the_last_fields(folder, format):
    """The state of before is still there, whole, and nothing else."""
    problem = block(n=6, cell="tri")
    problem.solve()
    stress = MATERIAL.full_stress(problem.u)
    write_fields(folder, problem, stress=stress, format=format)
    before = contents(folder)
    problem.u.x.array[:] *= 2.0
    with full(3_000), pytest.raises(OSError, match=r"File too large|No space left") as info:
        write_fields(folder, problem, stress=stress, format=format)
    assert info.value.filename.startswith(str(folder))
    assert contents(folder) == before
    with full(3_000), pytest.raises(OSError, match=r"File too large|No space left"):
        write_fields(folder / "new", problem, format=format)
    assert set(contents(folder)) == {*before, "new"}
    write_fields(folder, problem, stress=stress, format=format)
    after = contents(folder)
    assert after != before


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("format", "name", "make", "number"),
    [
        ("vtx", "body.bp", Path.touch, errno.ENOTDIR),
        ("vtx", "contact.bp", lambda p: (p / "mine").mkdir(parents=True), errno.EEXIST),
        ("vtk", "contact.pvd", Path.mkdir, errno.EISDIR),
        ("vtk", "paraview.py", Path.mkdir, errno.EISDIR),
    ],
)
def test_fields_do_not_replace_other_files(folder, format, name, make, number):
    on_root(lambda: make(folder / name))
    before = contents(folder)
    with fails(folder / name, number):
        write_fields(folder, block(cell="tri"), format=format)
    assert contents(folder) == before


@pytest.mark.ranks(2)
@pytest.mark.parametrize("theirs", [b"print(1)\n", b"", None])
def test_a_script_of_the_users_own_stays(folder, caplog, theirs):
    """A script of the user remains, with a warning; a script of the package is replaced."""
    problem = block(cell="tri")
    script = folder / "paraview.py"
    write_fields(folder, problem)
    ours = contents(folder)["paraview.py"]
    old = ours.replace(b"FOLDER", b"OLD") if theirs is None else theirs
    on_root(lambda: script.write_bytes(old))
    files = write_fields(folder, problem)
    assert files[0].exists()
    assert contents(folder)["paraview.py"] == (ours if theirs is None else theirs)
    said = f"{script} is not one of this package, and is left"
    warned = [r for r in caplog.records if said in r.getMessage()]
    assert len(warned) == int(theirs is not None and COMM.rank == 0)


# -- tables, summaries, pictures -------------------------------------------------------------------


@pytest.mark.ranks(2)
def test_full_disk_keeps_table_and_summary(folder):
    result = block(cell="tri").solve()
    writers = {
        "contact.csv": lambda f: write_contact_table(COMM, f, result.tables.values()),
        "summary.json": lambda f: write_summary(COMM, f, {"numbers": list(range(200))}),
    }
    for name, write in writers.items():
        write(str(folder))
        before = contents(folder)
        with full(100), fails(folder / name):
            write(folder)
        assert contents(folder) == before
        with fails(folder / "missing" / name, errno.ENOENT):
            write(folder / "missing")
        on_root((folder / name).unlink)
        on_root((folder / name).mkdir)
        with fails(folder / name, errno.EISDIR):
            write(folder)
        assert contents(folder) == {name: False}
        on_root((folder / name).rmdir)


# -- records ---------------------------------------------------------------------------------------


class Fills(Observer):
    """The disk is full after point 4: no file may be larger than ``size()`` bytes."""

    def __init__(self, size):
        self.size = size

    def step(self, step, state):
        number = step.index if isinstance(step, BranchStep) else step.number
        if number == 4:
            COMM.barrier()
            hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
            resource.setrlimit(resource.RLIMIT_FSIZE, (self.size(), hard))
            COMM.barrier()


def branch(folder, observer=None, *, resume=False, every=5):
    """A branch of nine steps with a checkpoint at every fifth point."""
    system, functionals = moved_block(COMM)
    with BranchRecord(folder, system, functionals, every=every, resume=resume) as kept:
        if resume:
            kept.go_on()
        else:
            record_in(kept, max_steps=9, observer=observer)


def history(folder, observer=None, *, resume=False):
    """A history with a checkpoint at every step."""
    evolution = recorded_evolution.pair(COMM, n=2)
    with EvolutionRecord(folder, evolution, resume=resume) as kept:
        if resume:
            kept.go_on()
        else:
            evolution.run([0.0, 1.0, 3.0], longest=0.4, record=kept, observer=observer)


def path(folder, observer=None, *, resume=False):
    """A path of nine steps with a checkpoint at every step."""
    made = recorded_path.made("bonds")
    control = StepControl(maximum=recorded_path.LONGEST)
    with PathRecord(folder, made, resume=resume) as kept:
        if resume:
            kept.go_on()
        else:
            ends = {"gamma_range": (0.0, 0.7), "max_steps": 9}
            made.run(**ends, control=control, record=kept, observer=observer)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("run", "room", "name"),
    [
        (partial(branch, every=100), 60, FILE_NAME),
        (branch, 0, "branch_0000_point_000005"),
        (history, 60, FILE_NAME),
        (history, None, "state_000005"),
        (path, 60, FILE_NAME),
        (path, None, "state_000005"),
    ],
    ids=["branch line", "branch file", "history line", "history file", "path line", "path file"],
)
def test_a_record_on_a_full_disk_is_resumed(folder, run, room, name):
    """Full in a line of the journal, or in a checkpoint: earlier points remain recorded.

    Args:
        run: function that records in a folder, or resumes there.
        room: bytes by which the journal may grow; None: no file may have more than 1000 bytes.
        name: file that cannot be written.
    """
    file = folder / "cut" / FILE_NAME
    place = file if name == FILE_NAME else file.parent / "checkpoints" / f"{name}.npz"

    def size():
        return 1000 if room is None else file.stat().st_size + room

    with fails(place), full(resource.RLIM_INFINITY):
        run(folder / "cut", Fills(size))
    found = contents(folder / "cut")
    assert not [p for p in found if "part" in p or "lock" in p]
    assert not [p for p in found if "000005" in p]
    journal = read_journal(folder / "cut")
    assert not journal.torn  # the incomplete line was removed
    assert len(journal.entries()) == 5
    run(folder / "whole")
    run(folder / "cut", resume=True)
    a, b = (read_journal(folder / name) for name in ("cut", "whole"))
    assert len(b.entries()) > 5
    assert [p.status for p in a.entries()] == [p.status for p in b.entries()]
    for found, wanted in zip(a.rows(), b.rows(), strict=True):
        for key, value in wanted.items():
            if isinstance(value, float):
                np.testing.assert_allclose(found[key], value, rtol=1e-8, atol=1e-8, err_msg=key)


@pytest.mark.ranks(2)
def test_a_record_that_cannot_begin_leaves_no_files(folder):
    system, functionals = moved_block(COMM)
    with full(1000), fails(folder / "new" / FILE_NAME):
        BranchRecord(folder / "new", system, functionals)
    assert contents(folder) == {"new": False}
    with full(0), fails(folder / "new" / journal_file.NOTE_NAME):
        BranchRecord(folder / "new", system, functionals)
    assert contents(folder) == {"new": False}
    on_root(lambda: (folder / "new/checkpoints").touch())
    with fails(folder / "new/checkpoints", errno.EEXIST):
        record(system, functionals, folder / "new", max_steps=2)
    on_root((folder / "new/checkpoints").unlink)
    on_root((folder / "new" / FILE_NAME).unlink)
    on_root((folder / "new" / FILE_NAME).mkdir)
    with pytest.raises(FileExistsError, match="nothing is overwritten"):
        BranchRecord(folder / "new", system, functionals)
    with fails(folder / "new" / FILE_NAME, errno.EISDIR):
        BranchRecord(folder / "new", system, functionals, resume=True)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("format", FORMATS)
def test_full_disk_keeps_the_last_series(folder, format):
    system, functionals = moved_block(COMM)
    record(system, functionals, folder / "record", max_steps=8)
    with BranchRecord(folder / "record", system, functionals, resume=True) as r:
        files = write_series(folder / "series", r, format=format)
        before = contents(folder / "series")
        with full(1_000), pytest.raises(OSError, match=r"File too large|No space left") as info:
            write_series(folder / "series", r, format=format)
        assert len(set(COMM.allgather(str(info.value)))) == 1
        assert info.value.filename.startswith(str(folder / "series"))
        assert contents(folder / "series") == before
        assert write_series(folder / "series", r, format=format) == files


# -- the lock --------------------------------------------------------------------------------------


@pytest.mark.ranks(2)
def test_the_lock_says_who_holds_it(folder):
    system, functionals = moved_block(COMM)
    with BranchRecord(folder, system, functionals):
        with pytest.raises(BlockingIOError, match="another run records to") as info:
            BranchRecord(folder, system, functionals, resume=True)
        said = COMM.allgather(str(info.value))
        assert len(set(said)) == 1
        ranks = " ".join(str(pid) for pid in COMM.allgather(os.getpid()))
        assert f"processes {ranks} on {COMM.bcast(os.uname().nodename)}" in said[0]
        assert (folder / journal_file.NOTE_NAME).exists()
        COMM.barrier()
    COMM.barrier()
    assert not (folder / journal_file.NOTE_NAME).exists()


def ranks_of(pid):
    """Processes below a process."""
    by_thread = [p.read_text().split() for p in Path(f"/proc/{pid}/task").glob("*/children")]
    children = [int(p) for those in by_thread for p in those]
    return [p for child in children for p in (child, *ranks_of(child))]


def runs(pid):
    """Whether a thread of a process is left: the first one may end before the others."""
    return any(state(thread) not in "ZX" for thread in Path(f"/proc/{pid}/task").glob("*"))


def state(thread):
    """Letter of the state of a thread, X if it is gone."""
    try:
        return (thread / "stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return "X"


@pytest.mark.skipif(
    find_spec("dolfinx_solver") is not None,
    reason="MPICH of the wheel has processes between mpiexec and its ranks",
)
def test_surviving_ranks_hold_the_record(folder):
    """Surviving ranks hold the record, naming their processes; after they end it is free."""
    taken = ("OMPI_", "PRTE_", "PMIX_", "PETSC_OPTIONS")
    clean = {k: v for k, v in os.environ.items() if not k.startswith(taken)}
    program = ["python3", "-m", "support.recorded_run", str(folder)]
    modules = os.pathsep.join([str(TREE / "tests"), os.environ.get("PYTHONPATH", "")])
    # A killed mpirun leaves its folder, in whose way a later one of the same number would be.
    new = {"DOLFINX_CONTACT_ENV": "direct", "TMPDIR": str(folder), "PYTHONPATH": modules}
    process = subprocess.Popen(
        [TREE / "docker/run", "mpirun", "-n", "2", *program],
        env=clean | new,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    path = folder / FILE_NAME
    end = time.monotonic() + 60
    while not path.exists() or path.read_bytes().count(b"\n") < 6:
        assert process.poll() is None
        assert time.monotonic() < end
        time.sleep(0.01)
    ranks = ranks_of(process.pid)
    system, functionals = moved_block(COMM)
    try:
        assert len(ranks) == 2
        os.kill(ranks[1], signal.SIGSTOP)  # the other one waits for it
        process.kill()
        process.wait()
        if runs(ranks[0]):
            with pytest.raises(BlockingIOError, match=r"processes \d+ \d+ on") as refused:
                BranchRecord(folder, system, functionals, resume=True)
            assert all(str(pid) in str(refused.value) for pid in ranks)
    finally:
        for pid in filter(runs, ranks):
            os.kill(pid, signal.SIGKILL)
    while any(map(runs, ranks)):
        time.sleep(0.01)
    with BranchRecord(folder, system, functionals, resume=True) as r:
        assert len(r.journal.branches[0].points) > 2
