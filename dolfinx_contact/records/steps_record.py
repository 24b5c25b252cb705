# SPDX-License-Identifier: LGPL-3.0-or-later
"""The common part of the records of histories, motions and paths: states step by step.

A record is a folder with the journal (energies and statuses of every accepted step) and a
checkpoint of every step (displacement, multipliers, rigid bodies, statuses and memory). A run is
resumed from the last step that suffices to continue it; later recorded steps are computed again
and not recorded again.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from typing import Any, ClassVar, Generic, TypeVar

from petsc4py import PETSc

import numpy as np

import ufl

from dolfinx_contact._errors import everywhere, require, same_everywhere
from dolfinx_contact.continuation.ending import Ends
from dolfinx_contact.equations.data import Datum
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution import EvolutionStep
from dolfinx_contact.evolution.run import RunState
from dolfinx_contact.evolution.step import AcceptedState
from dolfinx_contact.io.folder import output_folder
from dolfinx_contact.io.table import write_contact_table
from dolfinx_contact.parametric import ParametricContact
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.records.arrays import Arrays
from dolfinx_contact.records.columns import (
    EndEntry,
    HistoryGoesOn,
    PathGoesOn,
    StateEntry,
    plain,
)
from dolfinx_contact.records.fields import PointArrays
from dolfinx_contact.records.journal import EvolutionJournal, EvolutionRun
from dolfinx_contact.records.manifest import data_restored, manifest_of, values_of
from dolfinx_contact.records.record import Record, Resume

__all__ = ["StepsRecord"]

J = TypeVar("J", bound=EvolutionJournal)
S = TypeVar("S", bound=RunState)


class StepsRecord(Record[J], Generic[J, S]):
    """A record of runs, step by step. Collective, as a context.

    Args:
        folder: folder of the record, created if necessary.
        system: the contact problem, or the problem with its load.
        kind: class of the journal.
        method: words for the method of the runs and its parameters.
        surface_displacement: see `EvolutionRecord`, also for the following argument.
        resume: whether a record is continued.
        data: further Functions and Constants, with their places.
        forms: further forms, by name.
        driven: expressions by which a load drives Dirichlet data.

    Attributes:
        journal: content of the journal, on every rank.

    Raises:
        OSError, ValueError: on every rank, see `EvolutionRecord`.
    """

    #: Words for the recorded evolution, and for the coordinate of its states.
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
        self._more_data = data
        self._points = PointArrays(problem)
        self._index = -1  # number of the state where the runs are
        self._last: AcceptedState | None = None  # that state
        self._resumed_state: S | None = None  # state from which a recorded run continues
        try:
            now = manifest_of(problem, method=method, forms=forms, driven=driven)
            if self.journal.header:
                self._require_same(self.journal.header, now)
            if self.journal.states:
                self._require_load(self.journal.states[-1])
            self._begin_session(now)
        except Exception:
            self.close()
            raise

    def _require_load(self, state: StateEntry[Any]) -> None:
        """Refuse other data than the recorded ones under the load of a state. Collective."""
        at = f"{self._along} {state.time:.10g}"
        with self.looking():
            with everywhere(self.comm, f"the load at {at}"):
                self._load(state)
            now = self._values()
        recorded = self.journal.data_at(state.index)
        self._require_same({"values": recorded}, {"values": now}, f" at {at}")

    def _values(self) -> dict[str, Any]:
        """The values of all data as they are now. Collective."""
        return values_of(self.problem, more=self._more_data)

    # -- differences between histories and paths -------------------------------------------------

    def _load(self, state: StateEntry[Any]) -> None:
        """Put the load of a state into the data of the problem. Collective."""
        raise NotImplementedError

    def _goes_on(self, run_state: S) -> HistoryGoesOn | PathGoesOn:
        """The entry for the continuation of a run. Collective."""
        raise NotImplementedError

    def _names(self) -> Iterable[str]:
        """Names of the vectors that a state has in addition to the unknowns."""
        raise NotImplementedError

    def _fill(self, vectors: Mapping[str, PETSc.Vec], run_state: S) -> None:
        """Fill these vectors, which are 0."""
        raise NotImplementedError

    def _recalled(
        self, state: StateEntry[Any], vectors: Mapping[str, PETSc.Vec], arrays: Arrays
    ) -> S:
        """The state of a run at a recorded state, which is in the problem. Collective.

        Args:
            state: entry of the state.
            vectors: vectors of its checkpoint, by name.
            arrays: arrays at the points of its checkpoint.
        """
        raise NotImplementedError

    # -- recording -------------------------------------------------------------------------------

    def begin(self, task: Any, state: S) -> None:
        """Record the beginning of a run; nothing for a run that continues. Collective.

        Raises:
            ValueError: on every rank, if the record is closed, or the run does not begin where the
                record ends.
        """
        self._require_open()
        if state is self._resumed_state:
            return
        states = self.journal.states
        accepted = state.accepted
        if not states:
            tables = [self.problem.table(s) for s in self.problem.surfaces]
            self._keep(state, "".join(table.status for table in tables))
        elif len(states) == 1 and self._last is None:
            self._index = 0
            self._last = accepted
        last = self._last
        at_the_end = (
            last is not None
            and self._index == len(states) - 1
            and last.time == accepted.time
            and np.array_equal(last.unknowns, accepted.unknowns)
        )
        message = (
            f"the {self._what} is at {self._along} {accepted.time:.10g} and not at the end of the "
            f"record in {self.folder}, which is at {states[-1].time:.10g}: continue with "
            f"{type(self).__name__}(..., resume=True).go_on(), or record to another folder"
        )
        require(self.comm, at_the_end, message)
        self._append({"type": "run", "task": asdict(task), "after": self._index})

    def step(self, step: EvolutionStep, state: S) -> None:
        if self._index + 1 < len(self.journal.states):  # recorded before the run was killed
            self._index += 1
            self._last = state.accepted
            return
        self._keep(state, step.status, step.row())

    def end(self, ended: Ends) -> None:
        if ended.ending is None or self._index < len(self.journal.states) - 1:
            return  # more was recorded before, after which this is not the end
        end = EndEntry(ending=ended.ending, reason=ended.reason)
        self._append({"type": "end", **plain(end)})

    def _keep(self, run_state: S, letters: str, row: dict[str, Any] | None = None) -> None:
        """Record a state, which is in the problem. Collective.

        Args:
            run_state: the state, and the continuation of the run.
            letters: letters of its statuses.
            row: its row of the table of steps; None at the start.
        """
        accepted = run_state.accepted
        index = self._index + 1
        name = f"state_{index:06d}"
        values = self._values()
        before = self.journal.data_at(index - 1)
        square = self.comm.allreduce(float(np.dot(accepted.unknowns, accepted.unknowns)))
        goes_on = self._goes_on(run_state)
        vectors = self._vectors()
        self._fill(vectors, run_state)
        self.problem.write(vectors["x"])
        fingerprint = self._write_fields(name, vectors, self._points.gathered(accepted))
        for x in vectors.values():
            x.destroy()
        law = self.problem.with_memory(accepted.state.previous)
        entry = StateEntry(
            index=index,
            time=accepted.time,
            status=letters,
            size=float(np.sqrt(square)),
            energies=asdict(accepted.energies),
            data={place: v for place, v in values.items() if before.get(place) != v},
            row=row,
            first=accepted.statuses is None,
            run=goes_on,
            checkpoint=name,
            sum=fingerprint,
            surface=name if self._shows else None,
            surface_sum=self._write_surface(name, law) if self._shows else None,
        )
        self._append({"type": "state", **plain(entry)})
        self._index = index
        self._last = accepted

    def _vectors(self) -> dict[str, PETSc.Vec]:
        """New vectors for a state, the unknowns last. Collective."""
        return {name: self.problem.create_vector() for name in (*self._names(), "x")}

    # -- resuming --------------------------------------------------------------------------------

    def _last_run(self) -> EvolutionRun:
        if not self.journal.runs:
            raise ValueError(
                f"no run is in {self.folder}: run the {self._what} from its start, with "
                f"{type(self).__name__}(..., resume=True), or remove the folder"
            )
        return self.journal.runs[-1]

    def _stand_at(self, indices: Sequence[int]) -> S:
        """Go to the first of several recorded states that is undamaged. Collective.

        Args:
            indices: numbers of the states, from the last one back.
        """
        index, run_state = self._last_undamaged(indices, lambda i: (i, self._run_state(i)))
        self._index = index
        self._last = run_state.accepted
        return run_state

    def _run_state(self, index: int) -> S:
        """The state of a run at a recorded state, which is put into the problem. Collective.

        Raises:
            ValueError: on every rank, if its checkpoint is damaged.
        """
        state = self.journal.states[index]
        vectors = self._vectors()
        arrays = self._read_fields(state.checkpoint, state.sum, vectors)
        self.problem.put(vectors["x"], self._points.statuses(arrays))
        run_state = self._recalled(state, vectors, arrays)
        for x in vectors.values():
            x.destroy()
        return run_state

    # -- showing ---------------------------------------------------------------------------------

    def show(self, index: int) -> ContactProblem:
        """Put a recorded state into the problem, for tables, fields and pictures. Collective.

        Runs are not affected: the next run puts its own state back.

        Args:
            index: number of the step, 0 for the start.

        Returns:
            The problem under the law of the step, for evaluations such as `ContactProblem.table`.

        Raises:
            ValueError: on every rank, if there is no such step, or it is damaged.
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

    def state(self, index: int) -> State:
        """A recorded state, for evaluators with ``state=`` and runs with ``start=``. Collective.

        The problem stays as it is.

        Args:
            index: number of the step, 0 for the start.

        Raises:
            ValueError: on every rank, if there is no such step, or it is damaged.
        """
        with self.looking():
            law = self.show(index)
            state = self._run_state(index).accepted.state
        previous = law.equations.memory if index else [None] * len(state.memory)
        return replace(state, previous=tuple(previous))

    @contextmanager
    def looking(self) -> Iterator[None]:
        """Restore the state and the data of the problem at the end. Collective."""
        with data_restored(self.problem), self._system.restored(always=True):
            yield

    def write_contact(self, folder: str | os.PathLike[str], index: int) -> None:
        """Write the contact points of a recorded state, ``folder/contact.csv``. Collective.

        The problem stays as it is.

        Args:
            folder: folder of the file, created if necessary.
            index: number of the step, 0 for the start.

        Raises:
            OSError: on every rank, with the path, if it cannot be written.
            ValueError: on every rank, if there is no such step, or it is damaged.
        """
        with self.looking():
            shown = self.show(index)
            tables = [shown.table(s) for s in self.problem.surfaces]
        write_contact_table(self.comm, output_folder(self.comm, folder), tables)
