# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pages of records and charts: what they hold, and the file."""

from __future__ import annotations

import base64
import html
import json
import os
import re
import time
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._errors import on_root
from dolfinx_contact._files import part_of
from dolfinx_contact._optional import optional
from dolfinx_contact._validate import instance, is_number, one_of, positive
from dolfinx_contact.analysis import Chart, EventCurves, ProvedCount, Regions
from dolfinx_contact.continuation import Solutions
from dolfinx_contact.io.outside import SurfaceState
from dolfinx_contact.laws import status
from dolfinx_contact.plot.page.faces import points_on_face
from dolfinx_contact.plot.page.of_charts import scene_of_chart
from dolfinx_contact.plot.page.of_records import has_points, scene_of_record
from dolfinx_contact.plot.page.packing import Arrays, largest_value, packed_field
from dolfinx_contact.plot.page.scene import Scene, SolutionCount
from dolfinx_contact.records.journal import FILE_NAME, AnyJournal

__all__ = ["SCRIPTS", "explorer", "watch"]

#: In the order in which the page runs them.
SCRIPTS = ("decode", "words", "diagram", "body", "face", "table", "chart", "main")
#: Columns of contact tables that pages hold, beside those of laws. Forces are tractions by areas.
_COLUMNS = ("x", "area", "un", "ut", "n", "pressure", "shear", "support", "letters")
_COLOURED = ("pressure", "shear", "un", "ut")
_GROUP = 16  # states whose tables are unpacked together
_QUANTITIES = ("length", "force", "stress")
_LEAST_ERROR = 1e-4
_LARGEST_ERROR = 0.1
_SMALL = 0.03  # of the size of the body: a displacement that is drawn as it is
_SHOWN = 0.1  # of the size, as which a smaller one is drawn

Record = str | os.PathLike[str] | AnyJournal | Chart | Regions


def _check(a: Arguments) -> None:
    a.file = Path(a.file)
    if a.file.suffix != ".html":
        raise ValueError(f"a page is an .html file, not {a.file.name}")
    known = isinstance(a.record, str | os.PathLike | AnyJournal | Chart | Regions)
    if not known:
        kind = type(a.record).__name__
        raise ValueError(f"a record is a folder, a journal or a chart, got {kind}")
    if a.curves is not None and not isinstance(a.curves, EventCurves):
        raise ValueError(f"curves are what event_curves returned, got {type(a.curves).__name__}")
    instance(a.title, "title", str)
    for name in ("labels", "units"):
        words = getattr(a, name) or {}
        pairs = words.items() if isinstance(words, Mapping) else [(None, None)]
        if not all(isinstance(k, str) and isinstance(v, str) for k, v in pairs):
            raise ValueError(f"{name} must be a dictionary of words by words, got {words!r}")
    for quantity in a.units or {}:
        one_of(quantity, "the quantity of a unit", _QUANTITIES)
    if not (is_number(a.error) and _LEAST_ERROR <= a.error <= _LARGEST_ERROR):
        raise ValueError(
            f"the error must be a number from {_LEAST_ERROR} to {_LARGEST_ERROR} of the largest "
            f"displacement, got {a.error!r}"
        )
    a.counts = [_count_of(count) for count in a.counts]


def _count_of(count: Any) -> SolutionCount:
    if isinstance(count, ProvedCount):
        count = count.solutions
    if isinstance(count, Solutions):
        return SolutionCount(count.gamma, len(count.found), bool(count.complete), count.method)
    if not isinstance(count, SolutionCount):
        kind = type(count).__name__
        raise ValueError(f"counts are what find_solutions returned, or a SolutionCount, got {kind}")
    return count


@collective("a page", _check)
def explorer(
    file: str | os.PathLike[str],
    record: Record,
    *,
    curves: EventCurves | None = None,
    counts: Iterable[SolutionCount | Solutions | ProvedCount] = (),
    title: str = "",
    labels: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    error: float = 0.005,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Path:
    """Write a page in which a record or a chart is explored. Collective; rank 0 reads and writes.

    The page is one file, which needs a browser and no network: a diagram whose axes are any
    columns, with branches coloured by their statuses or any column, and special points by name; at
    every point the deformed body, the contact face and its table. A functional that is called
    ``stable`` (1 or 0, NaN where it is not decided) colours branches by stability. Bodies are shown
    where their displacement was recorded (``surface_displacement=True``); in 3D the browser needs
    WebGL.

    Displacements are packed with an error that the page states; tables of contact points are those
    of the record to the last bit.

    Args:
        file: ``.html``.
        record: the folder of a record, what `records.read_journal` or `records.journal_of` gave, a
            chart or regions, or a file that `Chart.save` has written.
        curves: of folds and events in a chart, by default those that it has.
        counts: of solutions, which are shown at their gamma with what is proved; also what
            `analysis.prove_counts` returned.
        title: by default the name of the record.
        labels: of columns, by name; of a chart those of ``mu`` and ``gamma``.
        units: of ``length``, ``force`` and ``stress``, for tables and axes.
        error: largest error of a displacement, over the largest displacement.
        comm: the ranks that call.

    Returns:
        The file, on every rank.

    Raises:
        ModuleNotFoundError: on every rank, if plotly is not installed, or lacks its script.
        OSError: on every rank, if there is no such record, or the file cannot be written; it is
            then as it was.
        ValueError: on every rank, for arguments that do not fit or differ between ranks, a record
            that is damaged, or one in which nothing was recorded yet.

    Example:
        ::

            with records.BranchRecord("output/branch", system, surface_displacement=True) as record:
                explore(system, [(x, 0.0)], gamma_range=(0.0, 1.0), record=record)
            proved = find_solutions(system, [x], 0.5)
            plot.explorer("output/diagram.html", "output/branch", counts=[proved])
    """
    path = Path(file)
    known = [_count_of(count) for count in counts]

    def write() -> None:
        library = _library()
        scene = _scene(record, curves)
        scene.counts += known
        named = title or _name(record)
        text = page(scene, library, named, labels or {}, units or {}, error)
        _put(path, text)

    on_root(comm, write)
    return path


def watch(
    file: str | os.PathLike[str],
    record: str | os.PathLike[str],
    *,
    counts: Iterable[SolutionCount | Solutions | ProvedCount] = (),
    title: str = "",
    labels: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    error: float = 0.005,
    seconds: float = 5.0,
    report: Callable[[str], None] = lambda text: None,
) -> Path:
    """Write the page of a record anew whenever its journal has grown, until its run has ended.

    On this rank alone. The page loads itself anew; what is chosen in it stays chosen.

    Args:
        file: as for `explorer`.
        record: folder of the record; it is waited for.
        counts: as for `explorer`, like the following.
        title: of the page.
        labels: of columns.
        units: of quantities.
        error: of displacements.
        seconds: between two readings of the journal, and after which the page loads itself anew.
        report: is called with a sentence whenever a page was written, or there is nothing yet.

    Returns:
        The file.

    Raises:
        OSError, ValueError: as `explorer`, and for seconds that are not positive.
    """
    positive(seconds, "seconds")
    if not isinstance(record, str | os.PathLike):
        raise ValueError(f"what is watched is the folder of a record, got {record!r}")
    look = dict(counts=counts, title=title, labels=labels, units=units, error=error)
    _check(Arguments(file=file, record=record, curves=None, **look))
    path = Path(file)
    library = _library()
    journal = Path(record) / FILE_NAME
    seen = -1
    while True:
        size = journal.stat().st_size if journal.is_file() else 0
        if size != seen:
            seen = size
            scene = scene_of_record(record) if size and has_points(record) else None
            if scene is None:
                report(f"waiting for a point in {journal}")
            else:
                scene.counts += [_count_of(count) for count in counts]
                reload = seconds if scene.unfinished else None
                named = title or _name(record)
                text = page(scene, library, named, labels or {}, units or {}, error, reload=reload)
                _put(path, text)
                report(f"{path}: {sum(len(series.statuses) for series in scene.series)} points")
                if not scene.unfinished:
                    return path
        time.sleep(seconds)


def _scene(record: Record, curves: EventCurves | None) -> Scene:
    if isinstance(record, Chart | Regions):
        return scene_of_chart(record, curves)
    if isinstance(record, str | os.PathLike) and Path(record).is_file():
        return scene_of_chart(Chart.load(record), curves)
    if curves is not None:
        raise ValueError("curves belong to charts, not to records")
    return scene_of_record(record)


def _name(record: Record) -> str:
    if isinstance(record, Chart | Regions):
        return "Numbers of solutions"
    if isinstance(record, AnyJournal):
        return record.folder.name if record.folder is not None else "Solutions"
    return Path(os.path.abspath(record)).name


def _put(path: Path, text: str) -> None:
    with part_of(path) as part:
        part.write_text(text, encoding="utf-8")


def _library() -> bytes:
    """The script of plotly.

    Raises:
        ModuleNotFoundError: if it is not installed, or is a package that lacks the script.
    """
    plotly = optional("plotly", "explorer", in_debian=False)
    file = files(plotly) / "package_data" / "plotly.min.js"
    if not file.is_file():
        raise ModuleNotFoundError(
            "plotly is installed without plotly.min.js, as python3-plotly of Debian is: "
            "python3 -m pip install 'signorini-coulomb[explorer]'",
            name="plotly",
        )
    return file.read_bytes()


# -- the page --------------------------------------------------------------------------------------


def page(
    scene: Scene,
    library: bytes,
    title: str,
    labels: Mapping[str, str],
    units: Mapping[str, str],
    error: float,
    *,
    reload: float | None = None,
) -> str:
    """The text of a page.

    Args:
        scene: what it shows.
        library: script that draws.
        title: of the page.
        labels: of columns.
        units: of quantities.
        error: largest error of a displacement, over the largest one.
        reload: seconds after which it loads itself anew.

    Raises:
        ValueError: if a label is of no column.
    """
    arrays = Arrays()
    words: dict[str, Any] = {
        "title": title,
        "about": _about(scene),
        "along": scene.along,
        "units": dict(units),
        "reload": reload,
        "points": sum(len(s.statuses) for s in scene.series),
        "statuses": _statuses(),
        "body": None,
        "fields": {},
        "surfaces": [],
        "chart": None,
        "counts": [
            {
                "gamma": float(c.gamma),
                "count": int(c.count),
                "proved": bool(c.proved),
                "method": c.method,
            }
            for c in scene.counts
        ],
    }
    notes = list(scene.notes)
    if scene.chart is not None:
        words["columns"] = [
            {"name": name, "label": labels.get(name, name), "functional": False}
            for name in ("mu", "gamma")
        ]
        words["chart"] = _chart(scene)
    else:
        words |= _series(arrays, scene, labels)
        if scene.body is not None:
            notes += _put_body(arrays, words, scene, error)
    if scene.unfinished:
        notes.append("The record is being written, or its run was cut off.")
    # Of a run that begins, columns of steps are not known yet.
    if not (scene.unfinished and words["points"] == 1):
        _check_labels(labels, [column["name"] for column in words["columns"]])
    words["notes"] = notes
    words["arrays"] = {name: packed.words for name, packed in arrays.packed.items()}
    data = [_script("meta", "application/json", _json(words))]
    packed_library = base64.b64encode(zlib.compress(library, 9)).decode()
    data.append(_script("library", "text/plain", packed_library))
    data += [_script(f"array:{n}", "text/plain", p.data) for n, p in arrays.packed.items()]
    here = files(__package__)
    scripts = [f"<script>\n{_read(here / f'{name}.js')}</script>" for name in SCRIPTS]
    parts = {
        "TITLE": html.escape(title),
        "STYLE": _read(here / "page.css"),
        "DATA": "\n".join(data),
        "SCRIPTS": "\n".join(scripts),
    }
    template = _read(here / "page.html")
    # By one pass, so that nothing is looked for in what was put in.
    return re.sub(r"@([A-Z]+)@", lambda found: parts[found[1]], template)


def _check_labels(labels: Mapping[str, str], columns: Sequence[str]) -> None:
    """Raise ``ValueError`` if a label is of no column."""
    unknown = sorted(set(labels) - set(columns))
    if unknown:
        known = ", ".join(columns)
        raise ValueError(f"labels are of columns: {unknown[0]!r} is none; there are: {known}")


def _read(file: Any) -> str:
    return str(file.read_text(encoding="utf-8"))


def _script(name: str, kind: str, content: str) -> str:
    return f'<script type="{kind}" id="{html.escape(name)}">{content}</script>'


def _json(words: Any) -> str:
    """JSON that may stand in a script: no tag can begin or end in it."""
    text = json.dumps(words, allow_nan=False, ensure_ascii=False)
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _about(scene: Scene) -> str:
    parts = [scene.kind]
    if scene.series:
        count = sum(len(s.statuses) for s in scene.series)
        many = f"{len(scene.series)} branches, " if len(scene.series) > 1 else ""
        parts.append(f"{many}{count} point{'s' * (count != 1)}")
    if scene.package:
        parts.append(f"recorded by dolfinx_contact {scene.package}")
    return " · ".join(parts)


def _statuses() -> dict[str, dict[str, str]]:
    kinds = {letter: kind for kind, letters in status.KINDS.items() for letter in letters}
    return {
        letter: {
            "name": name.replace("$u_t > 0$", "u_t > 0").replace("$u_t < 0$", "u_t < 0"),
            "colour": status.COLOURS[letter],
            "kind": kinds[letter],
        }
        for letter, name in status.NAMES.items()
    }


def _series(arrays: Arrays, scene: Scene, labels: Mapping[str, str]) -> dict[str, Any]:
    """Columns of all series, one after the other, and their descriptions."""
    names = scene.columns
    whole = np.full((len(names), sum(len(s.statuses) for s in scene.series)), np.nan)
    series = []
    first = 0
    for s in scene.series:
        count = len(s.statuses)
        for k, name in enumerate(names):
            if name in s.columns:
                whole[k, first : first + count] = s.columns[name]
        marks = [
            {
                "index": m.index,
                "kind": m.kind,
                "text": m.text,
                "at": _finite(m.at),
                "share": m.share,
            }
            for m in s.marks
        ]
        series.append(
            {"name": s.name, "first": first, "count": count, "marks": marks, "ending": s.ending}
        )
        first += count
    arrays.add("columns", whole)
    arrays.add("words", "\n".join(word for s in scene.series for word in s.statuses))
    arrays.add("states", np.array([i for s in scene.series for i in s.states], dtype=np.int32))
    columns = [
        {"name": name, "label": labels.get(name, name), "functional": name in scene.functionals}
        for name in names
    ]
    return {"columns": columns, "series": series, "axes": _axes(scene, whole)}


def _finite(values: Mapping[str, float]) -> dict[str, float]:
    return {name: float(v) for name, v in values.items() if np.isfinite(v)}


def _axes(scene: Scene, whole: npt.NDArray[np.float64]) -> list[str]:
    """Columns of the diagram at first: what is followed, and what changes with it."""
    across = "gamma" if "gamma" in scene.columns else scene.along
    others = [name for name in scene.columns if name not in (across, scene.along, "length")]
    rows = {name: whole[scene.columns.index(name)] for name in others}
    finite = {name: row[np.isfinite(row)] for name, row in rows.items()}
    moving = [n for n in others if len(finite[n]) and np.ptp(finite[n]) > 0]
    chosen = [n for n in scene.functionals if n in moving] or [
        n for n in moving if n not in ("open", "stick", "slip", "clamped")
    ]
    return [across, (chosen or moving or others or [across])[0]]


def _chart(scene: Scene) -> dict[str, Any]:
    chart = scene.chart
    assert chart is not None
    return {
        "ranges": [list(pair) for pair in chart.ranges],
        "regions": [
            {
                "number": r.number,
                "outlines": [outline.tolist() for outline in r.outlines],
                "solutions": [list(words) for words in r.solutions],
                "proved": r.proved,
                "looked": r.looked,
                "place": list(r.place),
            }
            for r in chart.regions
        ],
        "curves": [{"kind": c.kind, "points": c.points.tolist()} for c in chart.curves],
        "cells": [
            {"middle": list(c.middle), "solutions": list(c.solutions), "proved": c.proved}
            for c in chart.cells
        ],
        "exact": chart.exact,
    }


# -- bodies ----------------------------------------------------------------------------------------


def _put_body(arrays: Arrays, words: dict[str, Any], scene: Scene, error: float) -> list[str]:
    """Put the body, its states and the tables of contact points into a page; notes for it."""
    surface = scene.body
    assert surface is not None
    states = scene.states
    dim = states[0]().u.shape[1]
    size = float(np.linalg.norm(np.ptp(surface.x, axis=0)))

    def displacement(i: int) -> npt.NDArray[Any]:
        return states[i]().u

    def strained(i: int) -> npt.NDArray[Any]:
        values = states[i]().strain
        return np.zeros((0, 1)) if values is None else values[:, None]

    field, largest = _field(arrays, "displacement", "|u|", len(states), displacement, error)
    words["fields"]["displacement"] = field
    errors = [f"displacements {100 * field['error']:.2g} %"]
    if states[0]().strain is not None:
        strain, _ = _field(arrays, "strain", "equivalent strain", len(states), strained, error)
        words["fields"]["strain"] = strain
        errors.append(f"strains {100 * strain['error']:.2g} %")
    allowed = error * largest
    low, high = (np.append(v, np.zeros(3 - dim)) for v in np.array(field["ranges"]).T)
    ends = [surface.x.min(axis=0), surface.x.max(axis=0), low, high]
    words["body"] = {
        "dim": dim,
        "size": size,
        "scale": _scale(largest, size),
        "corners": surface.cells.shape[1],
        "x": arrays.add("body.x", surface.x),
        "cells": arrays.add("body.cells", surface.cells.astype(np.int32)),
        "bounds": np.column_stack(ends).tolist(),
    }
    hidden = []
    for number, name in enumerate(surface.contact):
        face = _face(arrays, scene, number, name, allowed)
        words["surfaces"].append(face)
        if name in surface.obstacles and face["obstacle"] is None:
            hidden.append(
                f"The obstacle of {name} is not shown: it moves so much further than the body that "
                f"a page cannot hold it to {100 * error:.2g} % of the largest displacement, or is "
                "not finite."
            )
    pressed = max(words["surfaces"], key=lambda face: face["traction"], default=None)
    words["body"]["start"] = pressed["pressed"] if pressed else len(states) - 1
    packing = (
        f"Errors of packing: {', '.join(errors)} of the largest one ({100 * error:.2g} % allowed), "
        "measured at all vertices of all points. Tables of contact points are exact."
    )
    return [packing, *hidden]


def _field(
    arrays: Arrays,
    name: str,
    label: str,
    count: int,
    read: Callable[[int], npt.NDArray[Any]],
    error: float,
) -> tuple[dict[str, Any], float]:
    """Put a field into a page: its description, its error over its largest value; that value."""
    largest, low, high = largest_value(name, count, read)
    field = packed_field(arrays, name, count, read, error * largest)
    field["error"] = field["error"] / largest if largest > 0 else 0.0
    ranges = np.column_stack([low, high]).tolist()
    return field | {"largest": largest, "label": label, "ranges": ranges}, largest


def _scale(largest: float, size: float) -> float:
    """A factor of 1, 2 or 5 by which a small displacement is seen, and 1 for others."""
    if largest <= 0 or largest >= _SMALL * size:
        return 1.0
    most = _SHOWN * size / largest
    power = 10.0 ** np.floor(np.log10(most))
    return float(max(power * part for part in (1, 2, 5) if power * part <= most))


def _face(arrays: Arrays, scene: Scene, number: int, name: str, allowed: float) -> dict[str, Any]:
    """A contact face: facets, obstacle, and the tables at all states."""
    surface = scene.body
    assert surface is not None
    facets = surface.contact[name]
    key = f"face.{number}"
    face: dict[str, Any] = {
        "name": name,
        "corners": facets.shape[1],
        "cells": arrays.add(f"{key}.cells", facets.astype(np.int32)),
        "obstacle": None,
    }
    if name in surface.obstacles:
        face["obstacle"] = _obstacle(arrays, scene, name, key, allowed)
    first = _tables_at(scene.states[0](), name)
    x = np.zeros((0, 3)) if first is None else first["x"]
    on = points_on_face(surface.x, facets, np.pad(x, ((0, 0), (0, 3 - x.shape[1]))))
    n = len(x)
    face |= {
        "points": n,
        "anchors": arrays.add(f"{key}.anchors", on.nodes.astype(np.int32)),
        "weights": arrays.add(f"{key}.weights", on.weights.astype(np.float32)),
        "nearest_points": arrays.add(f"{key}.nearest", on.nearest.astype(np.int32)),
        "place": arrays.add(f"{key}.place", on.place),
    }
    return face | _tables(arrays, scene, name, key, n)


def _tables_at(state: SurfaceState, name: str) -> dict[str, npt.NDArray[Any]] | None:
    """Columns of a contact table that a page holds, letters as numbers; None if there are none."""
    if state.tables is None or name not in state.tables:
        return None
    known = state.tables[name]
    chosen = [c for c in known if c in _COLUMNS or c in ("bond", "slid") or c[:9] == "internal."]
    found = {column: known[column] for column in chosen}
    for column in ("letters", "bond"):
        if column in found:
            found[column] = np.array([ord(letter) for letter in found[column]], dtype=np.uint8)
    return found


def _tables(arrays: Arrays, scene: Scene, name: str, key: str, n: int) -> dict[str, Any]:
    """The tables of a surface at all states, in groups of states."""
    groups = []
    components: dict[str, int] = {}
    largest: dict[str, tuple[float, float]] = {}
    traction = 0.0
    pressed = len(scene.states) - 1
    for start in range(0, len(scene.states) if n else 0, _GROUP):
        chosen = scene.states[start : start + _GROUP]
        tables = [_tables_at(state(), name) for state in chosen]
        if any(t is None or len(t["letters"]) != n for t in tables):
            raise ValueError(f"the tables of {name} have other numbers of contact points")
        known = [t for t in tables if t is not None]
        stored = {}
        for column in known[0]:
            values = np.array([t[column] for t in known])
            components[column] = values.shape[2] if values.ndim > 2 else 1
            stored[column] = arrays.add(f"{key}.{start}.{column}", values, xor=True)
            if values.dtype == np.float64 and column not in ("x", "n", "support", "area"):
                sizes = np.linalg.norm(values, axis=2) if values.ndim > 2 else values
                finite = sizes[np.isfinite(sizes)]
                low, high = largest.get(column, (0.0, 0.0))
                largest[column] = (
                    min(low, float(finite.min(initial=0.0))),
                    max(high, float(finite.max(initial=0.0))),
                )
            if column == "shear":
                normal = np.array([t["pressure"] for t in known])
                sizes = np.hypot(np.linalg.norm(values, axis=2), normal).max(axis=1)
                if sizes.max(initial=0.0) > traction:
                    traction = float(sizes.max())
                    pressed = start + int(sizes.argmax())
        groups.append({"first": start, "arrays": stored})
    names = [c for c in (*_COLOURED, *components) if c in largest]
    ranges = {c: list(largest[c]) for c in dict.fromkeys(names)}
    return {"groups": groups, "components": components, "ranges": ranges, "traction": traction} | {
        "pressed": pressed
    }


def _obstacle(
    arrays: Arrays, scene: Scene, name: str, key: str, allowed: float
) -> dict[str, Any] | None:
    """The obstacle of a contact face: where it is beside the vertices of the face.

    What a page holds is the way from a vertex of the face before it moves to the obstacle there, so
    that a gap is exaggerated as much as a displacement, and a closed one stays closed. The way at
    the first state, as long as the gap, is exact; what it changes by is packed.

    Returns:
        None if it cannot be packed with the error that is allowed, or is not finite.
    """
    surface = scene.body
    assert surface is not None
    nodes = np.unique(surface.contact[name])
    start = surface.x[nodes]

    def way(i: int) -> npt.NDArray[Any]:
        state = scene.states[i]()
        floor, moved, _ = state.obstacles[name]
        return np.asarray(floor + moved - start[:, : floor.shape[1]])

    first = way(0)
    count = len(scene.states)
    if not all(np.isfinite(way(i)).all() for i in range(count)):
        return None
    packed = Arrays()
    field = packed_field(packed, f"{key}.obstacle", count, lambda i: way(i) - first, allowed)
    if field["error"] > allowed:
        return None
    arrays.packed |= packed.packed
    return {
        "x": arrays.add(f"{key}.obstacle.x", start),
        "cells": arrays.add(f"{key}.obstacle.cells", surface.obstacles[name].astype(np.int32)),
        "way": arrays.add(f"{key}.obstacle.way", first),
        "field": field,
    }
