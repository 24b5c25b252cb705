# SPDX-License-Identifier: LGPL-3.0-or-later
"""The record of a path by arc length, from which a killed run is resumed; see `StepsRecord`.

A state has in addition the tangent of the step to it and everything that the next step depends on,
so that a run continues with the same points.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from petsc4py import PETSc

from dolfinx_contact.continuation.branch import BranchPoint
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.continuation.observer import ObserverLike, Stop
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.evolution import ArcLength, PathHistory, PathStep
from dolfinx_contact.evolution.path import PathState, PathTask, begun
from dolfinx_contact.evolution.run import Listeners
from dolfinx_contact.records.arrays import Arrays
from dolfinx_contact.records.columns import Arrived, PathGoesOn, StateEntry, plain
from dolfinx_contact.records.journal import PathJournal
from dolfinx_contact.records.record import Resume
from dolfinx_contact.records.steps_record import StepsRecord

__all__ = ["PathRecord"]


class PathRecord(StepsRecord[PathJournal, PathState]):
    """A record of the runs of a path by arc length in a folder. Collective.

    While the record is open no other process can write to it; ranks that outlive a killed
    ``mpirun`` hold it until they are ended.

    Args:
        folder: folder of the record, created if necessary.
        path: path whose runs are recorded.
        surface_displacement: see `EvolutionRecord`.
        resume: True to continue a record that exists, False to begin one where there is none,
            "if_exists" for either.

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
        driven = path.parametric._driven_expressions
        super().__init__(
            folder,
            path.parametric,
            PathJournal,
            method=(),
            surface_displacement=surface_displacement,
            resume=resume,
            driven=driven,
        )

    def _load(self, state: StateEntry[PathGoesOn]) -> None:
        self.path.parametric._set(state.run.gamma)

    def _goes_on(self, run_state: PathState) -> PathGoesOn:
        point = run_state.arrived
        arrived = None
        if point is not None:
            arrived = Arrived(
                tangent=self._layout.gamma(point.tangent),
                piece=self.path.parametric.letters(point.piece),
                step=point.step,
                corrections=point.corrections,
                tau=point.tau,
            )
        return PathGoesOn(
            gamma=run_state.gamma,
            arrived=arrived,
            number=run_state.number,
            length=run_state.length,
            known=run_state.known,
            ending=run_state.ending,
            reason=run_state.reason,
        )

    def _names(self) -> Iterable[str]:
        return ("tangent",)

    def _fill(self, vectors: Mapping[str, PETSc.Vec], run_state: PathState) -> None:
        if run_state.arrived is not None:
            t = vectors["tangent"]
            t.array[:] = run_state.arrived.tangent.array_r[: t.getLocalSize()]

    def _recalled(
        self,
        state: StateEntry[PathGoesOn],
        vectors: Mapping[str, PETSc.Vec],
        arrays: Arrays,
    ) -> PathState:
        gamma = state.run.gamma
        arrived = None
        energies = self.path.account(**state.energies)
        memory = self._points.memory(arrays)
        accepted = self.path.recalled(state.time, gamma, memory, energies, first=state.first)
        if (at := state.run.arrived) is not None:
            arrived = BranchPoint(
                self._layout.joined(vectors["x"], gamma),
                self._layout.joined(vectors["tangent"], at.tangent),
                self.path.parametric.piece_of(at.piece),
                gamma,
                at.step,
                at.corrections,
                at.tau,
            )
        return PathState(
            accepted,
            state.run.length,
            number=state.run.number,
            ending=state.run.ending,
            reason=state.run.reason,
            arrived=arrived,
            known=state.run.known,
            passed=(accepted.time,),
        )

    def begin(self, task: PathTask, state: PathState) -> None:
        """A run begins; of one that continues nothing is recorded. Collective.

        Raises:
            ValueError: on every rank, if it does not begin where the record ends, or is not the one
                that was begun there and killed.
        """
        runs = self.journal.runs
        if runs and runs[-1].ending is None and self._last is None:
            recorded = plain(_task(runs[-1].task))
            self._require_same({"task": recorded}, {"task": plain(task)}, " in the task of the run")
        super().begin(task, state)

    def go_on(
        self,
        *,
        stop: Stop[PathStep] | None = None,
        observer: ObserverLike[PathStep] | None = None,
        progress: bool | None = None,
    ) -> PathHistory:
        """Continue the last run as it was begun; one that has ended stays as it is. Collective.

        The path is at the end of the record then, and may run on with ``record=`` this record.

        Args:
            stop: the same as at the beginning, if there was one.
            observer: called with the points that are computed, beside the record.
            progress: see `ArcLength.run`.

        Returns:
            The points that were computed; the journal has all.

        Raises:
            ValueError: on every rank, if no run was recorded, its checkpoints are damaged, or the
                problem is not that of the record.
        """
        run = self._last_run()
        if run.ending is not None:
            run_state = self._stand_at([len(self.journal.states) - 1])
            self.path.put(run_state)
            history = PathHistory(run_state.accepted.time, run_state.accepted.energies)
            history.gamma = run_state.gamma
            history.end(run.ending, run.reason)
            return history
        task = _task(run.task)
        states = self.journal.states
        run_state = self._stand_at(range(len(states) - 1, run.after - 1, -1))
        passed = tuple(s.time for s in states[run.after : self._index + 1])
        run_state = replace(run_state, passed=passed)
        if self._index == run.after:
            run_state = begun(task, run_state)
        self._resumed_state = run_state
        listeners = Listeners(None, stop, observer, self, progress)
        return self.path.go_on(task, run_state, listeners)


def _task(words: Mapping[str, Any]) -> PathTask:
    """The task of a run, as the journal has it."""
    low, high = words["gamma_range"]
    return PathTask(
        **dict(words) | {"gamma_range": (low, high), "control": StepControl(**words["control"])}
    )
