# SPDX-License-Identifier: LGPL-3.0-or-later
"""Films of deformed bodies and of contact surfaces, written with imageio.

Frames are drawn like `picture_of_body` and `picture_of_contact`. All frames have the same colours,
axes and camera, and show the same part of obstacles.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar, Unpack

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
from dolfinx_contact._validate import count, is_number
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution.history import EvolutionStep, History
from dolfinx_contact.plot.bodies import draw_scene
from dolfinx_contact.plot.figures import Drawing, title_of, words_of
from dolfinx_contact.plot.scene import Look, check_look, framed, scene_of
from dolfinx_contact.plot.tractions import check_surface, contact_data, draw_contact

if TYPE_CHECKING:
    from dolfinx_contact.points.surface import DiscreteSurface
    from dolfinx_contact.problem import ContactProblem

__all__ = ["film", "film_of_contact"]

T = TypeVar("T")
States: TypeAlias = History | Iterable[State | EvolutionStep | str]

_SUFFIXES = (".gif", ".mp4")
_WIDTH = 900  # pixels of a frame that is drawn and then scaled
_SMALLEST = 300  # size of a frame in pixels
_RATES = (0.01, 1000.0)  # frames a second that GIF can store


def _check_film(a: Arguments) -> None:
    a.file = Path(a.file)
    if a.file.suffix not in _SUFFIXES:
        raise ValueError(f"a film must be a .gif or .mp4 file, got {a.file.name}")
    low, high = _RATES
    if not (is_number(a.rate) and low <= a.rate <= high):
        raise ValueError(f"the rate must be a number from {low} to {high} a second, got {a.rate!r}")
    count(a.size, "the size of a film in pixels", _SMALLEST)
    optional("imageio", "pictures")
    if a.file.suffix == ".mp4":
        optional("imageio_ffmpeg", "pictures", in_debian=False)


def _check_film_of_body(a: Arguments) -> None:
    check_look(film, a.look)
    _check_film(a)


def _check_film_of_contact(a: Arguments) -> None:
    check_surface(a)
    _check_film(a)


@collective("a film", _check_film_of_body, local=("states",))
def film(
    file: str | os.PathLike[str],
    problem: ContactProblem,
    states: States,
    *,
    stress: Any = None,
    scale: float = 1.0,
    title: str = "",
    rate: float = 10.0,
    size: int = 900,
    **look: Unpack[Look],
) -> Path:
    """Write a film of states of a body. Collective.

    Args:
        file: ``.gif``, or ``.mp4`` (requires imageio-ffmpeg).
        problem: contact problem; its displacement is restored at the end.
        states: one of the following: a history; states or steps in the order of the film, such as
            ``history.steps[::2]``, or ``map(record.state, range(10))`` with a record; or a
            generator that sets the displacement of the problem and yields a text for the title.
        stress: 3 x 3 UFL stress of the displacement, or one for each cell tag as in `write_fields`.
        scale: factor by which the displacement is multiplied, default 1; see `picture_of_body`.
        title: title of the film, followed in each frame by the time or load of the state, or by the
            text that the generator yields.
        rate: frames per second, default 10.
        size: largest width and height of a frame in pixels, default 900.
        **look: field, view, clip, arrows, region, edges, units: see `Look`. Without a stress and
            ``field`` the displacement is shown. A field is evaluated in each state if it is a UFL
            expression of the displacement; the values of a Function stay the same.

    Returns:
        Path of the film.

    Raises:
        ModuleNotFoundError: on every rank, if a package required for the format is not installed.
        OSError: on every rank, if the file cannot be written; an existing file is then unchanged.
        RuntimeError: on every rank, if VTK needs a display in 3D and there is none.
        TypeError: on every rank, if an option does not exist.
        ValueError: on every rank, if the suffix is not supported, the rate is not between 0.01 and
            1000, the size is below 300, there are no states, a displacement is not finite, or
            arguments differ between ranks.

    Example:
        ::

            def swinging():
                for phase in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False):
                    problem.u.x.array[:] = np.cos(phase) * mode.x.array
                    yield f"phase {phase:.2f}"

            plot.film("output/mode.gif", problem, swinging())
            plot.film("output/history.gif", problem, history)
    """
    if stress is None:
        look = Look(field="displacement") | look
    shots = _shots(problem, states, title, lambda p, words: scene_of(p, stress, scale, words, look))

    def drawings() -> Iterator[Drawing]:
        scenes = framed([scene for scene in shots if scene is not None])
        return (draw_scene(scene, _WIDTH) for scene in scenes)

    return _written(problem.comm, file, drawings, rate, size)


@collective("a film", _check_film_of_contact, local=("states",))
def film_of_contact(
    file: str | os.PathLike[str],
    problem: ContactProblem,
    states: States,
    *,
    surface: DiscreteSurface | None = None,
    over: Literal["x", "y"] | None = None,
    title: str = "",
    units: Mapping[str, str] | None = None,
    rate: float = 10.0,
    size: int = 900,
) -> Path:
    """Write a film of pressure, shear and status of a contact surface. Collective.

    All frames have the same axes and colours, and show the part of the surface that is in contact
    in at least one frame.

    Args:
        file: see `film`.
        problem: see `film`.
        states: see `film`.
        surface: see `picture_of_contact`.
        over: see `picture_of_contact`.
        title: see `film`.
        units: see `picture_of_contact`.
        rate: see `film`.
        size: see `film`.

    Returns:
        Path of the film. Errors are as in `film` and `picture_of_contact`.

    Example:
        ::

            units = {"length": "mm", "stress": "MPa"}
            plot.film_of_contact("output/pressure.gif", problem, history, units=units)
    """
    s = problem.surfaces[0] if surface is None else surface
    same_everywhere(problem.comm, surface=s.name)
    shots = _shots(problem, states, title, lambda p, words: (contact_data(p, s), words))

    def drawings() -> Iterator[Drawing]:
        touching = np.any([data["touching"] for data, _ in shots], axis=0)
        frames = [data | {"touching": touching} for data, _ in shots]
        for data, (_, words) in zip(frames, shots, strict=True):
            yield draw_contact(data, frames, s, words, over, units or {})

    return _written(problem.comm, file, drawings, rate, size)


def _shots(
    problem: ContactProblem,
    states: States,
    title: str,
    gather: Callable[[ContactProblem, str], T],
) -> list[T]:
    """Gather the data of all frames of a film, then restore the displacement. Collective.

    Args:
        problem: see `film`.
        states: see `film`.
        title: see `film`.
        gather: function of the problem, whose Functions contain a state, and of the title of the
            frame; it returns the data of the frame.
    """
    comm = problem.comm
    before = problem.u.x.array.copy()
    shots: list[T] = []
    try:
        for state in _in_turn(comm, states):
            finite = bool(np.isfinite(problem.u.x.array).all())
            message = f"the displacement of state {len(shots)} has an entry that is not finite"
            require(comm, finite, message)
            words = title_of(title, state if isinstance(state, str) else words_of(state))
            with problem.at(state if isinstance(state, State) else None) as shown:
                shots.append(gather(shown, words))
    finally:
        problem.u.x.array[:] = before
    require(comm, bool(shots), "there are no states to show")
    return shots


def _in_turn(comm: MPI.Comm, states: States) -> Iterator[State | str]:
    """Yield the states or texts of a film; raise errors on every rank. Collective."""
    iterator = iter(states.steps if isinstance(states, History) else states)
    end = object()
    while True:
        with everywhere(comm, "the states of a film"):
            item = next(iterator, end)
        same_everywhere(comm, end_of_the_states=item is end)
        if item is end:
            return
        state = item.state if isinstance(item, EvolutionStep) else item
        text = words_of(state) if isinstance(state, State) else state
        same_everywhere(comm, what_is_written=text)
        if not isinstance(state, State | str):
            raise ValueError(f"a film has states, steps or texts, got {state!r}")
        yield state


def _written(
    comm: MPI.Comm,
    file: str | os.PathLike[str],
    drawings: Callable[[], Iterable[Drawing]],
    rate: float,
    size: int,
) -> Path:
    """Draw frames and write them as a film on rank 0; return its path. Collective."""
    path = Path(file)
    is_gif = path.suffix == ".gif"
    timing = dict(duration=1000 / rate, loop=0) if is_gif else dict(fps=rate, macro_block_size=2)

    def write() -> None:
        from imageio import v2 as imageio

        pixels = [_pixels(drawing, size) for drawing in drawings()]
        with part_of(path) as part:
            imageio.mimwrite(part, pixels, **timing)

    on_root(comm, write)
    return path


def _pixels(drawing: Drawing, size: int) -> npt.NDArray[np.uint8]:
    """Return a figure or plotter as an RGB image, shape (height, width, 3).

    Height and width are even numbers of at most ``size`` pixels.
    """
    if hasattr(drawing, "canvas"):
        drawing.set_dpi(size / max(drawing.get_size_inches()))
        drawing.canvas.draw()
        image = np.asarray(drawing.canvas.buffer_rgba())
    else:
        from PIL import Image

        scale = int(np.ceil(size / _WIDTH))
        found = Image.fromarray(drawing.screenshot(return_img=True, scale=scale))
        found.thumbnail((size, size))
        image = np.asarray(found)
        drawing.close()
    height, width = (2 * (n // 2) for n in image.shape[:2])
    return np.ascontiguousarray(image[:height, :width, :3])
