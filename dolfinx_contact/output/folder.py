# SPDX-License-Identifier: LGPL-3.0-or-later
"""The output folder and the summary in it."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import dolfinx

__all__ = ["output_folder", "write_summary"]

_STARTED = time.perf_counter()


def output_folder(comm: MPI.Comm, path: str | os.PathLike[str]) -> Path:
    """Make the folder ``path`` if need be and see that it can be written to. Collective.

    Raises:
        OSError: on every rank, if the folder cannot be made or written to.
    """
    folder = Path(path)
    problem = None
    if comm.rank == 0:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            probe = folder / f".probe-{os.getpid()}"
            probe.touch()
            probe.unlink()
        except OSError as error:
            problem = f"cannot write to the output folder {folder}: {error.strerror}"
    problem = comm.bcast(problem)
    if problem is not None:
        raise OSError(problem)
    return folder


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"cannot write {type(value).__name__} to a summary")


def write_summary(comm: MPI.Comm, folder: Path, scalars: Mapping[str, Any]) -> dict[str, Any]:
    """Write ``folder/summary.json``: ``scalars`` with ranks, versions and the time since import.

    Returns:
        What was written, on every rank.
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
    if comm.rank == 0:
        partial = folder / "summary.json.part"
        partial.write_text(json.dumps(summary, indent=2, default=_plain) + "\n")
        partial.replace(folder / "summary.json")
    comm.barrier()
    return summary
