# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables as CSV: of contact points, and of whatever a script measures."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy.typing as npt

from dolfinx_contact._errors import on_root
from dolfinx_contact._files import os_error
from dolfinx_contact.io.disk import write_text
from dolfinx_contact.results.tables import ContactTable

__all__ = ["GrowingTable", "write_contact_table", "write_rows"]


def write_contact_table(
    comm: MPI.Comm, folder: str | os.PathLike[str], tables: Iterable[ContactTable]
) -> None:
    """Write ``folder/contact.csv``, a row a contact point, surface by surface. Collective.

    The columns are those of `ContactTable.columns`. Surfaces that have none of adhesion, or no
    ``slid``, where others have, have blanks there.

    Forces, pressure and shear are those of contact; what Dirichlet data do to the body at a contact
    node is in the last columns.

    Raises:
        OSError: on every rank, with the path, if it cannot be written; it is then as it was.
    """
    given = list(tables)

    def text() -> str:
        known = [t.columns() for t in given]
        names = _names(known)
        lines = [",".join(names)]
        for columns in known:
            words = [_written(columns[name]) if name in columns else None for name in names]
            count = len(columns["surface"])
            every = [[""] * count if column is None else column for column in words]
            lines += [",".join(row) for row in zip(*every, strict=True)]
        return "\n".join(lines) + "\n"

    write_text(comm, Path(folder) / "contact.csv", text)


def _names(known: Sequence[Mapping[str, npt.NDArray[Any]]]) -> list[str]:
    """Names of the columns of all tables, the bond after variables of laws, ``slid`` last."""
    names = dict.fromkeys(name for columns in known for name in columns)
    last = [name for name in ("bond", "slid") if name in names]
    return [*(name for name in names if name not in last), *last]


def _written(column: npt.NDArray[Any]) -> list[str]:
    """Numbers with all their digits; words as they are."""
    numbers = column.dtype.kind == "f"
    return [repr(float(v)) for v in column] if numbers else [str(v) for v in column]


def write_rows(
    comm: MPI.Comm, file: str | os.PathLike[str], rows: Sequence[Mapping[str, Any]]
) -> None:
    """Write rows as CSV, the keys of the first as its head; what is not in that is left out.

    Collective; the rows are those of rank 0.

    Raises:
        OSError: on every rank, with the path, if it cannot be written; it is then as it was.
        ValueError: on every rank, if there is no row.
    """

    def text() -> str:
        if not rows:
            raise ValueError(f"there are no rows for {file}")
        return _csv(list(rows[0]), rows, head=True)

    write_text(comm, Path(file), text)


class GrowingTable:
    """Rows as CSV, each on the disk before the next one is known. Collective.

    The keys of the first row are the head; what is not in that is left out. A file of before is
    replaced by the first row.

    Args:
        comm: communicator.
        file: the table.
    """

    def __init__(self, comm: MPI.Comm, file: str | os.PathLike[str]):
        self._comm = comm
        self._file = Path(file)
        self._names: list[str] = []

    def add(self, row: Mapping[str, Any]) -> None:
        """Write a row, that of rank 0.

        Raises:
            OSError: on every rank, with the path, if it cannot be written.
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
