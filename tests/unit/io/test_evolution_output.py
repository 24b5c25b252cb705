"""Files of histories: series, tables, animations."""

import csv
import itertools

from mpi4py import MPI

import numpy as np
import pytest
from support import recorded_path
from support.recorded_evolution import pair
from support.vtk_files import number_of_colours

from dolfinx_contact import plot, records
from dolfinx_contact.continuation import Observers
from dolfinx_contact.io import EvolutionSeries
from dolfinx_contact.laws import status
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.records import EvolutionRecord

COMM = MPI.COMM_WORLD
TIMES = [0.0, 1.0, 2.0, 3.0]


class Stop(Exception):
    """Exception of an observer."""


def lines(file):
    return file.read_text().splitlines()


def names(folder):
    """Return the names in a folder, synchronised over the ranks."""
    COMM.barrier()
    found = sorted(p.name for p in folder.iterdir())
    COMM.barrier()
    return found


@pytest.mark.ranks(2)
@pytest.mark.parametrize("format", [None, "vtk"])
def test_series_is_on_disk_after_each_step(folder, format):
    """Rows are on the disk at once; other runs go on with the numbers; nothing old is left."""
    evolution = pair(COMM, n=2)
    seen = []
    with EvolutionSeries(folder, evolution.problem, format=format) as series:

        def count(step):
            COMM.barrier()
            seen.append(len(lines(folder / "steps.csv")))

        observer = Observers(series, count)
        history = evolution.run(TIMES, observer=observer)
        later = evolution.run([3.0, 4.0], observer=observer)
    steps = [*history.steps, *later.steps]
    assert seen == list(range(3, len(steps) + 3))
    rows = list(csv.reader(lines(folder / "steps.csv")))
    expected = [*history.rows(), *later.rows()[1:]]
    assert rows[0] == list(expected[0])
    texts = [["" if v is None else str(v) for v in row.values()] for row in expected]
    assert rows[1:] == texts
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


def test_a_series_of_a_path_has_its_rows_and_every_second_state(folder):
    path = recorded_path.glued(COMM, 0.3, None, None)
    with EvolutionSeries(folder, path.problem, format="vtk", every=2) as series:
        history = path.run(gamma_range=(0.0, 1.0), max_steps=4, observer=series)
    rows = list(csv.DictReader(lines(folder / "steps.csv")))
    assert [row["gamma"] for row in rows] == [str(row["gamma"]) for row in history.rows()]
    assert len(list(folder.glob("evolution_contact0*.pvtu"))) == -(-len(rows) // 2)


def test_a_stopped_series_keeps_its_steps(folder):
    """Steps before the stop have tables and fields; steps of an earlier run have none."""
    for ends in (3.0, 2.0):
        evolution = pair(COMM, n=2)
        with EvolutionSeries(folder, evolution.problem, format="vtk") as series:

            def check(step, end=ends):
                if step.time > end:
                    raise Stop

            try:
                evolution.run(TIMES, observer=Observers(check, series))
            except Stop:
                assert ends == 2.0
    written = len(lines(folder / "steps.csv")) - 1
    assert written == 3
    assert len(list(folder.glob("evolution_contact0*.pvtu"))) == written


@pytest.mark.ranks(2)
def test_second_run_continues_the_numbers(folder):
    """A second run goes on with them, also from a record that was closed."""
    evolution = pair(COMM, n=2)
    with EvolutionRecord(folder, evolution) as record:
        evolution.run(TIMES[:2], record=record)
    other = pair(COMM, n=2)
    with EvolutionRecord(folder, other, resume=True) as record:
        record.go_on()
        history = other.run(TIMES[1:], record=record)
    assert [s.number for s in history.steps] == [2, 3]
    assert [row["step"] for row in records.read_journal(folder).rows()] == [0, 1, 2, 3]
    assert np.all(np.diff([s.time for s in history.steps]) > 0)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A history of two blocks, and its record."""
    evolution = pair(COMM, n=2)
    folder = COMM.bcast(tmp_path_factory.mktemp("record") if COMM.rank == 0 else None)
    with EvolutionRecord(folder / "record", evolution) as record:
        evolution.run(TIMES, record=record)
        yield record


@pytest.mark.ranks(2)
def test_a_film_takes_steps_and_their_states_on_any_number_of_ranks(folder):
    from PIL import Image

    evolution = pair(COMM, n=2)
    history = evolution.run(TIMES)
    for states in (history, history.steps, [step.state for step in history.steps]):
        file = plot.film(folder / "steps.gif", evolution.problem, states)
        with Image.open(file) as animation:
            assert animation.n_frames == len(history.steps)


@pytest.mark.ranks(2)
def test_pictures_of_states_have_their_times_and_statuses_as_titles():
    evolution = pair(COMM, n=2)
    steps = evolution.run(TIMES).steps
    problem = evolution.problem
    figure = plot.picture_of_states(None, problem, [steps[0], steps[-1].state])
    body = plot.picture_of_body(None, problem, state=steps[0].state)
    if COMM.rank == 0:
        titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
        expected = [f"time {s.time:.4g}: {status.summary(s.status)}" for s in (steps[0], steps[-1])]
        assert titles == expected
        present = {status.NAMES[letter] for s in (steps[0], steps[-1]) for letter in s.status}
        assert {text.get_text() for text in figure.legends[0].get_texts()} == present
        assert body.get_suptitle() == f"Deformed body, time {steps[0].time:.4g}"


@pytest.mark.ranks(2)
def test_a_film_of_contact_has_axes_for_all_states(folder):
    """It has a frame for each state; a single state is drawn with other axes."""
    from PIL import Image, ImageSequence

    evolution = pair(COMM, n=2)
    history = evolution.run(TIMES)
    problem = evolution.problem
    file = plot.film_of_contact(folder / "all.gif", problem, history.steps, size=400, title="joint")
    one = plot.film_of_contact(folder / "one.gif", problem, history.steps[:1], size=400)
    assert (file, one) == (folder / "all.gif", folder / "one.gif")
    if COMM.rank == 0:
        with Image.open(file) as animation, Image.open(one) as alone:
            frames = [np.asarray(f.convert("RGB"), int) for f in ImageSequence.Iterator(animation)]
            other = np.asarray(alone.convert("RGB"), int)
        assert len(frames) == len(history.steps)
        assert {max(f.shape) for f in frames} == {400}
        assert (np.abs(frames[0] - frames[-1]).max(axis=2) > 30).sum() > 100
        # the labels of the axes, at the left, differ from those of a single state
        changes = [np.abs(f - frames[0])[30:200, :30].max() for f in (*frames, other)]
        assert max(changes[:-1]) < 60 < changes[-1]
    with pytest.raises(ValueError, match="the size of a film in pixels must be"):
        plot.film_of_contact(folder / "all.gif", problem, history.steps, size=10)
    with pytest.raises(TypeError, match="film has no option 'stres'; its options are stress"):
        plot.film(folder / "all.gif", problem, history.steps, stres=None)


def test_films_and_pictures_refuse_other_items_than_states(folder):
    problem = pair(COMM, n=2).problem
    with pytest.raises(ValueError, match="a film has states, steps or texts, got 1"):
        plot.film(folder / "steps.gif", problem, [1, 2])
    with pytest.raises(ValueError, match="a film has states, steps or texts, got None"):
        plot.film(folder / "steps.gif", problem, [None])
    with pytest.raises(ValueError, match="takes States of a ContactProblem"):
        plot.picture_of_states(None, problem, [1])
    with pytest.raises(
        ValueError, match="curves must be a dictionary of curves by name, got a list"
    ):
        plot.draw_curves(None, [([0, 1], [0, 1])])


@pytest.mark.verifies(
    "pictures",
    "records of histories",
    reference="itself: as many pictures as steps, that differ",
    aspects=(
        "2D",
        "pairs",
        "records",
    ),
)
def test_an_animation_has_a_picture_of_each_state(folder, recorded):
    """The pictures have one size, differ, and are not blank."""
    from imageio import v2 as imageio
    from PIL import Image, ImageSequence

    problem = recorded.problem
    before = problem.u.x.array.copy()
    bodies = {1: 2.5e3, 2: 1e3}
    stress = {
        tag: LinearElastic.from_young(E, 0.3).full_stress(problem.u) for tag, E in bodies.items()
    }
    look = dict(stress=stress, scale=5.0, rate=5.0)
    states = [recorded.state(k) for k in (1, len(recorded.journal.states) - 1)]
    file = plot.film(folder / "blocks.gif", problem, states, **look)
    assert file == folder / "blocks.gif"
    np.testing.assert_array_equal(problem.u.x.array, before)
    with Image.open(file) as animation:
        seen = [np.asarray(f.convert("RGB"), int) for f in ImageSequence.Iterator(animation)]
        assert animation.info["duration"] == 200
    assert len(seen) == 2
    plot.film(folder / "blocks.mp4", problem, states, **look)
    assert imageio.get_reader(folder / "blocks.mp4").count_frames() == 2
    for a, b in itertools.pairwise(seen):
        assert a.shape == b.shape
        assert (np.abs(a - b).max(axis=2) > 30).sum() > 100
        assert a.mean() > 50
        assert number_of_colours(a) > 20
