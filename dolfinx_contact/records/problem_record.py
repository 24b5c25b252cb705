# SPDX-License-Identifier: LGPL-3.0-or-later
"""What records of one contact problem in a folder share: the journal, its lock, and checkpoints."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from dolfinx import fem

from dolfinx_contact._errors import on_root, require, same_everywhere
from dolfinx_contact.continuation.observer import Observer
from dolfinx_contact.io.folder import agreed_path, output_folder
from dolfinx_contact.records.checkpoints import Checkpoints, DamagedCheckpoint
from dolfinx_contact.records.identity import difference, other_words, same_words
from dolfinx_contact.records.kept_data import KeptData, nodes_of, other_values, owned_values
from dolfinx_contact.records.lines import FORMAT, JournalFile, Lines
from dolfinx_contact.records.lock import processes
from dolfinx_contact.records.points import places
from dolfinx_contact.records.surfaces import SurfaceFiles

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = ["ProblemRecord", "coincide"]

logger = logging.getLogger(__name__)

_COINCIDE = 1e-8  # of sizes that numbers have which are computed once more
_DATA = "data"  # the checkpoint of what is known from the beginning

J = TypeVar("J", bound=Lines)
T = TypeVar("T")
R = TypeVar("R", bound="ProblemRecord[Any]")


def coincide(numbers: Iterable[tuple[float, float, float]]) -> bool:
    """Whether numbers are those that were recorded.

    Args:
        numbers: what was recorded, what is found, and of which size they are.
    """
    return all(abs(a - b) <= _COINCIDE * size for a, b, size in numbers)


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

    def _require_same(self, problem: Mapping[str, Any], **more: Any) -> None:
        """Compare the header with the problem, if there is one. Collective.

        Args:
            problem: what it is known by (`identity`).
            more: words of the header, by name, that must be the same.

        Raises:
            ValueError: on every rank, if the journal is that of another problem.
        """
        recorded = self.journal.header
        if recorded:
            differs = self._nodes_differ(recorded, problem) or difference(
                recorded["problem"] | {"mesh": problem["mesh"]}, problem
            )
            for name, value in more.items():
                if not differs and not same_words(recorded[name], value):
                    differs = f"other {name}: {other_words(recorded[name], value)}"
            self._require_no_other(differs)

    def _require_data(
        self,
        data: KeptData,
        where: Sequence[str],
        sums: Mapping[str, str],
        *,
        other: str | None = None,
        at: str = "",
    ) -> None:
        """Refuse Functions, or Constants, that are not those that were recorded. Collective.

        Args:
            data: the Functions of the problem.
            where: checkpoints with the values that were recorded, as `KeptData.are_kept` had it.
            sums: check sums of the checkpoints by name.
            other: where Constants differ (`identity.other_data`); None if they do not.
            at: the state they are of, in words.
        """
        if other is None:
            other = data.difference(where, sums)
        differs = "" if other is None else f"other loads, materials or friction{at}{other}"
        self._require_no_other(differs)

    def _require_no_other(self, differs: str) -> None:
        """Refuse another problem than that of the journal. Collective.

        Args:
            differs: in which respect it is another, the same on every rank; "" if it is not.
        """
        message = f"the journal in {self.folder} is that of another problem: {differs}"
        require(self.comm, not differs, message)

    def _require_task(
        self, what: str, recorded: Mapping[str, Any], found: Mapping[str, Any]
    ) -> None:
        """Refuse to continue something that was begun in another way. Collective.

        Args:
            what: it is, in words.
            recorded: what it was to do.
            found: what it is to do now; of what is not in it anything may have been recorded.
        """
        for name, value in found.items():
            message = f"{what} was recorded with {name} {recorded[name]}, not {value}"
            require(self.comm, recorded[name] == value, message)

    def _require_again(
        self,
        what: str,
        along: str,
        recorded: tuple[float, str],
        found: tuple[float, str],
        numbers: Iterable[tuple[float, float, float]] | None,
    ) -> None:
        """Refuse what is computed once more and is not what was recorded. Collective.

        Args:
            what: it is, in words.
            along: by what its place is known, in words.
            recorded: the place and the statuses that were recorded.
            found: those that are found.
            numbers: that must be the same (`coincide`); None if it is another anyway.
        """
        place, status = recorded
        place_now, status_now = found
        same = numbers is not None and status == status_now and coincide(numbers)
        message = (
            f"{what} was recorded at {along} {place:.12g}, status {status}, and is now found at "
            f"{along} {place_now:.12g}, status {status_now}: the problem has changed"
        )
        require(self.comm, same, message)

    def _nodes_differ(self, recorded: Mapping[str, Any], problem: Mapping[str, Any]) -> str:
        """In which respect the meshes differ, "" if they are the same. Collective.

        Nodes that were moved by what was solved for are elsewhere in their last digits on other
        ranks. So they are compared where the hash of the whole mesh is another.
        """
        known = recorded["problem"]
        kept = self.journal.data
        if known["mesh"] == problem["mesh"]:
            return ""
        if not kept or known["cells"] != problem["cells"]:
            return "another mesh"
        nodes = nodes_of(self.problem)
        found = fem.Function(nodes.function_space)
        self._checkpoints.read_functions(kept["checkpoint"], kept["sum"], {"nodes": found})
        least = 1e-9 * self.problem.equations.body_size
        other = other_values(nodes, owned_values(found), least)
        return "" if other is None else f"another mesh: a coordinate of a node: {other}"

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

    def _begin(self, problem: Mapping[str, Any], data: KeptData | None = None, **more: Any) -> None:
        """Write the header, if there is none, and begin a session. Collective.

        Args:
            problem: what it is known by (`identity`).
            data: whose values are kept from the beginning, if they do not go with states.
            more: words of the header, by name.
        """
        from dolfinx_contact import __version__

        recorded = self.journal.header
        if recorded and recorded["package"] != __version__ and self.comm.rank == 0:
            logger.warning("recorded by %s, resumed by %s", recorded["package"], __version__)
        on_root(self.comm, lambda: self._file.drop_torn_line() if self._file else None)
        if not recorded:
            header = {"package": __version__, "of": self.journal.kind, **more, "problem": problem}
            header["points"] = places(self.problem)
            header["surface_displacement"] = self._shows
            self._append({"type": "header", "format": FORMAT, **header})
            self.journal.header = header
        self._shows = self.journal.header["surface_displacement"]
        session = {"time": time.time(), "ranks": self.comm.size, "package": __version__}
        session["checkpoints"] = self._checkpoints.format
        more_of_it = {}
        if not self.journal.data:
            more_of_it["data"] = self.journal.data = self._keep_data(data)
            self._surfaces.write_surface()
        self._append({"type": "session", **session, **more_of_it})
        self.journal.sessions.append(session)

    def _keep_data(self, data: KeptData | None) -> dict[str, Any]:
        """Keep the nodes of the mesh, and data; their entry in the journal. Collective."""
        kept = {} if data is None else data.changed()
        functions = {"nodes": nodes_of(self.problem), **kept}
        total = self._checkpoints.write(_DATA, {}, functions=functions)
        entry: dict[str, Any] = {"checkpoint": _DATA, "sum": total}
        if data is not None:
            entry["values"] = data.are_kept(_DATA, kept)
        return entry

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
