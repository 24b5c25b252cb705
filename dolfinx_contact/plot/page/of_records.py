# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes of records: branches, histories, motions, paths. All that reads a journal is here."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_contact.plot.page.scene import Array, Mark, Scene, SeriesShown
from dolfinx_contact.records.columns import PathGoesOn, SpecialEntry, StateEntry
from dolfinx_contact.records.journal import (
    FILE_NAME,
    AnyJournal,
    EvolutionJournal,
    Journal,
    PathJournal,
    read_journal,
)

__all__ = ["has_points", "scene_of_record"]

#: Of branches, beside gamma, the functionals and the distance along the branch.
_OF_POINTS = ("open", "stick", "slip", "clamped", "norm", "step", "corrections")
#: Of rows that are words, and not numbers to draw.
_WORDS = ("strategy", "event", "before", "after", "status")


def scene_of_record(record: str | os.PathLike[str] | AnyJournal) -> Scene:
    """The scene of a record, on this rank alone; it may be that of a run that continues.

    Args:
        record: its folder, or its journal.

    Raises:
        OSError: if there is no journal.
        ValueError: if it is damaged, or nothing was recorded in it yet.
    """
    if isinstance(record, AnyJournal):
        journal: AnyJournal = record
    else:
        if not (Path(record) / FILE_NAME).is_file():
            raise FileNotFoundError(f"{record} is no record: there is no {FILE_NAME} in it")
        journal = read_journal(record)
    if not _any_point(journal):
        where = journal.folder or "the journal"
        raise ValueError(f"no point was recorded in {where} yet")
    if isinstance(journal, Journal):
        scene = _of_branches(journal)
    elif isinstance(journal, EvolutionJournal):
        scene = _of_steps(journal)
    else:
        raise ValueError(f"journals of {journal.kind} cannot be shown")
    scene.package = str(journal.header.get("package", ""))
    scene.unfinished = scene.unfinished or journal.torn
    if scene.states:
        scene.body = journal.surface()
    else:
        scene.notes.append(
            "No displacement was recorded, so that no body is shown: record with "
            "surface_displacement=True."
        )
    return scene


def has_points(record: str | os.PathLike[str]) -> bool:
    """Whether anything was recorded yet in a folder that has a journal, on this rank alone.

    Raises:
        ValueError: if the journal is damaged.
    """
    return _any_point(read_journal(record))


def _any_point(journal: AnyJournal) -> bool:
    if isinstance(journal, Journal):
        return any(branch.points for branch in journal.branches.values())
    return not journal.is_empty


def _of_branches(journal: Journal) -> Scene:
    # It is no column of journals, so that a functional may have its name.
    distance = "distance"
    while distance in journal.functionals:
        distance += " along the branch"
    names = ["gamma", *journal.functionals, distance, *_OF_POINTS]
    scene = Scene("branches", "gamma", list(dict.fromkeys(names)), journal.functionals)
    for number in sorted(journal.branches):
        branch = journal.branches[number]
        if not branch.points:
            continue
        known = journal.columns(number)
        columns = {name: known[name].astype(float) for name in scene.columns if name in known}
        columns[distance] = np.cumsum(columns["step"])
        marks = [
            _mark(special, point.index, columns["gamma"])
            for point in branch.points
            for special in point.special
        ]
        scene.series.append(
            SeriesShown(
                f"branch {number}",
                columns,
                [str(word) for word in known["status"]],
                _states(scene, journal, number),
                marks,
                branch.reason,
            )
        )
    scene.unfinished = any(branch.ending is None for branch in journal.branches.values())
    if journal.is_diagram:
        scene.unfinished = scene.unfinished or journal.explored.ending is None
        share = "all" if journal.explored.complete else "not all"
        scene.kind = f"a diagram, {share} of its rays followed"
    return scene


def _mark(special: SpecialEntry, index: int, gammas: Array) -> Mark:
    """A special point of a branch: at its point, or between it and the one before."""
    gamma = float(special.gamma)
    at = index
    share = 1.0
    if index > 0:
        before, here = gammas[index - 1 : index + 1]
        if min(before, here) <= gamma <= max(before, here) and before != here:
            share = float((gamma - before) / (here - before))
        elif special.smooth and abs(before - gamma) < abs(here - gamma):
            at = index - 1  # beyond a turn of gamma: at the nearer of both
    words = ["smooth" if special.smooth else "nonsmooth"]
    if special.others:
        words.append(f"{special.others} other rays")
    if special.bracket:
        low, high = special.bracket
        words.append(f"between gamma {low:.6g} and {high:.6g}")
    changes = special.changes
    for change in changes[:4]:
        place = ", ".join(f"{c:.4g}" for c in change.x)
        words.append(f"{change.before} to {change.after} at ({place})")
    if len(changes) > 4:
        words.append(f"{len(changes) - 4} more points change")
    return Mark(at, special.kind, "; ".join(words), {"gamma": gamma}, share)


def _of_steps(journal: EvolutionJournal) -> Scene:
    is_path = isinstance(journal, PathJournal)
    kind = "a path" if is_path else "a history"
    rows: list[dict[str, Any]] = [_start(journal.states[0])]
    rows += [state.row for state in journal.states if state.row is not None]
    numbers: dict[str, None] = dict.fromkeys(["time", *(["gamma"] if is_path else [])])
    for row in rows:
        numbers |= dict.fromkeys(name for name in row if name not in (*_WORDS, "step"))
    columns = {name: np.array([_number(row.get(name)) for row in rows]) for name in numbers}
    names = list(columns)
    if is_path:
        # Its times are arc lengths; it is plotted over the load.
        columns = {"arc" if name == "time" else name: values for name, values in columns.items()}
        names = ["gamma", "arc", *(name for name in columns if name not in ("gamma", "arc"))]
    scene = Scene(kind, "arc" if is_path else "time", names)
    scene.functionals = _forces(journal, columns)
    marks = []
    for i, row in enumerate(rows):
        event = str(row.get("event") or "")
        if event:
            marks.append(Mark(i, event, f"{row.get('before')} to {row.get('after')}"))
        elif row.get("jump"):
            marks.append(Mark(i, "jump", "the state jumped in this step"))
    scene.series.append(
        SeriesShown(
            "path" if is_path else "history",
            columns,
            [state.status for state in journal.states],
            _states(scene, journal, 0),
            marks,
            journal.runs[-1].reason if journal.runs else "",
        )
    )
    scene.unfinished = not journal.runs or journal.runs[-1].ending is None
    return scene


def _forces(journal: AnyJournal, columns: Mapping[str, Array]) -> list[str]:
    """Contact forces among columns, that which changes most in front."""
    known = [f"{name}_{axis}" for name in journal.places for axis in "xyz"]
    forces = [name for name in known if name in columns]
    ranges = {name: np.nanmax(columns[name]) - np.nanmin(columns[name]) for name in forces}
    return sorted(forces, key=lambda name: -float(ranges[name]))


def _start(state: StateEntry[Any]) -> dict[str, Any]:
    """What is known of the start of a history or path, as a row of its table."""
    known = {"time": state.time, **state.energies}
    return known | ({"gamma": state.run.gamma} if isinstance(state.run, PathGoesOn) else {})


def _number(value: Any) -> float:
    """A number of a row, NaN for what is none."""
    return float(value) if isinstance(value, int | float | np.number) else float("nan")


def _states(scene: Scene, journal: AnyJournal, branch: int) -> list[int]:
    """Numbers of the states of the points of a branch, which the scene is given."""
    found: list[int] = []
    for index, entry in enumerate(journal.entries(branch)):
        if entry.surface is None:
            found.append(-1)
            continue
        found.append(len(scene.states))
        scene.states.append(partial(journal.surface_at, index, branch))
    return found
