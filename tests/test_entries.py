"""Entries of journals: their fields are the keys of lines, which come back as they were."""

import json
from dataclasses import fields, replace

import pytest

from dolfinx_contact.continuation import Ending, StepControl
from dolfinx_contact.evolution.path_state import Known
from dolfinx_contact.records.entries import (
    Arrived,
    BranchTask,
    ChangeEntry,
    EndEntry,
    HistoryGoesOn,
    JournalNode,
    NodePoint,
    PathGoesOn,
    PointEntry,
    RayEntry,
    SpecialEntry,
    StateEntry,
)

CHANGE = ChangeEntry(surface="contact", x=[0.5, 0.0], before="o", after="k")
SPECIAL = dict(
    kind="event",
    smooth=False,
    gamma=0.5,
    parity=None,
    others=0,
    complete=True,
    bracket=[0.4, 0.6],
    changes=[CHANGE],
)
POINT = PointEntry(
    index=3,
    gamma=0.5,
    step=0.1,
    corrections=2,
    tau=1.0,
    status="ok",
    counts={"open": 1, "stick": 1},
    special=[SpecialEntry(**SPECIAL)],
    norm=2.0,
    functionals={"force": -1.0},
    next_step=0.1,
    x_scale=1.0,
    largest_distance=0.2,
    scales=[1.0, 2.0],
    tangent_gamma=0.7,
)
NODE = JournalNode(
    point=NodePoint(**SPECIAL, method="rays"),
    rays=[RayEntry(status="ok", gamma=-0.3)],
    edges=[None, 2],
)
TASK = BranchTask(
    gamma_range=[0.0, 1.0],
    gamma_scale=1.0,
    control=StepControl(initial=0.1),
    max_steps=7,
    to_node=True,
)
HISTORY = HistoryGoesOn(
    number=4, length=0.1, rate=[1.0, 2.0], settled=False, ending=Ending.STOPPED, reason="enough"
)
PATH = PathGoesOn(
    gamma=0.3,
    arrived=Arrived(tangent=0.1, piece="ok", step=0.1, corrections=1, tau=0.5),
    number=4,
    length=0.1,
    known=Known(1.0, 2.0, [3.0], [1.0]),
    ending=None,
    reason="",
)


def state(run, **more):
    return StateEntry(
        index=1,
        time=0.5,
        status="ok",
        size=3.0,
        energies={"stored": 1.0},
        data={"the friction": [0.3]},
        first=False,
        run=run,
        checkpoint="state_000001",
        sum="0123abcd",
        **more,
    )


def through_file(line):
    return json.loads(json.dumps(line))


@pytest.mark.parametrize("entry", [POINT, NODE, TASK, EndEntry(ending=Ending.CLOSED, reason="it")])
def test_entries_come_back(entry):
    """Of a line, with whatever else stands there."""
    assert type(entry).of_line(through_file({"type": "any", **entry.line()})) == entry


@pytest.mark.parametrize("run", [HISTORY, PATH])
def test_states_come_back(run):
    """With the keys of how the run goes on among those of the line."""
    for entry in (state(run), state(run, row={"time": 0.5}, surface="state_000001")):
        line = through_file(entry.line())
        assert set(run.line()) < set(line)
        assert StateEntry.of_line(line, run=type(run)) == entry
        assert (line["norm"], "size" in line) == (3.0, False)


def test_what_is_not_known_has_no_key():
    """As a checkpoint where no fields were kept."""
    assert set(POINT.line()) == {f.name for f in fields(POINT)} - {
        *("checkpoint", "sum", "surface", "surface_sum", "ending", "reason")
    }
    kept = replace(POINT, checkpoint="point", sum="0123abcd")
    assert kept.line() == POINT.line() | {"checkpoint": "point", "sum": "0123abcd"}


def test_statuses_stand_where_they_change():
    """A line without them has those of the point before."""
    line = through_file(POINT.line_after(POINT))
    assert "status" not in line
    assert PointEntry.of_line_after(line, [POINT]) == POINT
    other = replace(POINT, status="kk")
    assert PointEntry.of_line_after(through_file(other.line_after(POINT)), [POINT]) == other
    with pytest.raises(IndexError):
        PointEntry.of_line_after(line, [])


@pytest.mark.parametrize("key", ["gamma", "next_step", "special", "functionals", "counts"])
def test_a_missing_key_is_an_error(key):
    line = POINT.line()
    del line[key]
    with pytest.raises(KeyError, match=key):
        PointEntry.of_line(line)
