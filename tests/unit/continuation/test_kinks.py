"""Kinks passed exactly, in batches and by stepping over them: the same branch."""

from mpi4py import MPI

import cases.branch_3d
import cases.followed_mesh
import numpy as np
import pytest
from support.checks import solved_start
from support.textbook import Textbook, one_node, start

from dolfinx_contact.continuation import Follower, StepControl, follow

COMM = MPI.COMM_WORLD


@pytest.mark.parametrize("kinks", ["batched", "stepping"])
def test_the_node_has_its_folds_in_batches_too(kinks):
    """The one-node S: both folds, with their changes of status and their parity."""
    system = one_node(2.0, 2.0, 1.0, 3.0, (0.0, -1.0), (-1.0, 0.0))
    control = StepControl(kinks=kinks, minimum=1e-6)
    x = start(system, [0, 0, 0, 1.0])
    branch = follow(system, x, 0.0, gamma_range=(-1.0, 5.0), control=control)
    assert branch.reason == "gamma reached the end of its range"
    folds = branch.special
    assert [s.kind for s in folds] == ["fold", "fold"]
    changes = [c for part in COMM.allgather([(1, 3), (3, 0)]) for c in part][:2]
    for s, gamma, change in zip(folds, (3.0, 2.0), changes, strict=True):
        assert [(c.before, c.after) for c in s.changes] == [change]
        assert s.parity == 1
        if kinks == "batched":
            assert s.located
            assert abs(s.gamma - gamma) < 1e-10
        else:  # within h_1, the shortest step and a little more, which the record says
            low, high = s.bracket
            assert low <= gamma <= high
            assert high - low < 6 * 16 * control.minimum


@pytest.mark.parametrize("kinks", ["batched", pytest.param("stepping", marks=pytest.mark.long)])
@pytest.mark.verifies(
    "branches",
    reference="itself: every event located",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_the_vee_by_batches_has_the_folds_of_exact_passage(kinks):
    """The V-shaped body: folds where the exact passage has them, three solutions at 0.7."""
    runs = {}
    for mode in ("exact", kinks):
        body = cases.followed_mesh.system(cases.followed_mesh.arguments(["--size", "0.1"]), COMM)
        x = solved_start(body)
        with Follower(body, StepControl(kinks=mode, minimum=1e-6), gamma_scale=1.0) as follower:
            branch = follower.run(follower.start(x, 0.0), gamma_range=(0.0, 1.0))
            there = follower.at(branch, 0.7)
            runs[mode] = branch, [body.letters(p.piece) for p in there]
            assert branch.reason == "gamma reached the end of its range"
            assert branch.bifurcations == []
    exact, letters = runs["exact"]
    other, same = runs[kinks]
    assert same == letters
    assert len(same) == 3
    tolerance = 1e-10 if kinks == "batched" else 16 * 1e-6
    folds = [[s.gamma for s in branch.folds] for branch in (exact, other)]
    np.testing.assert_allclose(*folds, atol=tolerance)
    for s in other.folds:
        assert s.located == (kinks == "batched")
        low, high = s.bracket or (s.gamma, s.gamma)
        assert low <= s.gamma <= high
    # Every change of status on the way is recorded.
    assert sum(len(s.changes) for s in other.special) == sum(len(s.changes) for s in exact.special)


def many_corners(n, slopes):
    """x_i = g/100 + slopes_i max(0, g - i/n): n kinks on the way, straight in between."""
    at = np.arange(1, n + 1) / n

    def corner(g, s):
        return 0.01 * g + np.where(s, slopes * (g - at), 0.0)

    return Textbook(
        n,
        lambda x, g, s: x - corner(g, s),
        lambda x, g, s: np.eye(n),
        lambda x, g, s: -(0.01 + np.where(s, slopes, 0.0)),
        lambda x, g, s: [[((g - a) if c else (a - g), 1 - c)] for a, c in zip(at, s, strict=True)],
        lambda x, g: (g > at).astype(int),
        (0, 1),
    )


@pytest.mark.ranks(2)
def test_a_batch_brackets_its_events():
    """Many corners on a nearly straight line: few steps, every event in its bracket."""
    n = 40
    system = many_corners(n, np.full(n, 0.02))
    control = StepControl(kinks="batched", initial=0.1)
    branch = follow(
        system, start(system, np.zeros(n)), 0.0, gamma_range=(0.0, 2.0), control=control
    )
    assert branch.reason == "gamma reached the end of its range"
    events = branch.special
    assert len(events) == n
    assert len(branch.points) < n
    for s in events:
        (change,) = s.changes
        gamma = (change.point + 1) / n
        low, high = s.bracket
        assert low <= gamma <= high
        assert low <= s.gamma <= high
        # Distances are linear in gamma here, and so exact.
        assert abs(s.gamma - gamma) < 1e-9
        before, after = branch.points[s.index - 1 : s.index + 1]
        assert sorted((before.gamma, after.gamma)) == [low, high]
    assert [s.gamma for s in events] == sorted(s.gamma for s in events)


def test_events_that_are_asked_for_are_located():
    n = 40
    wanted = {4, 5, 30}
    system = many_corners(n, np.full(n, 0.02))
    control = StepControl(kinks="batched", initial=0.1)
    with Follower(
        system, control, gamma_scale=2.0, locate=lambda change: change.point in wanted
    ) as follower:
        begin = follower.start(start(system, np.zeros(n)), 0.0)
        branch = follower.run(begin, gamma_range=(0.0, 2.0))
    assert len(branch.special) == n
    located = {s.changes[0].point: s.gamma for s in branch.special if s.located}
    assert wanted <= set(located)
    assert len(located) < n / 2
    for point, gamma in located.items():
        assert abs(gamma - (point + 1) / n) < 1e-12
