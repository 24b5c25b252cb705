# SPDX-License-Identifier: LGPL-3.0-or-later
"""A vibration for ParaView: one period of it, as an animation."""

from __future__ import annotations

import os
from pathlib import Path

from mpi4py import MPI

import numpy as np

from dolfinx import fem

from dolfinx_contact._errors import require
from dolfinx_contact.output.disk import aside
from dolfinx_contact.output.folder import output_folder
from dolfinx_contact.output.writers import Format, checked_format, see_room, series

__all__ = ["write_vibration"]


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
    require(comm, frames > 0, f"the number of frames must be 1 or more, got {frames}")
    mode = real.x.array + 1j * imaginary.x.array
    largest = comm.allreduce(float(np.abs(mode).max(initial=0.0)), op=MPI.MAX)
    require(comm, largest > 0, "nothing moves in this vibration")
    shown = fem.Function(V, name="displacement")
    kind, path = checked_format(comm, format), output_folder(comm, folder)
    with aside(comm, path, "write_vibration") as part:
        if kind == "vtx":
            see_room(comm, path / name, [[shown]], frames)
        each = series(comm, part / name, [shown], kind, single=False)
        for frame in range(frames):
            phase = np.exp(2j * np.pi * frame / frames)
            shown.x.array[:] = size * (mode * phase).real / largest
            each.write(frame / frames)
        each.close()
    return path / each.file.name
