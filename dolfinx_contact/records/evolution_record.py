# SPDX-License-Identifier: LGPL-3.0-or-later
"""The record of a history or motion, from which a killed run is resumed; see `StepsRecord`.

A state has in addition the Functions that its evolution keeps, such as the velocity. Steps that
were found together, on the way to a jump, do not suffice to continue the run: they are computed
again.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import replace

from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.continuation.observer import ObserverLike, Stop
from dolfinx_contact.evolution import EvolutionStep, History, NoContinuation
from dolfinx_contact.evolution.evolution import Evolution
from dolfinx_contact.evolution.run import Listeners, RunState
from dolfinx_contact.evolution.through_times import Accept, HistoryTask
from dolfinx_contact.records.arrays import Arrays
from dolfinx_contact.records.columns import HistoryGoesOn, StateEntry
from dolfinx_contact.records.journal import EvolutionJournal
from dolfinx_contact.records.record import Resume
from dolfinx_contact.records.steps_record import StepsRecord

__all__ = ["EvolutionRecord"]

_WITHOUT_CONTINUATION = (Ending.NO_SOLUTION, Ending.NOT_FOUND, Ending.NOT_SOLVED)


class EvolutionRecord(StepsRecord[EvolutionJournal, RunState]):
    """A record of the runs of an evolution in a folder. Collective.

    While the record is open no other process can write to it; ranks that outlive a killed
    ``mpirun`` hold it until they are ended.

    A record is resumed with the same problem only. It stores a manifest: the mesh, the forms and
    their domains of integration, Dirichlet conditions, surfaces and laws, and at every state the
    values of all Constants and Functions. On resumption the manifest is compared once, under the
    load at the last recorded time, and the error names the first item that differs. Later values
    of the load cannot be compared.

    Args:
        folder: folder of the record, created if necessary.
        evolution: evolution whose runs are recorded.
        surface_displacement: whether that of the outer surface of the bodies is kept at every step,
            in single precision, for `plot.draw_record`. A record that is resumed continues as it
            began.
        resume: True to continue a record that exists, False to begin one where there is none,
            "if_exists" for either.

    Attributes:
        journal: content of the journal, on every rank.

    Raises:
        OSError: on every rank, if the folder cannot be written to, another run records there,
            there is a record and it is not to be resumed, or the other way round. Later, from
            `QuasiStatic.run`, if a step cannot be written: the record then ends with the step
            before, and can be resumed.
        ValueError: on every rank, if the journal is damaged or that of another problem or load, or
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
            evolution.problem,
            EvolutionJournal,
            method=evolution.method,
            surface_displacement=surface_displacement,
            resume=resume,
            data=evolution.data,
            forms={f"the form {i} of the motion": f for i, f in enumerate(evolution.forms, 1)},
        )

    def _load(self, state: StateEntry[HistoryGoesOn]) -> None:
        self.evolution.load(state.time)

    def _goes_on(self, run_state: RunState) -> HistoryGoesOn:
        return HistoryGoesOn(
            number=run_state.number,
            length=run_state.length,
            rate=None if run_state.rate is None else [float(r) for r in run_state.rate],
            settled=run_state.settled,
            ending=run_state.ending,
            reason=run_state.reason,
        )

    def _names(self) -> Iterable[str]:
        return self.evolution.kept

    def _fill(self, vectors: Mapping[str, PETSc.Vec], run_state: RunState) -> None:
        n = self.problem.equations.owned_sizes[0]
        for name, f in self.evolution.kept.items():
            vectors[name].array[:n] = f.x.array[:n]

    def _recalled(
        self,
        state: StateEntry[HistoryGoesOn],
        vectors: Mapping[str, PETSc.Vec],
        arrays: Arrays,
    ) -> RunState:
        n = self.problem.equations.owned_sizes[0]
        for name, f in self.evolution.kept.items():
            f.x.array[:n] = vectors[name].array_r[:n]
            f.x.scatter_forward()
        memory = self._points.memory(arrays)
        energies = self.evolution.account(**state.energies)
        accepted = self.evolution.recalled(state.time, memory, energies, first=state.first)
        return RunState(
            accepted,
            state.run.length,
            None if state.run.rate is None else np.array(state.run.rate),
            state.run.number,
            ending=state.run.ending,
            reason=state.run.reason,
        )

    def go_on(
        self,
        *,
        accept: Accept | None = None,
        stop: Stop[EvolutionStep] | None = None,
        observer: ObserverLike[EvolutionStep] | None = None,
        progress: bool | None = None,
    ) -> History:
        """Continue the last run as it was begun; one that has ended stays as it is. Collective.

        The evolution is at the end of the record then, and may run on with ``record=`` this record.

        Args:
            accept: the same as at the beginning, if there was one.
            stop: likewise.
            observer: called with the steps that are computed, beside the record.
            progress: see `QuasiStatic.run`.

        Returns:
            The steps that were computed; the journal has all.

        Raises:
            NoContinuation: as `QuasiStatic.run`.
            ValueError: on every rank, if no run was recorded, its checkpoints are damaged, or the
                problem is not that of the record.
        """
        run = self._last_run()
        if run.ending is not None:
            run_state = replace(self._stand_at([len(self.journal.states) - 1]), length=math.inf)
            self.evolution.put(run_state)
            history = History(run_state.accepted.time, run_state.accepted.energies)
            history.end(run.ending, run.reason)
            if run.ending in _WITHOUT_CONTINUATION and run.task["at_jump"] != "stop":
                raise NoContinuation(run.reason, history)
            return history
        task = HistoryTask(**run.task | {"times": tuple(run.task["times"])})
        states = self.journal.states
        known = [i for i in range(run.after + 1, len(states)) if states[i].run.settled]
        run_state = self._stand_at([*reversed(known), run.after])
        if self._index == run.after:
            run_state = replace(run_state, length=task.longest, ending=None, reason="")
        self._resumed_state = run_state
        listeners = Listeners(accept, stop, observer, self, progress)
        return self.evolution.go_on(task, run_state, listeners)
