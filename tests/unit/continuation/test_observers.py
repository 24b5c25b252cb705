"""Observers of branches: the point that they are told of stands in the problem."""

from mpi4py import MPI

import numpy as np
import pytest
from support import recorded_evolution, recorded_path
from support.checks import solved_start
from support.histories import driven_block
from support.recorded_run import CONTROL, moved_block, resume, start

from dolfinx_contact.continuation import Observer, follow
from dolfinx_contact.records import (
    BranchRecord,
    PathRecord,
)

COMM = MPI.COMM_WORLD


class Killed(Exception):
    """Exception of an observer."""


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
    """Return the state in the problem, equal on every rank."""
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
    """Return the state in the problem after the point is restored explicitly."""
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
    """Load, obstacle and Dirichlet data have the gamma of the point, also with steps."""
    system = driven_block(kind, n=3)
    x = solved_start(system)
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
    """A point is recorded before an observer sees it, also if the observer raises."""
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
    """Observer storing its arguments."""

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
def test_one_observer_serves_branches_histories_and_paths(folder):
    """Branches, histories and paths call the same methods; a continuing run begins again."""
    system = driven_block("load", n=3)
    notes = Notes()
    branch = follow(system, solved_start(system), 0.5, gamma_range=(0.4, 0.6), observer=notes)
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
    expected = [("begin", "PathTask", "RunState")]
    expected += [("step", "PathStep", "RunState")] * len(rest.steps)
    assert len(rest.steps) == 2
    assert notes.told == [*expected, ("end", rest.ending, rest.reason)]
