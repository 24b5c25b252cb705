# SPDX-License-Identifier: LGPL-3.0-or-later
"""Output folders and atomic writing of files.

A file is written under a hidden name in the same folder and renamed after it has been flushed to
disk. If writing fails, an earlier file of the same name is unchanged.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import dolfinx

from dolfinx_contact._files import part_of
from dolfinx_contact._mpi import everywhere, on_root, same_everywhere

__all__ = ["agreed_path", "output_folder", "write_summary", "write_text"]

_STARTED = time.perf_counter()


def agreed_path(comm: MPI.Comm, path: str | os.PathLike[str], what: str) -> Path:
    """Return a path that is required to be the same on all ranks. Collective.

    Args:
        comm: communicator.
        path: path given by the user.
        what: name of the argument, for the message.

    Raises:
        TypeError: on every rank, if it is not a path.
        ValueError: on every rank, if the path differs between ranks.
    """
    with everywhere(comm, what):
        found = Path(path)
    same_everywhere(comm, **{what: str(found)})
    return found


def output_folder(comm: MPI.Comm, path: str | os.PathLike[str]) -> Path:
    """Create the folder ``path`` if necessary and test that it is writable. Collective.

    Raises:
        OSError: on every rank, if the folder cannot be created or written to.
        ValueError: on every rank, if the path differs between ranks.
    """
    folder = agreed_path(comm, path, "folder")

    def make() -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            reason = f"cannot write to the output folder: {error.strerror}"
            raise OSError(error.errno, reason, str(folder)) from None

    on_root(comm, make)
    return folder


def write_text(comm: MPI.Comm, file: Path, text: Callable[[], str]) -> None:
    """Write the text returned by a function, which is called on rank 0, to a file. Collective.

    Raises:
        OSError: on every rank, if the file cannot be written; an earlier file remains.
    """

    def write() -> None:
        content = text()
        with part_of(file) as part:
            part.write_text(content)

    on_root(comm, write)


def write_summary(
    comm: MPI.Comm, folder: str | os.PathLike[str], scalars: Mapping[str, Any]
) -> dict[str, Any]:
    """Write results by name to ``folder/summary.json``. Collective.

    The number of ranks, versions of packages and the time since import are added.

    Returns:
        Content of the file, on every rank.

    Raises:
        OSError: on every rank, if the file cannot be written; an earlier file remains.
        TypeError: on every rank, if a value cannot be written as JSON.
    """
    from dolfinx_contact import __version__

    summary = {
        **scalars,
        "ranks": comm.size,
        "versions": {
            "dolfinx": dolfinx.__version__,
            "petsc": ".".join(str(v) for v in PETSc.Sys.getVersion()),
            "dolfinx_contact": __version__,
        },
        "wall_seconds": comm.bcast(time.perf_counter() - _STARTED),
    }
    file = Path(folder) / "summary.json"
    write_text(comm, file, lambda: json.dumps(summary, indent=2, default=_plain) + "\n")
    return summary


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"cannot write {type(value).__name__} to a summary")
