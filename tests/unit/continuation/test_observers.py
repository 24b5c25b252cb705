"""Observers of branches: the point that they are told of stands in the problem."""

from mpi4py import MPI

import numpy as np
import pytest
from _triangle import linear_triangle
from support import recorded_evolution, recorded_path
from support.recorded_run import CONTROL, moved_block, start
from test_pair import triangle_on_a_body
from test_parametric import driven_block

from dolfinx import fem

from dolfinx_contact.continuation import Ending, Observer, explore, follow
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.explorer.lines import diagram_of
from dolfinx_contact.records import (
    BranchRecord,
    EvolutionRecord,
    PathRecord,
    read_journal,
    resume,
)
from dolfinx_contact.records.journal import FILE_NAME

COMM = MPI.COMM_WORLD


class Killed(Exception):
    """What an observer raises."""


class Looks(Observer):
    """Looks at the problem where it is told of something, as `seen` does; raises at ``last``."""

    def __init__(self, system, last=None):
        self.system = system
        self.last = last
        self.points = []
        self.seen = []
        self.calls = []

    def begin(self, task, state):
        self.calls.append(("begin", seen(self.system)))

    def step(self, step, state):
        self.points.append(step.point)
        self.seen.append(seen(self.system))
        assert self.seen[-1][1] == self.system.letters(step.point.piece)
        if step.index == self.last:
            raise Killed
        # What it does is no affair of the branch.
        self.system.problem.u.x.array[:] = 7.0

    def end(self, ended):
        self.calls.append(("end", seen(self.system)))


def table_of(system):
    """Statuses, gaps and contact forces at the state in the Functions, of the first surface."""
    table = system.problem.table(system.problem.surfaces[0])
    return "".join(table.status), table.un, table.rn


def seen(system):
    """What stands in the problem, the same on every rank."""
    problem = system.problem
    status, un, rn = table_of(system)
    given = [bc.g for bc in problem.bcs if hasattr(bc.g, "x")]
    fields = [f.x.array.copy() for f in (*problem.fields, *given)]
    return float(system.constant.value), status, un, rn, fields


def same(a, b):
    assert a[0] == b[0]
    assert a[1] == b[1]
    for mine, theirs in zip((*a[2:4], *a[4]), (*b[2:4], *b[4]), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-12)


def expected(system, point):
    """What stands there once the point is put there by hand."""
    system.result_at(point)
    return seen(system)


def check(system, looks):
    for point, found in zip(looks.points, looks.seen, strict=True):
        same(found, expected(system, point))


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param("load", marks=pytest.mark.long),
        "obstacle",
        pytest.param("dirichlet", marks=pytest.mark.long),
    ],
)
@pytest.mark.verifies(
    "observers",
    "branches",
    reference="itself: the points of the branch",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_every_point_stands_in_the_problem(kind):
    """By steps: the load, the obstacle or Dirichlet data have the gamma of the point as well."""
    system = driven_block(kind, n=3)
    x = start_of(system)
    looks = Looks(system)
    asked = []

    def stop(step):
        asked.append(seen(system))
        return ""

    branch = follow(
        system, x, 0.5, gamma_range=(0.4, 0.8), route="steps", observer=looks, stop=stop
    )
    assert len(looks.points) == len(branch.points) > 2
    last = seen(system)
    assert [name for name, _ in looks.calls] == ["begin", "end"]
    same(looks.calls[0][1], looks.seen[0])
    same(looks.calls[1][1], last)
    same(last, expected(system, branch.points[-1]))
    # The branch ends of itself at its last point.
    for a, b in zip(asked, looks.seen[1:-1], strict=True):
        same(a, b)
    check(system, looks)
    assert len({found[0] for found in looks.seen}) == len(looks.seen)
    plain = follow(system, x, 0.5, gamma_range=(0.4, 0.8), route="steps")
    gammas = [[p.gamma for p in b.points] for b in (plain, branch)]
    np.testing.assert_allclose(*gammas, atol=1e-9)


@pytest.mark.parametrize("route", [pytest.param("steps", marks=pytest.mark.long), "pivoting"])
def test_points_of_all_branches(route):
    """An exploration leaves the problem as it was."""
    system = linear_triangle(8, 2.0)
    system.set_parameter(-1.0)
    x = start_of(system)
    looks = Looks(system)
    before = seen(system)
    diagram = explore(system, [(x, -1.0)], gamma_range=(-1.0, 1.0), route=route, observer=looks)
    same(seen(system), before)
    assert len(diagram.edges) > 2
    assert len(looks.calls) == 2 * len(diagram.edges)
    assert len({found[1] for found in looks.seen}) > 3
    check(system, looks)


def start_of(system):
    system.problem.solve()
    x = system.create_vector()
    system.problem.write(x)
    return x


def test_no_assembly(monkeypatch):
    """That the point stands in the problem costs neither assembly nor factorisation."""
    count = [0]

    def counted(assemble):
        def counts(*args, **kwargs):
            count[0] += 1
            return assemble(*args, **kwargs)

        return counts

    for where, name in ((fem.petsc, "assemble_matrix"), (fem, "assemble_vector")):
        monkeypatch.setattr(where, name, counted(getattr(where, name)))
    work = []
    for observer in (None, Observer()):
        system = driven_block("load", n=3)
        x = start_of(system)
        count[0] = 0
        branch = follow(system, x, 0.5, gamma_range=(0.4, 0.8), route="steps", observer=observer)
        work.append((count[0], branch.factorisations, branch.solves))
    assert work[0] == work[1]
    assert work[0][0] > 0
    assert work[0][2] > 0


def test_after_a_kill(folder):
    """Points that come again, and those that follow, have statuses, gamma and driven data."""
    system, functionals = moved_block(COMM, n=3)
    x = start(system)
    whole = Looks(system)
    task = dict(gamma_range=(-0.1, 1.0), control=CONTROL, max_steps=12)
    follow(system, x, 0.0, observer=whole, **task)
    assert len({found[1] for found in whole.seen}) > 1

    class Both(Looks):
        def __init__(self, record, last):
            super().__init__(system, last)
            self.record = record

        def begin(self, *told):
            self.record.begin(*told)

        def step(self, *told):
            self.record.step(*told)
            super().step(*told)

        def end(self, *told):
            self.record.end(*told)

    with BranchRecord(folder, system, functionals, every=5) as record, pytest.raises(Killed):
        follow(system, x, 0.0, observer=Both(record, 8), **task)
    again, functionals = moved_block(COMM, n=3)
    looks = Looks(again)
    resume(folder, again, functionals, every=5, max_steps=12, observer=looks)
    again_from = len(whole.seen) - len(looks.seen)
    assert 5 <= again_from <= 8  # a point whose fields were kept
    for a, b in zip(looks.seen, whole.seen[again_from:], strict=True):
        assert a[1] == b[1]
        assert a[0] == pytest.approx(b[0], abs=1e-9)
        np.testing.assert_allclose(a[2], b[2], atol=1e-8)
        np.testing.assert_allclose(a[3], b[3], atol=1e-5)
    check(again, looks)


def disturb(problem):
    """Write to all Functions of the problem."""
    for f in problem.fields:
        f.x.array[:] = 7.0


def test_a_branch_is_not_disturbed_by_who_writes_to_functions(folder):
    """Observer, stop and functionals write to them: journal, surface and fields stay the same."""
    kept = dict(every=2, surface_displacement=True)
    way = dict(gamma_range=(0.0, 1.0), control=CONTROL, max_steps=4)
    for name in ("plain", "disturbed"):
        system, functionals = moved_block(COMM)
        problem = system.problem
        options = {}
        if name == "disturbed":
            functionals = {
                "first": lambda p: disturb(p) or 0.0,
                **functionals,
                "last": lambda p: disturb(p) or 0.0,
            }
            options = {
                "observer": lambda step, problem=problem: disturb(problem),
                "stop": lambda step, problem=problem: disturb(problem) or "",
            }
        with BranchRecord(folder / name, system, functionals, **kept) as record:
            follow(system, start(system), 0.0, record=record, **way, **options)
    a, b = (read_journal(folder / name) for name in ("plain", "disturbed"))
    for column in ("gamma", "status", "volume", "force"):
        np.testing.assert_array_equal(a.columns()[column], b.columns()[column])
    for index in range(5):
        first, second = (journal.surface_at(index) for journal in (a, b))
        np.testing.assert_array_equal(first.u, second.u)
        np.testing.assert_array_equal(
            first.tables["contact"]["force"], second.tables["contact"]["force"]
        )
    assert resume(folder / "disturbed", system, functionals, max_steps=6).ending is Ending.BUDGET


@pytest.mark.ranks(2)
@pytest.mark.parametrize("kind", ["pair", "moving"])
def test_a_history_is_not_disturbed_by_who_writes_to_functions(kind, folder):
    """Observer, stop and accept write to the Functions, and call the load of another time."""

    def run(name, disturbed):
        evolution = getattr(recorded_evolution, kind)(COMM)

        def writes(answer):
            def listener(step):
                disturb(evolution.problem)
                evolution.load(0.7)
                return answer

            return listener

        options = {"observer": writes(None), "stop": writes(""), "accept": writes(True)}
        with EvolutionRecord(folder / name, evolution, surface_displacement=True) as record:
            evolution.run(np.linspace(0, 1, 4), record=record, **(options if disturbed else {}))
        return read_journal(folder / name)

    plain, disturbed = run("plain", False), run("disturbed", True)
    assert [s.status for s in plain.states] == [s.status for s in disturbed.states]
    for name in ("external", "stored", "dissipated"):
        np.testing.assert_allclose(
            disturbed.columns()[name], plain.columns()[name], rtol=1e-9, atol=1e-12
        )
    for index in range(len(plain.states)):
        np.testing.assert_allclose(
            disturbed.surface_at(index).u, plain.surface_at(index).u, rtol=1e-6, atol=1e-12
        )


def test_classes_are_no_observers():
    system, _ = moved_block(COMM)
    way = dict(gamma_range=(-0.1, 1.0), max_steps=1)
    with pytest.raises(ValueError, match="Looks is a class: the observer must be an object"):
        follow(system, start(system), 0.0, observer=Looks, **way)
    with pytest.raises(ValueError, match=r"record must be a records\.BranchRecord"):
        follow(system, start(system), 0.0, record=BranchRecord, **way)


@pytest.mark.parametrize("route", ["steps", pytest.param("pivoting", marks=pytest.mark.long)])
def test_a_function_looks_on(route):
    """It is called as `stop` is, and with both ends; on one rank alone, too, and beside a class."""
    system = linear_triangle(8, 2.0)
    system.set_parameter(-1.0)
    x = start_of(system)
    found = []
    asked = []

    def look(step):
        found.append((step.point.gamma, len(step.special), float(system.constant.value)))

    def stop(step):
        asked.append((step.point.gamma, len(step.special), float(system.constant.value)))
        return "enough" if len(asked) == 2 else ""

    mine = look if COMM.rank == COMM.size - 1 else None
    branch = follow(system, x, -1.0, gamma_range=(-1.0, 1.0), route=route, observer=mine, stop=stop)
    assert branch.reason == "enough" or route == "pivoting"  # which has few points
    gammas = [p.gamma for p in branch.points]
    assert [g for g, _, _ in asked] == gammas[1 : 1 + len(asked)]
    if mine is not None:
        assert [g for g, _, _ in found] == [g for _, _, g in found] == gammas
        assert found[1 : 1 + len(asked)] == asked
    system.set_parameter(-1.0)
    looks = Looks(system)
    diagram = explore(
        system, [(x, -1.0)], gamma_range=(-1.0, 1.0), route=route, record=looks, observer=look
    )
    assert len(looks.points) == sum(len(b.points) for b in diagram.branches)
    assert len(found) == len(looks.points) + (len(gammas) if mine is not None else 0)


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "observers",
    "records of branches",
    reference="itself: the journal",
    aspects=(
        "2D",
        "branches",
        "records",
    ),
)
def test_a_record_comes_first(folder):
    """What is observed has been recorded, also where the observer raises."""
    system, functionals = moved_block(COMM, n=3)
    x = start(system)

    def observer(step):
        assert record.journal.branches[0].points[-1].gamma == pytest.approx(step.point.gamma)
        if len(record.journal.branches[0].points) == 4:
            raise Killed

    task = dict(gamma_range=(-0.1, 1.0), control=CONTROL, max_steps=12)
    with BranchRecord(folder, system, functionals) as record, pytest.raises(Killed):
        follow(system, x, 0.0, record=record, observer=observer, **task)
    assert len(record.journal.branches[0].points) == 4
    again, functionals = moved_block(COMM, n=3)
    gammas = []
    resume(folder, again, functionals, max_steps=5, observer=lambda s: gammas.append(s.point.gamma))
    assert len(gammas) > 1


class Notes(Observer):
    """What one observer is called with, whatever is followed."""

    def __init__(self):
        self.told = []

    def begin(self, task, state):
        self.told.append(("begin", type(task).__name__, type(state).__name__))

    def step(self, step, state):
        self.told.append(("step", type(step).__name__, type(state).__name__))

    def end(self, ended):
        self.told.append(("end", ended.ending, ended.reason))


@pytest.mark.verifies(
    "observers",
    "records of paths",
    reference="itself: the same calls of branches, histories and paths",
    aspects=(
        "branches",
        "records",
    ),
)
def test_one_observer_for_all(folder):
    """Branches, histories and paths call the same methods; a run that goes on begins again."""
    system = driven_block("load", n=3)
    notes = Notes()
    branch = follow(system, start_of(system), 0.5, gamma_range=(0.4, 0.6), observer=notes)
    words = ("BranchStep", "Stepping")
    expected = [("begin", "Task", "Stepping"), *[("step", *words)] * len(branch.points)]
    assert notes.told == [*expected, ("end", branch.ending, branch.reason)]

    evolution = recorded_evolution.pair(COMM)
    notes = Notes()
    history = evolution.run([0.0, 1.0, 2.0], observer=notes)
    expected = [("begin", "HistoryTask", "RunState")]
    expected += [("step", "EvolutionStep", "RunState")] * len(history.steps)
    assert notes.told == [*expected, ("end", history.ending, history.reason)]

    def stopping(step):
        if step.number == 2:
            raise Killed

    path = recorded_path.made("bonds")
    with PathRecord(folder, path) as record, pytest.raises(Killed):
        path.run(gamma_range=(0.0, 0.7), record=record, observer=stopping, max_steps=4)
    notes = Notes()
    with PathRecord(folder, recorded_path.made("bonds"), resume=True) as record:
        rest = record.go_on(observer=notes)
    expected = [("begin", "PathTask", "PathState")]
    expected += [("step", "PathStep", "PathState")] * len(rest.steps)
    assert len(rest.steps) == 2
    assert notes.told == [*expected, ("end", rest.ending, rest.reason)]


@pytest.mark.ranks(2)
@pytest.mark.parametrize("method", ["begin", "step", "end"])
def test_an_observer_that_raises_on_one_rank_ends_a_history(method):
    """On every rank, at the last accepted state."""

    class Raises(Observer):
        def _raise(self, *_):
            if COMM.rank == COMM.size - 1:
                evolution.problem.u.x.array[:] = 7.0
                raise Killed

    setattr(Raises, method, Raises._raise)
    evolution = recorded_evolution.pair(COMM)
    with pytest.raises(Killed):
        evolution.run([0.0, 1.0], observer=Raises())
    assert COMM.allreduce(np.abs(evolution.problem.u.x.array).max(), op=MPI.MAX) < 0.1


@pytest.mark.parametrize("route", [pytest.param("steps", marks=pytest.mark.long), "pivoting"])
def test_a_recorded_diagram(route, folder):
    """The journal has its nodes, rays and edges; explored again in parts it is the same."""

    def explored(record, **options):
        system = record.system
        system.set_parameter(-1.0)
        way = dict(gamma_range=(-1.0, 1.0), route=route, record=record)
        return explore(system, [(start_of(system), -1.0)], **way, **options)

    def triangle():
        return triangle_on_a_body(4, 2.5)

    with BranchRecord(folder / "whole", triangle()) as record:
        diagram = explored(record)
        layout = Layout(record.system)
        letters = record.system.letters
        rays = [
            [(letters(r.piece), layout.gamma(r.tangent)) for r in node.rays]
            for node in diagram.nodes
        ]
        for number, branch in enumerate(diagram.branches):
            for point in record.points(number):
                assert any(point.gamma == p.gamma for p in branch.points)
    assert len(diagram.nodes) > 0
    journal = read_journal(folder / "whole")
    assert [n.gamma for n in journal.nodes] == [n.point.gamma for n in diagram.nodes]
    assert [n.edges for n in journal.nodes] == [n.edges for n in diagram.nodes]
    assert [n.point.complete for n in journal.nodes] == [n.point.complete for n in diagram.nodes]
    assert [[(r.status, r.gamma) for r in n.rays] for n in journal.nodes] == rays
    assert [(e.branch, e.start, e.end) for e in journal.edges] == [
        (i, e.start, e.end) for i, e in enumerate(diagram.edges)
    ]
    assert journal.explored.complete == diagram.complete
    assert (journal.explored.ending, journal.explored.reason) == (diagram.ending, diagram.reason)
    for number, branch in enumerate(diagram.branches):
        gammas = journal.columns(number)["gamma"].tolist()
        assert gammas == [p.gamma for p in branch.points]
        assert journal.branches[number].ending is branch.ending

    # Wherever the journal is cut, it says that it goes on; its last line is that all is over.
    if COMM.rank == 0:
        lines = (folder / "whole" / FILE_NAME).read_bytes().splitlines(keepends=True)
        (folder / "cut").mkdir()
        for count in range(4, len(lines) + 1):
            (folder / "cut" / FILE_NAME).write_bytes(b"".join(lines[:count]))
            diagram_read = diagram_of(read_journal(folder / "cut"))
            assert diagram_read.unfinished == (count < len(lines))
            assert diagram_read.kind.startswith("a diagram, ")
    COMM.barrier()

    with BranchRecord(folder / "parts", triangle()) as record:
        explored(record, max_branches=2)
    part = read_journal(folder / "parts")
    assert part.explored.ending is Ending.BUDGET
    assert len(part.edges) == 2
    with BranchRecord(folder / "parts", triangle(), resume=True) as record:
        explored(record)
    again = read_journal(folder / "parts")
    if COMM.rank == 0:  # the end of the first exploration is none any more once there is more
        lines = (folder / "parts" / FILE_NAME).read_bytes().splitlines(keepends=True)
        ends = [i for i, line in enumerate(lines, 1) if b'"type": "explored"' in line]
        for count in range(ends[0], len(lines) + 1):
            (folder / "cut" / FILE_NAME).write_bytes(b"".join(lines[:count]))
            session = count == ends[0] + 1
            assert diagram_of(read_journal(folder / "cut")).unfinished == (
                count not in ends and not session
            )
    COMM.barrier()
    assert again.edges == journal.edges
    assert again.explored == journal.explored
    assert [n.edges for n in again.nodes] == [n.edges for n in journal.nodes]
    assert [n.gamma for n in again.nodes] == pytest.approx([n.gamma for n in journal.nodes])
