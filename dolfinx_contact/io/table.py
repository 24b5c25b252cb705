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

import numpy as np
import numpy.typing as npt

from dolfinx_contact._errors import on_root
from dolfinx_contact._files import os_error
from dolfinx_contact.io.disk import write_text
from dolfinx_contact.results.tables import ContactTable

__all__ = ["ADHESION", "COLUMNS", "GrowingTable", "write_contact_table", "write_rows"]

COLUMNS = [
    *("surface", "x", "y", "z", "un", "ut", "ut_x", "ut_y", "ut_z", "rn", "rt", "rt_x", "rt_y"),
    *("rt_z", "pressure", "shear", "status", "support_x", "support_y", "support_z"),
]
#: Columns that follow where a law has adhesion, with its variables between them and the bond.
ADHESION = ["rn_adh", "rt_adh", "bond"]


def _padded(vectors: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Three components, the third 0 in 2D."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def _written(numbers: Iterable[float]) -> list[str]:
    return [repr(float(v)) for v in numbers]


def write_contact_table(
    comm: MPI.Comm, folder: str | os.PathLike[str], tables: Iterable[ContactTable]
) -> None:
    """Write ``folder/contact.csv``, a row a contact point, surface by surface. Collective.

    Where a law has adhesion `ADHESION` follows: its part of ``rn`` and ``rt``, its variables (the
    intensity ``beta``), and the letter of the bond; where a law depends on it ``slid``, the
    distance slipped. Surfaces that have none have blanks there.

    Forces, pressure and shear are those of contact; what Dirichlet data do to the body at a contact
    node is in the last columns.

    Raises:
        OSError: on every rank, with the path, if it cannot be written; it is then as it was.
    """
    known = list(tables)
    adhesive = any(t.bond is not None for t in known)
    names = list(dict.fromkeys(name for t in known for name in t.internal))
    slides = any(t.slid is not None for t in known)

    def text() -> str:
        more = [*ADHESION[:-1], *names, *ADHESION[-1:]] if adhesive else []
        more += ["slid"] if slides else []
        lines = [",".join([*COLUMNS, *more])]
        for t in known:
            bonds = _bonds(t, names) if adhesive else [[]] * len(t.letters)
            columns = _columns(t)
            for i in range(len(t.letters)):
                row = [*(columns[name][i] for name in COLUMNS), *bonds[i]]
                if slides:
                    row += [""] if t.slid is None else _written(t.slid[i : i + 1])
                lines.append(",".join(row))
        return "\n".join(lines) + "\n"

    write_text(comm, Path(folder) / "contact.csv", text)


def _columns(t: ContactTable) -> dict[str, list[str]]:
    """What `COLUMNS` are, point by point."""
    vectors = {"": t.x, "ut_": t.ut, "rt_": t.rt, "support_": t.support}
    numbers: dict[str, npt.NDArray[np.float64]] = {
        f"{name}{axis}": _padded(of_points)[:, k]
        for name, of_points in vectors.items()
        for k, axis in enumerate("xyz")
    }
    numbers |= {"un": t.un, "ut": t.along(t.ut), "rn": t.rn, "rt": t.along(t.rt)}
    numbers |= {"pressure": t.pressure, "shear": t.along(t.shear)}
    words = {"surface": [t.name] * len(t.letters), "status": [str(c) for c in t.letters]}
    return words | {name: _written(values) for name, values in numbers.items()}


def _bonds(t: ContactTable, names: Sequence[str]) -> list[list[str]]:
    """The columns of adhesion, point by point; ``names`` of the variables of all tables."""
    if t.bond is None:
        return [[""] * (len(ADHESION) + len(names))] * len(t.letters)
    forces = t.rn_adh, t.along(t.rt - t.friction)
    blank = [""] * len(t.letters)
    columns = [_written(values) for values in forces]
    columns += [_written(t.internal[name]) if name in t.internal else blank for name in names]
    return [list(row) for row in zip(*columns, t.bond, strict=True)]


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
