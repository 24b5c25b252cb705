"""The record of evolutions: the journal, and runs that are interrupted or killed and resumed."""

import re
import shutil

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block, box, facets, same_tables
from support.histories import dragged
from support.killing import Stop, killed_and_resumed, require_same, stopping
from support.recorded_evolution import CASES, LONGEST, TIMES, cracked, pair, record

from dolfinx import mesh

from dolfinx_contact import (
    ParametricContact,
)
from dolfinx_contact.continuation import Ending
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.meshing import join
from dolfinx_contact.records import BranchRecord, EvolutionRecord, read_journal
from dolfinx_contact.records.journal import FILE_NAME

COMM = MPI.COMM_WORLD
NUMBERS = ("time", "length", "external", "stored", "dissipated")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Runs that nothing ends, on all ranks of the test; made when they are asked for."""
    made = {}

    def get(case, longest=LONGEST):
        if (case, longest) not in made:
            folder = COMM.bcast(tmp_path_factory.mktemp(case) if COMM.rank == 0 else None)
            assert record(CASES[case](COMM), folder, longest=longest).complete
            made[case, longest] = folder
        return made[case, longest]

    return get


def test_the_journal_has_the_steps_and_the_task_of_a_run(folder):
    evolution = pair(COMM)
    history = record(evolution, folder)
    journal = read_journal(folder)
    start, *rows = journal.rows()
    assert rows == [s.row() | {"status": s.status} for s in history.steps]
    assert start == history.rows()[0] | {"status": journal.states[0].status}
    columns = journal.columns()
    assert list(columns) == list(start) == list(rows[0])
    np.testing.assert_array_equal(columns["time"], [0.0, *(s.time for s in history.steps)])
    assert columns["status"].tolist()[1:] == [s.status for s in history.steps]
    assert columns["directions"].tolist() == [None, *(s.directions for s in history.steps)]
    assert [s.time for s in journal.states] == [0.0, *(s.time for s in history.steps)]
    assert (journal.runs[0].reason, journal.runs[0].complete) == ("the last time is reached", True)
    assert journal.runs[0].ending is Ending.REACHED
    assert journal.runs[0].task["times"] == TIMES.tolist()
    np.testing.assert_allclose(journal.places["contact"], [(x, 0) for x in np.arange(5) / 4])
    letters = set("".join(s.status for s in journal.states))
    assert {"o", "k", "+", "-"} <= letters
    # States of the record are those of the history.
    with EvolutionRecord(folder, evolution, resume=True) as kept:
        at = history.at(3.0)
        before = evolution.problem.u.x.array.copy()
        state = kept.state(history.steps.index(at) + 1)
        np.testing.assert_array_equal(evolution.problem.u.x.array, before)
        np.testing.assert_allclose(state.displacement, at.state.displacement, atol=1e-14)
        found = evolution.problem.table(evolution.problem.surfaces[0], state=state)
        same_tables(found, at.result.tables["contact"], 1e-12)
        np.testing.assert_allclose(
            found.increment, at.result.tables["contact"].increment, atol=1e-14
        )
        again = kept.go_on()
        assert (again.reason, again.steps) == ("the last time is reached", [])
        assert again.energies == history.energies
        last = history.rows()[-1]
        assert [(r["step"], r["time"]) for r in again.rows()] == [(last["step"], last["time"])]
        assert again.rows()[0]["contact_y"] == pytest.approx(last["contact_y"], rel=1e-12)
        # A second run of the same record.
        evolution.load = lambda time: None
        evolution.run([7.0, 8.0], record=kept)
    assert [r.after for r in read_journal(folder).runs] == [0, len(history.steps)]


@pytest.mark.ranks(2)
@pytest.mark.parametrize("case", ["crack", pytest.param("motion", marks=pytest.mark.long), "pair"])
@pytest.mark.verifies(
    "records of histories",
    "cracks",
    reference="itself: the run that nothing ended",
    aspects=(
        "2D",
        "pairs",
        "records",
    ),
)
@pytest.mark.verifies(
    "records of motions",
    reference="itself: the run that nothing ended",
    aspects=(
        "2D",
        "records",
    ),
)
def test_an_interrupted_history_resumes(case, whole, folder):
    """Interruptions by an observer, between the files of a step and its line, and within a line."""
    with pytest.raises(Stop):
        record(CASES[case](COMM), folder, observer=stopping(5))
    assert len(read_journal(folder).states) == 6
    seen = []
    with EvolutionRecord(folder, CASES[case](COMM), resume=True) as kept, pytest.raises(Stop):
        kept.go_on(observer=lambda step: (seen.append(step.number), stopping(8)(step)))
    assert seen == [6, 7, 8]
    path = folder / FILE_NAME
    if COMM.rank == 0:
        data = path.read_bytes()
        path.write_bytes(data[: data.rindex(b'{"type": "point"') + 50])
        (folder / "checkpoints/.state_000008.part.npz").touch()
    COMM.barrier()
    assert read_journal(folder).torn
    with EvolutionRecord(folder, CASES[case](COMM), resume=True) as kept:
        assert kept.go_on().complete
    require_same(folder, whole(case))


@pytest.mark.ranks(2)
def test_a_history_killed_before_its_first_point_begins_again(whole, folder):
    """The run has begun with its task, and not even its start was recorded."""
    if COMM.rank == 0:
        lines = (whole("pair") / FILE_NAME).read_bytes().splitlines(keepends=True)
        (folder / FILE_NAME).write_bytes(b"".join(lines[:3]))
        shutil.copy(whole("pair") / "surface.npz", folder)
    COMM.barrier()
    evolution = pair(COMM)
    with EvolutionRecord(folder, evolution, resume=True) as kept:
        assert kept.journal.is_empty
        with pytest.raises(ValueError, match="no run is in"):
            kept.go_on()
        with pytest.raises(ValueError, match="differs in the task of the run: longest"):
            evolution.run(TIMES, record=kept, longest=2 * LONGEST)
        assert evolution.run(TIMES, record=kept, longest=LONGEST, start=virgin(evolution)).complete
    require_same(folder, whole("pair"))


def virgin(evolution):
    """The state at rest, without memory; a run that failed has changed that of the evolution."""
    evolution.load(TIMES[0])
    return evolution.problem.snapshot()


@pytest.mark.parametrize(
    ("old", "new"),
    [(rb"(?s).*", b"nothing"), (rb"'descr'", b"'descr\"")],
    ids=["whole", "head"],
)
def test_a_damaged_checkpoint_of_a_history_is_passed_over(whole, folder, old, new):
    with pytest.raises(Stop):
        record(pair(COMM), folder, observer=stopping(6))
    if COMM.rank == 0:
        file = folder / "checkpoints/state_000006.npz"
        file.write_bytes(re.sub(old, new, file.read_bytes(), count=1))
    COMM.barrier()
    seen = []
    with EvolutionRecord(folder, pair(COMM), resume=True) as kept, pytest.raises(Stop):
        kept.go_on(observer=lambda step: (seen.append(step.number), stopping(8)(step)))
    assert seen == [6, 7, 8]
    found, wanted = (read_journal(path).rows() for path in (folder, whole("pair")))
    for name in NUMBERS:
        values = ([row[name] for row in rows[:8]] for rows in (found, wanted))
        np.testing.assert_allclose(*values, rtol=1e-10, atol=1e-12)


@pytest.mark.ranks(2)
def test_a_history_record_refuses_other_problems_and_loads(whole, folder):
    """Records of other problems and loads, damaged ones, and those that would be overwritten."""
    known = whole("pair")
    before = (whole("pair") / FILE_NAME).read_bytes()
    of_time = r"differs at the time \S+: the "
    for other, message in [
        (cracked(COMM), "differs: the mesh$"),
        (pair(COMM, n=6), "differs: the mesh$"),
        (
            pair(COMM, friction=0.26),
            of_time + r"friction of Coulomb of 'contact' \(0\.25 recorded, 0\.26 now\)$",
        ),
        (
            pair(COMM, way=0.013),
            of_time + "prescribed displacement$",
        ),
    ]:
        with pytest.raises(ValueError, match=f"record of another problem; {message}"):
            EvolutionRecord(known, other, resume=True)
    evolution = pair(COMM)
    with pytest.raises(FileExistsError, match="nothing is overwritten"):
        EvolutionRecord(known, evolution)
    with pytest.raises(FileNotFoundError, match="there is no journal"):
        EvolutionRecord(folder / "nowhere", evolution, resume=True)
    with pytest.raises(ValueError, match="a QuasiStatic or NSCD is required, got ContactProblem"):
        EvolutionRecord(folder, evolution.problem)
    assert (known / FILE_NAME).read_bytes() == before
    lines = before.splitlines(keepends=True)
    if COMM.rank == 0:
        (folder / FILE_NAME).write_bytes(b"".join([*lines[:5], *lines[6:]]))
    COMM.barrier()
    with pytest.raises(ValueError, match="line 6 of the journal is damaged: it is not line 6"):
        EvolutionRecord(folder, evolution, resume=True)
    problem, _ = dragged()
    system = ParametricContact(problem, problem.surfaces[0].law.friction)
    with pytest.raises(ValueError, match="the journal of an evolution, not of branches"):
        BranchRecord(known, system, resume=True)


@pytest.mark.ranks(2)
def test_a_submesh_is_refused(folder):
    """Its cells have no numbers identifying them on resumption."""
    square = box(COMM, 2, "tri")
    half = mesh.locate_entities(square, 2, lambda x: x[1] < 0.5 + 1e-9)
    part = mesh.create_submesh(square, 2, half)[0]
    problem = block(domain=part, where=lambda d: facets(d, 1, 0.0))
    with pytest.raises(ValueError, match=r"not a submesh: copy it with meshing\.join"):
        EvolutionRecord(folder, QuasiStatic(problem, lambda t: None))
    COMM.barrier()
    assert not (folder / FILE_NAME).exists()
    problem = block(domain=join([part]).mesh, where=lambda d: facets(d, 1, 0.0))
    with EvolutionRecord(folder, QuasiStatic(problem, lambda t: None)) as kept:
        assert kept.journal.is_empty


# -- kills -----------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("case", ["crack", "pair", "fine motion"])
@pytest.mark.verifies(
    "records of histories",
    "cracks",
    reference="itself: the run that nothing ended",
    aspects=(
        "2D",
        "pairs",
        "records",
    ),
)
@pytest.mark.verifies(
    "records of motions",
    reference="itself: the run that nothing ended",
    aspects=(
        "2D",
        "records",
    ),
)
def test_a_history_killed_at_random_moments_is_resumed(case, whole, folder):
    """Every session on another number of ranks; each is killed, but for the last."""
    longest = 0.05
    known = whole(case, longest)
    words = ("--case", case)
    script = "recorded_evolution.py"
    first = ("--longest", longest)
    killed_and_resumed(script, words, first, folder, known, kills=10)
    require_same(folder, known)
