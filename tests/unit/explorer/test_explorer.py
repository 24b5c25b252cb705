"""Pages of records: their content, and refused overwriting."""

import base64
import html.parser
import json
import os
import shutil
import subprocess
import zlib
from importlib.resources import files
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from support import recorded_evolution, recorded_path
from support.blocks import block, box
from support.checks import solved_start
from support.histories import dragged
from support.record_bodies import globe, polygon
from support.recorded_run import moved_block, record

import ufl
from dolfinx import fem

from dolfinx_contact import (
    Frictionless,
    HalfSpace,
    ParametricContact,
    RigidBody,
    RigidSurface,
    Sphere,
)
from dolfinx_contact.__main__ import main
from dolfinx_contact.continuation import Ending, StepControl, follow
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.explorer import SolutionCount, explorer
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.records import (
    BranchRecord,
    EvolutionRecord,
    Journal,
    PathRecord,
    read_journal,
    total,
)
from dolfinx_contact.records.journal import FILE_NAME, Entry, RecordedRun

pytest.importorskip("plotly", reason="plotly is not installed")
COMM = MPI.COMM_WORLD
KEPT = {"surface_displacement": True}


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
    """A page and its data."""

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
            tractions = {"pressure", "shear", "bound", "support"}
            assert set(table) >= {"x", "area", "un", "ut", "n"} | tractions
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
def test_a_page_shows_every_point_of_a_branch(cell, folder):
    n = 4 if cell == "quad" else 2
    system, functionals = moved_block(COMM, cell=cell, n=n)
    record(system, functionals, folder / "branch", max_steps=20, **KEPT)
    counts = [SolutionCount(0.1, 1, True, "by hand"), SolutionCount(0.2, 3, False)]
    look = dict(counts=counts, title="Ein Klötzchen <b>&", units={"length": "mm"})
    file = explorer(folder / "page.html", folder / "branch", **look)
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
        check_states(page, journal, journal.entries())
    COMM.barrier()


def round_tool(cell):
    """A polygon or globe below the block."""
    if cell == "quad":
        return RigidSurface(*polygon(24, (0.5, -1.002)), crease=30.0)
    return RigidSurface(*globe(8, (0.5, 0.5, -1.002)), crease=60.0)


@pytest.mark.parametrize("cell", ["quad", pytest.param("hex", marks=pytest.mark.long)])
@pytest.mark.verifies(
    "explorer",
    "surfaces of facets",
    reference="itself: the journal, number by number",
    aspects=("2D", "3D", "records"),
)
def test_a_page_shows_the_vertices_of_a_rigid_surface(cell, folder):
    system, functionals = moved_block(COMM, cell=cell, n=3, obstacle=round_tool(cell))
    record(system, functionals, folder / "branch", max_steps=4, **KEPT)
    explorer(folder / "page.html", folder / "branch")
    if COMM.rank == 0:
        page = read(folder / "page.html")
        journal = read_journal(folder / "branch")
        check_states(page, journal, journal.entries())
        (face,) = page.meta["surfaces"]
        assert len(page.array(face["obstacle"]["way"])) != len(np.unique(page.array(face["cells"])))
        facets = page.array(face["obstacle"]["cells"])
        assert facets.shape[1] == face["obstacle"]["corners"]
    COMM.barrier()


def record_a_linear_block(folder, route):
    """Record a linear block that is moved down and sideways on a floor."""
    floor = HalfSpace((0.0, -0.002), (0.0, 1.0))
    problem, top = dragged(obstacle=lambda _: floor, energy=LinearElastic(600.0, 400.0))
    domain = problem.V.mesh
    gamma = fem.Constant(domain, 0.0)
    x = ufl.SpatialCoordinate(domain)
    move = gamma * ufl.as_vector([0.01, -0.02 * (1.0 + 0.3 * x[0])])
    system = ParametricContact(problem, gamma, driven=[(top, move)])
    with BranchRecord(folder, system, {"force": total("rn")}, **KEPT) as kept:
        start = solved_start(system)
        control = StepControl(initial=0.02, maximum=0.02)
        options = dict(gamma_range=(0.0, 1.0), control=control, route=route)
        follow(system, start, 0.0, record=kept, **options)


@pytest.mark.ranks(2)
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
def test_a_page_shows_every_step_of_a_history(kind, folder):
    evolution = getattr(recorded_evolution, kind)(COMM)
    with EvolutionRecord(folder / kind, evolution, **KEPT) as kept:
        history = evolution.run(np.linspace(0, 1, 5), record=kept)
    explorer(folder / "page.html", folder / kind)
    if COMM.rank == 0:
        page = read(folder / "page.html")
        journal = read_journal(folder / kind)
        check_states(page, journal, journal.entries())
        rows = history.rows()
        for name in ("time", "stored", "dissipated", "newton_iterations", "stick"):
            np.testing.assert_array_equal(page.column(name), [row[name] for row in rows])
        assert page.column("time")[0] == 0
        assert page.meta["along"] == "time"
        assert page.meta["axes"][0] == "time"
        assert page.meta["axes"][1].rpartition("_")[2] in "xy"  # a contact force
    COMM.barrier()


@pytest.mark.ranks(2)
def test_axes_of_a_history_are_supports_and_loads(folder):
    """A floor comes up; a record of an older version has no columns of supports."""
    floor = []

    def rising(domain):
        floor.append(fem.Constant(domain, (0.0, 0.0)))
        return HalfSpace(floor[0], (0.0, 1.0))

    problem, _ = dragged(n=2, obstacle=rising)

    def load(time):
        floor[0].value[1] = 0.01 * time

    with EvolutionRecord(folder / "record", QuasiStatic(problem, load)) as kept:
        history = kept.evolution.run([0.0, 1.0, 2.0], record=kept)
    journal = read_journal(folder / "record")
    height = "point of HalfSpace of 'contact' y"
    assert list(journal.loads()) == [height]
    np.testing.assert_allclose(journal.loads()[height], [0.0, 0.01, 0.02])
    explorer(folder / "page.html", journal)
    older = read_journal(folder / "record")
    for state in older.states:
        state["row"] = {k: v for k, v in state.row.items() if not k.startswith("support_")}
    explorer(folder / "older.html", older)
    if COMM.rank == 0:
        page = read(folder / "page.html")
        forces = [row["support_0_y"] for row in history.rows()]
        assert forces[0] == 0.0
        assert forces[2] == pytest.approx(2 * forces[1])
        np.testing.assert_array_equal(page.column("support_0_y"), forces)
        np.testing.assert_array_equal(page.column("support_0_uy"), 0.0)
        for shown in (page, read(folder / "older.html")):
            np.testing.assert_array_equal(shown.column(height), journal.loads()[height])
            assert shown.meta["axes"] == ["time", "contact_y"]
    COMM.barrier()


@pytest.mark.parametrize(("way", "scale"), [(0.0, 20.0), (0.3, 1.0)])
def test_displacements_are_not_exaggerated_beside_a_long_way_of_an_obstacle(way, scale, folder):
    domain = box(COMM, 4, "quad")
    y = fem.Constant(domain, 0.0)
    ball = Sphere((0.5, -0.25), 0.25)
    tool = RigidBody(ball, about=(0.5, -0.25), motion={"y": y}, held=["x", "rz"])
    problem = block(domain=domain, law=Frictionless(), obstacle=tool, top=(0.0, -0.004))
    problem.solve()

    def load(time):
        y.value = -way * time

    evolution = QuasiStatic(problem, load)
    with EvolutionRecord(folder / "record", evolution, **KEPT) as kept:
        evolution.run([0.0, 1.0], record=kept)
    explorer(folder / "page.html", folder / "record")
    assert read(folder / "page.html").meta["body"]["scale"] == scale


@pytest.mark.ranks(2)
def test_a_page_shows_the_bonds_of_a_path(folder):
    path = recorded_path.made("bonds")
    with PathRecord(folder / "path", path, **KEPT) as kept:
        control = StepControl(initial=0.1, maximum=0.3)
        path.run(gamma_range=(0.0, 0.7), control=control, record=kept, max_steps=8)
    explorer(folder / "page.html", folder / "path")
    if COMM.rank == 0:
        page = read(folder / "page.html")
        journal = read_journal(folder / "path")
        check_states(page, journal, journal.entries())
        (face,) = page.meta["surfaces"]
        bonds = [bytes(page.table(face, state)["bond"]).decode() for state in (0, 8)]
        assert bonds == ["iii", "wii"]
    COMM.barrier()


@pytest.mark.parametrize("route", ["pivoting", "steps"])
def test_only_pivoted_branches_are_interpolated_between_points(route, folder):
    record_a_linear_block(folder / "linear", route=route)
    explorer(folder / "page.html", folder / "linear")
    page = read(folder / "page.html")
    assert page.meta["series"][0]["linear"] == (route == "pivoting")


@pytest.mark.parametrize("kind", ["pair", "cracked"])
def test_the_start_of_a_history_has_counts_and_forces(kind, folder):
    """The recorded run starts in the last state of another run."""
    evolution = getattr(recorded_evolution, kind)(COMM)
    before = evolution.run(np.linspace(0, 0.5, 3)).steps[-1]
    with EvolutionRecord(folder / kind, evolution, **KEPT) as kept:
        evolution.run([0.5, 0.75], start=before.state, record=kept)
    explorer(folder / "page.html", folder / kind)
    page = read(folder / "page.html")
    row = before.row()
    forces = [f"{name}_{axis}" for name in before.result.resultants for axis in "xy"]
    size = max(abs(row[name]) for name in forces)
    assert size > 0.1
    for name in ("open", "stick", "slip", *forces):
        assert abs(page.column(name)[0] - row[name]) < 1e-9 * size


# -- contents of journals --------------------------------------------------------------------------


def plain_journal(gamma, functionals=None, reason=""):
    """A journal in memory: one branch of a single sliding point, with functionals by name."""
    known = functionals or {}
    points = [
        Entry(index=i, gamma=float(g), step=0.1, corrections=1, tau=1.0, status="k", norm=1.0,
                   special=[], functionals={k: float(v[i]) for k, v in known.items()})
        for i, g in enumerate(gamma)
    ]  # fmt: skip
    branch = RecordedRun(points=points, ending=Ending.REACHED, reason=reason)
    return Journal(header={"functionals": list(known), "points": {}}, branches={0: branch})


def test_names_of_users_are_text(tmp_path):
    """Names with tags, quotes, placeholders of the template and letters of all kinds."""
    evil = "</script><script>alert(1)</script> \u2028 @DATA@ \"'&lt; ü γ 接触"
    file = tmp_path / "page.html"
    journal = plain_journal([0, 1], {evil: [1, 2]}, evil)
    explorer(file, journal, title=evil, labels={"gamma": evil})
    page = read(file)
    assert page.title == page.meta["title"] == evil
    assert [c["label"] for c in page.meta["columns"]][:2] == [evil, evil]
    assert page.meta["series"][0]["ending"] == evil
    assert file.read_text(encoding="utf-8").count("alert(1)</script>") == 0
    np.testing.assert_array_equal(page.column(evil), [1, 2])


def test_labels_of_pictures_are_shown_without_tex(tmp_path):
    """The same labels serve `draw_diagram`, which takes TeX, and the page."""
    file = tmp_path / "page.html"
    labels = {"gamma": r"load $\gamma_{max}$", "ut": "$u_t$ of A, 3 $"}
    explorer(file, plain_journal([0, 1], {"ut": [1, 2]}, "ended"), labels=labels)
    shown = [c["label"] for c in read(file).meta["columns"]]
    assert shown[:2] == ["load γₘₐₓ", "uₜ of A, 3 $"]


# -- what is refused -------------------------------------------------------------------------------


@pytest.fixture
def branch(folder):
    """The folder of a record of few points, without displacements."""
    system, functionals = moved_block(COMM)
    record(system, functionals, folder / "branch", max_steps=2)
    return folder / "branch"


@pytest.mark.ranks(2)
def test_explorer_names_damaged_records(folder):
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
    explorer(file, folder / "branch")
    if COMM.rank == 0:
        meta = read(file).meta
        assert meta["points"] == 3
        assert any("being written" in note for note in meta["notes"])
    changed(b"\n".join(lines[:2]) + b"\n")
    with pytest.raises(ValueError, match="no point was recorded"):
        explorer(file, folder / "branch")
    changed(whole.replace(b'"gamma": 0.0', b'"gamma": 0.5', 1))
    with pytest.raises(ValueError, match="the journal is damaged: its checksum is wrong"):
        explorer(file, folder / "branch")
    changed(whole)
    state = folder / "branch" / "surface" / "branch_0000_point_000002.npz"
    changed(b"nothing", state)
    with pytest.raises(ValueError, match=r"branch_0000_point_000002\.npz is damaged"):
        explorer(file, folder / "branch")
    COMM.barrier()
    if COMM.rank == 0:
        assert read(file).meta["points"] == 3  # that of before


# -- the command line ------------------------------------------------------------------------------


@pytest.mark.ranks(2)
def test_explorer_command_writes_a_page(branch, folder, capsys):
    file = folder / "page.html"
    words = ["explore", str(branch), "-o", str(file), "--title", "Block", "--label", "gamma=load"]
    assert main([*words, "--unit", "length=mm"]) == 0
    if COMM.rank == 0:
        meta = read(file).meta
        assert (meta["title"], meta["columns"][0]["label"]) == ("Block", "load")
        assert capsys.readouterr().out == f"{file}\n"
    for more, message in [
        (["--label", "gamma"], "--label is NAME=VALUE, got 'gamma'"),
        (["--proof", "x=none.npz"], "could not convert string to float"),
        (["--proof", "1=none.npz"], "there is no file none.npz"),
        (["--proof", f"1={branch / FILE_NAME}"], "is not a proof: it is not an npz file\n"),
        (["--label", "nothing=x"], "there is no column 'nothing'"),
        (["--error", "7"], "error must be a number from"),
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


@pytest.mark.skipif(shutil.which("node") is None, reason="there is no node to read the scripts")
def test_scripts_of_pages_have_valid_syntax():
    for file in files("dolfinx_contact.explorer").iterdir():
        if file.name.endswith(".js"):
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
        count = SolutionCount(0.05, 3, True, "by a proof")
        explorer(folder / f"branch_{cell}.html", folder / f"branch_{cell}", counts=[count],
                      title="<b>Block</b> & γ", units={"length": "mm"})  # fmt: skip
    record_a_linear_block(folder / "linear", route="pivoting")
    explorer(folder / "linear.html", folder / "linear")
    for cell in ("quad", "hex"):
        system, functionals = moved_block(COMM, cell=cell, n=3, obstacle=round_tool(cell))
        record(system, functionals, folder / f"rigid_{cell}", max_steps=8, **KEPT)
        explorer(folder / f"rigid_{cell}.html", folder / f"rigid_{cell}")
    evolution = recorded_evolution.pair(COMM)
    with EvolutionRecord(folder / "history", evolution, **KEPT) as kept:
        evolution.run(np.linspace(0, 1, 5), record=kept)
    explorer(folder / "history.html", folder / "history")
    system, functionals = moved_block(COMM)
    record(system, functionals, folder / "bare", max_steps=5)
    explorer(folder / "bare.html", folder / "bare")
    if COMM.rank == 0:
        gamma = np.linspace(0, 1, 10_000)
        odd = np.where(gamma > 0.9, np.nan, np.sin(9 * gamma))
        long = plain_journal(gamma, {"force": odd, "stable": gamma < 0.5})
        for name, journal in {"long": long, "one": plain_journal([1.0])}.items():
            explorer(folder / f"{name}.html", journal, comm=MPI.COMM_SELF)
