# SPDX-License-Identifier: LGPL-3.0-or-later
"""The script that shows results in ParaView."""

from __future__ import annotations

import logging
from pathlib import Path

from mpi4py import MPI

from dolfinx_contact._mpi import on_root
from dolfinx_contact.io.disk import put

__all__ = ["SCRIPT_NAME", "write_script"]

logger = logging.getLogger(__name__)

SCRIPT_NAME = "paraview.py"


def write_script(comm: MPI.Comm, part: Path, folder: Path) -> None:
    """Write ``paraview.py``, which shows the results in its folder. Collective.

    Another file of that name is kept, with a warning.

    Args:
        comm: communicator.
        part: folder in which it is written.
        folder: final folder, stored in the script because ParaView does not always pass the path of
            a script. The folder may be moved.
    """

    def write() -> None:
        text = Path(__file__).with_name("in_paraview.py").read_text()
        if _is_foreign(folder / SCRIPT_NAME, text):
            message = "%s is not one of this package, and is left unchanged: no script for ParaView"
            logger.warning(message, folder / SCRIPT_NAME)
            return
        known = text.replace('WRITTEN_TO = ""', f"WRITTEN_TO = {str(folder.resolve())!r}")
        put(part / SCRIPT_NAME, known.encode())

    on_root(comm, write)


def _is_foreign(file: Path, text: str) -> bool:
    """Whether there is a file that does not begin with the first two lines of ``text``."""
    head = "".join(text.splitlines(keepends=True)[:2]).encode()
    return file.is_file() and not file.read_bytes().startswith(head)
