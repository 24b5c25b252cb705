# SPDX-License-Identifier: LGPL-3.0-or-later
"""A vibration for ParaView, or as an animated picture: one period of it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._errors import require
from dolfinx_contact.io.disk import aside
from dolfinx_contact.io.folder import agreed_path, output_folder
from dolfinx_contact.io.gathering import gather_cells
from dolfinx_contact.io.writers import Format, checked_format, see_room, series
from dolfinx_contact.plot.pictures import draw, outer_cells

__all__ = ["picture_of_vibration", "write_vibration"]


def write_vibration(
    folder: str | os.PathLike[str],
    real: fem.Function,
    imaginary: fem.Function,
    *,
    name: str = "vibration",
    size: float = 1.0,
    frames: int = 24,
    format: Format = None,
) -> Path:
    """Write u(t) = Re((real + i imaginary) e^{i t}) over one period. Collective.

    The growth is left out, so that the animation can be repeated. Its time is the part of the
    period.

    Args:
        folder: where to, made if need be.
        real: the displacement at the beginning of the period.
        imaginary: minus that a quarter of a period later.
        name: of the file, without suffix.
        size: of the largest component of the displacement in the file.
        frames: of the animation.
        format: "vtx" (``.bp``) or "vtk" (``.pvd``), by default as in `write_fields`.

    Returns:
        The name of the file, on every rank.

    Raises:
        OSError: on every rank, with the path and the reason, if it cannot be written.
        ValueError: on every rank, if there is no frame, nothing moves, or the format is not known.
    """
    V = real.function_space
    comm = V.mesh.comm
    mode = _mode(real, imaginary, size, frames)
    shown = fem.Function(V, name="displacement")
    kind = checked_format(comm, format)
    path = output_folder(comm, folder)
    with aside(comm, path, "write_vibration") as part:
        if kind == "vtx":
            see_room(comm, path / name, [[shown]], frames)
        each = series(comm, part / name, [shown], kind, single=False)
        for frame in range(frames):
            phase = np.exp(2j * np.pi * frame / frames)
            shown.x.array[:] = (mode * phase).real
            each.write(frame / frames)
        each.close()
    return path / each.file.name


def picture_of_vibration(
    file: str | os.PathLike[str],
    real: fem.Function,
    imaginary: fem.Function,
    *,
    size: float = 1.0,
    frames: int = 24,
    title: str = "Vibration",
) -> Path | None:
    """Draw what `write_vibration` writes as an animated picture, by PyVista. Collective.

    The body is seen at rest, as an outline, and moving, in the colours of how far it is away.

    Args:
        file: the picture, ``.gif``.
        real: as there.
        imaginary: as there.
        size: of the largest component of the displacement.
        frames: of the animation.
        title: above it.

    Returns:
        The file, on every rank; None where it could not be drawn, with a warning in the log.

    Raises:
        ValueError: on every rank, if there is no frame, nothing moves, or the file is no ``.gif``.
    """
    domain = real.function_space.mesh
    path = agreed_path(domain.comm, file, "file")
    require(domain.comm, path.suffix == ".gif", f"the picture must be a .gif, got {path}")
    mode = _mode(real, imaginary, size, frames)
    V = fem.functionspace(domain, ("Lagrange", 1))
    tdim = domain.topology.dim
    at_nodes = fem.Function(real.function_space)
    at_vertices = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (tdim,))))
    values = {}
    for name, part in (("real", mode.real), ("imaginary", mode.imag)):
        at_nodes.x.array[:] = part
        at_vertices.interpolate(at_nodes)
        values[name] = np.pad(at_vertices.x.array.reshape(-1, tdim), ((0, 0), (0, 3 - tdim)))
    data: dict[str, Any] = gather_cells(domain.comm, V, outer_cells(V), values)
    if domain.comm.rank == 0:
        data |= {"title": title, "frames": frames}
    return draw(domain.comm, "vibration", data, path)


def _mode(
    real: fem.Function, imaginary: fem.Function, size: float, frames: int
) -> npt.NDArray[np.complex128]:
    """The mode, its largest component of a given size. Collective."""
    comm = real.function_space.mesh.comm
    require(comm, frames > 0, f"the number of frames must be 1 or more, got {frames}")
    mode = real.x.array + 1j * imaginary.x.array
    largest = comm.allreduce(float(np.abs(mode).max(initial=0.0)), op=MPI.MAX)
    require(comm, largest > 0, "nothing moves in this vibration")
    return np.asarray(size * mode / largest)
