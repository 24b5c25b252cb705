# SPDX-License-Identifier: LGPL-3.0-or-later
"""Films of deformed bodies, written with imageio.

Frames are drawn like `picture_of_body`. All frames have the same colours, obstacles and camera.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
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
from dolfinx_contact._validate import is_number
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.history import EvolutionStep
from dolfinx_contact.plot.bodies import draw_scene
from dolfinx_contact.plot.figures import Drawing
from dolfinx_contact.plot.in_2d import range_of
from dolfinx_contact.plot.scene import Look, Scene, scene_of, words_of

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = ["film"]

_SUFFIXES = (".gif", ".mp4")
_WIDTH = 900  # of a frame in 3D, in pixels
_FILM_DPI = 130
_RATES = (0.01, 1000.0)  # frames a second that GIF can store


def _check_film(a: Arguments) -> None:
    a.file = Path(a.file)
    if a.file.suffix not in _SUFFIXES:
        raise ValueError(f"animations are .gif or .mp4, not {a.file.name}")
    low, high = _RATES
    if not (is_number(a.rate) and low <= a.rate <= high):
        raise ValueError(f"the rate must be a number from {low} to {high} a second, got {a.rate!r}")
    optional("imageio", "pictures")
    if a.file.suffix == ".mp4":
        optional("imageio_ffmpeg", "pictures", in_debian=False)


@collective("a film", _check_film, local=("states",))
def film(
    file: str | os.PathLike[str],
    problem: ContactProblem,
    states: Iterable[State | EvolutionStep | str],
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
        states: states or steps in the order of the film, such as ``history.steps``, or
            ``map(record.state, range(10))`` with a record; or a generator that sets the
            displacement of the problem and yields a text for the title.
        stress: 3 x 3 UFL stress of the displacement, or one for each cell tag as in `write_fields`.
        scale: factor of the displacement, default 1; see `picture_of_body`.
        title: title, before the time or the load of a state, or its text.
        rate: frames a second, default 10.
        **look: field, view, clip, arrows: see `Look`. Without a stress and ``field`` the
            displacement is shown. A field is evaluated in each state if it is a UFL expression of
            the displacement; the values of a Function stay the same.

    Returns:
        The file.

    Raises:
        ModuleNotFoundError: on every rank, if a package writing such a file is not installed.
        OSError: on every rank, if the file cannot be written; an existing file is then unchanged.
        RuntimeError: on every rank, if VTK needs a display in 3D and there is none.
        ValueError: on every rank, for another suffix, a rate out of 0.01 to 1000, no states, a
            displacement that is not finite, or arguments differing between ranks.

    Example:
        ::

            def swinging():
                for phase in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False):
                    problem.u.x.array[:] = np.cos(phase) * mode.x.array
                    yield f"phase {phase:.2f}"


            plot.film("output/mode.gif", problem, swinging())
            plot.film("output/history.gif", problem, history.steps)
    """
    comm = problem.comm
    if stress is None:
        look = Look(field="displacement") | look
    before = problem.u.x.array.copy()
    scenes: list[Scene | None] = []
    try:
        for state in _in_turn(comm, states):
            finite = bool(np.isfinite(problem.u.x.array).all())
            message = f"the displacement of state {len(scenes)} has an entry that is not finite"
            require(comm, finite, message)
            text = state if isinstance(state, str) else words_of(state)
            words = ", ".join(filter(None, [title, text]))
            with problem.at(state if isinstance(state, State) else None) as shown:
                scenes.append(scene_of(shown, stress, scale, words, **look))
    finally:
        problem.u.x.array[:] = before
    require(comm, bool(scenes), "there are no states to show")
    path = Path(file)
    on_root(comm, lambda: _write([scene for scene in scenes if scene is not None], path, rate))
    return path


def _in_turn(
    comm: MPI.Comm, states: Iterable[State | EvolutionStep | str]
) -> Iterator[State | str]:
    """Iterate over states, also of steps; an error is raised on every rank. Collective."""
    iterator = iter(states)
    while True:
        with everywhere(comm, "the states of a film"):
            item = next(iterator, None)
        state = item.state if isinstance(item, EvolutionStep) else item
        text = words_of(state) if isinstance(state, State) else state
        same_everywhere(comm, what_is_written=text)
        if state is None:
            return
        if not isinstance(state, State | str):
            raise ValueError(f"a film has states, steps or texts, got {state!r}")
        yield state


def _write(scenes: list[Scene], file: Path, rate: float) -> None:
    """Draw frames and write them as a film. Not collective."""
    from imageio import v2 as imageio

    # the same obstacles, visible box and colours in all frames
    every = np.concatenate([scene.x for scene in scenes])
    scenes = [scene.with_planes_below(every) for scene in scenes]
    visible = np.concatenate([scene.visible_points() for scene in scenes])
    fields = [scene.values for scene in scenes if scene.values is not None]
    limits = range_of(np.concatenate(fields)) if fields else None
    pixels = [_pixels(draw_scene(scene, visible, limits, _WIDTH)) for scene in scenes]
    is_gif = file.suffix == ".gif"
    timing = dict(duration=1000 / rate, loop=0) if is_gif else dict(fps=rate, macro_block_size=2)
    with part_of(file) as part:
        imageio.mimwrite(part, pixels, **timing)


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
