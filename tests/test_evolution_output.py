"""What histories leave on the disk: series, tables, animations."""

from mpi4py import MPI

import numpy as np
import pytest
from recorded_evolution import pair

from dolfinx_contact import output
from dolfinx_contact.output import EvolutionRecord, EvolutionSeries

COMM = MPI.COMM_WORLD
TIMES = [0.0, 1.0, 2.0, 3.0]


class Stop(Exception):
    """What an observer raises."""


def lines(file):
    return file.read_text().splitlines()


def names(folder):
    """What is in a folder, on every rank at the same time."""
    COMM.barrier()
    found = sorted(p.name for p in folder.iterdir())
    COMM.barrier()
    return found


@pytest.mark.parametrize("format", [None, "vtk"])
def test_a_series_step_by_step(folder, format):
    """Rows are on the disk at once; other runs go on with the numbers; nothing old is left."""
    evolution, seen = pair(COMM, n=2), []
    with EvolutionSeries(folder, evolution.problem, format=format) as series:

        def observer(step):
            series(step)
            COMM.barrier()
            seen.append(len(lines(folder / "steps.csv")))

        history = evolution.run(TIMES, observer=observer)
        later = evolution.run([3.0, 4.0], observer=observer)
    steps = [*history.steps, *later.steps]
    assert seen == list(range(2, len(steps) + 2))
    rows = [row.split(",")[:2] for row in lines(folder / "steps.csv")]
    assert rows == [["step", "time"], *([str(s.number), str(s.time)] for s in steps)]
    assert [s.number for s in steps] == list(range(1, len(steps) + 1))
    assert {"steps.csv", "paraview.py"} < set(names(folder))
    assert all(file.exists() for file in series.files)

    def failing(t):
        raise Stop

    again = pair(COMM, n=2)
    again.load = failing
    with pytest.raises(Stop), EvolutionSeries(folder, again.problem, format=format) as series:
        again.run(TIMES, observer=series)
    assert names(folder) == ["paraview.py"]
    assert series.files == []


def test_a_series_that_is_stopped(folder):
    """Of the steps before it has table and fields, and of the run before nothing."""
    for ends in (3.0, 2.0):
        evolution = pair(COMM, n=2)
        with EvolutionSeries(folder, evolution.problem, format="vtk") as series:

            def observer(step, series=series, end=ends):
                if step.time > end:
                    raise Stop
                series(step)

            try:
                evolution.run(TIMES, observer=observer)
            except Stop:
                assert ends == 2.0
    written = len(lines(folder / "steps.csv")) - 1
    assert written == 2
    assert len(list((folder / "evolution_contact").iterdir())) == written


def test_a_series_outside_of_its_context(folder):
    evolution = pair(COMM, n=2)
    series = EvolutionSeries(folder, evolution.problem)
    with pytest.raises(ValueError, match="writes in its context alone"):
        evolution.run(TIMES, observer=series)
    with series:
        pass
    with pytest.raises(ValueError, match="writes in its context alone"):
        evolution.run([1.0, 2.0], observer=series)
    assert names(folder) == []


def test_numbers_in_a_record(folder):
    """A second run goes on with them, also from a record that was closed."""
    evolution = pair(COMM, n=2)
    with EvolutionRecord(folder, evolution) as record:
        evolution.run(TIMES[:2], record=record)
    other = pair(COMM, n=2)
    with EvolutionRecord(folder, other, resume=True) as record:
        record.go_on()
        history = other.run(TIMES[1:], record=record)
    assert [s.number for s in history.steps] == [2, 3]
    assert [row["step"] for row in output.read_evolution(folder).rows()] == [1, 2, 3]
    assert np.all(np.diff([s.time for s in history.steps]) > 0)
