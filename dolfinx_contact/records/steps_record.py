# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records of histories, motions and paths, from which interrupted runs can be resumed.

The journal contains energies and statuses of every accepted step. Each step has a checkpoint with
displacement, multipliers, rigid bodies, statuses and memory, and with the velocity of a motion or
the tangent of a path. A run is resumed from its last resumable step. While a jump of the solution
is being located, accepted steps are not resumable.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from dolfinx import fem

from dolfinx_contact._ending import Ending, Ends
from dolfinx_contact._mpi import everywhere, require, same_everywhere
from dolfinx_contact.continuation.observer import ObserverLike, Stop
from dolfinx_contact.continuation.step_control import StepControl
from dolfinx_contact.equations.state import State
from dolfinx_contact.evolution import (
    ArcLength,
    EvolutionStep,
    History,
    NoContinuation,
    PathHistory,
)
from dolfinx_contact.evolution.arc_length import PathTask
from dolfinx_contact.evolution.quasi_static import Evolution
from dolfinx_contact.evolution.run import Listeners, Runnable, RunState
from dolfinx_contact.evolution.step import AcceptedState
from dolfinx_contact.evolution.through_times import HistoryTask
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.records.branch_entries import BranchEntries
from dolfinx_contact.records.journal import (
    Entry,
    EvolutionJournal,
    PathJournal,
)
from dolfinx_contact.records.manifest import data_restored, manifest_of, values_of
from dolfinx_contact.records.record import Record, Resume

__all__ = ["EvolutionRecord", "PathRecord", "StepsRecord"]

J = TypeVar("J", bound=EvolutionJournal)
H = TypeVar("H", bound=History)

_WITHOUT_CONTINUATION = (Ending.NO_SOLUTION, Ending.NOT_FOUND, Ending.NOT_SOLVED)
#: Attributes of the state of a run that are recorded elsewhere.
_ELSEWHERE = ("accepted", "ending", "reason", "passed")


class StepsRecord(Record[J], Generic[J, H]):
    """Base class of the records of evolutions and paths, with one point per step. Collective.

    Args:
        folder: folder of the record, created if necessary.
        runs: evolution or path whose runs are recorded.
        kind: class of the journal.
        points: conversion of the points of a path to entries; None (default) for histories and
            motions.
        surface_displacement: whether the displacement of the outer surface is recorded, see
            `EvolutionRecord`.
        resume: whether an existing record is continued, see `EvolutionRecord`.

    Attributes:
        journal: content of the journal, on every rank.

    Raises:
        OSError, ValueError: on every rank, for the reasons listed in `EvolutionRecord`.
    """

    _part = "the run"
    #: Nouns for the recorded evolution, and for the coordinate of its states.
    _what: ClassVar[str]
    _along: ClassVar[str]

    def __init__(
        self,
        folder: str | os.PathLike[str],
        runs: Runnable[Any, H],
        kind: type[J],
        points: BranchEntries | None = None,
        *,
        surface_displacement: bool,
        resume: Resume,
    ):
        self._runs = runs
        self._points = points
        self._x = runs.problem.create_vector()
        self._kept: Mapping[str, fem.Function] = getattr(runs, "kept", {})
        self._index = -1  # number of the state where the runs are
        self._last: AcceptedState | None = None  # that state
        self._resumed_state: RunState | None = None  # state from which a recorded run continues
        super().__init__(
            folder, runs.problem, kind, surface_displacement=surface_displacement, resume=resume
        )

    def _header(self) -> dict[str, Any]:
        runs = self._runs
        forms = {f"the form {i} of the motion": f for i, f in enumerate(runs.forms, 1)}
        new = manifest_of(self.problem, method=runs.method, forms=forms, driven=runs.driven)
        self._require_same(self.journal.header, new)
        for state in self.journal.states[-1:]:
            at = f"{self._along} {state.time:.10g}"
            with self._looking():
                self._load(state)
                values = values_of(self.problem, more=runs.data)
            self._require_same({"values": state.data}, {"values": values}, f" at {at}")
        return dict(new)

    # -- differences between histories and paths -------------------------------------------------

    def _load(self, state: Entry) -> None:
        """Set the data of the problem to the load of a recorded state. Collective."""
        raise NotImplementedError

    def _task(self, words: Mapping[str, Any]) -> Any:
        """Create the task of a recorded run from its recorded attributes."""
        raise NotImplementedError

    # -- recording -------------------------------------------------------------------------------

    def begin(self, task: Any, state: RunState) -> None:
        """Record the beginning of a new run; a resumed run is not recorded again. Collective.

        Raises:
            ValueError: on every rank, if the record is closed, if the run does not start from the
                last recorded state, or if its task differs from the task of an interrupted run.
        """
        self._require_open()
        if state is self._resumed_state:
            return
        runs = self.journal.runs
        states = self.journal.states
        killed = bool(runs) and runs[-1].ending is None and self._last is None
        self._branch = len(runs) - int(killed)
        if killed:
            self._begin(vars(task))
        if len(states) == 1 and self._last is None:  # killed before its first step
            self._index = 0
            self._last = state.accepted
        if states:
            self._require_end(state.accepted)
        if not killed:
            self._begin(vars(task), after=max(self._index, 0))
        if not states:
            history = self._runs.history(state)
            history.begin(state.number, self.problem)
            letters = "".join(t.status for t in self.problem.tables().values())
            self._write_state(state, letters, history.first)

    def _require_end(self, accepted: AcceptedState) -> None:
        """Raise `ValueError` on every rank if a state is not the last recorded state."""
        last = self._last
        at_the_end = (
            last is not None
            and self._index == len(self.journal.states) - 1
            and last.time == accepted.time
            and np.array_equal(last.unknowns, accepted.unknowns)
        )
        message = (
            f"the {self._what} is at {self._along} {accepted.time:.10g} and not at the end of the "
            f"record in {self.folder}, which is at {self.journal.states[-1].time:.10g}: continue "
            f"with {type(self).__name__}(..., resume=True).go_on(), or record to another folder"
        )
        require(self.comm, at_the_end, message)

    def step(self, step: EvolutionStep, state: RunState) -> None:
        """Record a step, unless it was recorded before an interruption. Collective."""
        if self._index + 1 < len(self.journal.states):
            self._index += 1
            self._last = state.accepted
        else:
            self._write_state(state, step.status, step.row())

    def end(self, ended: Ends) -> None:
        """Record the end of a run. Collective."""
        # if later steps are already recorded, the run does not end here
        if ended.ending is not None and self._index == len(self.journal.states) - 1:
            self._write_end(ended)

    def _write_state(self, run_state: RunState, letters: str, row: dict[str, Any]) -> None:
        """Record the state that the problem contains. Collective.

        Args:
            run_state: state of the run.
            letters: statuses of the contact points, one letter each.
            row: row of the state in the table of steps.
        """
        accepted = run_state.accepted
        index = self._index + 1
        name = f"state_{index:06d}"
        square = self.comm.allreduce(float(np.dot(accepted.unknowns, accepted.unknowns)))
        entry: dict[str, Any] = {
            "index": index,
            "time": accepted.time,
            "gamma": accepted.state.gamma,
            "status": letters,
            "size": float(np.sqrt(square)),
            "energies": asdict(accepted.energies),
            "data": values_of(self.problem, more=self._runs.data),
            "row": row,
            "first": accepted.statuses is None,
            "ending": run_state.ending,
            "reason": run_state.reason,
            "run": {k: v for k, v in vars(run_state).items() if k not in _ELSEWHERE},
        }
        vectors = {"x": self._x}
        if self._points is not None and run_state.arrived is not None:
            entry["run"]["arrived"] = self._points.columns(run_state.arrived)
            vectors = self._points.split(run_state.arrived)
        self.problem.write(vectors["x"])
        arrays = self._states.of_vectors(vectors) | self._states.of_functions(self._kept)
        arrays |= self._states.of_points(accepted)
        keys = self._write_arrays("checkpoint", name, arrays)
        law = self.problem.with_memory(accepted.state.previous)
        self._write_point(name, {**entry, **keys}, law)
        self._index = index
        self._last = accepted

    # -- resuming --------------------------------------------------------------------------------

    def go_on(
        self,
        *,
        stop: Stop[Any] | None = None,
        observer: ObserverLike[Any] | None = None,
        progress: bool | None = None,
    ) -> H:
        """Continue the last run with its recorded task. Collective.

        A run that has ended is not continued; the evolution is then set to the last recorded state,
        from which a later ``run(..., record=record)`` starts.

        Args:
            stop: stop condition of the original run, if any.
            observer: function called with every computed step, after the step has been recorded.
            progress: whether rank 0 shows the progress, see `QuasiStatic.run`.

        Returns:
            History of the steps computed by this call; the journal contains all steps.

        Raises:
            NoContinuation: see `QuasiStatic.run`.
            ValueError: on every rank, if no run was recorded, or if all checkpoints are corrupt.
        """
        states = self.journal.states
        if not states:
            raise ValueError(
                f"no run is in {self.folder}: run the {self._what} from its start, with "
                f"{type(self).__name__}(..., resume=True), or remove the folder"
            )
        self._branch = len(self.journal.runs) - 1
        run = self.journal.runs[-1]
        settled = [i for i in range(run.after + 1, len(states)) if states[i].run.settled]
        indices = [len(states) - 1] if run.ending else [*reversed(settled), run.after]
        self._index, run_state = self._last_undamaged(indices, lambda i: (i, self._run_state(i)))
        self._last = run_state.accepted
        task = self._task(run.task)
        if run.ending is None:
            if self._index == run.after:
                run_state = self._runs.begun(task, run_state)
            passed = tuple(s.time for s in states[run.after : self._index + 1])
            self._resumed_state = replace(run_state, passed=passed)
            listeners = Listeners(stop, observer, self, progress)
            return self._runs.go_on(task, self._resumed_state, listeners)
        self._runs.put(run_state)
        history = self._runs.history(run_state)
        history.begin(run_state.number, self.problem)
        history.end(run.ending, run.reason)
        if run.ending in _WITHOUT_CONTINUATION and getattr(task, "at_jump", "stop") != "stop":
            raise NoContinuation(run.reason, history)
        return history

    def _run_state(self, index: int) -> RunState:
        """Write a recorded state into the problem; return the state of the run. Collective.

        Raises:
            ValueError: on every rank, if the checkpoint of the state is corrupt.
        """
        state = self.journal.states[index]
        run = dict(state.run)
        points = None if run["arrived"] is None else self._points
        vectors = {"x": self._x} if points is None else points.vectors
        arrays = self._read_checkpoint(state, vectors, self._kept)
        self.problem.read(vectors["x"], self._states.statuses(arrays))
        self._load(state)
        energies = self._runs.account(**state.energies)
        memory = self._states.memory(arrays)
        stepper = self._runs.stepper(None)
        accepted = stepper.recalled(state.time, memory, energies, first=state.first)
        if points is not None:
            run["arrived"] = points.joined(run["arrived"])
        if run["rate"] is not None:
            run["rate"] = np.array(run["rate"])
        return RunState(accepted, **run)

    # -- states ----------------------------------------------------------------------------------

    def state(self, index: int) -> State:
        """Return a recorded state, for evaluation or as ``start`` of a run. Collective.

        The problem is not changed.

        Args:
            index: number of the step, 0 for the start.

        Raises:
            ValueError: on every rank, if the step does not exist or its checkpoint is corrupt.
        """
        same_everywhere(self.comm, index=index)
        last = len(self.journal.states) - 1
        valid = isinstance(index, int | np.integer) and 0 <= index <= last
        require(self.comm, valid, f"steps 0 to {last} are recorded, not {index}")
        with self._looking():
            after = self._run_state(index).accepted
            previous: list[Memory | None] = [None] * len(after.memory)
            if index > 0:
                before = self._run_state(index - 1).accepted
                previous = [m.later(after.time - before.time) for m in before.memory]
        return replace(after.state, previous=tuple(previous))

    @contextmanager
    def _looking(self) -> Iterator[None]:
        """Context manager that restores state and data of the problem on exit. Collective."""
        system = getattr(self._runs, "parametric", self.problem)
        with data_restored(self.problem), system.restored(always=True):
            yield


class EvolutionRecord(StepsRecord[EvolutionJournal, History]):
    """Record of the runs of an evolution in a folder. Collective.

    An open record holds a file lock, so that no other process can write to it. If ``mpirun`` is
    killed and some of its ranks survive, they keep the lock until they are terminated.

    A record can only be resumed with the same problem. It stores a manifest: the mesh, the forms
    and their domains of integration, Dirichlet conditions, surfaces and laws, and at every state
    the values of all Constants and Functions. The manifest is compared once on resumption, under
    the load at the last recorded time; an error names the first difference. Later values of the
    load cannot be compared.

    Args:
        folder: folder of the record, created if necessary.
        evolution: evolution whose runs are recorded.
        surface_displacement: whether the displacement of the outer surface is recorded at every
            step, in single precision, for the explorer. Ignored if a record is resumed, which
            keeps its original setting.
        resume: True to continue an existing record, False to begin a new one, "if_exists" for
            either.

    Attributes:
        journal: content of the journal, on every rank.

    Raises:
        OSError: on every rank, if the folder cannot be written to, another run records there, or
            the existence of a record contradicts ``resume``. Later, during the run, if a step
            cannot be written: the record then ends with the previous step and can be resumed.
        ValueError: on every rank, if the journal is corrupt or belongs to another problem or load,
            or if arguments differ between ranks. Nothing is written in this case.

    Example:
        Record a run, and read the record::

            with EvolutionRecord("output/path", evolution) as record:
                history = evolution.run(times, record=record)
            rows = read_journal("output/path").rows()

        If the run is interrupted, a script with the same evolution continues it::

            with EvolutionRecord("output/path", evolution, resume=True) as record:
                history = record.go_on()
    """

    _what = "evolution"
    _along = "the time"

    def __init__(
        self,
        folder: str | os.PathLike[str],
        evolution: Evolution,
        *,
        surface_displacement: bool = False,
        resume: Resume = False,
    ):
        if not isinstance(evolution, Evolution):
            raise ValueError(f"a QuasiStatic or NSCD is required, got {type(evolution).__name__}")
        self.evolution = evolution
        super().__init__(
            folder,
            evolution,
            EvolutionJournal,
            surface_displacement=surface_displacement,
            resume=resume,
        )

    def _load(self, state: Entry) -> None:
        with everywhere(self.comm, f"the load at the time {state.time:.10g}"):
            self.evolution.load(state.time)

    def _task(self, words: Mapping[str, Any]) -> HistoryTask:
        return HistoryTask(**{**words, "times": tuple(words["times"])})


class PathRecord(StepsRecord[PathJournal, PathHistory]):
    """Record of the runs of an arc-length path in a folder. Collective.

    An open record holds a file lock, so that no other process can write to it. If ``mpirun`` is
    killed and some of its ranks survive, they keep the lock until they are terminated.

    Args:
        folder: folder of the record, created if necessary.
        path: path whose runs are recorded.
        surface_displacement: whether the displacement of the outer surface is recorded, see
            `EvolutionRecord`.
        resume: True to continue an existing record, False to begin a new one, "if_exists" for
            either.

    Attributes:
        journal: content of the journal, on every rank.

    Raises:
        OSError, ValueError: on every rank, for the reasons listed in `EvolutionRecord`.

    Example:
        Record a path, and read the record::

            with PathRecord("output/path", path) as record:
                history = path.run(gamma_range=(0.0, 1.0), record=record)
            folds = read_journal("output/path").folds

        If the run is interrupted, a script with the same `ArcLength` continues it::

            with PathRecord("output/path", path, resume=True) as record:
                history = record.go_on()
                back = path.run(gamma_range=(0.0, 1.0), direction="back", record=record)
    """

    _what = "path"
    _along = "the arc length"

    def __init__(
        self,
        folder: str | os.PathLike[str],
        path: ArcLength,
        *,
        surface_displacement: bool = False,
        resume: Resume = False,
    ):
        if not isinstance(path, ArcLength):
            raise ValueError(f"an ArcLength is required, got {type(path).__name__}")
        self.path = path
        super().__init__(
            folder,
            path,
            PathJournal,
            BranchEntries(path.parametric),
            surface_displacement=surface_displacement,
            resume=resume,
        )

    def _load(self, state: Entry) -> None:
        self.path.parametric._set(state.gamma)

    def _task(self, words: Mapping[str, Any]) -> PathTask:
        low, high = words["gamma_range"]
        control = StepControl(**words["control"])
        return PathTask(**{**words, "gamma_range": (low, high), "control": control})
