"""Pages of records: what they hold is what was recorded; they are written once, or refused."""

import base64
import html.parser
import json
import os
import shutil
import subprocess
import sys
import zlib
from importlib.resources import files
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import recorded_evolution
import recorded_path
from matplotlib.colors import to_hex
from recorded_run import moved_block, record

from dolfinx_contact import Sphere, plot
from dolfinx_contact.__main__ import main
from dolfinx_contact.analysis import Chart, ChartCell, ChartCurve
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.io.outside import OuterSurface, SurfaceState
from dolfinx_contact.plot.curves import FILLS
from dolfinx_contact.plot.page import writing
from dolfinx_contact.plot.page.faces import points_on_face
from dolfinx_contact.plot.page.of_charts import scene_of_chart
from dolfinx_contact.plot.page.packing import Arrays, largest_value, packed_field
from dolfinx_contact.plot.page.scene import Mark, Scene, SeriesShown
from dolfinx_contact.records import EvolutionRecord, PathRecord, read_journal
from dolfinx_contact.records.journal import FILE_NAME

COMM = MPI.COMM_WORLD
KEPT = {"surface_displacement": True}
serial = pytest.mark.skipif(COMM.size > 1, reason="nothing is computed on ranks")


@pytest.fixture
def no_library(monkeypatch):
    """Pages without plotly, whose script says nothing of what they hold."""
    monkeypatch.setattr(writing, "_library", lambda: b"library")


# -- a reader of pages, by itself ------------------------------------------------------------------


class Scripts(html.parser.HTMLParser):
    """The scripts of a page by their ids, and its title."""

    def __init__(self, text):
        super().__init__()
        self.found = {}
        self.title = ""
        self.links = []
        self._in = None
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        known = dict(attributes)
        self.links += [known[k] for k in ("src", "href") if k in known]
        self._in = (tag, known.get("id"))

    def handle_endtag(self, tag):
        self._in = None

    def handle_data(self, data):
        if self._in and self._in[0] == "script" and self._in[1]:
            self.found[self._in[1]] = data
        elif self._in and self._in[0] == "title":
            self.title += data


class Page:
    """What a page holds."""

    def __init__(self, text):
        scripts = Scripts(text)
        assert scripts.links == []
        self.title = scripts.title
        self.meta = json.loads(scripts.found["meta"])
        self.library = zlib.decompress(base64.b64decode(scripts.found["library"]))
        self._scripts = scripts.found

    def array(self, name):
        words = self.meta["arrays"][name]
        data = zlib.decompress(base64.b64decode(self._scripts[f"array:{name}"]))
        if words["dtype"] == "text":
            return data.decode()
        dtype = np.dtype("<" + words["dtype"])
        raw = np.frombuffer(data, np.uint8).reshape(dtype.itemsize, -1).T.copy()
        if words["xor"] and words["shape"][0] > 1:
            raw = np.bitwise_xor.accumulate(raw.reshape(words["shape"][0], -1), axis=0)
        return raw.reshape(-1).view(dtype).reshape(words["shape"])

    def field(self, field, state):
        block = [b for b in field["blocks"] if b["first"] <= state][-1]
        modes, steps, parts = (self.array(block[k]) for k in ("modes", "steps", "parts"))
        assert modes.dtype == np.int16
        values = (parts[state - block["first"]] * steps) @ modes.astype(np.float32)
        return values.reshape(field["vertices"], field["components"])

    def table(self, face, state):
        group = [g for g in face["groups"] if g["first"] <= state][-1]
        return {k: self.array(a)[state - group["first"]] for k, a in group["arrays"].items()}

    def column(self, name):
        names = [c["name"] for c in self.meta["columns"]]
        return self.array("columns")[names.index(name)]


def read(file):
    return Page(Path(file).read_text(encoding="utf-8"))


def made(scene, **options):
    given = {"title": "a title", "labels": {}, "units": {}, "error": 0.005} | options
    return Page(writing.page(scene, b"library", *given.values()))


# -- packing ---------------------------------------------------------------------------------------


def unpacked(arrays, field, count):
    """A field at all states, decoded here."""
    found = []
    for block in field["blocks"]:
        parts = []
        for name in ("modes", "steps", "parts"):
            packed = arrays.packed[block[name]]
            dtype = np.dtype("<" + packed.words["dtype"])
            raw = np.frombuffer(zlib.decompress(base64.b64decode(packed.data)), np.uint8)
            flat = raw.reshape(dtype.itemsize, -1).T.copy().reshape(-1).view(dtype)
            parts.append(flat.reshape(packed.words["shape"]))
        modes, steps, weights = parts
        found.append((weights * steps) @ modes.astype(np.float32))
    return np.concatenate(found).reshape(count, -1, field["components"])


def turning(count, n, dim=3):
    """A body that turns and trembles, with its displacement."""
    rng = np.random.default_rng(1)
    x = rng.random((n, dim))
    waves = [rng.normal(size=(n, dim)) / 2.0**k for k in range(12)]
    states = []
    for angle in np.linspace(0, 2.5, count):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.eye(dim)
        turn[:2, :2] = [[c, -s], [s, c]]
        shaken = sum(0.02 * np.sin((k + 2) * angle) * wave for k, wave in enumerate(waves))
        states.append(x @ turn.T - x + shaken)
    return np.array(states)


@serial
@pytest.mark.parametrize("allowed", [0.005, 0.0005])
@pytest.mark.parametrize(("count", "n"), [(1, 7), (40, 200), (300, 60)])
def test_the_error_of_packing_is_the_stated_one(count, n, allowed):
    states = turning(count, n)[-count:] + 0.1
    arrays = Arrays()
    largest, low, high = largest_value("u", count, lambda i: states[i])
    field = packed_field(arrays, "u", count, lambda i: states[i], allowed * largest)
    off = np.linalg.norm(unpacked(arrays, field, count) - states, axis=2).max()
    np.testing.assert_allclose(largest, np.linalg.norm(states, axis=2).max())
    np.testing.assert_array_equal(
        [low, high], [np.minimum(states.min((0, 1)), 0), states.max((0, 1))]
    )
    assert 0 < field["error"] <= allowed * largest
    np.testing.assert_allclose(off, field["error"], rtol=1e-4)
    # What is packed is a part of what it was.
    size = sum(len(p.data) for p in arrays.packed.values())
    assert count == 1 or size < states.astype(np.float32).nbytes / 2


@serial
def test_a_field_that_is_zero_or_not_finite():
    arrays = Arrays()
    zero = np.zeros((3, 5, 2))
    field = packed_field(arrays, "u", 3, lambda i: zero[i], 0.0)
    assert field["error"] == 0
    np.testing.assert_array_equal(unpacked(arrays, field, 3), zero)
    zero[1, 2, 0] = np.nan
    with pytest.raises(ValueError, match="u of state 1 has an entry that is not finite"):
        largest_value("u", 3, lambda i: zero[i])
    with pytest.raises(ValueError, match="u of state 2 is that of another mesh"):
        largest_value("u", 3, lambda i: np.zeros((5 + (i == 2), 2)))
    states = turning(5, 30)
    # What is not allowed by far is told, and is not refused.
    assert 1e-9 < packed_field(Arrays(), "u", 5, lambda i: states[i], 1e-9)["error"] < 1e-4


@serial
def test_states_that_have_nothing_in_common():
    """The least error that is allowed is reached whatever the states."""
    states = np.random.default_rng(3).normal(size=(128, 150, 3))
    arrays = Arrays()
    largest = np.linalg.norm(states, axis=2).max()
    field = packed_field(arrays, "u", 128, lambda i: states[i], 1e-4 * largest)
    off = np.linalg.norm(unpacked(arrays, field, 128) - states, axis=2).max()
    assert off <= 1.001 * field["error"] <= 1.001e-4 * largest


@serial
def test_contact_points_on_facets():
    """Points on triangles, quadrilaterals and edges are where their weights say."""
    rng = np.random.default_rng(2)
    x = np.array([[i, j, 0.2 * i] for j in range(3) for i in range(4)], float)
    quads = [
        [i + 4 * j, i + 1 + 4 * j, i + 4 + 4 * j, i + 5 + 4 * j] for j in (0, 1) for i in (0, 1, 2)
    ]
    triangles = [t for q in quads for t in (q[:3], q[1:])]
    points = np.column_stack([3 * rng.random(40), 2 * rng.random(40), np.zeros(40)])
    points[:, 2] = 0.2 * points[:, 0]
    points[0] = x[5]
    for facets in (quads, triangles):
        found = points_on_face(x, np.array(facets), points)
        there = np.einsum("nk,nkc->nc", found.weights, x[found.nodes])
        np.testing.assert_allclose(there, points, atol=1e-12)
        assert found.nearest.shape == np.shape(facets)
        assert found.weights.min() > -0.51
    edges = np.array([[2, 1], [3, 2], [0, 1]])
    found = points_on_face(x[:4], edges, np.array([[2.25, 0, 0.45], [0.5, 0, 0.1], [1, 0, 0.2]]))
    np.testing.assert_allclose(found.place, np.array([2.25, 0.5, 1.0]) * np.hypot(1, 0.2))
    nothing = points_on_face(x, np.array(quads), np.zeros((0, 3)))
    assert nothing.nodes.shape == (0, 4)


# -- records ---------------------------------------------------------------------------------------


def check_states(page, journal, entries, allowed=0.005):
    """Compare the body and the tables of a page with a record."""
    surface = journal.surface()
    np.testing.assert_array_equal(page.array("body.x"), surface.x)
    np.testing.assert_array_equal(page.array("body.cells"), surface.cells)
    states = [journal.surface_at(i) for i in range(len(entries))]
    for name, read in (("displacement", lambda s: s.u), ("strain", lambda s: s.strain[:, None])):
        field = page.meta["fields"][name]
        largest = max(np.linalg.norm(read(s), axis=1).max() for s in states)
        worst = 0.0
        for i, state in enumerate(states):
            off = np.linalg.norm(page.field(field, i) - read(state), axis=1).max()
            worst = max(worst, off / largest)
        assert worst <= allowed
        np.testing.assert_allclose(field["error"], worst, rtol=1e-3, atol=1e-9)
    said = f"displacements {100 * page.meta['fields']['displacement']['error']:.2g} %"
    assert any(said in note for note in page.meta["notes"])
    largest = page.meta["fields"]["displacement"]["largest"]
    for face in page.meta["surfaces"]:
        name = face["name"]
        np.testing.assert_array_equal(page.array(face["cells"]), surface.contact[name])
        for i, state in enumerate(states):
            table = page.table(face, i)
            known = state.tables[name]
            assert bytes(table.pop("letters")).decode() == "".join(known["letters"])
            assert set(table) >= {"x", "area", "un", "ut", "n", "pressure", "shear", "support"}
            if "bond" in table:
                assert bytes(table.pop("bond")).decode() == "".join(known["bond"])
            for column, values in table.items():
                assert values.dtype == np.float64
                np.testing.assert_array_equal(values, known[column].reshape(values.shape))
            if face["obstacle"]:
                floor, moved, _ = state.obstacles[name]
                start = page.array(face["obstacle"]["x"])[:, : floor.shape[1]]
                way = page.array(face["obstacle"]["way"]) + page.field(face["obstacle"]["field"], i)
                off = np.linalg.norm(start + way - floor - moved, axis=1).max()
                assert off <= 1.001 * allowed * largest + 1e-14 * np.abs(floor).max()
            else:
                assert name not in state.obstacles


@pytest.mark.parametrize("cell", ["quad", pytest.param("tet", marks=pytest.mark.long)])
@pytest.mark.verifies(
    "explorer",
    "pictures",
    reference="itself: the journal, number by number",
    aspects=(
        "2D",
        "3D",
        "branches",
        "records",
    ),
)
def test_a_branch(cell, folder, no_library):
    n = 4 if cell == "quad" else 2
    system, functionals = moved_block(COMM, cell=cell, n=n)
    record(system, functionals, folder / "branch", max_steps=20, **KEPT)
    counts = [plot.SolutionCount(0.1, 1, True, "by hand"), plot.SolutionCount(0.2, 3, False)]
    look = dict(counts=counts, title="Ein Klötzchen <b>&", units={"length": "mm"})
    file = plot.explorer(folder / "page.html", folder / "branch", **look)
    assert file == folder / "page.html"
    if COMM.rank == 0:
        page = read(file)
        journal = read_journal(folder / "branch")
        columns = journal.columns(0)
        for name in ("gamma", "volume", "force", "open", "stick", "slip", "step", "norm"):
            np.testing.assert_array_equal(page.column(name), columns[name])
        np.testing.assert_array_equal(page.column("distance"), np.cumsum(columns["step"]))
        assert page.array("words").split("\n") == columns["status"].tolist()
        assert page.array("states").tolist() == list(range(len(columns["gamma"])))
        special = [(s.kind, s.gamma) for p in journal.entries() for s in p.special]
        marks = page.meta["series"][0]["marks"]
        assert [(m["kind"], m["at"]["gamma"]) for m in marks] == special
        gammas = columns["gamma"]
        for mark in marks:
            i = mark["index"]
            between = gammas[i - 1] + mark["share"] * (gammas[i] - gammas[i - 1])
            np.testing.assert_allclose(between, mark["at"]["gamma"], rtol=1e-9)
        assert page.title == page.meta["title"] == "Ein Klötzchen <b>&"
        assert page.meta["units"] == {"length": "mm"}
        assert [c["proved"] for c in page.meta["counts"]] == [True, False]
        assert page.meta["axes"] == ["gamma", "volume"]
        assert page.library == b"library"
        check_states(page, journal, journal.entries())
    COMM.barrier()


def test_functionals_with_names_of_the_page(folder, no_library):
    """What the user has named is shown under that name; what the page adds takes another."""
    system, _ = moved_block(COMM)
    functionals = {"distance": lambda p: 42.0, "series": lambda p: 43.0}
    record(system, functionals, folder / "branch", max_steps=3)
    plot.explorer(folder / "page.html", folder / "branch", labels={"distance": "far"})
    if COMM.rank == 0:
        page = read(folder / "page.html")
        np.testing.assert_array_equal(page.column("distance"), [42.0] * 4)
        np.testing.assert_array_equal(page.column("series"), [43.0] * 4)
        along = np.cumsum(read_journal(folder / "branch").columns()["step"])
        np.testing.assert_array_equal(page.column("distance along the branch"), along)
        names = [c["name"] for c in page.meta["columns"]]
        assert len(set(names)) == len(names)
    COMM.barrier()


def test_a_round_obstacle_and_small_displacements(folder, no_library):
    """Gaps that are long beside displacements are exact, and a page is made."""
    disc = Sphere((0.5, -0.602), 0.6)
    system, functionals = moved_block(COMM, obstacle=disc, sliding="small")
    record(system, functionals, folder / "branch", max_steps=3, **KEPT)
    plot.explorer(folder / "page.html", folder / "branch", error=1e-4)
    if COMM.rank == 0:
        page = read(folder / "page.html")
        journal = read_journal(folder / "branch")
        check_states(page, journal, journal.entries(), 1e-4)
        field = page.meta["fields"]["displacement"]
        floor, moved, _ = journal.surface_at(0).obstacles["contact"]
        (face,) = page.meta["surfaces"]
        way = page.array(face["obstacle"]["way"])
        start = page.array(face["obstacle"]["x"])[:, :2]
        np.testing.assert_allclose(start + way, floor + moved, rtol=1e-15)
        # Single precision would be seen where displacements are exaggerated.
        np.testing.assert_allclose(np.hypot(*(floor - [0.5, -0.602]).T), 0.6, rtol=1e-15)
        assert np.linalg.norm(way, axis=1).max() > 100 * field["largest"]
    COMM.barrier()


@serial
@pytest.mark.parametrize("far", [1.0, np.nan])
def test_an_obstacle_that_a_page_cannot_hold(far):
    """It is left out, with a note that says so; the rest is shown."""
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    edge = np.array([[0, 1]])
    scene = plain_scene({"gamma": [0, 1, 2]})
    scene.series[0].states[:] = range(3)
    scene.body = OuterSurface(x, np.arange(3), np.array([[0, 1, 2]]), {"floor": edge}, {},
                              {"floor": edge})  # fmt: skip
    places = np.random.default_rng(4).random((3, 2, 2))

    def state(i):
        floor = far * places[i]
        obstacle = np.array([floor, 0 * floor, np.tile([0.0, 1.0], (2, 1))])
        return SurfaceState(1e-9 * i * x[:, :2], {"floor": obstacle})

    scene.states = [lambda i=i: state(i) for i in range(3)]
    page = made(scene)
    (face,) = page.meta["surfaces"]
    assert face["obstacle"] is None
    assert not any("obstacle" in name for name in page.meta["arrays"])
    assert any("The obstacle of floor is not shown" in note for note in page.meta["notes"])
    np.testing.assert_allclose(page.field(page.meta["fields"]["displacement"], 2),
                               2e-9 * x[:, :2], rtol=1e-4)  # fmt: skip


@pytest.mark.parametrize("kind", ["pair", "moving", "cracked"])
@pytest.mark.verifies(
    "explorer",
    reference="itself: the journal, number by number",
    aspects=(
        "2D",
        "pairs",
        "records",
    ),
)
def test_a_history(kind, folder, no_library):
    evolution = getattr(recorded_evolution, kind)(COMM)
    with EvolutionRecord(folder / kind, evolution, **KEPT) as kept:
        history = evolution.run(np.linspace(0, 1, 5), record=kept)
    plot.explorer(folder / "page.html", folder / kind)
    if COMM.rank == 0:
        page = read(folder / "page.html")
        journal = read_journal(folder / kind)
        check_states(page, journal, journal.entries())
        rows = history.rows()
        for name in ("time", "stored", "dissipated", "newton_iterations", "stick"):
            np.testing.assert_array_equal(page.column(name)[1:], [row[name] for row in rows])
        assert page.column("time")[0] == 0
        assert page.meta["along"] == "time"
        assert page.meta["axes"][0] == "time"
        assert page.meta["axes"][1].rpartition("_")[2] in "xy"  # a contact force
    COMM.barrier()


@pytest.mark.verifies(
    "explorer",
    reference="itself: the journal, number by number",
    aspects=(
        "2D",
        "records",
    ),
)
def test_a_path(folder, no_library):
    path = recorded_path.made("bonds")
    with PathRecord(folder / "path", path, **KEPT) as kept:
        control = StepControl(initial=0.1, maximum=0.2)
        history = path.run(gamma_range=(0.0, 0.7), control=control, record=kept, max_steps=8)
    plot.explorer(folder / "page.html", folder / "path")
    if COMM.rank == 0:
        page = read(folder / "page.html")
        journal = read_journal(folder / "path")
        check_states(page, journal, journal.entries())
        np.testing.assert_array_equal(page.column("gamma"), journal.gammas)
        np.testing.assert_array_equal(page.column("arc")[1:], [s.time for s in history.steps])
        kinds = [row["event"] for row in journal.rows() if row["event"]]
        assert [m["kind"] for m in page.meta["series"][0]["marks"]] == kinds
        assert page.meta["axes"][0] == "gamma"
        face = page.meta["surfaces"][0]
        assert "internal.beta" in page.table(face, 1)
    COMM.barrier()


# -- what a scene may have -------------------------------------------------------------------------


def plain_scene(columns, **more):
    count = len(next(iter(columns.values())))
    columns = {k: np.array(v, dtype=float) for k, v in columns.items()}
    series = SeriesShown("branch 0", columns, ["ok"] * count, [-1] * count, **more)
    return Scene("branches", next(iter(columns)), list(columns), series=[series])


@serial
def test_words_of_users_are_words():
    """Names with tags, quotes, marks of the template and letters of all kinds."""
    evil = "</script><script>alert(1)</script> \u2028 @DATA@ \"'&lt; ü γ 接触"
    scene = plain_scene({"gamma": [0, 1], evil: [1, 2]}, marks=[Mark(1, evil, evil)], ending=evil)
    text = writing.page(scene, b"library", evil, {"gamma": evil}, {}, 0.005)
    page = Page(text)
    assert page.title == page.meta["title"] == evil
    assert [c["label"] for c in page.meta["columns"]] == [evil, evil]
    assert page.meta["series"][0]["marks"][0]["text"] == evil
    assert text.count("alert(1)</script>") == 0
    np.testing.assert_array_equal(page.column(evil), [1, 2])


@serial
def test_points_without_numbers():
    scene = plain_scene({"gamma": [0.0, np.nan, np.inf], "nothing": [np.nan] * 3})
    page = made(scene)
    np.testing.assert_array_equal(page.column("gamma"), [0.0, np.nan, np.inf])
    assert np.isnan(page.column("nothing")).all()
    assert page.meta["axes"] == ["gamma", "nothing"]
    assert made(plain_scene({"gamma": [1.0]})).meta["axes"] == ["gamma", "gamma"]


@serial
def test_ten_thousand_points():
    gamma = np.linspace(0, 1, 10_000)
    page = made(plain_scene({"gamma": gamma, "force": np.sin(9 * gamma)}))
    np.testing.assert_array_equal(page.column("force"), np.sin(9 * gamma))


def benchmark_scene(count=300, n=29):
    """A cube with 5048 vertices outside that is pressed, waved at and dragged on its lower face."""
    side = np.linspace(0, 1, n + 1)
    grid = {}
    cells = []
    for axis in range(3):
        for end in (0, n):
            for i in range(n):
                for j in range(n):
                    corners = []
                    for a, b in ((i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)):
                        place = [a, b]
                        place.insert(axis, end)
                        corners.append(grid.setdefault(tuple(place), len(grid)))
                    cells.append(corners)
    x = side[np.array(list(grid))]
    lower = np.array([c for c in cells if all(x[v, 2] == 0 for v in c)])
    body = OuterSurface(x, np.arange(len(x)), np.array(cells), {"contact": lower}, {}, {})

    def state(i):
        t = i / count
        away = np.linalg.norm(x[:, :2] - [0.5 + 0.4 * t, 0.5], axis=1)
        bump = np.exp(-8 * away**2) * np.exp(-2 * x[:, 2])
        u = np.column_stack(
            [t * x[:, 2] ** 2 + 0.1 * bump, 0.05 * np.sin(7 * x[:, 0] + 9 * t), -bump * t]
        )
        return SurfaceState(0.1 * u, {}, None, np.abs(bump - 0.3 * t * x[:, 2]))

    columns = {"gamma": np.linspace(0, 1, count), "force": np.linspace(0, 1, count) ** 2}
    scene = plain_scene(columns)
    scene.series[0].states[:] = range(count)
    scene.body = body
    scene.states = [lambda i=i: state(i) for i in range(count)]
    return scene


@serial
@pytest.mark.long
def test_the_size_of_a_page():
    """300 points of a body with 5000 surface vertices, displacement and a scalar: 6 MB."""
    scene = benchmark_scene()
    assert len(scene.body.x) > 5000
    library = pytest.importorskip("plotly", reason="plotly is not installed") and writing._library()
    text = writing.page(scene, library, "size", {}, {}, 0.005)
    fields = Page(text).meta["fields"]
    print(len(text.encode()), {k: v["error"] for k, v in fields.items()})
    assert len(text.encode()) < 6e6
    assert max(field["error"] for field in fields.values()) <= 0.005


# -- charts ----------------------------------------------------------------------------------------


def chart_of_a_wedge():
    """Three solutions between gamma = 2 and gamma = F from F = 2 on; else one."""
    cells = []
    ends = np.linspace(0, 4, 9)
    for a in range(8):
        for b in range(8):
            mu, gamma = (ends[a], ends[a + 1]), (ends[b], ends[b + 1])
            x, y = np.mean(mu), np.mean(gamma)
            words = ("k", "o", "-") if 2 < y < x else ("o",)
            cells.append(ChartCell(tuple(map(float, mu)), tuple(map(float, gamma)), words, True))
    mus = np.linspace(2, 4, 17)
    folds = [ChartCurve("fold", tuple((m, g) for m, g in zip(mus, y, strict=True)))
             for y in (mus, np.full(17, 2.0))]  # fmt: skip
    return Chart(tuple(cells), (*folds, ChartCurve("event", ((0.0, 1.0), (4.0, 1.5)))))


@serial
@pytest.mark.verifies(
    "explorer", "charts", reference="closed form: areas of the regions of a wedge", aspects=("2D",)
)
def test_a_chart(tmp_path, no_library):
    """Regions end at the curves and not at cells, and are numbered; the file keeps the curves."""
    chart = chart_of_a_wedge()
    chart.save(tmp_path / "chart.json")
    again = Chart.load(tmp_path / "chart.json")
    assert again.curves == chart.curves
    plot.explorer(tmp_path / "chart.html", tmp_path / "chart.json", labels={"mu": "F"})
    meta = read(tmp_path / "chart.html").meta
    assert [c["label"] for c in meta["columns"]] == ["F", "gamma"]
    found = meta["chart"]
    assert found["exact"]
    assert [c["kind"] for c in found["curves"]] == ["fold", "fold", "event"]
    assert [r["number"] for r in found["regions"]] == [1, 2]
    one, three = found["regions"]
    assert (len(one["solutions"][0]), len(three["solutions"][0])) == (1, 3)
    assert one["proved"]
    assert three["proved"]
    assert one["looked"] + three["looked"] == 64 - 4  # four places are on a curve

    def area(region):
        total = 0.0
        for outline in region["outlines"]:
            x, y = np.array(outline).T
            total += abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))) / 2
        return total

    np.testing.assert_allclose(area(three), 2.0)  # the triangle, whatever the cells
    np.testing.assert_allclose(area(one), 14.0)
    x, y = three["place"]
    assert 2 < y < x


@serial
def test_a_picture_of_a_chart(tmp_path):
    """It is filled up to the curves too, by areas: 2 of 16, and not the 1.5 of the cells."""
    axes = plot.draw_chart(tmp_path / "chart.png", chart_of_a_wedge())
    assert (tmp_path / "chart.png").stat().st_size > 8000
    areas = []
    for count in (1, 3):
        shown = [p.get_xy() for p in axes.patches if to_hex(p.get_facecolor()) == FILLS[count]]
        twice = [np.sum(x[:-1, 0] * x[1:, 1] - x[1:, 0] * x[:-1, 1]) for x in shown]
        areas.append(np.abs(twice).sum())
    assert abs(areas[1] / areas[0] - 2 / 14) < 0.01


@serial
def test_a_chart_without_curves():
    chart = Chart(chart_of_a_wedge().cells)
    scene = scene_of_chart(chart)
    assert not scene.chart.exact
    assert any("regions end at cells" in note for note in scene.notes)
    assert {len(r.solutions[0]) for r in scene.chart.regions} == {1, 3}


@serial
@pytest.mark.parametrize(
    ("curve", "message"),
    [
        (
            dict(kind="edge", points=((0, 1), (1, 1))),
            "the kind of a curve must be one of fold, event",
        ),
        (dict(kind="fold", points=((0, 1),)), "two pairs or more"),
        (dict(kind="fold", points=((0, 1), (float("nan"), 1))), "finite"),
        (dict(kind="fold", points=((1, 1), (0, 1))), "must not fall"),
        (dict(kind="fold", points="ab"), "pairs of numbers"),
    ],
)
def test_curves_that_are_none(curve, message):
    with pytest.raises(ValueError, match=message):
        ChartCurve(**curve)


# -- what is refused -------------------------------------------------------------------------------


@pytest.fixture
def branch(folder):
    """The folder of a record of few points, without displacements."""
    system, functionals = moved_block(COMM)
    record(system, functionals, folder / "branch", max_steps=2)
    return folder / "branch"


def test_arguments_that_do_not_fit(branch, folder, no_library):
    file = folder / "page.html"
    for more, message in [
        (dict(file=folder / "page.pdf"), "a page is an .html file"),
        (dict(record=3), "a folder, a journal or a chart, got int"),
        (dict(curves=[1]), "what event_curves returned"),
        (dict(title=3), "title must be a str"),
        (dict(labels={"gamma": 3}), "labels must be a dictionary of words"),
        (
            dict(units={"mass": "kg"}),
            "the quantity of a unit must be one of length, force, stress; got .mass",
        ),
        (dict(error=0.0), "the error must be a number from"),
        (dict(error=float("nan")), "the error must be a number from"),
        (dict(counts=[3]), "what find_solutions returned"),
        (dict(labels={"nothing": "x"}), "labels are of columns: 'nothing' is none; there are: gam"),
    ]:
        with pytest.raises(ValueError, match=message):
            plot.explorer(**{"file": file, "record": branch} | more)
    for count in (
        dict(gamma=np.nan, count=1),
        dict(gamma=0.0, count=-1),
        dict(gamma=0.0, count=1.5),
    ):
        with pytest.raises(ValueError, match="count"):
            plot.SolutionCount(**count, proved=True)
    if COMM.size > 1:
        with pytest.raises(ValueError, match="title differs between ranks"):
            plot.explorer(file, branch, title=f"rank {COMM.rank}")
    assert not file.exists()
    with pytest.raises(FileNotFoundError, match="no record"):
        plot.explorer(file, folder / "nowhere")
    with pytest.raises(OSError, match="nowhere"):
        plot.explorer(folder / "nowhere" / "page.html", branch)
    plot.explorer(file, branch)
    if COMM.rank == 0:
        meta = read(file).meta
        assert meta["body"] is None
        assert any("record with surface_displacement=True" in note for note in meta["notes"])
        assert [p.name for p in folder.glob("*.html")] == ["page.html"]
    COMM.barrier()


def test_records_that_are_damaged(folder, no_library):
    system, functionals = moved_block(COMM)
    record(system, functionals, folder / "branch", max_steps=3, **KEPT)
    file = folder / "page.html"
    journal = folder / "branch" / FILE_NAME
    whole = journal.read_bytes()
    COMM.barrier()

    def changed(data, at=journal):
        COMM.barrier()
        if COMM.rank == 0:
            at.write_bytes(data)
        COMM.barrier()

    lines = whole.split(b"\n")
    changed(b"\n".join(lines[:-2])[:-9])  # the line of the last point is being written
    plot.explorer(file, folder / "branch")
    if COMM.rank == 0:
        meta = read(file).meta
        assert meta["points"] == 3
        assert any("being written" in note for note in meta["notes"])
    changed(b"\n".join(lines[:2]) + b"\n")
    with pytest.raises(ValueError, match="no point was recorded"):
        plot.explorer(file, folder / "branch")
    changed(whole.replace(b'"gamma": 0.0', b'"gamma": 0.5', 1))
    with pytest.raises(ValueError, match="the journal is damaged: its check sum is wrong"):
        plot.explorer(file, folder / "branch")
    changed(whole)
    state = folder / "branch" / "surface" / "branch_0000_point_000002.npz"
    changed(b"nothing", state)
    with pytest.raises(ValueError, match=r"branch_0000_point_000002\.npz is damaged"):
        plot.explorer(file, folder / "branch")
    COMM.barrier()
    if COMM.rank == 0:
        assert read(file).meta["points"] == 3  # that of before


def test_plotly_is_missing(branch, folder, monkeypatch):
    """Or is that of Debian, which lacks the script."""
    monkeypatch.setitem(sys.modules, "plotly", None)
    file = folder / "page.html"
    match = r"plotly is not installed: python3 -m pip install 'signorini-coulomb\[explorer\]'$"
    with pytest.raises(ModuleNotFoundError, match=match):
        plot.explorer(file, branch)
    monkeypatch.delitem(sys.modules, "plotly")
    if COMM.rank == 0:
        (folder / "plotly").mkdir()
        (folder / "plotly" / "__init__.py").write_text("")
    COMM.barrier()
    monkeypatch.syspath_prepend(str(folder))
    with pytest.raises(ModuleNotFoundError, match=r"without plotly.min.js, as python3-plotly"):
        plot.explorer(file, branch)
    assert not file.exists()
    monkeypatch.delitem(sys.modules, "plotly", raising=False)  # rank 0 alone looked for it


# -- following, and the command line ---------------------------------------------------------------


def test_a_record_that_grows(folder, no_library):
    """The page is written whenever there is more, and no more when the run has ended."""
    system, functionals = moved_block(COMM)
    record(system, functionals, folder / "whole", max_steps=6, **KEPT)
    if COMM.rank == 0:
        lines = (folder / "whole" / FILE_NAME).read_bytes().splitlines(keepends=True)
        shutil.copytree(folder / "whole", folder / "grows", ignore=lambda *_: [FILE_NAME])
        journal = folder / "grows" / FILE_NAME
        left = [lines[:2], lines[2:5], [lines[5][:20]], [lines[5][20:], *lines[6:]]]
        said = []
        pages = []

        def told(text):
            said.append(text.rpartition(": ")[2] if ": " in text else "waiting")
            if (folder / "page.html").exists():
                pages.append(read(folder / "page.html").meta)
            if left:
                with journal.open("ab") as file:
                    file.writelines(left.pop(0))

        plot.watch(folder / "page.html", folder / "grows", seconds=0.01, report=told)
        count = len(read_journal(folder / "whole").entries())
        assert said == ["waiting", "waiting", "2 points", "2 points", f"{count} points"]
        assert [page["reload"] for page in pages] == [0.01, 0.01, None]
        for wrong in (0, -1.0, "x", float("nan")):
            with pytest.raises(ValueError, match="seconds must be a positive number"):
                plot.watch(folder / "page.html", folder / "grows", seconds=wrong)
    COMM.barrier()


def test_the_command(branch, folder, no_library, capsys):
    file = folder / "page.html"
    words = ["explore", str(branch), "-o", str(file), "--title", "Block", "--label", "gamma=load"]
    assert main([*words, "--unit", "length=mm"]) == 0
    if COMM.rank == 0:
        meta = read(file).meta
        assert (meta["title"], meta["columns"][0]["label"]) == ("Block", "load")
        assert capsys.readouterr().out == f"{file}\n"
    for more, message in [
        (["--label", "gamma"], "--label is NAME=VALUE, got 'gamma'"),
        (["--proof", "x=none.npz"], "--proof is GAMMA=FILE with a number"),
        (["--proof", "1=none.npz"], "there is no file none.npz"),
        (["--proof", f"1={branch / FILE_NAME}"], "is no proof: it is no npz file\n"),
        (["--label", "nothing=x"], "labels are of columns: 'nothing' is none"),
        (["--error", "7"], "the error must be a number from"),
    ]:
        assert main([*words, *more]) == 1
        errors = capsys.readouterr().err
        assert (message in errors) == (COMM.rank == 0)
    assert main(["explore", str(folder / "nowhere")]) == 1
    capsys.readouterr()
    assert main(["info"]) == 0
    out = capsys.readouterr().out
    if COMM.rank == 0:
        assert f"{COMM.size} rank" in out
        for name in ("dolfinx_contact", "DOLFINx", "PETSc", "mumps", "plotly"):
            assert name in out


@serial
def test_scripts_are_part_of_the_package():
    here = files("dolfinx_contact.plot.page")
    known = {p.name for p in here.iterdir() if not p.name.endswith((".py", "__"))}
    assert known == {"page.html", "page.css", *(f"{name}.js" for name in writing.SCRIPTS)}


@serial
@pytest.mark.skipif(shutil.which("node") is None, reason="there is no node to read the scripts")
def test_scripts_are_read_by_node():
    for name in writing.SCRIPTS:
        file = files("dolfinx_contact.plot.page") / f"{name}.js"
        subprocess.run(["node", "--check", str(file)], check=True)


# -- for a browser ---------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.skipif(
    "DOLFINX_CONTACT_RESULTS" not in os.environ,
    reason="`make test-browser` opens what it writes in a browser",
)
def test_pages_for_a_browser():
    """Pages of every kind, for `tests/in_browser.py` to click in."""
    folder = Path(os.environ["DOLFINX_CONTACT_RESULTS"])
    for cell, n in (("quad", 6), ("hex", 3)):
        system, functionals = moved_block(COMM, cell=cell, n=n)
        record(system, functionals, folder / f"branch_{cell}", max_steps=12, **KEPT)
        count = plot.SolutionCount(0.05, 3, True, "by a proof")
        plot.explorer(folder / f"branch_{cell}.html", folder / f"branch_{cell}", counts=[count],
                      title="<b>Block</b> & γ", units={"length": "mm"})  # fmt: skip
    evolution = recorded_evolution.pair(COMM)
    with EvolutionRecord(folder / "history", evolution, **KEPT) as kept:
        evolution.run(np.linspace(0, 1, 5), record=kept)
    plot.explorer(folder / "history.html", folder / "history")
    system, functionals = moved_block(COMM)
    record(system, functionals, folder / "bare", max_steps=5)
    plot.explorer(folder / "bare.html", folder / "bare")
    if COMM.rank == 0:
        chart_of_a_wedge().save(folder / "chart.json", overwrite=True)
        library = writing._library()
        gamma = np.linspace(0, 1, 10_000)
        odd = np.where(gamma > 0.9, np.nan, np.sin(9 * gamma))
        long = plain_scene({"gamma": gamma, "force": odd, "stable": gamma < 0.5})
        scenes = {"long": long, "one": plain_scene({"gamma": [1.0], "none": [np.nan]})}
        for name, scene in scenes.items():
            text = writing.page(scene, library, name, {}, {}, 0.005)
            (folder / f"{name}.html").write_text(text, encoding="utf-8")
    COMM.barrier()
    plot.explorer(folder / "chart.html", folder / "chart.json")
