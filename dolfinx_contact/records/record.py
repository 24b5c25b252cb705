# SPDX-License-Identifier: LGPL-3.0-or-later
"""Record of one contact problem in a folder: a locked journal and array files.

A point or state is written to disk before the next one is computed: first its array files, then the
line of the journal with their names. This line completes the point: a run may be killed at any
moment and is resumed from the complete lines on any number of ranks. Points recorded after the last
resumable point are recomputed, but not recorded again. Every point has its own files, because a
process that is killed while writing to an HDF5 file may damage its previous content. `Record` is
the base class of the records of branches (`branch_record`) and of histories, motions and paths
(`steps_record`).
"""

from __future__ import annotations

import logging
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, TypeAlias, TypeVar

from petsc4py import PETSc

import numpy as np

from dolfinx import fem

from dolfinx_contact._ending import Ends
from dolfinx_contact._files import os_error
from dolfinx_contact._mpi import everywhere, on_root, require, same_everywhere
from dolfinx_contact.continuation.observer import Observer
from dolfinx_contact.io.files import agreed_path, output_folder
from dolfinx_contact.io.outside import Outside
from dolfinx_contact.records.arrays import DamagedFile, load, save
from dolfinx_contact.records.journal import (
    ARRAYS,
    FORMAT,
    AnyJournal,
    Entry,
    array_file,
    outer_surface_file,
    reread,
)
from dolfinx_contact.records.journal_file import JournalFile, run_name
from dolfinx_contact.records.manifest import difference
from dolfinx_contact.records.states import StateArrays, places
from dolfinx_contact.results.outer_surface import Arrays, flat

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = ["Record", "Resume"]

logger = logging.getLogger(__name__)

#: Whether a record is continued: it must exist, must not exist, or may exist.
Resume: TypeAlias = "bool | Literal['if_exists']"
J = TypeVar("J", bound=AnyJournal)
T = TypeVar("T")
R = TypeVar("R", bound="Record[Any]")


class Record(Observer, ABC, Generic[J]):
    """Journal and array files of one contact problem in a folder. Collective.

    Args:
        folder: folder of the record, created if necessary.
        problem: recorded contact problem.
        kind: class of the journal, such as `Journal`.
        surface_displacement: whether the displacement of the outer surface is stored at every
            point. Ignored if a record is resumed, which keeps its original setting.
        resume: True to continue an existing record, False to begin a new one, ``"if_exists"`` to
            continue the record if it exists and to begin a new one otherwise.

    Attributes:
        journal: content of the journal, on every rank.

    Raises:
        OSError: on every rank, if the folder cannot be written to, another run records there, or
            the existence of a record contradicts ``resume``.
        ValueError: on every rank, if the journal is corrupt or belongs to another kind or problem.
    """

    #: Noun for a branch or run, with its number.
    _part: ClassVar[str]

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
        self.folder: Path = agreed if resume is True else output_folder(self.comm, agreed)
        self._branch = 0  # number of the branch or run that is being recorded
        self._file: JournalFile[J] | None = None  # on rank 0
        run = run_name(self.comm)

        def opened() -> J:
            self._file = JournalFile(self.folder, kind, resume=resume, run=run)
            return self._file.journal

        self.journal: J = on_root(self.comm, opened)
        try:
            with everywhere(self.comm, "the fields of a record"):
                self._states = StateArrays(problem)
                self._outside = Outside(problem)
            self._begin_session(self._header())
        except Exception:
            self.close()
            raise

    @abstractmethod
    def _header(self) -> dict[str, Any]:
        """Return the items of the header, including the manifest. Collective.

        Raises:
            ValueError: on every rank, if the items differ from the recorded header.
        """

    def _require_same(
        self, recorded: Mapping[str, Any], now: Mapping[str, Any], at: str = ""
    ) -> None:
        """Raise `ValueError` if the problem differs from the recorded problem. Collective.

        Args:
            recorded: recorded sections of the manifest by name; nothing is compared if it is empty.
            now: present sections of the manifest, by name.
            at: time or location of the comparison for the message, such as " at the time 1".

        Raises:
            ValueError: on every rank, with the first item that differs.
        """
        items = (difference(recorded[section], now[section]) for section in now if recorded)
        item = next((words for words in items if words), "")
        message = f"{self.folder} has the record of another problem; differs{at}: {item}"
        require(self.comm, not item, message)

    def _begin_session(self, new: Mapping[str, Any]) -> None:
        """Write the header if the record is new, and a line for this session. Collective.

        Args:
            new: items of the header of a new record.

        Raises:
            ValueError: on every rank, if a recorded outer surface is missing or was replaced.
        """
        from dolfinx_contact import __version__

        def prepare() -> None:
            self.journal.check_surfaces()
            if self._file is not None:
                self._file.drop_torn_line(self.journal.length)

        on_root(self.comm, prepare)
        if not self.journal.header:
            common = {"of": self.journal.kind, "format": FORMAT, "package": __version__}
            common |= {"points": places(self.problem), "surface_displacement": self._shows}
            self._append({"type": "header", **common, **new})
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

    def _begin(self, task: Mapping[str, Any], after: int = 0, *, free: Sequence[str] = ()) -> None:
        """Record the beginning of a branch or run, or compare it with the record. Collective.

        Args:
            task: attributes of the task (range, step control and so on) by name.
            after: index of the recorded state from which a run starts.
            free: names of attributes that may differ from the recorded task.

        Raises:
            ValueError: on every rank, if the branch or run was begun with a different task in an
                earlier session.
        """
        known = self.journal.branches.get(self._branch)
        if known is None:
            self._append({"type": "begin", "branch": self._branch, "task": task, "after": after})
            return
        recorded, now = (
            {k: v for k, v in words.items() if k not in free}
            for words in (known.task, reread(task))
        )
        place = f" in the task of {self._part.format(self._branch)}"
        self._require_same({"task": recorded}, {"task": now}, place)

    def _write_point(self, name: str, entry: Mapping[str, Any], law: ContactProblem) -> None:
        """Record the point whose state the problem contains. Collective.

        Args:
            name: name of the file with the outer surface.
            entry: entry of the point, including the items for its checkpoint, if there is one.
            law: problem whose law (with its memory) is used to evaluate the contact tables.
        """
        points = self.journal.branches[self._branch].points
        keys = self._write_surface(name, law) if self._shows else {}
        if points and points[-1].status == entry["status"]:
            entry = {k: v for k, v in entry.items() if k != "status"}
        self._append({"type": "point", "branch": self._branch, **entry, **keys})

    def _write_end(self, ended: Ends, keys: Mapping[str, str] | None = None) -> None:
        """Record the end of a branch or run, unless the last point contains it. Collective.

        Args:
            ended: branch or run with its `ending` and `reason`.
            keys: journal items of a checkpoint of the last point; default: none was written.
        """
        if self.journal.branches[self._branch].ending is not ended.ending:
            ending = {"ending": ended.ending, "reason": ended.reason}
            self._append({"type": "end", "branch": self._branch, **ending, **(keys or {})})

    def _write_surface(self, name: str, law: ContactProblem) -> dict[str, str]:
        """Write the present outer surface; return its name and fingerprint. Collective.

        The law of the problem, with its memory, is used to evaluate the contact tables.
        """
        state = self._outside.state(law)
        arrays: Arrays = {}
        if state is not None:  # double precision where values are differences of coordinates
            single = {name: getattr(state, name).astype(np.float32) for name in ("u", "strain")}
            arrays = flat(vars(state) | single)
        return self._write_arrays("surface", name, arrays)

    def _write_arrays(self, kind: str, name: str, arrays: Arrays) -> dict[str, str]:
        """Write arrays of a point to a file. Collective.

        Args:
            kind: kind of the array file, a key of `journal.ARRAYS`.
            name: name of the file, without suffix.
            arrays: arrays by name, on rank 0.

        Raises:
            OSError: on every rank, with the path, if the arrays cannot be written; no partial file
                remains.
        """
        checksum = self._save(array_file(self.folder, kind, name), arrays)
        return {kind: name, ARRAYS[kind].checksum: checksum}

    def _save(self, file: Path, arrays: Arrays) -> str:
        """Write the arrays of rank 0 to a file and return its fingerprint. Collective."""

        def write() -> str:
            try:
                file.parent.mkdir(exist_ok=True)
            except OSError as error:
                raise os_error(error, file.parent) from None
            return save(file, arrays)

        return on_root(self.comm, write)

    def _append(self, entry: Mapping[str, Any]) -> None:
        """Write a line of the journal and add it to the journal in memory. Collective.

        Raises:
            OSError: on every rank, if the line cannot be written; its array files are removed.
            ValueError: on every rank, if the record is closed.
        """
        self._require_open()
        entry = {**entry, "line": self.journal.lines + 1}

        def write() -> None:
            try:
                if self._file is not None:
                    self._file.append(entry)
            except OSError:
                for kind in ARRAYS.keys() & entry.keys():
                    array_file(self.folder, kind, entry[kind]).unlink(missing_ok=True)
                raise

        on_root(self.comm, write)
        self.journal.take(reread(entry))

    def _require_open(self) -> None:
        """Raise ``ValueError`` on every rank if the journal is closed. Collective."""
        closed = self.comm.rank == 0 and self._file is None
        message = f"the record in {self.folder} is closed: open it with resume=True"
        require(self.comm, not closed, message)

    # -- reading -----------------------------------------------------------------------------------

    def _read_checkpoint(
        self,
        entry: Entry,
        vectors: Mapping[str, PETSc.Vec],
        functions: Mapping[str, fem.Function],
    ) -> Arrays:
        """Read the checkpoint of a point. Collective.

        Args:
            entry: entry of the point.
            vectors: vectors of unknowns to fill, by name.
            functions: Functions to fill, by name.

        Returns:
            Arrays at contact points, on every rank.

        Raises:
            DamagedFile: on every rank, if the checkpoint is corrupt or missing.
        """
        arrays: Arrays = {}
        file = array_file(self.folder, "checkpoint", entry.checkpoint)
        on_root(self.comm, lambda: arrays.update(load(file, entry.sum)))
        self._states.fill(vectors, arrays)
        self._states.fill_functions(functions, arrays)
        at_points = {k: v for k, v in arrays.items() if k.startswith(("statuses.", "memory."))}
        return self.comm.bcast(at_points)

    def _last_undamaged(self, indices: Sequence[int], read: Callable[[int], T]) -> T:
        """Read the last state that has an intact checkpoint. Collective.

        Corrupt checkpoints are skipped, with a warning in the log.

        Args:
            indices: indices of the states, in descending order.
            read: function that reads the state with an index.

        Raises:
            ValueError: on every rank, if all checkpoints are corrupt.
        """
        for index in indices[:-1]:
            try:
                return read(index)
            except DamagedFile as error:
                if self.comm.rank == 0:
                    logger.warning("%s; the previous checkpoint is tried", error)
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
