# SPDX-License-Identifier: LGPL-3.0-or-later
"""A launcher of one MPI starts copies of a program that has another: N runs of one rank each.

Wheels of DOLFINx bring an MPI of their own, whose ``mpiexec`` is beside the interpreter. The
``mpirun`` of the machine knows nothing of it, and every copy would take itself for the whole run.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from mpi4py import MPI

__all__ = ["refuse_serial_copies"]

#: Variables in which launchers tell a process of how many it is: Open MPI; MPICH and Intel MPI.
_SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")


def refuse_serial_copies(environ: Mapping[str, str] = os.environ) -> None:
    """Raise ``RuntimeError`` in every copy of a run whose launcher is that of another MPI.

    For the head of the package: MPI has been initialised, and nothing has been computed.

    Args:
        environ: of this process.
    """
    if MPI.COMM_WORLD.size > 1:
        return
    started = [f"{name}={environ[name]}" for name in _SIZES if _number(environ.get(name)) > 1]
    # PMIx alone, as of Slurm, gives every process its number, but not how many there are.
    if not started and _number(environ.get("PMIX_RANK")) > 0:
        started = [f"PMIX_RANK={environ['PMIX_RANK']}"]
    if not started:
        return
    library = MPI.Get_library_version().strip("\0 \n").splitlines()[0].replace("\t", " ")
    beside = Path(sys.executable).with_name("mpiexec")
    launcher = str(beside) if beside.exists() else "the mpirun or mpiexec of that MPI"
    raise RuntimeError(
        f"this process is one of several ({started[0]}), but mpi4py sees one rank: the launcher is "
        f"not of the MPI that mpi4py has ({library}), and every rank would compute the whole by "
        f"itself. Start the ranks with {launcher}"
    )


def _number(text: str | None) -> int:
    return int(text) if text and text.isdecimal() else 0
