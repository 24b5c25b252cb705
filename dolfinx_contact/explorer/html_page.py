# SPDX-License-Identifier: LGPL-3.0-or-later
"""Write an HTML page for exploring a record of branches, a history or a path."""

from __future__ import annotations

import html
import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from html.entities import html5
from importlib.resources import files
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from dolfinx_contact._files import part_of
from dolfinx_contact._install import optional
from dolfinx_contact._mpi import Arguments, collective, on_root
from dolfinx_contact._validate import count, is_number, number, one_of
from dolfinx_contact.analysis import ProvedCount
from dolfinx_contact.continuation import Solutions
from dolfinx_contact.explorer.lines import AnyRecord, DiagramData, diagram_of
from dolfinx_contact.explorer.packing import Arrays, deflated
from dolfinx_contact.explorer.surfaces import add_bodies
from dolfinx_contact.laws import status
from dolfinx_contact.records import EvolutionJournal, Journal, read_journal

__all__ = ["SolutionCount", "explorer"]

#: Scripts in the order in which the page runs them.
_SCRIPTS = ("decode", "words", "diagram", "body", "face", "table", "main")
_QUANTITIES = ("length", "force", "stress")
_ERRORS = (1e-4, 0.1)
#: Characters that Unicode has as subscripts.
_SUBSCRIPTS = dict(zip("0123456789aehijklmnoprstuvx", "₀₁₂₃₄₅₆₇₈₉ₐₑₕᵢⱼₖₗₘₙₒₚᵣₛₜᵤᵥₓ", strict=True))

Record = str | os.PathLike[str] | AnyRecord


@dataclass(frozen=True)
class SolutionCount:
    """Number of solutions at one value of the parameter gamma.

    Attributes:
        gamma: value of the parameter, a finite number.
        count: number of known solutions.
        proved: whether it is proved that there are no other solutions.
        method: name of the method by which solutions were counted.

    Raises:
        ValueError: if gamma is not finite, or the count is negative.
    """

    gamma: float
    count: int
    proved: bool
    method: str = ""

    def __post_init__(self) -> None:
        number(self.gamma, "gamma of a count")
        count(self.count, "the count", 0)


Counts = Iterable[SolutionCount | Solutions | ProvedCount]


def _count(solutions: Any) -> SolutionCount:
    if isinstance(solutions, ProvedCount):
        solutions = solutions.solutions
    if isinstance(solutions, Solutions):
        number_of = len(solutions.found)
        return SolutionCount(solutions.gamma, number_of, bool(solutions.complete), solutions.method)
    if not isinstance(solutions, SolutionCount):
        kind = type(solutions).__name__
        raise ValueError(f"counts must be results of find_solutions or SolutionCount, got {kind}")
    return solutions


def _check(a: Arguments) -> None:
    if Path(a.file).suffix != ".html":
        raise ValueError(f"the file name must end in .html, got {Path(a.file).name}")
    for quantity in a.units or {}:
        one_of(quantity, "the quantity of a unit", _QUANTITIES)
    if not (is_number(a.error) and _ERRORS[0] <= a.error <= _ERRORS[1]):
        raise ValueError(
            f"error must be a number from {_ERRORS[0]} to {_ERRORS[1]}, got {a.error!r}"
        )
    a.counts = [_count(c) for c in a.counts]


@collective("a page", _check)
def explorer(
    file: str | os.PathLike[str],
    record: Record,
    *,
    counts: Counts = (),
    title: str = "",
    labels: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    error: float = 0.005,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Path:
    """Write a page that explores a record. Collective; rank 0 reads and writes.

    The page is one file for a browser and needs no network. It shows a diagram of any two columns,
    with special points and with branches coloured by their statuses or by any column. For each
    point it shows the deformed body, the contact surface and its table. If the problem is piecewise
    affine, a click between two points shows the interpolated state. A functional named ``stable``
    (1 or 0, NaN if not decided) colours branches by stability. Bodies are shown if their
    displacement was recorded (``surface_displacement=True``); in 3D the browser needs WebGL.

    Displacements are compressed with an error that is stated on the page; contact tables are exact.

    Args:
        file: name of the page, ending in ``.html``.
        record: folder of a record, or journal (`records.read_journal`, `records.journal_of`).
        counts: numbers of solutions to show at their values of gamma: `SolutionCount` objects, or
            results of `find_solutions` or `analysis.prove_counts`.
        title: title; by default the name of the record.
        labels: displayed names of columns, by column; formulas between dollars are shown as text.
        units: names of the units of the quantities "length", "force" and "stress".
        error: largest error of a displacement, relative to the largest displacement; from 1e-4 to
            0.1.
        comm: communicator.

    Returns:
        Path of the page.

    Raises:
        OSError: if the record cannot be read or the page cannot be written; an existing page is
            then unchanged.
        ValueError: if an argument is out of its range, a label belongs to no column, or the record
            is corrupt or has no point yet.
        ModuleNotFoundError: if plotly is not installed.

    Example:
        ::

            with records.BranchRecord("output/branch", system, surface_displacement=True) as record:
                explore(system, [(x, 0.0)], gamma_range=(0.0, 1.0), record=record)
            proved = find_solutions(system, [x], 0.5)
            explorer.explorer("output/diagram.html", "output/branch", counts=[proved])
    """
    page = _Page(title, dict(labels or {}), dict(units or {}), error, [_count(c) for c in counts])

    def write() -> None:
        page.library = _library()
        _put(Path(file), page.of(record))

    on_root(comm, write)
    return Path(file)


def _put(path: Path, text: str) -> None:
    with part_of(path) as part:
        part.write_text(text, encoding="utf-8")


def _library() -> bytes:
    """Return the JavaScript file of plotly.

    Raises:
        ModuleNotFoundError: if plotly or this file is not installed.
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


@dataclass
class _Page:
    """Options of a page, see `explorer`.

    Attributes:
        title: title; "" for the name of the record.
        labels: displayed names of columns, by column.
        units: names of units, by quantity.
        error: largest error of a displacement, relative to the largest displacement.
        counts: numbers of solutions at values of gamma.
        library: script of plotly.
    """

    title: str
    labels: dict[str, str]
    units: dict[str, str]
    error: float
    counts: list[SolutionCount]
    library: bytes = b""

    def of(self, record: Any) -> str:
        """Return the HTML text of the page for a record."""
        if isinstance(record, Journal | EvolutionJournal):
            journal = record
            name = "Solutions" if journal.folder is None else journal.folder.name
        else:
            name = Path(os.path.abspath(record)).name
            try:
                journal = read_journal(record)
            except FileNotFoundError as error:
                raise FileNotFoundError(f"{record} is not a record: it has no journal") from error
        arrays = Arrays()
        diagram = diagram_of(journal)
        content = _content(arrays, diagram)
        # Point numbers of the states with a recorded surface, and those surfaces.
        numbers = []
        states: list[Any] = []
        for line in diagram.lines:
            entries: Sequence[Any] = journal.entries(line.number)
            for index, entry in enumerate(entries):
                numbers.append(len(states) if entry.surface is not None else -1)
                if entry.surface is not None:
                    states.append(journal.surface_at(index, line.number))
        arrays.add("states", np.array(numbers, dtype=np.int32))
        notes = ["No body is shown: its displacement was not recorded; record with "
                 "surface_displacement=True."]  # fmt: skip
        if states:
            bodies, notes = add_bodies(arrays, journal.surface(), states, self.error)
            content |= bodies
        if diagram.unfinished:
            notes.append("The record is being written, or its run was interrupted.")
        package = journal.header.get("package")
        about = f"{len(diagram.lines)} branches, " if len(diagram.lines) > 1 else ""
        noun = "point" if diagram.along == "gamma" else "state"
        about = f"{diagram.kind} · {about}{len(numbers)} {noun}{'s' * (len(numbers) != 1)}"
        content["about"] = about + (f" · recorded by dolfinx_contact {package}" if package else "")
        # Columns of steps are unknown before the first step.
        check = not (diagram.unfinished and len(numbers) == 1)
        return self._text(arrays, content, name, diagram.columns, notes, check=check)

    def _text(
        self,
        arrays: Arrays,
        content: dict[str, Any],
        name: str,
        columns: Sequence[str],
        notes: list[str],
        *,
        check: bool = True,
    ) -> str:
        """Return the HTML text of a page, given its arrays and descriptions.

        Raises:
            ValueError: if a label belongs to no column.
        """
        unknown = sorted(set(self.labels) - set(columns))
        if unknown and check:
            raise ValueError(f"there is no column {unknown[0]!r}; columns: {', '.join(columns)}")
        title = self.title or name
        described = self._columns(columns, content)
        meta = {"body": None, "fields": {}, "surfaces": []} | content
        meta |= {
            "title": title,
            "units": self.units,
            "counts": [asdict(c) for c in self.counts],
            "statuses": _statuses(),
            "notes": notes,
            "arrays": arrays.formats,
            "columns": described,
        }
        data = [_script("meta", "application/json", _json(meta))]
        data.append(_script("library", "text/plain", deflated(self.library)))
        data += [_script(f"array:{n}", "text/plain", text) for n, text in arrays.data.items()]
        folder = files("dolfinx_contact.explorer")

        def read(name: str) -> str:
            return (folder / name).read_text(encoding="utf-8")

        parts = {
            "TITLE": html.escape(title),
            "STYLE": read("page.css"),
            "DATA": "\n".join(data),
            "SCRIPTS": "\n".join(f"<script>\n{read(f'{s}.js')}</script>" for s in _SCRIPTS),
        }
        # One pass, so that inserted text is not searched.
        return re.sub(r"@([A-Z]+)@", lambda found: parts[found[1]], read("page.html"))

    def _columns(self, columns: Sequence[str], content: dict[str, Any]) -> list[dict[str, Any]]:
        """Describe the columns; remove the functionals and scales from ``content``."""
        labels = {column: _without_tex(text) for column, text in self.labels.items()}
        functionals = content.pop("functionals", [])
        scales = content.pop("scales", {})
        return [
            {
                "name": n,
                "label": labels.get(n, n),
                "functional": n in functionals,
                "scale": scales.get(n, 0.0),
            }
            for n in columns
        ]


def _content(arrays: Arrays, diagram: DiagramData) -> dict[str, Any]:
    """Store the columns of all lines, concatenated, in ``arrays``; describe lines and axes."""
    counts = [len(line.statuses) for line in diagram.lines]
    firsts = np.cumsum([0, *counts]).tolist()
    values = [
        np.concatenate([line.columns[name] for line in diagram.lines]) for name in diagram.columns
    ]
    arrays.add("columns", np.array(values))
    arrays.add_text("words", "\n".join(word for line in diagram.lines for word in line.statuses))
    series = [
        {
            "name": line.name,
            "first": first,
            "count": count,
            "marks": line.marks,
            "linear": line.linear,
            "ending": line.ending,
        }
        for line, first, count in zip(diagram.lines, firsts[:-1], counts, strict=True)
    ]
    return {
        "along": diagram.along,
        "points": firsts[-1],
        "functionals": diagram.functionals,
        "scales": diagram.scales(),
        "axes": diagram.axes,
        "series": series,
    }


def _statuses() -> dict[str, dict[str, str]]:
    """Return name, colour and kind of each status, by its letter."""
    kinds = {letter: kind for kind, letters in status.KINDS.items() for letter in letters}
    return {
        letter: {
            "name": _without_tex(name),
            "colour": status.COLOURS[letter],
            "kind": kinds[letter],
        }
        for letter, name in status.NAMES.items()
    }


def _without_tex(text: str) -> str:
    r"""Return a label with formulas as plain text: ``$\gamma_1$`` becomes "γ₁".

    An index with characters that are not in `_SUBSCRIPTS` is not converted.
    """

    def lowered(index: re.Match[str]) -> str:
        text = index[1] or index[2]
        return "".join(_SUBSCRIPTS[c] for c in text) if set(text) <= set(_SUBSCRIPTS) else index[0]

    def plain(formula: re.Match[str]) -> str:
        symbols = re.sub(r"\\([A-Za-z]+) ?", lambda c: html5.get(f"{c[1]};", c[1]), formula[1])
        return re.sub("[{}]", "", re.sub(r"_(?:(\w)|{(\w+)})", lowered, symbols))

    return re.sub(r"\$([^$]+)\$", plain, text)


def _script(name: str, kind: str, content: str) -> str:
    return f'<script type="{kind}" id="{html.escape(name)}">{content}</script>'


def _json(content: Any) -> str:
    """Return JSON for a script element, escaped so that it contains no HTML tag."""
    text = json.dumps(content, allow_nan=False, ensure_ascii=False)
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text
