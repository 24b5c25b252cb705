"""The record of paths by arc length: runs that are interrupted or killed and resumed, and back."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import same_tables
from support.killing import Stop, killed_and_resumed, require_same, stopping
from support.recorded_path import CASES, LONGEST, STARTS, made, record, resume

from dolfinx_contact.continuation import StepControl
from dolfinx_contact.records import BranchRecord, EvolutionRecord, PathRecord, read_journal
from dolfinx_contact.records.journal import FILE_NAME

COMM = MPI.COMM_WORLD


def require_same_path(folder, other):
    """The same points to 1e-10: journals, memory, and unknowns and tangents where they end."""
    require_same(folder, other)
    a, b = (read_journal(path) for path in (folder, other))
    np.testing.assert_allclose(a.gammas, b.gammas, rtol=0, atol=1e-10 * np.ptp(b.gammas))
    for s, t in zip(a.states, b.states, strict=True):
        assert s.reason == t.reason
        for name in ("tangent_gamma", "status", "step") if t.run.arrived else ():
            found = getattr(s.run.arrived, name)
            wanted = getattr(t.run.arrived, name)
            assert found == (wanted if name == "status" else pytest.approx(wanted, abs=1e-10))
    assert [(r.reason, r.after) for r in a.runs] == [(r.reason, r.after) for r in b.runs]


def fields_at(folder, case, index):
    """Displacement and multipliers of a recorded point on this rank."""
    path = made(case, anew=False)
    with PathRecord(folder, path, resume=True) as kept:
        state = kept.state(index)
        return [state.displacement, *state.multipliers]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Runs that nothing ends, on all ranks of the test; made when they are asked for."""
    found = {}

    def get(case, longest=LONGEST):
        if (case, longest) not in found:
            folder = COMM.bcast(tmp_path_factory.mktemp(case) if COMM.rank == 0 else None)
            assert record(case, folder, longest=longest).runs[-1].complete
            found[case, longest] = folder
        return found[case, longest]

    return get


@pytest.mark.ranks(2)
def test_the_journal_says_what_was_followed(folder):
    path = made("bonds")
    control = StepControl(maximum=LONGEST)
    ends = CASES["bonds"][1]
    with PathRecord(folder, path) as kept:
        history = path.run(gamma_range=ends, control=control, record=kept, max_steps=16)
        journal = read_journal(folder)
        start, *rows = journal.rows()
        assert rows == [s.row() | {"status": s.status} for s in history.steps]
        assert (start["step"], start["gamma"], start["length"]) == (0, 0.0, 0.0)
        np.testing.assert_array_equal(journal.gammas, [0.0, *(s.gamma for s in history.steps)])
        assert [r["gamma"] for r in journal.folds] == [s.gamma for s in history.folds]
        assert [r["step"] for r in journal.kinks] == [s.number for s in history.kinks]
        assert [r["event"] for r in journal.folds] == ["nonsmooth fold", "smooth fold"]
        assert journal.runs[0].reason == "the budget of 16 steps is exhausted"
        # The state of a point is that of the run.
        at = history.folds[1]
        standing = path.problem.u.x.array.copy()
        state = kept.state(at.number)
        assert state.gamma == at.gamma
        found = path.problem.table(path.problem.surfaces[0], state=state)
        same_tables(found, at.result.tables["contact"], 1e-12)
        np.testing.assert_array_equal(path.problem.u.x.array, standing)
        assert float(path.parametric.constant.value) == history.steps[-1].gamma
        np.testing.assert_allclose(state.displacement, at.state.displacement, atol=1e-13)
        # A run that has ended stays as it is, and the next one is on the same record.
        again = kept.go_on()
        assert (again.reason, again.steps) == (history.reason, [])
        assert again.energies == history.energies
        stop = {"stop": lambda step: "far enough" if step.number == 18 else ""}
        assert (
            path.run(gamma_range=ends, control=control, record=kept, **stop).reason == "far enough"
        )
    assert [r.after for r in read_journal(folder).runs] == [0, 16]


@pytest.mark.parametrize(
    "case",
    [
        pytest.param("bonds", marks=pytest.mark.long),
        pytest.param("crack", marks=pytest.mark.long),
        "pair",
    ],
)
@pytest.mark.verifies(
    "records of paths",
    "cracks",
    reference="itself: the path that nothing ended",
    aspects=(
        "2D",
        "pairs",
        "records",
    ),
)
@pytest.mark.verifies(
    "RCCM adhesion",
    reference="itself: the path that nothing ended",
    aspects=(
        "2D",
        "records",
    ),
)
def test_an_interrupted_path_resumes(case, whole, folder):
    """On the way there, by an observer; in the midst of a line; and on the way back."""
    with pytest.raises(Stop):
        record(case, folder, observer=stopping(5))
    assert len(read_journal(folder).states) == 6
    known = read_journal(whole(case))
    seen = []
    # A point that shows other statuses than those by which it was come to, if there is one.
    shows = [s.index for s in known.states[7:] if s.status != s.run.arrived.status]
    later = min(shows, default=7)
    assert (later > 7) == (case == "bonds")
    with pytest.raises(Stop):
        resume(case, folder, observer=lambda s: (seen.append(s.number), stopping(later)(s)))
    assert seen == list(range(6, later + 1))
    with pytest.raises(Stop):
        resume(case, folder, observer=stopping(later + 1))
    file = folder / FILE_NAME
    if COMM.rank == 0:
        data = file.read_bytes()
        file.write_bytes(data[: data.rindex(b'{"type": "point"') + 50])
        (folder / f"checkpoints/.state_{later + 1:06d}.part.npz").touch()
    COMM.barrier()
    assert read_journal(folder).torn
    turn = known.runs[1].after
    with pytest.raises(Stop):
        resume(case, folder, observer=stopping(turn + 2))
    assert len(read_journal(folder).runs) == 2
    resume(case, folder)
    require_same_path(folder, whole(case))
    last = len(read_journal(folder).states) - 1
    fields = (fields_at(path, case, last) for path in (folder, whole(case)))
    for found, wanted in zip(*fields, strict=True):
        scale = COMM.allreduce(np.abs(wanted).max(initial=0), op=MPI.MAX)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-10 * scale)


def test_a_path_record_refuses_other_problems_and_ranges(whole, folder):
    """Records of other problems, loads and ranges, and those that would be overwritten."""
    known = whole("crack")
    before = (whole("crack") / FILE_NAME).read_bytes()
    for other, message in [
        (made("pair", anew=False), "differs: the mesh$"),
        (made("crack", friction=0.26, anew=False), "differs at the arc length .*: the friction"),
        (made("crack", way=0.013, anew=False), "differs: the expression 1 that drives"),
    ]:
        with pytest.raises(ValueError, match=f"record of another problem; {message}"):
            PathRecord(known, other, resume=True)
    path = made("crack")
    with pytest.raises(FileExistsError, match="nothing is overwritten"):
        PathRecord(known, path)
    with pytest.raises(FileNotFoundError, match="there is no journal"):
        PathRecord(folder / "nowhere", path, resume=True)
    with pytest.raises(ValueError, match="an ArcLength is required, got ParametricContact"):
        PathRecord(folder, path.parametric)
    with pytest.raises(ValueError, match="the journal of a path, not of branches"):
        BranchRecord(known, path.parametric, resume=True)
    with pytest.raises(ValueError, match="a QuasiStatic or NSCD is required, got ArcLength"):
        EvolutionRecord(folder, path)
    assert (known / FILE_NAME).read_bytes() == before
    with PathRecord(folder / "run", path) as kept:
        with pytest.raises(ValueError, match="no run is in"):
            kept.go_on()
        given = {"start": STARTS[path], "observer": stopping(2)}
        with pytest.raises(Stop):
            path.run(gamma_range=(-1.0, 1.0), record=kept, **given)
        with pytest.raises(ValueError, match="steps 0 to 2 are recorded, not 3"):
            kept.state(3)
    with PathRecord(folder / "run", made("crack"), resume=True) as kept:
        with pytest.raises(
            ValueError,
            match=r"in the task of the run: gamma_range \(-1\.0, 1\.0 recorded, -1\.0, 2\.0 now\)",
        ):
            kept.path.run(gamma_range=(-1.0, 2.0), start=STARTS[kept.path], record=kept)
        with pytest.raises(ValueError, match="the path is at the arc length 0 and not at the end"):
            kept.path.run(gamma_range=(-1.0, 1.0), start=STARTS[kept.path], record=kept)
    before = (folder / "run" / FILE_NAME).read_bytes()
    with pytest.raises(ValueError, match="is closed: open it with resume=True"):
        kept.path.run(gamma_range=(-1.0, 1.0), start=STARTS[kept.path], record=kept)
    assert (folder / "run" / FILE_NAME).read_bytes() == before


# -- kills -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", ["bonds", "crack", "pair"])
@pytest.mark.verifies(
    "records of paths",
    "RCCM adhesion",
    reference="itself: the path that nothing ended",
    aspects=(
        "2D",
        "records",
    ),
)
@pytest.mark.long
def test_a_path_killed_at_random_moments_is_resumed(case, whole, folder):
    """Every session on another number of ranks; each is killed, but for the last."""
    longest = LONGEST / 8
    known = whole(case, longest)
    words = ("--case", case, "--longest", longest)
    killed_and_resumed("recorded_path.py", words, (), folder, known, kills=10)
    require_same_path(folder, known)
