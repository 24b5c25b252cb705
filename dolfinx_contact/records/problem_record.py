# SPDX-License-Identifier: LGPL-3.0-or-later
"""What records of one contact problem in a folder share: the journal, its lock, and checkpoints."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeAlias, TypeVar

from petsc4py import PETSc

from dolfinx_contact._errors import everywhere, on_root, require, same_everywhere
from dolfinx_contact._files import os_error
from dolfinx_contact.continuation.observer import Observer
from dolfinx_contact.io.folder import agreed_path, output_folder
from dolfinx_contact.io.outside import Outside
from dolfinx_contact.records.arrays import Arrays, DamagedFile, load, save
from dolfinx_contact.records.fields import FieldArrays
from dolfinx_contact.records.lines import (
    FORMAT,
    JournalFile,
    Lines,
    checkpoint_file,
    has_journal,
    outer_surface_file,
    surface_file,
)
from dolfinx_contact.records.lock import processes
from dolfinx_contact.records.manifest import difference
from dolfinx_contact.records.points import places

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = ["ProblemRecord", "Resume"]

logger = logging.getLogger(__name__)

#: Whether a record is continued: it must exist, must not exist, or may exist.
Resume: TypeAlias = "bool | Literal['if_exists']"
J = TypeVar("J", bound=Lines)
T = TypeVar("T")
R = TypeVar("R", bound="ProblemRecord[Any]")


class ProblemRecord(Observer, Generic[J]):
    """A folder with a journal, locked, and checkpoints of one contact problem. Collective.

    While it is open no other process can record there; ranks that outlive a killed ``mpirun`` hold
    it until they are ended.

    Args:
        folder: of the record, made if need be.
        problem: what it is of.
        kind: of the journal.
        surface_displacement: whether that of the outer surface is kept at every point; not used
            where a record is resumed, which continues as it began.
        resume: True to continue a record that exists, False to begin one where there is none,
            "if_exists" for either.

    Attributes:
        journal: what has been recorded, on every rank.

    Raises:
        OSError: on every rank, if the folder cannot be written to, another run records there,
            there is a record and it is not to be resumed, or the other way round.
        ValueError: on every rank, if the journal is damaged or one of something else.
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
        known = resume in (False, True, "if_exists")
        require(self.comm, known, f"resume must be True, False or 'if_exists', got {resume!r}")
        same_everywhere(
            self.comm, surface_displacement=bool(surface_displacement), resume=str(resume)
        )
        agreed = agreed_path(self.comm, folder, "folder")
        self.folder = agreed if resume is True else output_folder(self.comm, agreed)
        self._file: JournalFile[J] | None = None
        self._shows = bool(surface_displacement)
        holders = processes(self.comm)

        def opened() -> J:
            new = not (has_journal(self.folder) if resume == "if_exists" else resume)
            self._file = JournalFile(self.folder, kind, new=new, holders=holders)
            return self._file.journal

        self.journal: J = on_root(self.comm, opened)
        try:
            with everywhere(self.comm, "the fields of a record"):
                self._fields = FieldArrays(problem)
                self._outside = Outside(problem)
            self._law = problem  # whose law the tables of contact points have
        except Exception:
            self.close()
            raise

    def _require_same(
        self, recorded: Mapping[str, Any], now: Mapping[str, Any], at: str = ""
    ) -> None:
        """Refuse another problem than the recorded one. Collective.

        Args:
            recorded: sections of the manifest, by name, as recorded.
            now: the same sections as they are now.
            at: place of the values along the run, such as " at the time 1".

        Raises:
            ValueError: on every rank, with the first item that differs.
        """
        items = (difference(recorded[section], now[section]) for section in now)
        item = next((words for words in items if words), "")
        message = f"{self.folder} has the record of another problem; differs{at}: {item}"
        require(self.comm, not item, message)

    def _require_task(self, what: str, recorded: Mapping[str, Any], now: Mapping[str, Any]) -> None:
        """Refuse to continue a branch or run with another task than the recorded one. Collective.

        Args:
            what: the branch or run, for the message.
            recorded: the recorded task.
            now: items of the task as they are now.
        """
        for name, value in now.items():
            message = f"{what} differs: {name} ({recorded[name]} recorded, {value} now)"
            require(self.comm, recorded[name] == value, message)

    def _write_fields(
        self, name: str, vectors: Mapping[str, PETSc.Vec], arrays: Arrays | None = None
    ) -> str:
        """Write the checkpoint of a point, and return its fingerprint. Collective.

        Args:
            name: name of the point.
            vectors: vectors of unknowns by name; the last stays in the Functions of the problem.
            arrays: further arrays, on rank 0.

        Raises:
            OSError: on every rank, with the path, if it cannot be written; nothing is left then.
        """
        found = self._fields.gathered(vectors) | (arrays or {})
        return on_root(self.comm, lambda: self._save(checkpoint_file(self.folder, name), found))

    def _read_fields(self, name: str, fingerprint: str, vectors: Mapping[str, PETSc.Vec]) -> Arrays:
        """Fill vectors from a checkpoint, and return its arrays at points. Collective.

        Raises:
            DamagedFile: on every rank, if the checkpoint is damaged or missing.
        """
        found: Arrays = {}
        file = checkpoint_file(self.folder, name)
        on_root(self.comm, lambda: found.update(load(file, fingerprint)))
        self._fields.fill(vectors, found)
        at_points = {k: v for k, v in found.items() if k.startswith(("statuses.", "memory."))}
        return self.comm.bcast(at_points)

    def _write_surface(self, name: str) -> str:
        """Write the outer surface at the present displacement; its fingerprint. Collective.

        Raises:
            OSError: on every rank, with the path, if it cannot be written; nothing is left then.
        """
        state = self._outside.state(self._law)
        arrays = {} if state is None else state.arrays()
        return on_root(self.comm, lambda: self._save(surface_file(self.folder, name), arrays))

    @staticmethod
    def _save(file: Path, arrays: Arrays) -> str:
        try:
            file.parent.mkdir(exist_ok=True)
        except OSError as error:
            raise os_error(error, file.parent) from None
        return save(file, arrays)

    def _remove(self, entry: Mapping[str, Any]) -> None:
        """Remove the files of an entry that could not be written. Not collective."""
        if self.comm.rank == 0 and "checkpoint" in entry:
            checkpoint_file(self.folder, entry["checkpoint"]).unlink(missing_ok=True)
        if self.comm.rank == 0 and "surface" in entry:
            surface_file(self.folder, entry["surface"]).unlink(missing_ok=True)

    def _begin(self, manifest: Mapping[str, Any], **more: Any) -> None:
        """Write the header, if there is none, and begin a session. Collective.

        Args:
            manifest: sections of the manifest (`manifest_of`).
            more: further items of the header, by name.
        """
        from dolfinx_contact import __version__

        recorded = self.journal.header
        if recorded and recorded["package"] != __version__ and self.comm.rank == 0:
            logger.warning("recorded by %s, resumed by %s", recorded["package"], __version__)
        on_root(self.comm, self.journal.check_surfaces)
        on_root(self.comm, lambda: self._file.drop_torn_line() if self._file else None)
        if not recorded:
            header = {"package": __version__, "of": self.journal.kind, **more, **manifest}
            header["points"] = places(self.problem)
            header["surface_displacement"] = self._shows
            self._append({"type": "header", "format": FORMAT, **header})
            self.journal.header = header
        self._shows = self.journal.header["surface_displacement"]
        session = {"time": time.time(), "ranks": self.comm.size, "package": __version__}
        if not self.journal.sessions:
            surface = self._outside.surface()
            arrays = {} if surface is None else surface.arrays()
            file = outer_surface_file(self.folder)
            session["outer_surface"] = on_root(self.comm, lambda: self._save(file, arrays))
        self._append({"type": "session", **session})
        self.journal.sessions.append(session)

    def _append(self, entry: Mapping[str, Any]) -> None:
        """Write a line of the journal. Collective.

        Raises:
            OSError: on every rank, if the line cannot be written; the files that it names are
                removed.
        """
        self._require_open()
        try:
            on_root(self.comm, lambda: self._file.append(entry) if self._file else None)
        except OSError:
            self._remove(entry)
            raise

    def _require_open(self) -> None:
        """Raise ``ValueError`` on every rank if the journal is closed. Collective."""
        closed = self.comm.rank == 0 and self._file is None
        message = f"the record in {self.folder} is closed: open it with resume=True"
        require(self.comm, not closed, message)

    def _last_whole(self, indices: Sequence[int], read: Callable[[int], T]) -> T:
        """The first of some states that can be read. Collective.

        A damaged checkpoint is passed over, with a warning in the log.

        Args:
            indices: of the states, from the last one back.
            read: reads one.

        Raises:
            ValueError: on every rank, if all are damaged, or one is that of another problem.
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
