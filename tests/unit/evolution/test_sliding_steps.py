"""Steps of bodies that slide over each other, which know their size."""

import logging

from mpi4py import MPI

import cases.flattened_ring
import numpy as np
import pytest
from support.mortars import stacked
from support.sliding_bodies import TIMES, Bodies, sliding_history

from dolfinx_contact import Coulomb, Frictionless
from dolfinx_contact.evolution import NoContinuation, QuasiStatic

COMM = MPI.COMM_WORLD


def same(a, b, tolerance):
    """Whether two problems are at the same state, relative to its size."""
    off = np.array(
        [
            [np.abs(f.x.array - g.x.array).max(initial=0.0), np.abs(f.x.array).max(initial=0.0)]
            for f, g in zip(a.fields, b.fields, strict=True)
        ]
    )
    off, size = COMM.allreduce(off, np.maximum).T
    return bool(np.all(off <= tolerance * size))


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "self contact",
    reference="itself: steps of which none is halved",
    aspects=("2D", "large sliding"),
)
def test_a_step_in_a_cycle_is_halved(caplog):
    """A ring that first touches itself: no strategy but Newton's method is tried."""
    args = cases.flattened_ring.arguments(["--n=32", "--friction=0.5"])
    times = np.linspace(0.0, 1.65, 18)
    ends = []

    def pressed(times):
        ring = cases.flattened_ring.Ring(args, COMM, whole=True)

        def load(t):
            ring.plate.value[1] = cases.flattened_ring.OUTER - t

        history = QuasiStatic(ring.problem, load).run(
            times,
            halve_steps=True,
            stop=lambda step: "it was halved" if step.rejected else "",
        )
        ends.append(ring.problem)
        return history

    with caplog.at_level(logging.INFO, "dolfinx_contact"):
        history = pressed(times)
    last = history.steps[-1]
    assert last.rejected == 1
    assert last.time - last.start == pytest.approx(times[1] / 2)
    assert COMM.rank > 0 or "the status repeats in a cycle" in caplog.text
    assert all("failed" not in r.message for r in caplog.records if r.levelno > logging.INFO)
    again = pressed([0.0, *(s.time for s in history.steps)])
    assert not any(s.rejected for s in again.steps)
    assert same(*ends, 1e-8)


@pytest.mark.long
@pytest.mark.verifies(
    "sliding pairs",
    reference="itself: solves that begin at the state before",
    aspects=("2D", "pairs", "large sliding"),
)
def test_extrapolation_changes_no_result():
    """To and fro over facets: the same end, and fewer iterations."""
    ends = []
    counts = []
    for extrapolate in (False, True):
        bodies = Bodies(stacked(10, 7, (-1.0, 2.0), (0.0, 1.0), "quad"), 2, Coulomb(0.3))
        history = sliding_history(bodies).run(TIMES, extrapolate=extrapolate)
        assert history.reason == "the last time is reached"
        ends.append(bodies.problem)
        counts.append(sum(s.result.iterations for s in history.steps))
    assert same(*ends, 1e-7)
    assert counts[1] < counts[0]


def pressed_block(way):
    """A soft block on another, pressed down by a part of its height, and its history."""
    bodies = Bodies(stacked(4, 3, (-0.5, 1.5), (0.0, 1.0), "quad"), 3, Frictionless())

    def load(t):
        bodies.move(lambda X: np.tile([0.0, -way * t], (len(X), 1)))

    return QuasiStatic(bodies.problem, load)


@pytest.mark.verifies(
    "sliding pairs",
    "hyperelastic bodies",
    reference="itself: shorter steps",
    aspects=("2D", "pairs", "large sliding"),
)
def test_a_fall_of_the_smallest_det_is_refused():
    """A folded solution ends a run; if steps are halved, the run continues."""
    with pytest.raises(NoContinuation, match=r"the smallest det F falls from .*halve_steps=True"):
        pressed_block(0.9).run([0.0, 1.0])
    history = pressed_block(0.9).run([0.0, 1.0], halve_steps=True)
    assert history.complete
    assert sum(s.rejected for s in history.steps) > 0
    assert [s.inserted for s in history.steps] == [True] * (len(history.steps) - 1) + [False]


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "sliding pairs",
    reference="closed form: a way over the size of a facet",
    aspects=("2D", "pairs", "large sliding"),
)
def test_facets_that_a_step_passes(caplog):
    """A block that slides without friction over a plate: the way, and a word about it, once."""
    bodies = Bodies(stacked(40, 5, (-1.0, 2.0), (0.0, 1.0), "quad"), 3, Frictionless())

    def load(t):
        shift = [0.15 * max(t - 1.0, 0.0), -1e-3 * min(t, 1.0)]
        bodies.move(lambda X: np.tile(shift, (len(X), 1)))

    history = QuasiStatic(bodies.problem, load).run([0.0, 1.0, 2.0, 4.0, 6.0])
    ways = [s.result.indicators.surfaces["contact"].slip_in_step for s in history.steps]
    facet = 3.0 / 40
    expected = np.array([0.0, 0.15, 0.3, 0.3]) / facet
    np.testing.assert_allclose(ways, expected, atol=0.03)
    told = [r for r in caplog.records if "facets of the other face" in r.message]
    assert len(told) == (COMM.rank == 0)
