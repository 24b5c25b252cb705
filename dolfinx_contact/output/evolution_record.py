# SPDX-License-Identifier: LGPL-3.0-or-later
"""The record of an evolution on the disk, from which a killed run is resumed.

A record is a folder with the journal (`evolution_journal.py`: times, energies and statuses of every
accepted step) and a checkpoint of every step: displacement, multipliers, rigid bodies, statuses and
memory. All of a step is on the disk before the next one is computed. Resumed, on any number of
ranks, a run goes on from the last step that says how. Those recorded beyond it, on the way to a
jump, are computed once more, must coincide with the record, and are not recorded again.
"""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._errors import everywhere, require, same_everywhere
from dolfinx_contact.equations.given_data import GivenData, given_data, numbers_of
from dolfinx_contact.evolution import EvolutionStep, History
from dolfinx_contact.evolution.moment import Moment
from dolfinx_contact.evolution.run import Evolution
from dolfinx_contact.evolution.standing import Standing, Task
from dolfinx_contact.output.at_points import AtPoints
from dolfinx_contact.output.evolution_journal import EvolutionJournal, EvolutionRun
from dolfinx_contact.output.folder import output_folder
from dolfinx_contact.output.identity import identity
from dolfinx_contact.output.problem_record import ProblemRecord
from dolfinx_contact.output.table import write_contact_table

__all__ = ["EvolutionRecord"]

logger = logging.getLogger(__name__)

_COINCIDE = 1e-8  # of the values that are compared
_SAME_DATA = 1e-9  # of the values of loads and other data


class EvolutionRecord(ProblemRecord[EvolutionJournal]):
    """Records the runs of an evolution in a folder. Collective.

    While it is open no other process can record there. Ranks that ``mpirun`` has started end with
    it from then on, also when it is killed.

    Args:
        folder: of the record, made if need be.
        evolution: whose runs are recorded.
        resume: whether to go on with a record that exists. Else there must be none.

    Attributes:
        journal: what has been recorded, on every rank.

    Raises:
        OSError: on every rank, if the folder cannot be written to, another process records there,
            there is a record and it is not to be resumed, or the other way round. Later, from
            `QuasiStatic.run`, if a step cannot be written: the record then ends with the step
            before, and can be resumed.
        ValueError: on every rank, if the journal is damaged or that of another problem or load, or
            arguments differ between ranks. Nothing has been written then.

    Example:
        Record a run, and look at it::

            with EvolutionRecord("output/path", evolution) as record:
                history = evolution.run(times, record=record)
            rows = read_evolution("output/path").rows()

        If it is killed, a script that has made the same evolution goes on::

            with EvolutionRecord("output/path", evolution, resume=True) as record:
                history = record.go_on()
    """

    def __init__(
        self, folder: str | os.PathLike[str], evolution: Evolution, *, resume: bool = False
    ):
        if not isinstance(evolution, Evolution):
            raise ValueError(f"a QuasiStatic or NSCD is needed, got {type(evolution).__name__}")
        problem = evolution.problem
        same_everywhere(problem.comm, resume=bool(resume))
        super().__init__(folder, problem, EvolutionJournal, resume=resume)
        self.evolution = evolution
        self._points = AtPoints(problem)
        self._last: Moment | None = None  # where the evolution stands
        self._index = -1  # of that state
        try:
            # The values of all data are compared state by state.
            known = identity(problem, but=given_data(problem.equations))
            method = list(evolution.method)
            self._require_same(known, method=method)
            if self.journal.states:
                self._require_load(self.journal.states[-1])
            self._begin(known, method=method)
        except Exception:
            self.close()
            raise

    def _require_load(self, state: Mapping[str, Any]) -> None:
        """Refuse a load that is not the recorded one at the time of a state. Collective."""
        eq, time = self.problem.equations, state["time"]
        before = GivenData(eq)
        try:
            with everywhere(self.comm, f"the load at the time {time:g}"):
                self.evolution.load(time)
            self._require_data(state["data"], numbers_of(eq), time)
        finally:
            before.restore()

    def _require_data(
        self, recorded: list[list[float]], found: list[list[float]], t: float
    ) -> None:
        same = [len(a) for a in recorded] == [len(b) for b in found] and all(
            np.allclose(a, b, rtol=0, atol=_SAME_DATA * np.max(np.abs(a), initial=0.0))
            for a, b in zip(recorded, found, strict=True)
        )
        message = (
            f"the journal in {self.folder} is that of another problem: other loads, materials or "
            f"friction at the time {t:.10g}"
        )
        require(self.comm, same, message)

    # -- what a run tells ------------------------------------------------------------------------

    def begin(self, task: Task, standing: Standing) -> None:
        """A run begins; see `evolution.standing.Recorder`. Collective.

        Raises:
            ValueError: on every rank, if it does not begin where the record ends.
        """
        states, moment = self.journal.states, standing.moment
        if not states:
            self._keep(0, moment, {})
        elif len(states) == 1 and self._last is None:
            self._compare(0, self._entry(moment, self._letters()))
            self._index, self._last = 0, moment
        goes_on = self._index == len(states) - 1 and self._last is moment
        message = (
            f"the evolution is at the time {moment.time:.10g} and not at the end of the record in "
            f"{self.folder}, which is at {states[-1]['time']:.10g}: go on with "
            "EvolutionRecord(..., resume=True).go_on(), or record to another folder"
        )
        require(self.comm, goes_on, message)
        run = EvolutionRun(asdict(task), self._index)
        self._append({"type": "run", "task": run.task, "after": run.after})
        self.journal.runs.append(run)

    def step(self, step: EvolutionStep, standing: Standing) -> None:
        """A step was accepted; see `evolution.standing.Recorder`. Collective."""
        index, row = self._index + 1, step.row()
        entry = {
            "row": row,
            "number": step.number,
            "length": standing.length,
            "rate": standing.rate,
            "settled": standing.settled,
        }
        if index < len(self.journal.states):
            self._compare(index, self._entry(standing.moment, step.status))
            self._index, self._last = index, standing.moment
            return
        self._keep(index, standing.moment, entry, step.status)

    def end(self, history: History) -> None:
        """A run has ended; see `evolution.standing.Recorder`. Collective."""
        run, left = self.journal.runs[-1], len(self.journal.states) - 1 - self._index
        message = f"the run ends {left} steps before the one that was recorded: {history.reason}"
        require(self.comm, left == 0, message)
        self._append({"type": "end", "reason": history.reason, "complete": history.complete})
        run.reason, run.complete = history.reason, history.complete

    def _keep(
        self, index: int, moment: Moment, more: Mapping[str, Any], letters: str | None = None
    ) -> None:
        """Put a state on the disk, which stands in the problem. Collective."""
        entry = {"index": index} | self._entry(moment, letters or self._letters()) | dict(more)
        name, vectors = f"state_{index:06d}", self._vectors()
        n = self.problem.equations.owned_sizes[0]
        for key, f in self.evolution.kept.items():
            vectors[key].array[:n] = f.x.array[:n]
        self.problem.write(vectors["x"])
        check_sum = self._checkpoints.write(name, vectors, self._points.gathered(moment))
        for x in vectors.values():
            x.destroy()
        entry |= {"checkpoint": name, "sum": check_sum}
        self._append({"type": "state", **entry})
        self.journal.states.append(entry)
        self._index, self._last = index, moment

    def _vectors(self) -> dict[str, PETSc.Vec]:
        """For what a state has, the unknowns last. Collective."""
        return {name: self.problem.create_vector() for name in (*self.evolution.kept, "x")}

    def _entry(self, moment: Moment, letters: str) -> dict[str, Any]:
        """What the journal says of every state. Collective."""
        square = self.comm.allreduce(float(np.dot(moment.unknowns, moment.unknowns)))
        return {
            "time": moment.time,
            "status": letters,
            "norm": float(np.sqrt(square)),
            "energies": asdict(moment.energies),
            "data": numbers_of(self.problem.equations),
        }

    def _letters(self) -> str:
        """Letters of the statuses that stand in the surfaces, as those of a step. Collective."""
        return "".join(self.problem.table(s).status for s in self.problem.surfaces)

    def _compare(self, index: int, found: Mapping[str, Any]) -> None:
        """Refuse a state that is not the one that was recorded. Collective."""
        recorded = self.journal.states[index]
        self._require_data(recorded["data"], found["data"], found["time"])
        a, b = ([s["time"], s["norm"], *s["energies"].values()] for s in (recorded, found))
        scales = [abs(a[0]), a[1], *[max(map(abs, a[2:]))] * len(a[2:])]
        same = recorded["status"] == found["status"] and all(
            abs(p - q) <= _COINCIDE * scale for p, q, scale in zip(a, b, scales, strict=True)
        )
        message = (
            f"step {index} was recorded at the time {recorded['time']:.12g}, status "
            f"{recorded['status']}, and is now found at {found['time']:.12g}, status "
            f"{found['status']}: the problem has changed"
        )
        require(self.comm, same, message)

    # -- going on --------------------------------------------------------------------------------

    def go_on(
        self,
        *,
        accept: Callable[[EvolutionStep], bool] | None = None,
        observer: Callable[[EvolutionStep], object] | None = None,
        progress: bool | None = None,
    ) -> History:
        """Go on with the last run as it was begun; one that has ended stays as it is. Collective.

        The evolution is at the end of the record then, and may run on with ``record=`` this record.

        Args:
            accept: the same as at the beginning, if there was one.
            observer: told of the steps that are computed, beside the record.
            progress: see `QuasiStatic.run`.

        Returns:
            The steps that were computed; the journal has all.

        Raises:
            NoContinuation: as `QuasiStatic.run`.
            ValueError: on every rank, if no run was recorded, its checkpoints are damaged, or the
                problem is not that of the record.
        """
        if not self.journal.runs:
            raise ValueError(
                f"no run is in {self.folder}: run the evolution from its start, with "
                "EvolutionRecord(..., resume=True), or remove the folder"
            )
        run, states = self.journal.runs[-1], self.journal.states
        if run.reason:
            self._index = len(states) - 1
            self._last = self._moment(self._index)
            self.evolution.put(self._standing_at(self._index, math.inf))
            history = History(self._last.time, self._last.energies)
            history.reason, history.complete = run.reason, run.complete
            return history
        task = Task(**run.task | {"times": tuple(run.task["times"])})
        standing = self._standing(run, task)
        return self.evolution.go_on(
            task, standing, accept=accept, observer=observer, record=self, progress=progress
        )

    def _standing(self, run: EvolutionRun, task: Task) -> Standing:
        """The last one of a run whose checkpoint is whole. Collective."""
        states = self.journal.states
        known = [i for i in range(run.after + 1, len(states)) if states[i]["settled"]]
        for index in (*reversed(known), run.after):
            try:
                moment = self._moment(index)
            except ValueError as error:
                if "damaged" not in str(error) or index == run.after:
                    raise
                if self.comm.rank == 0:
                    logger.warning("%s; going back to one before", error)
                continue
            break
        self._index, self._last = index, moment
        return self._standing_at(index, task.longest if index == run.after else None)

    def _standing_at(self, index: int, length: float | None) -> Standing:
        """Where a run stood at a state, which is `_last`.

        Args:
            index: of the state.
            length: no longer is the next step; None for what the run had found.
        """
        assert self._last is not None
        state = self.journal.states[index]
        longest = state["length"] if length is None else length
        # The start is no step.
        return Standing(self._last, longest, state.get("rate"), state.get("number", 0))

    def _moment(self, index: int) -> Moment:
        """A recorded state, put into the problem. Collective.

        Raises:
            ValueError: on every rank, if it is damaged, or of another load.
        """
        problem, state = self.problem, self.journal.states[index]
        vectors, n = self._vectors(), problem.equations.owned_sizes[0]
        self._checkpoints.read(state["checkpoint"], state["sum"], vectors)
        found = self._checkpoints.arrays(state["checkpoint"])
        problem.put(vectors["x"], self._points.statuses(found))
        for key, f in self.evolution.kept.items():
            f.x.array[:n] = vectors[key].array_r[:n]
            f.x.scatter_forward()
        for x in vectors.values():
            x.destroy()
        memory = self._points.memory(found)
        energies = self.evolution.account(**state["energies"])
        moment = self.evolution.recalled(state["time"], memory, energies, first=index == 0)
        self._require_data(state["data"], numbers_of(problem.equations), state["time"])
        return moment

    def show(self, index: int) -> None:
        """Put a recorded state into the problem, for tables, fields and pictures. Collective.

        The evolution stays where it is, and is put back there by the next run.

        Args:
            index: of the step; 0 is the start.

        Raises:
            ValueError: on every rank, if there is none, or it is damaged.
        """
        same_everywhere(self.comm, index=index)
        last = len(self.journal.states) - 1
        known = isinstance(index, int | np.integer) and 0 <= index <= last
        require(self.comm, known, f"steps 0 to {last} are recorded, not {index}")
        if index == 0:
            self._moment(0)
            return
        before = self._moment(index - 1)
        step = self._moment(index).time - before.time
        later = [None if m is None else m.later(step) for m in before.memory]
        self.problem.equations.remember(later)

    @contextmanager
    def looking(self) -> Iterator[None]:
        """Put back at the end what stands in the problem, whatever was shown. Collective."""
        eq = self.problem.equations
        memory, data = eq.memory, GivenData(eq)
        try:
            with self.problem.restored(always=True):
                yield
        finally:
            eq.remember(memory)
            data.restore()

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
            self.show(index)
            tables = [self.problem.table(s) for s in self.problem.surfaces]
        write_contact_table(self.comm, output_folder(self.comm, folder), tables)
