# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records of histories, motions and paths, from which interrupted runs can be resumed.

A record is a folder with the journal (energies and statuses of every accepted step) and a
checkpoint of every step (displacement, multipliers, rigid bodies, statuses and memory; the velocity
of a motion, the tangent of a path). A run is resumed from its last resumable step. Steps inside the
search for a jump are not resumable, because they belong together. Recorded steps after the last
resumable step are computed again but not recorded again.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from typing import Any, ClassVar, Generic, TypeVar

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._ending import Ending, Ends
from dolfinx_contact._mpi import everywhere, require, same_everywhere
from dolfinx_contact.continuation.branch import BranchPoint
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.continuation.observer import ObserverLike, Stop
from dolfinx_contact.continuation.parameters import StepControl
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
from dolfinx_contact.records.fields import PointArrays
from dolfinx_contact.records.journal import (
    Entry,
    EvolutionJournal,
    EvolutionRun,
    PathJournal,
    plain,
)
from dolfinx_contact.records.manifest import data_restored, manifest_of, values_of
from dolfinx_contact.records.record import Record, Resume

__all__ = ["EvolutionRecord", "PathRecord", "StepsRecord"]

J = TypeVar("J", bound=EvolutionJournal)
H = TypeVar("H", bound=History)

_WITHOUT_CONTINUATION = (Ending.NO_SOLUTION, Ending.NOT_FOUND, Ending.NOT_SOLVED)


class StepsRecord(Record[J], Generic[J, H]):
    """Base of the records of runs, with one entry per step. A collective context manager.

    Args:
        folder: folder of the record, created if necessary.
        runs: evolution or path whose runs are recorded.
        kind: class of the journal.
        surface_displacement: whether the displacement of the outer surface is recorded, see
            `EvolutionRecord`.
        resume: whether an existing record is continued, see `EvolutionRecord`.

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
        runs: Runnable[Any, H],
        kind: type[J],
        *,
        surface_displacement: bool,
        resume: Resume,
    ):
        problem = runs.problem
        super().__init__(
            folder, problem, kind, surface_displacement=surface_displacement, resume=resume
        )
        self._runs = runs
        self._points = PointArrays(problem)
        self._index = -1  # number of the state where the runs are
        self._last: AcceptedState | None = None  # that state
        self._resumed_state: RunState | None = None  # state from which a recorded run continues
        try:
            forms = {f"the form {i} of the motion": f for i, f in enumerate(runs.forms, 1)}
            now = manifest_of(problem, method=runs.method, forms=forms, driven=runs.driven)
            if self.journal.header:
                self._require_same(self.journal.header, now)
            if self.journal.states:
                self._require_load(self.journal.states[-1])
            self._begin_session(now)
        except Exception:
            self.close()
            raise

    def _require_load(self, state: Entry) -> None:
        """Require the recorded data under the load of a state. Collective."""
        at = f"{self._along} {state.time:.10g}"
        with self._looking():
            with everywhere(self.comm, f"the load at {at}"):
                self._load(state)
            now = values_of(self.problem, more=self._runs.data)
        self._require_same({"values": state.data}, {"values": now}, f" at {at}")

    # -- differences between histories and paths -------------------------------------------------

    def _load(self, state: Entry) -> None:
        """Put the load of a state into the data of the problem. Collective."""
        raise NotImplementedError

    def _more(self, run_state: RunState | None) -> Mapping[str, npt.ArrayLike]:
        """Return the owned values of the vectors of a state in addition to the unknowns.

        Args:
            run_state: the state; None if only the names are needed.
        """
        raise NotImplementedError

    def _put_more(self, state: Entry, vectors: Mapping[str, PETSc.Vec]) -> None:
        """Put the items of `_more` into the problem. Collective.

        Args:
            state: entry of the state.
            vectors: vectors of its checkpoint, by name.
        """

    def _goes_on(self, run_state: RunState) -> dict[str, Any]:
        """Return additional items needed to continue a run. Collective."""
        raise NotImplementedError

    def _recalled(
        self, state: Entry, accepted: AcceptedState, vectors: Mapping[str, PETSc.Vec]
    ) -> RunState:
        """Return the state of a run at a recorded state. Collective.

        Args:
            state: entry of the state.
            accepted: the state, which is in the problem.
            vectors: vectors of its checkpoint, by name.
        """
        raise NotImplementedError

    def _task(self, words: Mapping[str, Any]) -> Any:
        """Return the task of a recorded run."""
        raise NotImplementedError

    def _continued(self, run: EvolutionRun, task: Any, run_state: RunState) -> RunState:
        """Return the state from which a run continues; `self._index` is its number."""
        raise NotImplementedError

    # -- recording -------------------------------------------------------------------------------

    def begin(self, task: Any, state: RunState) -> None:
        """Record the beginning of a new run; a resumed run is not recorded again. Collective.

        Raises:
            ValueError: on every rank, if the record is closed, or the run does not begin at the
                end of the record.
        """
        self._require_open()
        if state is self._resumed_state:
            return
        states = self.journal.states
        accepted = state.accepted
        if not states:
            tables = [self.problem.table(s) for s in self.problem.surfaces]
            self._write_state(state, "".join(table.status for table in tables))
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

    def step(self, step: EvolutionStep, state: RunState) -> None:
        """Record a step, unless it was recorded before the run was killed. Collective."""
        if self._index + 1 < len(self.journal.states):
            self._index += 1
            self._last = state.accepted
            return
        self._write_state(state, step.status, step.row())

    def end(self, ended: Ends) -> None:
        """Record the end of a run. Collective."""
        if ended.ending is None or self._index < len(self.journal.states) - 1:
            return  # more was recorded before, after which this is not the end
        self._append({"type": "end", "ending": ended.ending, "reason": ended.reason})

    def _write_state(
        self, run_state: RunState, letters: str, row: dict[str, Any] | None = None
    ) -> None:
        """Record a state, which is in the problem. Collective.

        Args:
            run_state: the state, and the continuation of the run.
            letters: letters of its statuses.
            row: its row of the table of steps; None at the start.
        """
        accepted = run_state.accepted
        index = self._index + 1
        name = f"state_{index:06d}"
        values = values_of(self.problem, more=self._runs.data)
        square = self.comm.allreduce(float(np.dot(accepted.unknowns, accepted.unknowns)))
        common = {k: getattr(run_state, k) for k in ("number", "length", "settled")}
        common |= {"ending": run_state.ending, "reason": run_state.reason}
        # files first, then the line that names them
        vectors = self._vectors(run_state)
        self.problem.write(vectors["x"])
        keys = self._write_fields(name, vectors, self._points.gathered(accepted))
        for x in vectors.values():
            x.destroy()
        keys |= self._write_surface(name, self.problem.with_memory(accepted.state.previous))
        self._append(
            {
                "type": "state",
                "index": index,
                "time": accepted.time,
                "status": letters,
                "size": float(np.sqrt(square)),
                "energies": asdict(accepted.energies),
                "data": values,
                "row": row,
                "first": accepted.statuses is None,
                "run": common | self._goes_on(run_state),
                **keys,
            }
        )
        self._index = index
        self._last = accepted

    def _vectors(self, run_state: RunState | None = None) -> dict[str, PETSc.Vec]:
        """Return new vectors for a state, the unknowns last and 0. Collective."""
        vectors = {}
        for name, values in {**self._more(run_state), "x": ()}.items():
            x = vectors[name] = self.problem.create_vector()
            x.array[: np.size(values)] = values
        return vectors

    # -- resuming --------------------------------------------------------------------------------

    def _last_run(self) -> EvolutionRun:
        if not self.journal.runs:
            raise ValueError(
                f"no run is in {self.folder}: run the {self._what} from its start, with "
                f"{type(self).__name__}(..., resume=True), or remove the folder"
            )
        return self.journal.runs[-1]

    def _stand_in_run(self, run: EvolutionRun) -> RunState:
        """Go to the last state from which a recorded run can continue. Collective."""
        states = self.journal.states
        if run.ending is not None:
            return self._stand_at([len(states) - 1])
        settled = [i for i in range(run.after + 1, len(states)) if states[i].run.settled]
        return self._stand_at([*reversed(settled), run.after])

    def _stand_at(self, indices: Sequence[int]) -> RunState:
        """Go to the first of several recorded states that is undamaged. Collective.

        Args:
            indices: numbers of the states, from the last one back.
        """
        self._index, run_state = self._last_undamaged(indices, lambda i: (i, self._run_state(i)))
        self._last = run_state.accepted
        return run_state

    def _run_state(self, index: int) -> RunState:
        """Return the state of a run at a recorded state, put into the problem. Collective.

        Raises:
            ValueError: on every rank, if its checkpoint is damaged.
        """
        state = self.journal.states[index]
        vectors = self._vectors()
        arrays = self._read_fields(state.checkpoint, state.sum, vectors)
        self.problem.put(vectors["x"], self._points.statuses(arrays))
        self._put_more(state, vectors)
        energies = self._runs.account(**state.energies)
        memory = self._points.memory(arrays)
        stepper = self._runs.stepper(None)
        accepted = stepper.recalled(state.time, memory, energies, first=state.first)
        run_state = self._recalled(state, accepted, vectors)
        for x in vectors.values():
            x.destroy()
        return run_state

    def go_on(
        self,
        *,
        stop: Stop[Any] | None = None,
        observer: ObserverLike[Any] | None = None,
        progress: bool | None = None,
    ) -> H:
        """Continue the last run with its recorded task. Collective.

        A run that has ended is not continued; the evolution is then put to the end of the record.
        A later ``run(..., record=record)`` starts from there.

        Args:
            stop: stop condition; must be the stop condition with which the run began, if any.
            observer: function called with every computed step, after the step is recorded.
            progress: whether rank 0 shows the progress, see `QuasiStatic.run`.

        Returns:
            History of the steps computed by this call; the journal contains all steps.

        Raises:
            NoContinuation: see `QuasiStatic.run`.
            ValueError: on every rank, if no run was recorded, or its checkpoints are damaged.
        """
        run = self._last_run()
        run_state = self._stand_in_run(run)
        task = self._task(run.task)
        if run.ending is not None:
            self._runs.put(run_state)
            history = self._runs.history(run_state)
            history.end(run.ending, run.reason)
            if run.ending in _WITHOUT_CONTINUATION and getattr(task, "at_jump", "stop") != "stop":
                raise NoContinuation(run.reason, history)
            return history
        self._resumed_state = self._continued(run, task, run_state)
        listeners = Listeners(stop, observer, self, progress)
        return self._runs.go_on(task, self._resumed_state, listeners)

    # -- states ----------------------------------------------------------------------------------

    def state(self, index: int) -> State:
        """Return a recorded state, for evaluation or as ``start`` of a run. Collective.

        The problem is not changed.

        Args:
            index: number of the step, 0 for the start.

        Raises:
            ValueError: on every rank, if the step does not exist or its checkpoint is damaged.
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

    A record is resumed with the same problem only. It stores a manifest: the mesh, the forms and
    their domains of integration, Dirichlet conditions, surfaces and laws, and at every state the
    values of all Constants and Functions. On resumption the manifest is compared once, under the
    load at the last recorded time, and the error names the first item that differs. Later values
    of the load cannot be compared.

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
            the existence of a record contradicts ``resume``. Later, from `QuasiStatic.run`, if a
            step cannot be written: the record then ends with the previous step, and can be resumed.
        ValueError: on every rank, if the journal is damaged or of another problem or load, or
            arguments differ between ranks. Nothing has been written then.

    Example:
        Record a run, and read it::

            with EvolutionRecord("output/path", evolution) as record:
                history = evolution.run(times, record=record)
            rows = read_journal("output/path").rows()

        If it is killed, a script that has made the same evolution continues::

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
            raise ValueError(f"a QuasiStatic or NSCD is needed, got {type(evolution).__name__}")
        self.evolution = evolution
        super().__init__(
            folder,
            evolution,
            EvolutionJournal,
            surface_displacement=surface_displacement,
            resume=resume,
        )

    def _load(self, state: Entry) -> None:
        self.evolution.load(state.time)

    def _more(self, run_state: RunState | None) -> Mapping[str, npt.ArrayLike]:
        n = self.problem.equations.owned_sizes[0]
        return {name: f.x.array[:n] for name, f in self.evolution.kept.items()}

    def _goes_on(self, run_state: RunState) -> dict[str, Any]:
        return {"rate": None if run_state.rate is None else run_state.rate.tolist()}

    def _put_more(self, state: Entry, vectors: Mapping[str, PETSc.Vec]) -> None:
        n = self.problem.equations.owned_sizes[0]
        for name, f in self.evolution.kept.items():
            f.x.array[:n] = vectors[name].array_r[:n]
            f.x.scatter_forward()

    def _recalled(
        self, state: Entry, accepted: AcceptedState, vectors: Mapping[str, PETSc.Vec]
    ) -> RunState:
        run = state.run
        rate = None if run.rate is None else np.array(run.rate)
        ending = None if run.ending is None else Ending[run.ending]
        return RunState(
            accepted, run.length, run.number, ending=ending, reason=run.reason, rate=rate
        )

    def _task(self, words: Mapping[str, Any]) -> HistoryTask:
        return HistoryTask(**{**words, "times": tuple(words["times"])})

    def _continued(self, run: EvolutionRun, task: HistoryTask, run_state: RunState) -> RunState:
        return run_state if self._index > run.after else self.evolution.begun(task, run_state)


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
        OSError, ValueError: on every rank, as `EvolutionRecord`.

    Example:
        Record a path, and read it::

            with PathRecord("output/path", path) as record:
                history = path.run(gamma_range=(0.0, 1.0), record=record)
            folds = read_journal("output/path").folds

        If it is killed, a script that has made the same `ArcLength` continues::

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
            raise ValueError(f"an ArcLength is needed, got {type(path).__name__}")
        self.path = path
        self._layout = Layout(path.parametric)
        super().__init__(
            folder,
            path,
            PathJournal,
            surface_displacement=surface_displacement,
            resume=resume,
        )

    def _load(self, state: Entry) -> None:
        self.path.parametric._set(state.run.gamma)

    def _more(self, run_state: RunState | None) -> Mapping[str, npt.ArrayLike]:
        if run_state is None or run_state.arrived is None:
            return {"tangent": ()}
        values = run_state.arrived.tangent.array_r
        return {"tangent": values[: len(values) - int(self._layout.last)]}

    def _goes_on(self, run_state: RunState) -> dict[str, Any]:
        point = run_state.arrived
        arrived = None
        if point is not None:
            arrived = {
                "tangent": self._layout.gamma(point.tangent),
                "piece": self.path.parametric.letters(point.piece),
                "step": point.step,
                "corrections": point.corrections,
                "tau": point.tau,
            }
        return {"gamma": run_state.accepted.gamma, "arrived": arrived, "known": run_state.known}

    def _put_more(self, state: Entry, vectors: Mapping[str, PETSc.Vec]) -> None:
        self._load(state)

    def _recalled(
        self, state: Entry, accepted: AcceptedState, vectors: Mapping[str, PETSc.Vec]
    ) -> RunState:
        run = state.run
        arrived = None
        if (step := run.arrived) is not None:
            arrived = BranchPoint(
                self._layout.joined(vectors["x"], run.gamma),
                self._layout.joined(vectors["tangent"], step.tangent),
                self.path.parametric.piece_of(step.piece),
                run.gamma,
                step.step,
                step.corrections,
                step.tau,
            )
        return RunState(
            accepted,
            run.length,
            number=run.number,
            ending=None if run.ending is None else Ending[run.ending],
            reason=run.reason,
            arrived=arrived,
            known=dict(run.known),
            passed=(accepted.time,),
        )

    def _task(self, words: Mapping[str, Any]) -> PathTask:
        low, high = words["gamma_range"]
        control = StepControl(**words["control"])
        return PathTask(**{**words, "gamma_range": (low, high), "control": control})

    def _continued(self, run: EvolutionRun, task: PathTask, run_state: RunState) -> RunState:
        passed = tuple(s.time for s in self.journal.states[run.after : self._index + 1])
        run_state = replace(run_state, passed=passed)
        return self.path.begun(task, run_state) if self._index == run.after else run_state

    def begin(self, task: PathTask, state: RunState) -> None:
        """Record the beginning of a new run; a resumed run is not recorded again. Collective.

        Raises:
            ValueError: on every rank, if the run does not begin at the end of the record, or its
                task differs from the task of the killed run that begins there.
        """
        runs = self.journal.runs
        if runs and runs[-1].ending is None and self._last is None:
            recorded = plain(self._task(runs[-1].task))
            self._require_same({"task": recorded}, {"task": plain(task)}, " in the task of the run")
        super().begin(task, state)
