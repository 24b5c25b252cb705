# SPDX-License-Identifier: LGPL-3.0-or-later
"""What records of histories and of paths share: states step by step, on the disk and from there.

A record is a folder with the journal (`journal.py`: energies and statuses of every
accepted step) and a checkpoint of every step: displacement, multipliers, rigid bodies, statuses and
memory. All of a step is on the disk before the next one is computed. Resumed, on any number of
ranks, a run continues from the last step that suffices for it. Those recorded beyond it are
computed once more and are not recorded again.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any, ClassVar, Generic, TypeVar

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl

from dolfinx_contact._errors import everywhere, require, same_everywhere
from dolfinx_contact.continuation.ending import Ends
from dolfinx_contact.equations.data import Datum
from dolfinx_contact.evolution import EvolutionStep
from dolfinx_contact.evolution.run_state import RunState
from dolfinx_contact.evolution.step import AcceptedState
from dolfinx_contact.io.folder import output_folder
from dolfinx_contact.io.table import write_contact_table
from dolfinx_contact.parametric import ParametricContact
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.records.entries import EndEntry, Entry, StateEntry
from dolfinx_contact.records.fields import PointArrays
from dolfinx_contact.records.journal import EvolutionJournal, EvolutionRun
from dolfinx_contact.records.manifest import data_restored, manifest_of, values_of
from dolfinx_contact.records.problem_record import ProblemRecord, Resume

__all__ = ["StepsRecord"]

logger = logging.getLogger(__name__)

Arrays = dict[str, npt.NDArray[Any]]

J = TypeVar("J", bound=EvolutionJournal)
S = TypeVar("S", bound=RunState)


class StepsRecord(ProblemRecord[J], Generic[J, S]):
    """Records runs step by step in a folder. Collective, as a context.

    Args:
        folder: of the record, made if need be.
        system: the contact problem, or it and its load, which are put back after a look.
        kind: of the journal.
        method: what the runs are known by beside the problem, in words.
        surface_displacement: see `EvolutionRecord`, as for the following.
        resume: True to continue a record that exists, False to begin one where there is none,
            "if_exists" for either.
        data: Functions and Constants beside those of the problem, with their places.
        forms: beside those of the problem, by name.
        driven: expressions by which a load drives Dirichlet data.

    Attributes:
        journal: what has been recorded, on every rank.

    Raises:
        OSError, ValueError: on every rank, see `EvolutionRecord`.
    """

    #: What is recorded, and what its states are distinguished by.
    _what: ClassVar[str]
    _along: ClassVar[str]

    def __init__(
        self,
        folder: str | os.PathLike[str],
        system: ContactProblem | ParametricContact,
        kind: type[J],
        *,
        method: Sequence[str],
        surface_displacement: bool,
        resume: Resume,
        data: Sequence[Datum] = (),
        forms: Mapping[str, ufl.Form] | None = None,
        driven: Sequence[Any] = (),
    ):
        problem = system if isinstance(system, ContactProblem) else system.problem
        super().__init__(
            folder, problem, kind, surface_displacement=surface_displacement, resume=resume
        )
        self._system = system
        self._points = PointArrays(problem)
        self._last: AcceptedState | None = None  # where the runs stand
        self._index = -1  # of that state
        self._resumed_state: S | None = None  # where a run that was recorded continues
        self._more = data
        try:
            now = manifest_of(problem, method=method, forms=forms, driven=driven)
            if self.journal.header:
                self._require_same(self.journal.header, now)
            self._require_load()
            self._begin(now)
        except Exception:
            self.close()
            raise

    def _require_load(self) -> None:
        """Refuse other data than the recorded ones under the load of the last state. Collective."""
        if not self.journal.states:
            return
        state = self.journal.states[-1]
        at = f"{self._along} {state.time:.10g}"
        with self.looking():
            with everywhere(self.comm, f"the load at {at}"):
                self._load(state)
            now = self._values()
        recorded = self.journal.data_at(state.index)
        self._require_same({"values": recorded}, {"values": now}, f" at {at}")

    def _values(self) -> dict[str, Any]:
        """The values of all data as they are now. Collective."""
        return values_of(self.problem, more=self._more)

    # -- what records of one kind have ---------------------------------------------------------

    def _load(self, state: StateEntry[Any]) -> None:
        """Put the load of a state into the data of the problem. Collective."""
        raise NotImplementedError

    def _entry_of(self, run_state: S) -> Entry:
        """The entry of the journal for how a run continues. Collective."""
        raise NotImplementedError

    def _names(self) -> Iterable[str]:
        """Of what a state has beside the unknowns, as vectors of unknowns."""
        raise NotImplementedError

    def _fill(self, vectors: Mapping[str, PETSc.Vec], run_state: S) -> None:
        """Put what a state has beside the unknowns into vectors, which are 0."""
        raise NotImplementedError

    def _recalled(
        self,
        state: StateEntry[Any],
        vectors: Mapping[str, PETSc.Vec],
        found: Mapping[str, npt.NDArray[Any]],
        first: bool,
    ) -> S:
        """The state of a run at a recorded state, which has been put into the problem. Collective.

        Args:
            state: its entry in the journal.
            vectors: that were kept.
            found: arrays at the points.
            first: whether statuses at the state are not known.
        """
        raise NotImplementedError

    # -- events of a run --------------------------------------------------------------------------

    def begin(self, task: Any, state: S) -> None:
        """A run begins; of one that continues nothing is recorded. Collective.

        Raises:
            ValueError: on every rank, if this is closed, or it does not begin where the record
                ends.
        """
        self._require_open()
        if state is self._resumed_state:
            return
        states = self.journal.states
        accepted = state.accepted
        if not states:
            self._keep(state, self._letters())
        elif len(states) == 1 and self._last is None:
            self._index = 0
            self._last = accepted
        message = (
            f"the {self._what} is at {self._along} {accepted.time:.10g} and not at the end of the "
            f"record in {self.folder}, which is at {states[-1].time:.10g}: continue with "
            f"{type(self).__name__}(..., resume=True).go_on(), or record to another folder"
        )
        at_the_end = self._index == len(states) - 1 and self._is_at(accepted)
        require(self.comm, at_the_end, message)
        run = EvolutionRun(task=asdict(task), after=self._index)
        self._append({"type": "run", "task": run.task, "after": run.after})
        self.journal.runs.append(run)

    def _is_at(self, accepted: AcceptedState) -> bool:
        """Whether a state is that at which the record stands. Not collective."""
        last = self._last
        if last is None or last.time != accepted.time:
            return False
        return np.array_equal(last.unknowns, accepted.unknowns)

    def step(self, step: EvolutionStep, state: S) -> None:
        if self._index + 1 < len(self.journal.states):  # recorded before the run was killed
            self._index += 1
            self._last = state.accepted
            return
        self._keep(state, step.status, step.row())

    def end(self, ended: Ends) -> None:
        run = self.journal.runs[-1]
        if ended.ending is None or self._index < len(self.journal.states) - 1:
            return  # more was recorded before, after which this is not the end
        end = EndEntry(ending=ended.ending, reason=ended.reason)
        self._append({"type": "end", **end.line()})
        run.end(ended.ending, ended.reason)

    def _keep(self, run_state: S, letters: str, row: dict[str, Any] | None = None) -> None:
        """Put a state, which is in the problem, on the disk. Collective.

        Args:
            run_state: the state and how the run continues from it.
            letters: letters of its statuses.
            row: its row of the table of steps; None at the start.
        """
        accepted = run_state.accepted
        self._law = self.problem.with_memory(accepted.state.previous)
        index = self._index + 1
        name = f"state_{index:06d}"
        values = self._values()
        square = self.comm.allreduce(float(np.dot(accepted.unknowns, accepted.unknowns)))
        run = self._entry_of(run_state)
        vectors = self._vectors()
        self._fill(vectors, run_state)
        self.problem.write(vectors["x"])
        arrays = self._points.gathered(accepted)
        check_sum = self._write_fields(name, vectors, arrays)
        for x in vectors.values():
            x.destroy()
        surface = self._write_surface(name) if self._shows else None
        before = self.journal.data_at(index - 1)
        entry = StateEntry(
            index=index,
            time=accepted.time,
            status=letters,
            size=float(np.sqrt(square)),
            energies=asdict(accepted.energies),
            data={place: v for place, v in values.items() if before.get(place) != v},
            row=row,
            first=accepted.statuses is None,
            run=run,
            checkpoint=name,
            sum=check_sum,
            surface=name if self._shows else None,
            surface_sum=surface,
        )
        self._append({"type": "state", **entry.line()})
        self.journal.states.append(entry)
        self._index = index
        self._last = accepted

    def _vectors(self) -> dict[str, PETSc.Vec]:
        """For what a state has, the unknowns last. Collective."""
        return {name: self.problem.create_vector() for name in (*self._names(), "x")}

    def _letters(self) -> str:
        """Letters of the statuses that stand in the surfaces, as those of a step. Collective."""
        return "".join(self.problem.table(s).status for s in self.problem.surfaces)

    # -- continuing --------------------------------------------------------------------------------

    def _last_run(self) -> EvolutionRun:
        if not self.journal.runs:
            raise ValueError(
                f"no run is in {self.folder}: run the {self._what} from its start, with "
                f"{type(self).__name__}(..., resume=True), or remove the folder"
            )
        return self.journal.runs[-1]

    def _ended(self) -> S:
        """The state of a run that has ended, which is the last state. Collective."""
        self._index = len(self.journal.states) - 1
        run_state = self._run_state(self._index)
        self._last = run_state.accepted
        return run_state

    def _resumed(self, run: EvolutionRun, known: Sequence[int]) -> S:
        """The state of a run at the last state from which it can continue. Collective.

        A damaged checkpoint is passed over, with a warning in the log.

        Args:
            run: that has not ended.
            known: indices of the states that suffice to continue it, beside that where it begins.
        """
        indices = (*reversed(known), run.after)
        index, run_state = self._last_whole(indices, lambda i: (i, self._run_state(i)))
        self._index = index
        self._last = run_state.accepted
        return run_state

    def _run_state(self, index: int) -> S:
        """The state of a run at a recorded state, which is put into the problem. Collective.

        Raises:
            ValueError: on every rank, if it is damaged.
        """
        problem = self.problem
        state = self.journal.states[index]
        vectors = self._vectors()
        found = self._read_fields(state.checkpoint, state.sum, vectors)
        problem.put(vectors["x"], self._points.statuses(found))
        run_state = self._recalled(state, vectors, found, state.first)
        for x in vectors.values():
            x.destroy()
        return run_state

    def show(self, index: int) -> ContactProblem:
        """Put a recorded state into the problem, for tables, fields and pictures. Collective.

        Runs stay where they are, and what they stand at is put back by the next one.

        Args:
            index: of the step; 0 is the start.

        Returns:
            The problem under the law of the step, for evaluations such as `ContactProblem.table`.

        Raises:
            ValueError: on every rank, if there is none, or it is damaged.
        """
        same_everywhere(self.comm, index=index)
        last = len(self.journal.states) - 1
        known = isinstance(index, int | np.integer) and 0 <= index <= last
        require(self.comm, known, f"steps 0 to {last} are recorded, not {index}")
        if index == 0:
            self._run_state(0)
            return self.problem
        before = self._run_state(index - 1).accepted
        step = self._run_state(index).accepted.time - before.time
        return self.problem.step_from(before.state, step=step)

    @contextmanager
    def looking(self) -> Iterator[None]:
        """Put back at the end what is in the problem, whatever was shown. Collective."""
        with data_restored(self.problem), self._system.restored(always=True):
            yield

    def write_contact(self, folder: str | os.PathLike[str], index: int) -> None:
        """Write the contact points of a recorded state, ``folder/contact.csv``. Collective.

        The problem stays as it is.

        Args:
            folder: where to, made if need be.
            index: of the step; 0 is the start.

        Raises:
            OSError: on every rank, with the path, if it cannot be written.
            ValueError: on every rank, if there is no such step, or it is damaged.
        """
        with self.looking():
            shown = self.show(index)
            tables = [shown.table(s) for s in self.problem.surfaces]
        write_contact_table(self.comm, output_folder(self.comm, folder), tables)
