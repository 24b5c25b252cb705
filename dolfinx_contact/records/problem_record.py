# SPDX-License-Identifier: LGPL-3.0-or-later
"""What records of one contact problem in a folder share: the journal, its lock, and checkpoints."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from dolfinx_contact._errors import on_root, require, same_everywhere
from dolfinx_contact.continuation.observer import Observer
from dolfinx_contact.io.folder import agreed_path, output_folder
from dolfinx_contact.records.checkpoints import Checkpoints, DamagedCheckpoint
from dolfinx_contact.records.lines import FORMAT, JournalFile, Lines
from dolfinx_contact.records.lock import processes
from dolfinx_contact.records.manifest import difference
from dolfinx_contact.records.points import places
from dolfinx_contact.records.surfaces import SurfaceFiles

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = ["ProblemRecord"]

logger = logging.getLogger(__name__)

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
        resume: whether to continue a record that exists. Else there must be none.

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
        resume: bool,
    ):
        self.problem = problem
        self.comm = problem.comm
        same_everywhere(self.comm, surface_displacement=bool(surface_displacement))
        known = agreed_path(self.comm, folder, "folder")
        self.folder = known if resume else output_folder(self.comm, known)
        self._file: JournalFile[J] | None = None
        self._made: Checkpoints | None = None
        self._made_surfaces: SurfaceFiles | None = None
        self._shows = bool(surface_displacement)
        holders = processes(self.comm)

        def opened() -> J:
            self._file = JournalFile(self.folder, kind, new=not resume, holders=holders)
            return self._file.journal

        self.journal: J = on_root(self.comm, opened)

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

    @property
    def _checkpoints(self) -> Checkpoints:
        """What is kept of states. Collective."""
        if self._made is None:
            self._made = Checkpoints(self.folder / "checkpoints", self.problem)
        return self._made

    @property
    def _surfaces(self) -> SurfaceFiles:
        """What is kept of the outer surface. Collective."""
        if self._made_surfaces is None:
            self._made_surfaces = SurfaceFiles(self.folder, self.problem)
        return self._made_surfaces

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
        on_root(self.comm, lambda: self._file.drop_torn_line() if self._file else None)
        if not recorded:
            header = {"package": __version__, "of": self.journal.kind, **more, **manifest}
            header["points"] = places(self.problem)
            header["surface_displacement"] = self._shows
            self._append({"type": "header", "format": FORMAT, **header})
            self.journal.header = header
        if not self.journal.sessions:
            self._surfaces.write_surface()
        self._shows = self.journal.header["surface_displacement"]
        session = {"time": time.time(), "ranks": self.comm.size, "package": __version__}
        session["checkpoints"] = self._checkpoints.format
        self._append({"type": "session", **session})
        self.journal.sessions.append(session)

    def _append(self, entry: Mapping[str, Any]) -> None:
        """Write a line of the journal. Collective.

        What it names is removed if it cannot be written: a checkpoint, and where the outer surface
        is, which is written here.
        """
        self._require_open()
        try:
            if "surface" in entry:
                self._surfaces.write_state(entry["surface"])
            on_root(self.comm, lambda: self._file.append(entry) if self._file else None)
        except OSError:
            if "checkpoint" in entry:
                self._checkpoints.remove(entry["checkpoint"])
            if "surface" in entry:
                self._surfaces.remove(entry["surface"])
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
            except DamagedCheckpoint as error:
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
