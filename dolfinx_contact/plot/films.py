# SPDX-License-Identifier: LGPL-3.0-or-later
"""Films of deformed bodies, written with imageio, and pictures of records.

Frames are drawn like `picture_of_body`. All frames have the same colours, obstacles and camera.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from operator import index
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx_contact._files import part_of
from dolfinx_contact._install import optional
from dolfinx_contact._mpi import (
    Arguments,
    collective,
    everywhere,
    on_root,
    require,
    same_everywhere,
)
from dolfinx_contact._validate import is_number, number
from dolfinx_contact.plot.bodies import (
    body_scene,
    check_look,
    draw_scene,
    scene_of_surface,
    title_of,
)
from dolfinx_contact.plot.figures import Drawing, save
from dolfinx_contact.plot.in_2d import finite_range
from dolfinx_contact.plot.look import Look, Options, options_of
from dolfinx_contact.plot.scene import Scene
from dolfinx_contact.records.columns import StateEntry
from dolfinx_contact.records.journal import AnyJournal

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.records.steps_record import StepsRecord

__all__ = ["animate", "draw_record", "film"]

_SUFFIXES = (".gif", ".mp4")
_PICTURES = (".png", ".pdf", ".svg")
_WIDTH = 900  # of a frame in 3D, in pixels
_FILM_DPI = 130
_RATES = (0.01, 1000.0)  # frames a second that GIF can store


def _check_film(a: Arguments) -> None:
    a.file, a.rate = _checked_file(a.file, a.rate)
    check_look(a)


def _checked_file(file: str | os.PathLike[str], rate: Any) -> tuple[Path, float]:
    """Return the path and the rate of a film, or raise an error. Not collective."""
    path = Path(file)
    if path.suffix not in _SUFFIXES:
        raise ValueError(f"animations are .gif or .mp4, not {path.name}")
    if not (is_number(rate) and _RATES[0] <= rate <= _RATES[1]):
        low, high = _RATES
        raise ValueError(f"the rate must be a number from {low} to {high} a second, got {rate!r}")
    optional("imageio", "pictures")
    if path.suffix == ".mp4":
        optional("imageio_ffmpeg", "pictures", in_debian=False)
    return path, float(rate)


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
) -> Path:
    """Write a film of states of a body. Collective.

    Args:
        file: ``.gif``, or ``.mp4`` (requires imageio-ffmpeg).
        problem: contact problem; its displacement is restored at the end.
        states: iterator, such as a generator, that sets the displacement of the problem and yields
            a text for the title, state by state.
        stress: 3 x 3 UFL stress of the displacement, or one for each cell tag as in `write_fields`.
        scale: factor of the displacement, default 1; other factors are added to the title.
        title: title, before the text of the state.
        rate: frames a second, default 10.
        look: fields, view, section, zoom, colours: see `Look`. Without a stress and ``fields`` the
            displacement is shown.

    Returns:
        The file.

    Raises:
        ModuleNotFoundError: on every rank, if a package that writes such a file is not installed.
        OSError: on every rank, if the file cannot be written; an existing file is then unchanged.
        RuntimeError: on every rank, if VTK needs a display in 3D and there is none.
        ValueError: on every rank, for another suffix, a rate out of 0.01 to 1000, no states, a
            displacement that is not finite, or arguments that differ between ranks.

    Example:
        ::

            def swinging():
                for phase in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False):
                    problem.u.x.array[:] = np.cos(phase) * mode.x.array
                    yield f"phase {phase:.2f}"


            plot.film("output/mode.gif", problem, swinging())
    """
    comm = problem.comm
    if stress is None:
        look = Look(fields="displacement") | look
    options = options_of(problem.V.mesh.topology.dim, stress is not None, **look)
    before = problem.u.x.array.copy()
    frames: list[Scene | None] = []
    try:
        for text in _in_turn(comm, states):
            finite = bool(np.isfinite(problem.u.x.array).all())
            message = f"the displacement of state {len(frames)} has an entry that is not finite"
            require(comm, finite, message)
            words = title_of(", ".join(part for part in (title, text) if part), scale)
            frames.append(body_scene(problem, stress, scale, options, words))
    finally:
        problem.u.x.array[:] = before
    require(comm, bool(frames), "there are no states to show")
    path = Path(file)
    on_root(comm, lambda: _write([f for f in frames if f is not None], options, path, rate))
    return path


def _in_turn(comm: MPI.Comm, states: Iterable[str]) -> Iterator[str]:
    """Iterate over states; an error on one rank is raised on every rank. Collective."""
    iterator = iter(states)
    while True:
        with everywhere(comm, "the states of a film"):
            text = next(iterator, None)
        same_everywhere(comm, what_is_written=text)
        if text is None:
            return
        yield text


def _check_animation(a: Arguments) -> None:
    if a.steps is not None:
        a.steps = _indices(a.steps, "steps", len(a.record.journal.states))


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
) -> Path:
    """Write a film of a recorded history, with its times. Collective.

    Args:
        file: see `film`.
        record: `EvolutionRecord` or `PathRecord`. The problem is not changed.
        steps: numbers of the steps in the order of the film, 0 for the start, or a slice such as
            ``slice(100, 200, 5)``; default all steps.
        stress: see `film`, like the following arguments.
        scale: factor of the displacement.
        title: title, before the time.
        rate: frames a second.
        look: see `film`.

    Returns:
        The file.

    Raises:
        ModuleNotFoundError: see `film`, like the following errors.
        OSError: see `film`.
        RuntimeError: see `film`.
        ValueError: see `film`; also for steps that are not recorded.

    Example:
        ::

            with records.EvolutionRecord("output/path", evolution) as record:
                evolution.run(times, record=record)
                plot.animate("output/path.gif", record, stress=steel.full_stress(u))
    """
    states = record.journal.states
    shown = range(len(states)) if steps is None else _indices(steps, "steps", len(states))

    def times() -> Iterator[str]:
        for step in shown:
            record.show(step)
            yield f"time {states[step].time:.4g}"

    options: dict[str, Any] = dict(stress=stress, scale=scale, title=title, rate=rate)
    with record.looking():
        return film(file, record.problem, times(), **options, **look)


def draw_record(
    file: str | os.PathLike[str] | None,
    journal: AnyJournal,
    *,
    points: Sequence[int] | slice | None = None,
    branch: int = 0,
    scale: float = 1.0,
    title: str = "",
    rate: float = 10.0,
    **look: Unpack[Look],
) -> Drawing | Path:
    """Draw recorded bodies at a point, or write a film of several points. Not collective.

    Only the folder of the record is needed, neither the mesh nor the problem. The record must
    contain displacements (``surface_displacement=True``). Facets are linear.

    Args:
        file: ``.png``, ``.pdf`` or ``.svg`` for a picture of one point, ``.gif`` or ``.mp4`` for a
            film; None draws a picture and writes nothing.
        journal: result of `records.read_journal`.
        points: numbers of the points or steps in the order of the film, 0 for the start, or a
            slice. Default in a picture: the last one with a displacement; in a film: all of them.
        branch: number of the branch, default 0; histories and paths have branch 0 only.
        scale: factor of the displacement, default 1.
        title: title, before gamma or the time.
        rate: frames a second of a film, default 10.
        look: see `Look`; the only field is ``"displacement"``, which is shown by default.

    Returns:
        The figure (2D) or plotter (3D) of a picture; the path of a film.

    Raises:
        ModuleNotFoundError: if a package that writes such a file is not installed.
        OSError: if the file cannot be written; an existing file is then unchanged.
        RuntimeError: if VTK needs a display in 3D and there is none.
        ValueError: for another suffix, a rate out of 0.01 to 1000, a scale that is not finite,
            points that are not recorded or have no displacement, more than one point in a picture,
            or a damaged record.

    Example:
        ::

            journal = records.read_journal("output/branch")
            plot.draw_record("output/last.png", journal)
            plot.draw_record("output/branch.gif", journal, scale=10.0)
    """
    if not isinstance(journal, AnyJournal):
        kind = type(journal).__name__
        raise ValueError(f"the journal must be one of records.read_journal, got {kind}")
    scale = number(scale, "the scale of the displacement")
    is_picture = file is None or Path(file).suffix in _PICTURES
    if file is not None and not is_picture:
        file, rate = _checked_file(file, rate)
    # points with a displacement
    entries = journal.entries(branch)
    if points is None:
        shown = [i for i, entry in enumerate(entries) if entry.surface is not None]
        shown = shown[-1:] if is_picture else shown
    else:
        shown = _indices(points, "points", len(entries))
    if not shown:
        raise ValueError("no displacement was recorded: record with surface_displacement=True")
    if is_picture and len(shown) > 1:
        raise ValueError(f"a picture shows one point, not {len(shown)}; .gif and .mp4 show several")
    surface = journal.surface()
    dim = 3 if surface.x[:, 2].any() else 2
    options = options_of(dim, False, **(Look(fields="displacement") | look))
    if any(e is not None for e in options.fields.values()):
        raise ValueError("a record contains the displacement and no other field")
    frames = []
    for point in shown:
        state = journal.surface_at(point, branch)
        entry = entries[point]
        if isinstance(entry, StateEntry):
            text = f"time {entry.time:.4g}"
        else:
            text = f"gamma {entry.gamma:.4g}"
        values = {name: np.linalg.norm(state.u, axis=1) for name in options.fields}
        words = title_of(", ".join(part for part in (title, text) if part), scale)
        scene = scene_of_surface(surface, state, scale)
        frames.append(replace(scene, values=values, title=words))
    if file is not None and not is_picture:
        _write(frames, options, Path(file), rate)
        return Path(file)
    drawing = draw_scene(frames[0], options)
    save(drawing, file)
    return drawing


def _indices(numbers: Sequence[int] | slice, name: str, count: int) -> list[int]:
    """Return numbers of points or steps, or raise an error if there are none. Not collective."""
    every = range(count)[numbers] if isinstance(numbers, slice) else numbers
    if not (chosen := [index(i) for i in every]):
        raise ValueError(f"{name} are none: there are no states to show")
    return chosen


def _write(scenes: Sequence[Scene], options: Options, file: Path, rate: float) -> None:
    """Draw frames and write them as a film. Not collective."""
    from imageio import v2 as imageio

    # the same obstacles, visible box and colours in all frames
    bodies = _corners([scene.x for scene in scenes])
    scenes = [replace(s, obstacles=[o.below(bodies) for o in s.obstacles]) for s in scenes]
    reach = _corners([bodies, *(o.x for s in scenes for o in s.obstacles)])
    limits = {}
    for name in scenes[0].coloured:
        limits[name] = finite_range(np.concatenate([s.coloured[name] for s in scenes]))
    look: dict[str, Any] = dict(reach=reach, limits=limits, width=_WIDTH)
    pixels = [_pixels(draw_scene(scene, options, **look)) for scene in scenes]
    is_gif = file.suffix == ".gif"
    timing = dict(duration=1000 / rate, loop=0) if is_gif else dict(fps=rate, macro_block_size=2)
    with part_of(file) as part:
        imageio.mimwrite(part, pixels, **timing)


def _corners(points: Sequence[npt.NDArray[np.float64]]) -> npt.NDArray[np.float64]:
    """Corners (8, 3) of the box around points."""
    every = np.concatenate(points)
    ends = np.stack([every.min(axis=0), every.max(axis=0)], axis=1)
    return np.array(np.meshgrid(*ends)).reshape(3, -1).T


def _pixels(drawing: Drawing) -> npt.NDArray[np.uint8]:
    """Image (height, width, 3) of even size of a figure, or of a plotter, which is closed."""
    if hasattr(drawing, "canvas"):
        drawing.set_dpi(_FILM_DPI)
        drawing.canvas.draw()
        image = np.asarray(drawing.canvas.buffer_rgba())
    else:
        image = np.asarray(drawing.screenshot(None, return_img=True))
        drawing.close()
    height, width = (2 * (n // 2) for n in image.shape[:2])
    return np.ascontiguousarray(image[:height, :width, :3])
