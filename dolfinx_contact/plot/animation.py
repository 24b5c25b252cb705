# SPDX-License-Identifier: LGPL-3.0-or-later
"""Animations of the deformed body: of states one after the other, and of a recorded history.

Frames are those of `picture_of_body`, drawn one after the other by the same program, with one
frame, one scale of colours and one camera for all.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Unpack

from mpi4py import MPI

import numpy as np

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._errors import everywhere, on_root, require, same_everywhere
from dolfinx_contact._validate import is_number
from dolfinx_contact.plot.floors import lay_floors
from dolfinx_contact.plot.look import Look, checked_look, checked_scale
from dolfinx_contact.plot.pictures import body_seen, check_look, draw, magnified, surface_seen
from dolfinx_contact.plot.render import known_range
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.records.columns import StateEntry
from dolfinx_contact.records.journal import AnyJournal
from dolfinx_contact.records.steps_record import StepsRecord

__all__ = ["animate", "draw_record", "film"]

#: What writes files of a kind: module, and how it is installed.
_WRITERS = {
    ".gif": ("imageio", "imageio, or python3-imageio of Debian"),
    ".mp4": ("imageio_ffmpeg", "imageio-ffmpeg; .gif does not need it"),
}
PICTURES = (".png", ".pdf", ".svg")
_SLOWEST = 0.01  # pictures a second, which the format of .gif can store
_FASTEST = 1000.0
_SKIN = 0.04  # of the size, by which obstacles are thick in a picture


def _check_film(a: Arguments) -> None:
    a.file = _film_path(a.file)
    a.scale = checked_scale(a.scale)
    a.rate = _checked_rate(a.rate)
    check_look(a)


def _film_path(file: str | os.PathLike[str]) -> Path:
    """The path of a film, or ``ValueError``. Not collective."""
    path = Path(file)
    if path.suffix not in _WRITERS:
        raise ValueError(f"animations are .gif or .mp4, not {path.name}")
    return path


def _checked_rate(rate: Any) -> float:
    """Pictures a second as a number that films can have, or ``ValueError``. Not collective."""
    if not (is_number(rate) and _SLOWEST <= rate <= _FASTEST):
        raise ValueError(
            f"the rate must be a number of pictures a second from {_SLOWEST} to {_FASTEST}, "
            f"got {rate!r}"
        )
    return float(rate)


@collective("a film", _check_film)
def film(
    file: str | os.PathLike[str],
    problem: ContactProblem,
    states: Iterable[str],
    *,
    stress: Any = None,
    scale: float = 1.0,
    title: str = "",
    rate: float = 10.0,
    **look: Unpack[Look],
) -> Path | None:
    """Draw states of a body one after the other as an animation, without a display. Collective.

    Args:
        file: ``.gif``, or ``.mp4``, for which imageio-ffmpeg must be installed.
        problem: whose displacement is drawn; it is put back at the end.
        states: sets the displacement of the problem and yields what is written beside the title,
            state by state: a generator. A scale that is not 1 is written behind it.
        stress: 3 x 3 UFL stress of the displacement, by cell tags if there are several materials,
            as for `write_fields`, for the colours.
        scale: factor of the displacement.
        title: above the pictures.
        rate: pictures a second.
        look: as for `picture_of_body`; without a stress and ``fields`` the displacement is shown.

    Returns:
        The file, on every rank; None where it could not be drawn, as for `picture_of_body`.

    Raises:
        ModuleNotFoundError: on every rank, if what writes such a file is not installed.
        ValueError: on every rank, for another suffix, a rate that is no number from 0.01 to 1000,
            no states, a displacement that is not finite, or arguments that differ between ranks.

    Example:
        ::

            def swinging():
                for phase in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False):
                    problem.u.x.array[:] = np.cos(phase) * mode.x.array
                    yield f"phase {phase:.2f}"


            plot.film("output/mode.gif", problem, swinging())
    """
    comm = problem.comm
    path = Path(file)
    on_root(comm, lambda: _require_writer(path.suffix))
    if stress is None:
        look = Look(fields="displacement") | look
    before = problem.u.x.array.copy()
    frames: list[dict[str, Any]] = []
    try:
        for words in _in_turn(comm, states):
            beside = ", ".join(part for part in (title, words, *magnified(scale)) if part)
            finite = bool(np.isfinite(problem.u.x.array).all())
            message = f"the displacement of state {len(frames)} has an entry that is not finite"
            require(comm, finite, message)
            kind, data = body_seen(problem, stress, scale, beside, look)
            frames.append(data)
    finally:
        problem.u.x.array[:] = before
    require(comm, bool(frames), "there are no states to show")
    return _draw_film(comm, path, kind, frames, rate)


def _check_animation(a: Arguments) -> None:
    if a.steps is not None:
        a.steps = _checked_numbers(a.steps, "steps", len(a.record.journal.states))


@collective("a film of a record", _check_animation)
def animate(
    file: str | os.PathLike[str],
    record: StepsRecord[Any, Any],
    *,
    steps: Sequence[int] | slice | None = None,
    stress: Any = None,
    scale: float = 1.0,
    title: str = "",
    rate: float = 10.0,
    **look: Unpack[Look],
) -> Path | None:
    """Draw a recorded history as an animation, with its times. Collective.

    Args:
        file: as for `film`.
        record: an `EvolutionRecord` or `PathRecord`. The problem stays as it is.
        steps: which are shown, in this order, 0 the start; or a slice of all of them, as
            ``slice(100, 200, 5)``; by default all.
        stress: as for `film`, like the following.
        scale: factor of the displacement.
        title: above the pictures, before the time.
        rate: pictures a second.
        look: as for `film`.

    Returns:
        The file, on every rank; None where it could not be drawn, as for `picture_of_body`.

    Raises:
        ModuleNotFoundError: on every rank, if what writes such a file is not installed.
        ValueError: on every rank, as for `film`, and for steps that are not recorded.

    Example:
        ::

            with records.EvolutionRecord("output/path", evolution) as record:
                evolution.run(times, record=record)
                plot.animate("output/path.gif", record, stress=steel.full_stress(u))
    """
    states = record.journal.states
    shown = range(len(states)) if steps is None else _checked_numbers(steps, "steps", len(states))

    def times() -> Iterator[str]:
        for index in shown:
            record.show(index)
            yield f"time {states[index].time:.4g}"

    shows = dict(stress=stress, scale=scale, title=title, rate=rate)
    with record.looking():
        return film(file, record.problem, times(), **shows, **look)


def draw_record(
    file: str | os.PathLike[str],
    journal: AnyJournal,
    *,
    points: Sequence[int] | slice | None = None,
    branch: int = 0,
    scale: float = 1.0,
    title: str = "",
    rate: float = 10.0,
    **look: Unpack[Look],
) -> Path | None:
    """Draw recorded bodies at a point, or as an animation; on this rank alone.

    Nothing but the folder of the record is needed: neither the mesh nor the problem. Displacements
    must have been recorded (``surface_displacement=True``). Facets are linear.

    Args:
        file: ``.png``, ``.pdf`` or ``.svg``, the picture of one point, or an animation as for
            `film`.
        journal: what `records.read_journal` returned.
        points: which are shown, in this order; of a history or path steps, 0 the start; or a slice
            of all of them. By default those with a displacement: the last one in a picture, all in
            an animation.
        branch: its number; histories and paths have branch 0 alone.
        scale: factor of the displacement.
        title: above the pictures, before gamma or the time.
        rate: pictures a second.
        look: as for `picture_of_body`; the only field is ``"displacement"``, which is shown.

    Returns:
        The file; None where it could not be drawn, as for `picture_of_body`.

    Raises:
        ModuleNotFoundError: if what writes such a file is not installed.
        ValueError: for another suffix, a rate that is not positive, a scale that is not finite,
            points that are not recorded or without a displacement, more than one for a picture, or
            a record that is damaged.

    Example:
        ::

            journal = records.read_journal("output/branch")
            plot.draw_record("output/last.png", journal)
            plot.draw_record("output/branch.gif", journal, scale=10.0)
    """
    if not isinstance(journal, AnyJournal):
        kind = type(journal).__name__
        raise ValueError(f"the journal must be one of records.read_journal, got {kind}")
    path = Path(file)
    is_picture = path.suffix in PICTURES
    scale = checked_scale(scale)
    if not is_picture:
        path = _film_path(file)
        rate = _checked_rate(rate)
        _require_writer(path.suffix)
    entries = journal.entries(branch)
    if points is None:
        known = [i for i, entry in enumerate(entries) if entry.surface is not None]
        points = known[-1:] if is_picture else known
    else:
        points = _checked_numbers(points, "points", len(entries))
    if not points:
        raise ValueError("no displacement was recorded: record with surface_displacement=True")
    if is_picture and len(points) > 1:
        raise ValueError(
            f"a picture shows one point, not {len(points)}: .gif and .mp4 show several"
        )
    surface = journal.surface()
    dim = 2 if np.ptp(surface.x[:, 2]) == 0 else 3
    shown = checked_look(Look(fields="displacement") | look, dim, stress=False)
    if any(e is not None for e in shown["fields"].values()):
        raise ValueError("of a record displacements are known, and no other fields")
    frames: list[dict[str, Any]] = []
    for index in points:
        state = journal.surface_at(index, branch)
        entry = entries[index]
        if isinstance(entry, StateEntry):
            words = f"time {entry.time:.4g}"
        else:
            words = f"gamma {entry.gamma:.4g}"
        beside = ", ".join(part for part in (title, words, *magnified(scale)) if part)
        frame = {"title": beside, "look": shown | {"fields": None}}
        frame["colours"] = {name: np.linalg.norm(state.u, axis=1) for name in shown["fields"]}
        frames.append(frame | surface_seen(surface, state, scale, shown["apart"]))
    kind = f"body_{dim}d"
    if is_picture:
        lay_floors(frames, dim)
        return draw(MPI.COMM_SELF, kind, frames[0], path)
    return _draw_film(MPI.COMM_SELF, path, kind, frames, rate)


def _checked_numbers(numbers: Any, what: str, count: int) -> list[int]:
    """Numbers of points or steps, of ``count``, as a list, or ``ValueError``. Not collective."""
    if isinstance(numbers, slice):
        numbers = range(count)[numbers]
    known = isinstance(numbers, Iterable) and not isinstance(numbers, str | bytes)
    chosen = list(numbers) if known else []
    whole = all(isinstance(i, int | np.integer) and not isinstance(i, bool) for i in chosen)
    if known and not chosen:
        raise ValueError(f"{what} are none: there are no states to show")
    if not known or not whole:
        raise ValueError(f"{what} must be a sequence of whole numbers, got {numbers!r}")
    return [int(i) for i in chosen]


def _draw_film(
    comm: MPI.Comm, path: Path, kind: str, frames: Sequence[dict[str, Any]], rate: float
) -> Path | None:
    """Draw frames of one kind, in which the same is seen in the same colours. Collective."""
    common: dict[str, Any] = {}
    if comm.rank == 0:
        lay_floors(frames, int(kind[-2]))
        common["reach"] = _reach(frames)
        # A section shows what is inside.
        shown = [frame.get("inside", frame)["colours"] for frame in frames]
        common["limits"] = {
            name: (
                min(known_range(colours[name])[0] for colours in shown),
                max(known_range(colours[name])[1] for colours in shown),
            )
            for name in frames[0]["colours"]
        }
    data = {"kind": kind, "frames": [frame | common for frame in frames], "rate": float(rate)}
    return draw(comm, "film", data, path, count=len(frames))


def _in_turn(comm: MPI.Comm, states: Iterable[str]) -> Iterator[str]:
    """The states, whose errors on one rank are raised on every rank. Collective."""
    left = iter(states)
    while True:
        with everywhere(comm, "the states of a film"):
            words = next(left, None)
        same_everywhere(comm, what_is_written=words)
        if words is None:
            return
        yield words


def _require_writer(suffix: str) -> None:
    module, package = _WRITERS[suffix]
    if find_spec(module) is None:
        raise ModuleNotFoundError(
            f"{suffix} needs what is not installed: python3 -m pip install {package}", name=module
        )


def _reach(frames: Sequence[dict[str, Any]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Two opposite corners of what is seen in any frame, or all of them in 3D (n, 3)."""
    body = np.concatenate([frame["x"] for frame in frames])
    skin = _SKIN * np.linalg.norm(np.ptp(body, axis=0))
    parts = [body]
    flat = bool(np.ptp(body[:, 2]) == 0)
    for frame in frames:
        pairs = zip(frame["obstacle_x"], frame["obstacle_normals"], strict=True)
        parts += [part for x, n in pairs for part in (x, x + skin * n)] if flat else []
    seen = np.concatenate(parts)
    ends = np.array([seen.min(axis=0), seen.max(axis=0)])
    return np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])
