# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lines of a diagram: columns and special points of the branches or runs in a journal."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact.records import EvolutionJournal, Journal, PathJournal

__all__ = ["AnyRecord", "BranchLine", "DiagramData", "diagram_of"]

AnyRecord = Journal | EvolutionJournal

#: Columns of branches, after gamma and the functionals.
_OF_POINTS = ("open", "stick", "slip", "clamped", "norm", "step", "corrections")
#: Columns of steps that are not numbers.
_WORDS = ("strategy", "event", "before", "after", "status")


@dataclass(frozen=True, eq=False)
class BranchLine:
    """Line of a diagram: a branch, a history or a path.

    Attributes:
        name: name displayed in the legend.
        number: number of the branch; 0 for histories and paths.
        columns: values at all points, by name.
        statuses: status letters of all contact points, one string per point of the line.
        marks: special points, one dictionary each: ``index`` of the point of the line at or after
            the special point; ``kind``; ``text``; ``at``, a dictionary of column values that are
            known at the special point; and ``share``, its relative position between the preceding
            point (0) and the point ``index`` (1).
        linear: whether the state is piecewise linear between the points.
        ending: reason why the line ends; "" if the run has not ended.
    """

    name: str
    number: int
    columns: dict[str, Array]
    statuses: list[str]
    marks: list[dict[str, Any]]
    linear: bool
    ending: str


@dataclass
class DiagramData:
    """Lines of a diagram, with the columns and properties of the journal from which they come.

    Attributes:
        kind: description of the record, such as "branches" or "a history".
        along: column over which the lines are plotted: gamma, time or arc.
        columns: names of all columns.
        functionals: names of the columns that contain functionals defined by the user; for
            histories and paths, contact forces.
        lines: lines in order.
        unfinished: whether the journal is still being written or was interrupted.
        alike: groups of columns sharing a scale, such as the components of a force.
    """

    kind: str
    along: str
    columns: list[str]
    functionals: list[str]
    lines: list[BranchLine] = field(default_factory=list)
    unfinished: bool = False
    alike: list[list[str]] = field(default_factory=list)

    def scales(self) -> dict[str, float]:
        """Return the largest modulus of each column, or of its group in `alike`, by column."""
        columns = {
            n: np.concatenate([line.columns[n] for line in self.lines]) for n in self.columns
        }
        sizes = {
            name: float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
            for name, values in columns.items()
        }
        for group in self.alike:
            largest = max((sizes[name] for name in group), default=0.0)
            sizes |= dict.fromkeys(group, largest)
        return sizes

    @property
    def axes(self) -> tuple[str, str]:
        """Columns shown first: gamma or time, and a varying column, preferably a functional."""
        across = "gamma" if "gamma" in self.columns else self.along
        others = [n for n in self.columns if n not in (across, self.along, "length")]

        values = {n: np.concatenate([line.columns[n] for line in self.lines]) for n in others}
        varying = [name for name in others if _span(values[name]) > 0]
        first = [name for name in self.functionals if name in varying]
        rest = [name for name in varying if name not in _OF_POINTS[:4]]
        return across, (first or rest or varying or others or [across])[0]


def diagram_of(journal: AnyRecord) -> DiagramData:
    """Return the lines of a journal, which may belong to a run in progress.

    Raises:
        ValueError: if no point was recorded yet.
    """
    points = journal.entries() if isinstance(journal, EvolutionJournal) else journal.rows()
    if not points:
        raise ValueError(f"no point was recorded in {journal.folder or 'the journal'} yet")
    diagram = _branches(journal) if isinstance(journal, Journal) else _steps(journal)
    diagram.unfinished = diagram.unfinished or journal.torn
    return diagram


def _branches(journal: Journal) -> DiagramData:
    # The user may have named a functional "distance".
    distance = "distance"
    while distance in journal.functionals:
        distance += " along the branch"
    names = list(dict.fromkeys(["gamma", *journal.functionals, distance, *_OF_POINTS]))
    kind = "branches"
    unfinished = any(branch.ending is None for branch in journal.branches.values())
    if journal.is_diagram:
        unfinished = unfinished or journal.explored.ending is None
        share = "all" if journal.explored.complete else "not all"
        kind = f"a diagram, {share} of its rays followed"
    diagram = DiagramData(kind, "gamma", names, journal.functionals, unfinished=unfinished)
    for number, branch in sorted(journal.branches.items()):
        if not branch.points:
            continue
        table = journal.columns(number)
        table[distance] = np.cumsum(table["step"])
        columns = {name: table[name].astype(float) for name in names}
        marks = [_mark(s, p.index, columns["gamma"]) for p in branch.points for s in p.special]
        # Pivoting follows affine pieces from vertex to vertex and has no step length.
        linear = all(point.next_step == 0 for point in branch.points)
        statuses = [str(word) for word in table["status"]]
        name = f"branch {number}"
        diagram.lines.append(
            BranchLine(name, number, columns, statuses, marks, linear, branch.reason)
        )
    return diagram


def _mark(special: Any, index: int, gammas: Array) -> dict[str, Any]:
    """Return the mark of a special point on the way to the point ``index``."""
    gamma = float(special.gamma)
    share = 1.0
    if index > 0:
        low, high = gammas[index - 1 : index + 1]
        if min(low, high) <= gamma <= max(low, high) and low != high:
            share = float((gamma - low) / (high - low))
        elif special.smooth and abs(low - gamma) < abs(high - gamma):
            index -= 1  # outside a turn of gamma: at the nearer point
    words = ["smooth" if special.smooth else "nonsmooth"]
    if special.others:
        words.append(f"{special.others} other rays")
    if special.bracket:
        words.append("between gamma {:.6g} and {:.6g}".format(*special.bracket))
    for change in special.changes[:4]:
        place = ", ".join(f"{c:.4g}" for c in change.x)
        words.append(f"{change.before} to {change.after} at ({place})")
    if len(special.changes) > 4:
        words.append(f"{len(special.changes) - 4} more points change")
    at = {"gamma": gamma}
    return {
        "index": index,
        "kind": special.kind,
        "text": "; ".join(words),
        "at": at,
        "share": share,
    }


def _steps(journal: EvolutionJournal) -> DiagramData:
    is_path = isinstance(journal, PathJournal)
    along = "arc" if is_path else "time"
    rows = journal.rows()
    numbers = [name for name in dict.fromkeys(k for row in rows for k in row) if name != "step"]
    columns = {
        along if name == "time" else name: np.array([_number(row.get(name)) for row in rows])
        for name in numbers
        if name not in _WORDS
    }
    columns |= {} if is_path else journal.loads()
    names = list(dict.fromkeys((["gamma"] if is_path else []) + [along, *columns]))
    forces = [f"{name}_{axis}" for name in journal.places for axis in "xyz"]
    spans = {name: _span(columns[name]) for name in forces if name in columns}
    functionals = sorted(spans, key=lambda name: -spans[name])
    marks: list[dict[str, Any]] = []
    for i, row in enumerate(rows):
        event = row.get("event") or ("jump" if row.get("jump") else "")
        text = (
            f"{row.get('before')} to {row.get('after')}" if row.get("event") else "jump in a step"
        )
        if event:
            marks.append({"index": i, "kind": event, "text": text, "at": {}, "share": 1.0})
    name = "path" if is_path else "history"
    last = journal.runs[-1] if journal.runs else None
    statuses = [state.status for state in journal.states]
    ending = "" if last is None else last.reason
    line = BranchLine(name, 0, columns, statuses, marks, False, ending)
    unfinished = last is None or last.ending is None
    alike = [[n for n in columns if n in journal.states[0].energies]]
    vectors = {name[:-1] for name in columns if re.search("_u?[xyz]$", name)}
    alike += [[n for n in columns if n[:-1] == vector] for vector in sorted(vectors)]
    return DiagramData(f"a {name}", along, names, functionals, [line], unfinished, alike)


def _span(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if len(finite) else 0.0


def _number(value: Any) -> float:
    """Return an entry of a row as a number; NaN if it is not a number."""
    return float(value) if isinstance(value, int | float) else float("nan")
