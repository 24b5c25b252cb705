# SPDX-License-Identifier: LGPL-3.0-or-later
"""CSV tables of contact points, and of rows provided by a script."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

from dolfinx_contact._files import os_error
from dolfinx_contact._mpi import on_root
from dolfinx_contact.io.files import write_text
from dolfinx_contact.results.tables import ContactTable

__all__ = ["GrowingTable", "write_contact_table", "write_rows"]


def write_contact_table(
    comm: MPI.Comm, folder: str | os.PathLike[str], tables: Iterable[ContactTable]
) -> None:
    """Write ``folder/contact.csv`` with one row per contact point. Collective.

    The columns are listed in `ContactTable.columns`; columns missing for a surface are blank.
    Forces, pressure and shear are contact forces; the columns whose names begin with ``support_``
    contain the reactions of Dirichlet data at contact nodes.

    Raises:
        OSError: on every rank, if the file cannot be written; an earlier file remains.
    """
    columns = [t.columns() for t in tables]
    # columns of some laws come last
    names = dict.fromkeys(name for table in columns for name in table)
    head = sorted(names, key=lambda name: name in ("bond", "slid"))

    def text() -> str:
        rows = [
            dict(zip(table, row, strict=True))
            for table in columns
            for row in zip(*(column.tolist() for column in table.values()), strict=True)
        ]
        return _csv(head, rows, head=True)

    write_text(comm, Path(folder) / "contact.csv", text)


def write_rows(
    comm: MPI.Comm, file: str | os.PathLike[str], rows: Sequence[Mapping[str, Any]]
) -> None:
    """Write the rows of rank 0 as CSV. Collective.

    The columns are the keys of the first row; other keys are ignored.

    Raises:
        OSError: on every rank, if the file cannot be written; an earlier file remains.
        ValueError: on every rank, if ``rows`` is empty.
    """

    def text() -> str:
        if not rows:
            raise ValueError(f"there are no rows for {file}")
        return _csv(list(rows[0]), rows, head=True)

    write_text(comm, Path(file), text)


class GrowingTable:
    """CSV file whose rows are flushed to disk as soon as they are added. Collective.

    The columns are the keys of the first row; other keys are ignored. The first row replaces an
    existing file.

    Args:
        comm: communicator.
        file: path of the table.
    """

    def __init__(self, comm: MPI.Comm, file: str | os.PathLike[str]):
        self._comm = comm
        self._file = Path(file)
        self._names: list[str] = []

    def add(self, row: Mapping[str, Any]) -> None:
        """Write a row from rank 0. Collective.

        Raises:
            OSError: on every rank, if the file cannot be written.
        """
        first = not self._names
        self._names = self._names or list(row)

        def append() -> None:
            try:
                with self._file.open("a", newline="") as stream:
                    stream.write(_csv(self._names, [row]))
                    stream.flush()
                    os.fsync(stream.fileno())
            except OSError as error:
                raise os_error(error, self._file) from error

        if first:
            write_text(self._comm, self._file, lambda: _csv(self._names, [row], head=True))
        else:
            on_root(self._comm, append)


def _csv(names: Sequence[str], rows: Sequence[Mapping[str, Any]], *, head: bool = False) -> str:
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(names), extrasaction="ignore", lineterminator="\n")
    if head:
        writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()
