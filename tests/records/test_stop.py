"""Runs that the user stops: histories and motions end with a step, and go on from there."""

from mpi4py import MPI

import numpy as np
import pytest
from support import recorded_evolution
from support.recorded_evolution import TIMES

from dolfinx_contact.continuation import Ending
from dolfinx_contact.records import EvolutionRecord, read_journal

COMM = MPI.COMM_WORLD


class Killed(Exception):
    """Exception of an observer."""


def made(case):
    """Return an evolution, its times, and a function shortening it."""
    if case == "motion":
        return recorded_evolution.moving(COMM), TIMES[:2], {}
    return recorded_evolution.pair(COMM, n=2), TIMES[:3], {"longest": 0.5}


def after(number, asked):
    """Stop criterion after a step, which stores its arguments and the numbers of closed points."""

    def stop(step):
        asked.append(step.number)
        return "far enough" if step.number == number else ""

    return stop


def later(times, start):
    return [start, *(t for t in times if t > start)]


def of(history):
    return [(s.number, s.time, s.status, s.energies) for s in history.steps]


@pytest.mark.ranks(2)
@pytest.mark.parametrize("case", ["pair", "motion"])
@pytest.mark.verifies(
    "stops",
    reference="itself: the run without a stop",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_a_stopped_run_and_its_continuation_are_the_whole_run(case):
    """A stopped run and its continuation have the steps of an uninterrupted run."""
    evolution, times, steps = made(case)
    asked = []
    whole = evolution.run(times, stop=after(-1, asked), **steps)
    numbers = [s.number for s in whole.steps]
    assert whole.ending is Ending.REACHED
    assert asked == numbers[:-1]  # where it ends of itself nobody is asked
    assert len(numbers) > 3
    evolution, times, steps = made(case)
    asked = []
    seen = []
    told = {"stop": after(2, asked), "observer": lambda step: seen.append(step.number)}
    first = evolution.run(times, **told, **steps)
    assert asked == seen == [1, 2]
    assert not first.complete
    assert first.ending is Ending.STOPPED
    assert first.reason == "far enough"
    assert of(first) == of(whole)[:2]
    rest = evolution.run(later(times, first.time), **steps)
    assert rest.complete
    assert [s.number for s in rest.steps] == numbers[2:]
    assert rest.steps[-1].status == whole.steps[-1].status
    a, b = (h.energies.external for h in (rest, whole))
    assert a == pytest.approx(b, rel=1e-9)


@pytest.mark.ranks(2)
def test_stop_criterion_sees_the_end_of_the_step():
    """The end of the step, as when the observer is told of it."""
    evolution, times, steps = made("pair")
    problem = evolution.problem

    def seen():
        return problem.u.x.array.copy()

    asked = []
    told = []

    def stop(step):
        asked.append(seen())
        problem.u.x.array[:] *= 7.0  # put back, what it does is no affair of the run
        problem.u.x.array[:] /= 7.0
        return ""

    evolution.run(times, stop=stop, observer=lambda _: told.append(seen()), **steps)
    assert len(asked) == len(told) - 1 > 2
    for a, b in zip(asked, told, strict=False):
        np.testing.assert_array_equal(a, b)


@pytest.mark.ranks(2)
def test_one_rank_alone_stops():
    """Refused before anything is computed."""
    if COMM.size == 1:
        pytest.skip("there are several ranks in this")
    evolution, times, steps = made("pair")
    with pytest.raises(ValueError, match="stop differs between ranks"):
        evolution.run(times, stop=after(1, []) if COMM.rank == 0 else None, **steps)


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "stops",
    "records of histories",
    reference="itself: the run that stays stopped",
    aspects=(
        "2D",
        "pairs",
        "records",
    ),
)
def test_a_killed_run_that_had_to_stop_stays_stopped(folder):
    """After killing it during the last call of the observer, it stays stopped."""

    def observer(step):
        if step.number == 2:
            raise Killed

    evolution, times, steps = made("pair")
    with EvolutionRecord(folder, evolution) as kept, pytest.raises(Killed):
        evolution.run(times, record=kept, stop=after(2, []), observer=observer, **steps)
    assert [row["step"] for row in read_journal(folder).rows()] == [0, 1, 2]
    evolution, times, steps = made("pair")
    asked = []
    with EvolutionRecord(folder, evolution, resume=True) as kept:
        history = kept.go_on(stop=after(2, asked))
        assert (history.steps, asked) == ([], [])
        assert (history.ending, history.reason) == (Ending.STOPPED, "far enough")
        # What follows is a run of its own.
        assert evolution.run(later(times, history.time), record=kept, **steps).complete
    assert kept.journal.runs[-1].ending is Ending.REACHED
