# SPDX-License-Identifier: LGPL-3.0-or-later
"""The script beside results that shows them in ParaView."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from dolfinx_contact._errors import on_root
from dolfinx_contact.output.disk import put

__all__ = ["SCRIPT_NAME", "write_script"]

SCRIPT_NAME = "paraview.py"


def write_script(comm: MPI.Comm, part: Path, folder: Path) -> None:
    """Write ``paraview.py``, which shows whatever results are in its folder. Collective.

    Args:
        comm: communicator.
        part: where it is written.
        folder: where it will be. It may be moved; ParaView does not always say where a script is.
    """

    def write() -> None:
        text = Path(__file__).with_name("in_paraview.py").read_text()
        known = text.replace('WRITTEN_TO = ""', f"WRITTEN_TO = {str(folder.resolve())!r}")
        put(part / SCRIPT_NAME, known.encode())

    on_root(comm, write)
