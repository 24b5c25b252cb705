# SPDX-License-Identifier: LGPL-3.0-or-later
"""The record of one contact problem in a folder: a locked journal and files of arrays.

A point or state is on the disk before the next one is computed: first its files of arrays, then
the line of the journal that names them. This line is the commit: a run may be killed at any moment,
and is resumed from the complete lines on any number of ranks. Every point has files of its own,
because a process that is killed while it writes to an HDF5 file may damage what the file contained.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeAlias, TypeVar

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._files import os_error
from dolfinx_contact._mpi import everywhere, on_root, require, same_everywhere
from dolfinx_contact.continuation.observer import Observer
from dolfinx_contact.io.files import agreed_path, output_folder
from dolfinx_contact.io.outside import Outside
from dolfinx_contact.records.arrays import Arrays, DamagedFile, load, save
from dolfinx_contact.records.fields import FieldArrays
from dolfinx_contact.records.journal import (
    FORMAT,
    AnyJournal,
    checkpoint_file,
    outer_surface_file,
    reread,
    surface_file,
)
from dolfinx_contact.records.journal_file import JournalFile, run_name
from dolfinx_contact.records.manifest import difference
from dolfinx_contact.records.points import places
from dolfinx_contact.results.outer_surface import flat

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = ["Record", "Resume"]

logger = logging.getLogger(__name__)

#: Whether a record is continued: it must exist, must not exist, or may exist.
Resume: TypeAlias = "bool | Literal['if_exists']"
J = TypeVar("J", bound=AnyJournal)
T = TypeVar("T")
R = TypeVar("R", bound="Record[Any]")


class Record(Observer, Generic[J]):
    """Folder with the journal and the array files of one contact problem. Collective.

    An open record holds a file lock, so that no other process can write to it. If ``mpirun`` is
    killed and some of its ranks survive, they keep the lock until they are terminated.

    Args:
        folder: folder of the record, created if necessary.
        problem: contact problem that is recorded.
        kind: class of the journal.
        surface_displacement: whether the displacement of the outer surface is stored at every
            point. Ignored if a record is resumed, which keeps its original setting.
        resume: True to continue an existing record, False to begin a new one, ``"if_exists"`` to
            continue a record if it exists and begin one otherwise.

    Attributes:
        journal: content of the journal, on every rank.

    Raises:
        OSError: on every rank, if the folder cannot be written to, another run records there, or
            the existence of a record contradicts ``resume``.
        ValueError: on every rank, if the journal is damaged or of another kind.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        problem: ContactProblem,
        kind: type[J],
        *,
        surface_displacement: bool,
        resume: Resume,
    ):
        self.problem = problem
        self.comm = problem.comm
        valid = resume in (False, True, "if_exists")
        require(self.comm, valid, f"resume must be True, False or 'if_exists', got {resume!r}")
        self._shows = bool(surface_displacement)
        same_everywhere(self.comm, surface_displacement=self._shows, resume=str(resume))
        agreed = agreed_path(self.comm, folder, "folder")
        self.folder = agreed if resume is True else output_folder(self.comm, agreed)
        self._file: JournalFile[J] | None = None  # on rank 0
        run = run_name(self.comm)

        def opened() -> J:
            self._file = JournalFile(self.folder, kind, resume=resume, run=run)
            return self._file.journal

        self.journal: J = on_root(self.comm, opened)
        try:
            with everywhere(self.comm, "the fields of a record"):
                self._fields = FieldArrays(problem)
                self._outside = Outside(problem)
        except Exception:
            self.close()
            raise

    # -- sessions ----------------------------------------------------------------------------------

    def _require_same(
        self, recorded: Mapping[str, Any], now: Mapping[str, Any], at: str = ""
    ) -> None:
        """Raise ``ValueError`` if the problem differs from the recorded problem. Collective.

        Args:
            recorded: recorded sections of the manifest, by name.
            now: present sections of the manifest, by name.
            at: time or place of the comparison for the message, such as " at the time 1".

        Raises:
            ValueError: on every rank, with the first item that differs.
        """
        items = (difference(recorded[section], now[section]) for section in now)
        item = next((words for words in items if words), "")
        message = f"{self.folder} has the record of another problem; differs{at}: {item}"
        require(self.comm, not item, message)

    def _begin_session(self, manifest: Mapping[str, Any], **more: Any) -> None:
        """Write the header, if there is none, and the line of a session. Collective.

        Args:
            manifest: sections of the manifest (`manifest_of`).
            more: further items of the header, by name.

        Raises:
            ValueError: on every rank, if a recorded outer surface is missing or was exchanged.
        """
        from dolfinx_contact import __version__

        def prepare() -> None:
            self.journal.check_surfaces()
            if self._file is not None:
                self._file.drop_torn_line(self.journal.length)

        on_root(self.comm, prepare)
        if not self.journal.header:
            new = {"of": self.journal.kind, "format": FORMAT, "package": __version__}
            new |= {"points": places(self.problem), "surface_displacement": self._shows}
            self._append({"type": "header", **new, **more, **manifest})
        header = self.journal.header
        if header["package"] != __version__ and self.comm.rank == 0:
            logger.warning("recorded by %s, resumed by %s", header["package"], __version__)
        self._shows = header["surface_displacement"]
        session = {"time": time.time(), "ranks": self.comm.size, "package": __version__}
        if not self.journal.sessions:
            surface = self._outside.surface()
            arrays = {} if surface is None else flat(vars(surface))
            session["outer_surface"] = self._save(outer_surface_file(self.folder), arrays)
        self._append({"type": "session", **session})

    # -- writing -----------------------------------------------------------------------------------

    def _write_fields(
        self, name: str, vectors: Mapping[str, PETSc.Vec], arrays: Arrays | None = None
    ) -> dict[str, str]:
        """Write the checkpoint of a point, and return its keys in the journal. Collective.

        Args:
            name: name of the point.
            vectors: vectors of unknowns by name; the last stays in the Functions of the problem.
            arrays: further arrays, on rank 0.

        Raises:
            OSError: on every rank, with the path, if it cannot be written; nothing of it remains.
        """
        gathered = self._fields.gathered(vectors) | (arrays or {})
        return {"checkpoint": name, "sum": self._save(checkpoint_file(self.folder, name), gathered)}

    def _write_surface(self, name: str, law: ContactProblem) -> dict[str, str]:
        """Write the present outer surface, and return its keys in the journal. Collective.

        Args:
            name: name of the point.
            law: problem under whose law the tables of contact points are evaluated.

        Returns:
            Keys of the line of the point; empty if the record has no surfaces.

        Raises:
            OSError: on every rank, with the path, if it cannot be written; nothing of it remains.
        """
        if not self._shows:
            return {}
        state = self._outside.state(law)
        arrays: Arrays = {}
        if state is not None:  # double precision where values are differences of coordinates
            single = {name: getattr(state, name).astype(np.float32) for name in ("u", "strain")}
            arrays = flat(vars(state) | single)
        return {"surface": name, "surface_sum": self._save(surface_file(self.folder, name), arrays)}

    def _save(self, file: Path, arrays: Arrays) -> str:
        """Write the arrays of rank 0 to a file, and return its fingerprint. Collective."""

        def write() -> str:
            try:
                file.parent.mkdir(exist_ok=True)
            except OSError as error:
                raise os_error(error, file.parent) from None
            return save(file, arrays)

        return on_root(self.comm, write)

    def _append(self, entry: Mapping[str, Any]) -> None:
        """Write a line of the journal, and add it to the journal in memory. Collective.

        Raises:
            OSError: on every rank, if the line cannot be written; the files that it names are
                removed.
            ValueError: on every rank, if the record is closed.
        """
        self._require_open()
        entry = {**entry, "line": self.journal.lines + 1}

        def write() -> None:
            try:
                if self._file is not None:
                    self._file.append(entry)
            except OSError:
                for key, file_of in (("checkpoint", checkpoint_file), ("surface", surface_file)):
                    if key in entry:
                        file_of(self.folder, entry[key]).unlink(missing_ok=True)
                raise

        on_root(self.comm, write)
        self.journal.take(reread(entry))

    def _require_open(self) -> None:
        """Raise ``ValueError`` on every rank if the journal is closed. Collective."""
        closed = self.comm.rank == 0 and self._file is None
        message = f"the record in {self.folder} is closed: open it with resume=True"
        require(self.comm, not closed, message)

    # -- reading -----------------------------------------------------------------------------------

    def _read_fields(self, name: str, fingerprint: str, vectors: Mapping[str, PETSc.Vec]) -> Arrays:
        """Fill vectors from a checkpoint, and return its arrays at points. Collective.

        Raises:
            DamagedFile: on every rank, if the checkpoint is damaged or missing.
        """
        arrays: Arrays = {}
        file = checkpoint_file(self.folder, name)
        on_root(self.comm, lambda: arrays.update(load(file, fingerprint)))
        self._fields.fill(vectors, arrays)
        at_points = {k: v for k, v in arrays.items() if k.startswith(("statuses.", "memory."))}
        return self.comm.bcast(at_points)

    def _last_undamaged(self, indices: Sequence[int], read: Callable[[int], T]) -> T:
        """Return the first state whose checkpoint is undamaged. Collective.

        Damaged checkpoints are skipped, with a warning in the log.

        Args:
            indices: indices of the states, from the last one back.
            read: function that reads a state.

        Raises:
            ValueError: on every rank, if all checkpoints are damaged.
        """
        for index in indices[:-1]:
            try:
                return read(index)
            except DamagedFile as error:
                if self.comm.rank == 0:
                    logger.warning("%s; going back to one before", error)
        return read(indices[-1])

    def close(self) -> None:
        """Close the journal; the record can then be resumed."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def __enter__(self: R) -> R:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
