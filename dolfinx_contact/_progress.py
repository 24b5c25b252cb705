# SPDX-License-Identifier: LGPL-3.0-or-later
"""Progress display on rank 0: updated in place on a terminal, otherwise occasional lines.

The functions do not communicate and have no effect on other ranks.
"""

from __future__ import annotations

import shutil
import sys
import time
from typing import TextIO

from mpi4py import MPI

__all__ = ["PROGRESS", "Progress"]

#: Values of ``progress=``; None shows the progress of long computations.
PROGRESS = (True, False, None)

_PATIENCE = 3.0  # seconds before progress is shown automatically
_SECONDS = 10.0  # seconds between lines without a terminal


class Progress:
    """Progress line of a long computation.

    Args:
        comm: communicator; only rank 0 writes.
        wanted: whether progress is shown; default: only after the first few seconds.
        stream: output stream; default: standard error.
    """

    def __init__(self, comm: MPI.Comm, wanted: bool | None = None, *, stream: TextIO | None = None):
        self._stream = (stream or sys.stderr) if comm.rank == 0 else None
        self._live = self._stream is not None and self._stream.isatty()
        self._start = time.monotonic()
        self._silent = wanted is False or comm.rank > 0
        self._after = 0.0 if wanted else _PATIENCE
        self._next = 0.0
        self._open = False
        self._shown = False

    @property
    def seconds(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self._start

    @property
    def due(self) -> bool:
        """Whether the progress display should be updated now."""
        return not self._silent and time.monotonic() - self._start >= self._after

    def update(self, text: str) -> None:
        """Update the progress line on a terminal; otherwise write a new line now and then."""
        self._shown = True
        if self._live:
            # A wrapped line could not be erased.
            self._put(text[: shutil.get_terminal_size().columns - 1], stay=True)
        elif time.monotonic() >= self._next:
            self._put(text)
            self._next = time.monotonic() + _SECONDS

    def write(self, text: str) -> None:
        """Write a permanent line to the progress display."""
        self._shown = True
        self._put(text)

    def clear(self) -> None:
        """Erase the line on a terminal, so that other output can be written."""
        if self._open and self._stream is not None:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
            self._open = False

    def close(self, text: str = "") -> None:
        """Erase the progress line; if progress was shown, write ``text`` as a last line."""
        self.clear()
        if self._shown and text:
            self._put(text)
        self._shown = False

    def _put(self, text: str, *, stay: bool = False) -> None:
        if self._stream is None:
            return
        erase = "\r\x1b[K" if self._open else ""
        self._stream.write(erase + text + ("" if stay else "\n"))
        self._stream.flush()
        self._open = stay
