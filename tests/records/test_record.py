"""The record of branches: the journal, checkpoints, and runs that are killed and resumed."""

import json
import shutil
import zlib

from mpi4py import MPI

import numpy as np
import pytest
from support import recorded_run
from support.killing import killed_and_resumed
from support.recorded_run import moved_block, record, record_in, resume

from dolfinx_contact.continuation import (
    BranchStep,
    Ending,
    Observer,
    StepControl,
    Task,
    follow,
)
from dolfinx_contact.records import (
    BranchRecord,
    journal_of,
    read_journal,
)
from dolfinx_contact.records.journal import FILE_NAME

COMM = MPI.COMM_WORLD
NUMBERS = ("gamma", "step", "norm", "volume", "force")


def require_same(journal, other, tolerance=1e-8):
    """The same points, special points and statuses."""
    a = journal.columns()
    b = other.columns()
    np.testing.assert_array_equal(a["index"], b["index"])
    np.testing.assert_array_equal(a["status"], b["status"])
    for name in NUMBERS:
        np.testing.assert_allclose(a[name], b[name], rtol=tolerance, atol=tolerance, err_msg=name)
    s = journal.special()
    t = other.special()
    assert s["kind"].tolist() == t["kind"].tolist()
    np.testing.assert_allclose(s["gamma"], t["gamma"], atol=tolerance)
    for mine, theirs in zip(s["changes"], t["changes"], strict=True):
        assert [(c["before"], c["after"]) for c in mine] == [
            (c["before"], c["after"]) for c in theirs
        ]
        np.testing.assert_allclose([c["x"] for c in mine], [c["x"] for c in theirs], atol=1e-12)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """An unkilled run on all ranks of the test."""
    folder = COMM.bcast(tmp_path_factory.mktemp("whole") if COMM.rank == 0 else None)
    branch = record(*moved_block(COMM), folder)
    return folder, branch, read_journal(folder)


# -- the journal -----------------------------------------------------------------------------------


@pytest.mark.ranks(2)
def test_journal_says_what_was_followed(whole):
    _, branch, journal = whole
    table = journal.to_pandas()
    assert table["gamma"].tolist() == [p.gamma for p in branch.points]
    assert table["step"].tolist() == [p.step for p in branch.points]
    assert table["index"].tolist() == list(range(len(branch.points)))
    special = journal.special(0)
    assert special["gamma"].tolist() == [s.gamma for s in branch.special]
    assert special["index"].tolist() == [s.index for s in branch.special]
    assert journal.branches[0].reason == branch.reason == "gamma reached the end of its range"
    assert journal.branches[0].ending is branch.ending is Ending.REACHED
    # Compressed, so less volume; and a force as soon as a point has closed.
    assert table["volume"].iloc[-1] < 0.99
    assert (table["open"][table["force"] > 1e-9] < 5).all()
    assert (table["force"] > 1e-9).sum() > 70
    assert (table[["open", "stick", "slip", "clamped"]].sum(axis=1) == 5).all()
    counted = [[s.count(c) for c in "ok"] for s in table["status"]]
    assert table[["open", "stick"]].to_numpy().tolist() == counted
    with pytest.raises(ValueError, match="no branch 3"):
        journal.to_pandas(3)


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "checkpoints",
    "records of branches",
    reference="itself: the points of the branch",
    aspects=(
        "2D",
        "branches",
        "records",
    ),
)
def test_fields_come_back_exactly(whole):
    folder, branch, _ = whole
    system, functionals = moved_block(COMM)
    with BranchRecord(folder, system, functionals, resume=True) as r:
        kept = r.journal.branches[0].kept
        assert set(kept) >= {0, 7, 14, *(s.index for s in branch.special), len(branch.points) - 1}
        for index, back in zip(kept, r.points(0), strict=True):
            point = branch.points[index]
            np.testing.assert_allclose(back.y.array_r, point.y.array_r, rtol=1e-14, atol=1e-16)
            np.testing.assert_allclose(back.tangent.array_r, point.tangent.array_r, rtol=1e-14)
            np.testing.assert_array_equal(back.piece.codes, point.piece.codes)
            assert back.gamma == point.gamma
        with pytest.raises(ValueError, match="point 1 of branch 0 has no checkpoint"):
            r.state(0, 1)


@pytest.mark.parametrize(
    ("cell", "method", "degree"),
    [
        pytest.param("tri", "integral", 2, marks=pytest.mark.long),
        pytest.param("tri", "mixed", 1, marks=pytest.mark.long),
        ("tet", "nodal", 1),
    ],
)
@pytest.mark.verifies(
    "records of branches",
    reference="itself: the branch at once",
    aspects=(
        "2D",
        "3D",
        "branches",
        "records",
    ),
)
@pytest.mark.verifies(
    "integral contact",
    "mixed contact",
    reference="itself: the branch at once",
    aspects=(
        "2D",
        "branches",
        "records",
    ),
)
@pytest.mark.verifies(
    "nodal contact",
    reference="itself: the branch at once",
    aspects=(
        "3D",
        "branches",
        "records",
    ),
)
def test_every_discretisation_resumes(cell, method, degree, folder):
    """A few steps, then a few more from the disk: the same as all at once."""
    options = dict(cell=cell, method=method, degree=degree, n=2)
    names = ("whole", "parts")
    # At the twelfth point of the tetrahedra two events tie: round-off decides which is named.
    record(*moved_block(COMM, **options), folder / names[0], max_steps=11)
    record(*moved_block(COMM, **options), folder / names[1], max_steps=8, every=100)
    branch = resume(folder / names[1], *moved_block(COMM, **options), max_steps=11)
    assert branch.reason == "the budget of 11 steps is exhausted"
    assert branch.ending is Ending.BUDGET
    require_same(*(read_journal(folder / name) for name in names))


def test_json_and_numpy_are_enough_to_read_a_record(whole):
    folder, branch, journal = whole
    lines = [json.loads(line) for line in (folder / FILE_NAME).read_text().splitlines()]
    assert [line["line"] for line in lines] == list(range(1, len(lines) + 1))
    points = [line for line in lines if line["type"] == "point"]
    assert [p["gamma"] for p in points] == [p.gamma for p in branch.points]
    assert [p["functionals"]["force"] for p in points] == journal.columns()["force"].tolist()
    (name, *_) = [p["checkpoint"] for p in points if "checkpoint" in p]
    with np.load(folder / f"checkpoints/{name}.npz") as arrays:
        assert arrays["x.0"].shape == (16, 8)
        assert np.isfinite(arrays["tangent.0"]).all()
    with np.load(folder / "surface.npz") as arrays:
        assert arrays["x"].shape == (25, 3)


def parsed(data, folder):
    """The journal in the content of a file, read only by this rank."""
    own = folder / f"rank_{COMM.rank}"
    own.mkdir(exist_ok=True)
    (own / FILE_NAME).write_bytes(data)
    return read_journal(own)


@pytest.mark.ranks(2)
def test_a_torn_last_line_is_dropped(whole, folder):
    """The file may end at any byte: only complete lines count."""
    data = (whole[0] / FILE_NAME).read_bytes()
    lines = data.splitlines(keepends=True)
    start = len(b"".join(lines[:8]))
    for length in range(start, start + len(lines[8]) + 1):
        journal = parsed(data[:length], folder)
        complete = 8 + (length == start + len(lines[8]))
        assert len(journal.branches[0].points) == complete - 3
        assert journal.torn == (start < length < start + len(lines[8]))


def test_a_damaged_line_is_an_error(whole, folder):
    lines = (whole[0] / FILE_NAME).read_bytes().splitlines(keepends=True)
    digit = lines[9].replace(b'"norm": 0.', b'"norm": 1.')
    assert digit != lines[9]
    damaged = {
        "a digit": [*lines[:9], digit, *lines[10:]],
        "a hole": [*lines[:9], *lines[10:]],
        "no header": lines[1:],
        "half a line": [*lines[:9], lines[9][:20] + b"\n", *lines[10:]],
        "zeros": [*lines[:9], b"\0" * 30 + b"\n", *lines[10:]],
        "twice": [*lines[:9], lines[8], *lines[9:]],
        "the last one": [*lines[:-1], lines[-1].replace(b"type", b"tipe")],
    }
    system, functionals = moved_block(COMM)
    for name, content in damaged.items():
        path = folder / name.replace(" ", "_")
        if COMM.rank == 0:
            path.mkdir()
            (path / FILE_NAME).write_bytes(b"".join(content))
        COMM.barrier()
        with pytest.raises(ValueError, match=r"line \d+ of the journal is damaged"):
            resume(path, system, functionals)
        assert (path / FILE_NAME).read_bytes() == b"".join(content)
        assert not (path / "checkpoints").exists()


def numbered(lines, numbers):
    """Lines with other numbers."""
    found = []
    for line, number in zip(lines, numbers, strict=True):
        entry = {k: v for k, v in json.loads(line).items() if k not in ("crc", "line")}
        entry |= {} if number is None else {"line": number}
        body = json.dumps(entry)[:-1]
        found.append(f'{body}, "crc": "{zlib.crc32(body.encode()):08x}"}}\n'.encode())
    return found


def test_a_line_that_is_missing_is_noticed(whole, folder):
    """Whichever it is, the last but one too, in whose place nothing else shows it."""
    lines = (whole[0] / FILE_NAME).read_bytes().splitlines(keepends=True)
    count = len(lines)
    assert numbered(lines, range(1, count + 1)) == lines
    for i in range(count - 1):
        with pytest.raises(ValueError, match=r"line \d+ of the journal is damaged"):
            parsed(b"".join([*lines[:i], *lines[i + 1 :]]), folder)
    # An end that is told of the point before the one that it was of.
    end = [b'{"type": "end", "branch": 0, "ending": "BUDGET", "reason": "", "crc": ""}']
    at_its_place = [*lines[:8], *numbered(end, [9])]
    assert parsed(b"".join(at_its_place), folder).branches[0].ending is Ending.BUDGET
    beyond = [*lines[:8], *numbered(end, [10])]
    with pytest.raises(ValueError, match=r"line 9 .*it is not line 9: lines are missing"):
        parsed(b"".join(beyond), folder)


# -- what is refused -------------------------------------------------------------------------------


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (dict(n=5), "differs: the mesh$"),
        (dict(cell="tri"), "differs: the mesh$"),
        (dict(degree=2), r"differs: the number of unknowns \(\d+ recorded, \d+ now\)$"),
        (
            dict(friction=0.31),
            r"differs: the friction of Coulomb of 'contact' \(0\.3 recorded, 0\.31 now\)$",
        ),
        (
            dict(method="mixed"),
            r"differs: the contact method of 'contact' \(nodal recorded, mixed now\)$",
        ),
        (dict(tilt=0.11), "differs: the expression 1 that drives Dirichlet data$"),
    ],
)
def test_the_journal_of_another_problem_is_refused(whole, options, message):
    before = (whole[0] / FILE_NAME).read_bytes()
    system, functionals = moved_block(COMM, **options)
    with pytest.raises(ValueError, match=message):
        resume(whole[0], system, functionals)
    assert (whole[0] / FILE_NAME).read_bytes() == before
    # What was recorded is still there.
    require_same(read_journal(whole[0]), whole[2], tolerance=0)


def test_branch_record_refuses_other_folders_and_functionals(whole, folder):
    system, functionals = moved_block(COMM)
    with pytest.raises(FileExistsError, match="nothing is overwritten"):
        BranchRecord(whole[0], system, functionals)
    with pytest.raises(FileNotFoundError, match="there is no journal"):
        resume(folder / "nowhere", system, functionals)
    assert not (folder / "nowhere").exists()
    with pytest.raises(ValueError, match="differs: the functionals"):
        resume(whole[0], system, {"force": recorded_run.force})
    with pytest.raises(ValueError, match="names of columns: gamma"):
        BranchRecord(folder / "new", system, {"gamma": recorded_run.force})
    for name in (1, "", None, ("a", "b")):
        with pytest.raises(ValueError, match="the name of a functional must be a word, got"):
            BranchRecord(folder / "new", system, {name: recorded_run.force})
        with pytest.raises(ValueError, match="the name of a functional must be a word, got"):
            journal_of(system, [], {name: recorded_run.force})
    with pytest.raises(ValueError, match="every must be an integer of at least 1"):
        BranchRecord(folder / "new", system, every=0)
    with pytest.raises(ValueError, match="must be a function of the problem"):
        BranchRecord(folder / "new", system, {"one": 1.0})
    assert not (folder / "new").exists()
    COMM.barrier()
    with BranchRecord(folder / "new", system) as r:
        with pytest.raises(BlockingIOError, match="another run records"):
            BranchRecord(folder / "new", system, resume=True)
        assert r.last_state() is None
    with pytest.raises(ValueError, match="no point of branch 0"):
        resume(folder / "new", system)


def test_another_task_is_refused(folder):
    """A branch goes on with the recorded step control, and its points follow one another."""
    system, functionals = moved_block(COMM)
    record(system, functionals, folder, max_steps=3)
    text = (folder / FILE_NAME).read_bytes()
    with BranchRecord(folder, system, functionals, resume=True) as r:
        point, stepping = r.state(0, 0)
        r.begin(task(r, gamma_scale=1.1), stepping)
        with pytest.raises(
            ValueError,
            match=r"differs in the task of branch 0: gamma_scale \(1\.1 recorded, 2\.0 now\)",
        ):
            r.begin(task(r, gamma_scale=2.0), stepping)
        with pytest.raises(ValueError, match="point 9 cannot follow the 4 recorded"):
            r.step(BranchStep(0, 9, point), stepping)
    assert (folder / FILE_NAME).read_bytes().startswith(text)
    assert len(read_journal(folder).branches[0].points) == 4


def task(r, **changes):
    known = r.journal.branches[0].task
    control = StepControl(**known["control"])
    return Task(
        **known | {"gamma_range": tuple(known["gamma_range"]), "control": control} | changes
    )


# -- resuming --------------------------------------------------------------------------------------


def test_a_damaged_checkpoint_of_a_branch_is_passed_over(whole, folder):
    """The run goes on from the checkpoint before; if all are damaged, an error says so."""
    system, functionals = moved_block(COMM)
    record(system, functionals, folder, max_steps=16)
    points = read_journal(folder).branches[0].points
    kept = [p.checkpoint for p in points if p.checkpoint is not None]
    if COMM.rank == 0:
        (folder / f"checkpoints/{kept[-1]}.npz").write_bytes(b"nothing")
    COMM.barrier()
    seen = []

    class Watch(Observer):
        def step(self, step, state):
            seen.append(step.index)

    branch = resume(folder, system, functionals, max_steps=1000, observer=Watch())
    assert seen[0] == int(kept[-2][-6:])
    assert branch.reason == "gamma reached the end of its range"
    require_same(read_journal(folder), whole[2])
    if COMM.rank == 0:
        shutil.rmtree(folder / "checkpoints")
    COMM.barrier()
    with pytest.raises(ValueError, match="is missing"):
        resume(folder, system, functionals)


def test_one_script_begins_and_continues_a_record(whole, folder):
    """With resume="if_exists" one script begins a record and continues it."""
    for steps in (2, 4):
        system, functionals = moved_block(COMM)
        with BranchRecord(folder / "r", system, functionals, resume="if_exists") as r:
            if r.journal.is_empty:
                record_in(r, max_steps=steps)
            else:
                r.go_on(max_steps=steps)
    assert len(read_journal(folder / "r").entries()) == 5
    with pytest.raises(ValueError, match="resume must be True, False or 'if_exists', got 'maybe'"):
        BranchRecord(folder / "r", system, functionals, resume="maybe")


def test_a_finished_branch_stays_as_it_is(whole):
    folder, branch, journal = whole
    again = resume(folder, *moved_block(COMM))
    assert again.reason == branch.reason
    (point,) = again.points
    assert point.gamma == branch.points[-1].gamma
    require_same(read_journal(folder), journal, tolerance=0)


@pytest.mark.verifies(
    "records of branches",
    reference="itself: the branch that nothing ended",
    aspects=(
        "2D",
        "branches",
        "records",
    ),
)
def test_an_interrupted_branch_resumes(whole, folder):
    """Ended by an exception between the checkpoint and the line of a point, and in a line."""
    system, functionals = moved_block(COMM)

    class Interrupt(Observer):
        def step(self, step, state):
            if step.index == 20:
                raise KeyboardInterrupt

    with BranchRecord(folder, system, functionals, every=7) as r, pytest.raises(KeyboardInterrupt):
        follow(
            system,
            recorded_run.start(system),
            0.0,
            gamma_range=(-0.1, 1.0),
            control=recorded_run.CONTROL,
            observer=Interrupt(),
            record=r,
        )
    path = folder / FILE_NAME
    if COMM.rank == 0:
        lines = path.read_bytes().splitlines(keepends=True)
        # As if killed while the line of point 14 was written, whose checkpoint is there already.
        at = next(i for i, line in enumerate(lines) if b'"index": 14,' in line)
        path.write_bytes(b"".join(lines[:at]) + lines[at][:-9])
        (folder / "checkpoints/.branch_0000_point_000014.part.npz").touch()
    COMM.barrier()
    assert len(read_journal(folder).branches[0].points) == 14
    resume(folder, system, functionals, every=7)
    require_same(read_journal(folder), whole[2])


def test_a_journal_without_a_complete_line_starts_afresh(folder):
    """Killed in its first moment: there is nothing to lose, and a record can begin."""
    system, functionals = moved_block(COMM)
    if COMM.rank == 0:
        (folder / FILE_NAME).write_bytes(b'{"type": "header", "form')
    COMM.barrier()
    with pytest.raises(FileNotFoundError, match=r"there is no journal\.jsonl"):
        resume(folder, system, functionals)
    record(system, functionals, folder, max_steps=1)
    assert len(read_journal(folder).branches[0].points) == 2


# -- kills -----------------------------------------------------------------------------------------


@pytest.mark.verifies(
    "records of branches",
    reference="itself: the branch that nothing ended",
    aspects=(
        "2D",
        "branches",
        "records",
    ),
)
@pytest.mark.long
def test_a_branch_killed_at_random_moments_is_resumed(whole, folder):
    killed_and_resumed("recorded_run.py", [], [], folder, whole[0], kills=10)
    require_same(read_journal(folder), whole[2])
