# SPDX-License-Identifier: LGPL-3.0-or-later
"""What records of histories and of paths share: states step by step, on the disk and from there.

A record is a folder with the journal (`journal.py`: energies and statuses of every
accepted step) and a checkpoint of every step: displacement, multipliers, rigid bodies, statuses and
memory. All of a step is on the disk before the next one is computed. Resumed, on any number of
ranks, a run continues from the last step that suffices for it. Those recorded beyond it are
computed once more, must coincide with the record, and are not recorded again.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Generic, TypeVar

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl

from dolfinx_contact._errors import everywhere, require, same_everywhere
from dolfinx_contact.continuation.ending import Ends
from dolfinx_contact.equations.given_data import Datum, GivenData, given_data, numbers_of
from dolfinx_contact.equations.measures import Scales
from dolfinx_contact.equations.order import Gathered
from dolfinx_contact.evolution import EvolutionStep
from dolfinx_contact.evolution.accepted import AcceptedState
from dolfinx_contact.evolution.motion import MovingState
from dolfinx_contact.evolution.run_state import RunState
from dolfinx_contact.io.folder import output_folder
from dolfinx_contact.io.table import write_contact_table
from dolfinx_contact.parametric import ParametricContact
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.records.entries import EndEntry, Entry, StateEntry
from dolfinx_contact.records.identity import identity, other_data
from dolfinx_contact.records.journal import EvolutionJournal, EvolutionRun
from dolfinx_contact.records.kept_data import KeptData
from dolfinx_contact.records.problem_record import ProblemRecord

__all__ = ["StepsRecord"]

logger = logging.getLogger(__name__)

Arrays = dict[str, npt.NDArray[Any]]

_BALANCED = 1e-6  # of forces that are evaluated once more
_ROUND_OFF = 1e-9  # of a stiffness times a displacement
#: What forces are known by: in words, and the size of one that is none.
_FORCES = {
    "residual": ("the relative residual", 1.0),
    "rows": ("the norm of the forces of the body", 0.0),
    "kinetic": ("the kinetic energy", 0.0),
}


@dataclass(frozen=True, kw_only=True)
class _Found:
    """What a state that is computed once more is known by; see `StateEntry`."""

    index: int
    time: float
    status: str
    size: float
    energies: dict[str, float]
    data: list[list[float]]


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
        resume: whether to continue a record that exists. Else there must be none.
        data: Functions and Constants beside those of the problem, with their places.
        forms: beside those of the problem.
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
        resume: bool,
        data: Sequence[Datum] = (),
        forms: Sequence[ufl.Form] = (),
        driven: Sequence[Any] = (),
    ):
        problem = system if isinstance(system, ContactProblem) else system.problem
        same_everywhere(problem.comm, resume=bool(resume))
        super().__init__(
            folder, problem, kind, surface_displacement=surface_displacement, resume=resume
        )
        self._system = system
        self._points = _AtPoints(problem)
        self._last: AcceptedState | None = None  # where the runs stand
        self._index = -1  # of that state
        self._resumed_state: S | None = None  # where a run that was recorded continues
        try:
            self._data = KeptData(problem, self._checkpoints, more=data)
            # The values of all data are compared state by state.
            known = identity(
                problem,
                but=given_data(problem.equations),
                forms=forms,
                functions=self._data.elements,
                driven=driven,
            )
            words = list(method)
            self._require_same(known, method=words)
            if self.journal.states:
                self._require_load(self.journal.states[-1])
            self._begin(known, method=words)
        except Exception:
            self.close()
            raise

    def _require_load(self, state: StateEntry[Any]) -> None:
        """Refuse a load that is not the recorded one at a state. Collective."""
        with self.looking():
            with everywhere(self.comm, f"the load at {self._along} {state.time:g}"):
                self._load(state)
            self._require_data_of(state, numbers_of(self.problem.equations))

    def _require_data_of(self, state: StateEntry[Any], found: list[list[float]]) -> None:
        """Refuse data that are not those of a state. Collective."""
        self._require_data(
            self._data,
            state.values,
            {s.checkpoint: s.sum for s in self.journal.states},
            other=other_data(self.problem, state.data, found),
            at=f" at {self._along} {state.time:.10g}",
        )

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
            self._keep(state, self._found(0, accepted, self._letters()))
        elif len(states) == 1 and self._last is None:
            self._compare(self._found(0, accepted, self._letters()))
            self._index = 0
            self._last = accepted
        at_the_end = self._index == len(states) - 1 and self._last is accepted
        if not at_the_end and self._last is not None and self._index == len(states) - 1:
            self._require_no_change(self._last, accepted)
        message = (
            f"the {self._what} is at {self._along} {accepted.time:.10g} and not at the end of the "
            f"record in {self.folder}, which is at {states[-1].time:.10g}: continue with "
            f"{type(self).__name__}(..., resume=True).go_on(), or record to another folder"
        )
        require(self.comm, at_the_end, message)
        run = EvolutionRun(task=asdict(task), after=self._index)
        self._append({"type": "run", "task": run.task, "after": run.after})
        self.journal.runs.append(run)

    def _require_no_change(self, last: AcceptedState, accepted: AcceptedState) -> None:
        """Refuse a run whose start has other data than the end of the record. Collective."""
        changed = ""
        if accepted.time == last.time:
            changed = last.data.changed(self.comm, accepted.data)
        require(
            self.comm,
            not changed,
            f"since the {self._what} came to the end of the record in {self.folder}, at "
            f"{self._along} {last.time:.10g}, {changed} has changed: a record is resumed with the "
            "data of its script and what the load sets, so put back what was there, leave to the "
            "load what changes in time, or record to another folder",
        )

    def step(self, step: EvolutionStep, state: S) -> None:
        index = self._index + 1
        found = self._found(index, state.accepted, step.status)
        if index < len(self.journal.states):
            self._compare(found)
            self._index = index
            self._last = state.accepted
            return
        self._keep(state, found, step.row())

    def end(self, ended: Ends) -> None:
        run = self.journal.runs[-1]
        left = len(self.journal.states) - 1 - self._index
        message = f"the run ends {left} steps before the one that was recorded: {ended.reason}"
        require(self.comm, left == 0, message)
        if ended.ending is not None:
            end = EndEntry(ending=ended.ending, reason=ended.reason)
            self._append({"type": "end", **end.line()})
            run.end(ended.ending, ended.reason)

    def _keep(self, run_state: S, found: _Found, row: dict[str, Any] | None = None) -> None:
        """Put a state on the disk, which is in the problem. Collective."""
        forces = self._forces(run_state.accepted)
        run = self._entry_of(run_state)
        name = f"state_{found.index:06d}"
        vectors = self._vectors()
        self._fill(vectors, run_state)
        self.problem.write(vectors["x"])
        arrays = self._points.gathered(run_state.accepted)
        functions = self._data.changed()
        check_sum = self._checkpoints.write(name, vectors, arrays, functions)
        for x in vectors.values():
            x.destroy()
        entry = StateEntry(
            **vars(found),
            row=row,
            forces=forces,
            first=run_state.accepted.statuses is None,
            run=run,
            checkpoint=name,
            sum=check_sum,
            values=self._data.are_kept(name, functions),
            surface=name if self._shows else None,
        )
        self._append({"type": "state", **entry.line()})
        self.journal.states.append(entry)
        self._index = found.index
        self._last = run_state.accepted

    def _vectors(self) -> dict[str, PETSc.Vec]:
        """For what a state has, the unknowns last. Collective."""
        return {name: self.problem.create_vector() for name in (*self._names(), "x")}

    def _found(self, index: int, accepted: AcceptedState, letters: str) -> _Found:
        """What is compared of a state. Collective."""
        square = self.comm.allreduce(float(np.dot(accepted.unknowns, accepted.unknowns)))
        return _Found(
            index=index,
            time=accepted.time,
            status=letters,
            size=float(np.sqrt(square)),
            energies=asdict(accepted.energies),
            data=numbers_of(self.problem.equations),
        )

    def _letters(self) -> str:
        """Letters of the statuses that stand in the surfaces, as those of a step. Collective."""
        return "".join(self.problem.table(s).status for s in self.problem.surfaces)

    def _compare(self, found: _Found) -> None:
        """Refuse a state that is not the one that was recorded. Collective."""
        recorded = self.journal.states[found.index]
        self._require_data_of(recorded, found.data)
        a, b = ([s.time, s.size, *s.energies.values()] for s in (recorded, found))
        scales = [abs(a[0]), a[1], *[max(map(abs, a[2:]))] * len(a[2:])]
        self._require_again(
            f"step {found.index}",
            self._along,
            (recorded.time, recorded.status),
            (found.time, found.status),
            zip(a, b, scales, strict=True),
        )

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
            ValueError: on every rank, if it is damaged, or of another load.
        """
        problem = self.problem
        state = self.journal.states[index]
        vectors = self._vectors()
        self._checkpoints.read(state.checkpoint, state.sum, vectors)
        found = self._checkpoints.arrays(state.checkpoint)
        problem.put(vectors["x"], self._points.statuses(found))
        run_state = self._recalled(state, vectors, found, state.first)
        for x in vectors.values():
            x.destroy()
        self._require_data_of(state, numbers_of(problem.equations))
        self._require_forces(state, run_state.accepted)
        return run_state

    def _require_forces(self, state: StateEntry[Any], accepted: AcceptedState) -> None:
        """Refuse a problem whose forces at a recorded state are not those of then. Collective."""
        recorded = state.forces
        found = self._forces(accepted)
        least = found["least"]
        for name, (words, unit) in _FORCES.items():
            if name not in recorded or name not in found:
                continue
            a = recorded[name]
            b = found[name]
            size = max(abs(a), abs(b), unit)
            allowed = _BALANCED * size + (least if name == "rows" else 0.0)
            same = abs(a - b) <= allowed or (np.isnan(a) and np.isnan(b))
            other = (
                f"at {self._along} {state.time:.10g} {words} was {a:.6g} and is now {b:.6g}: "
                "something is not as it was recorded that data and forms do not show"
            )
            self._require_no_other("" if same else other)

    def _forces(self, accepted: AcceptedState) -> dict[str, float]:
        """What forces at a state, which is in the problem, are known by. Collective."""
        eq = self.problem.equations
        if isinstance(accepted, MovingState):
            rows = accepted.motion.rows
            u = accepted.motion.u
            square = self.comm.allreduce(float(np.dot(rows, rows)))
            largest = self.comm.allreduce(float(np.max(np.abs(u), initial=0.0)), op=max)
            return {
                "rows": float(np.sqrt(square)),
                "kinetic": accepted.motion.kinetic,
                "least": _ROUND_OFF * eq.stiffness_scale * largest,
            }
        state = self.problem.with_memory(accepted.memory).evaluate()
        residual = Scales(eq, settled=True).measure(state).worst
        return {"residual": residual, "least": 0.0}

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
        later = [None if m is None else m.later(step) for m in before.memory]
        return self.problem.with_memory(later)

    @contextmanager
    def looking(self) -> Iterator[None]:
        """Put back at the end what is in the problem, whatever was shown. Collective."""
        eq = self.problem.equations
        data = GivenData(eq)
        try:
            with self._system.restored(always=True):
                yield
        finally:
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
            shown = self.show(index)
            tables = [shown.table(s) for s in self.problem.surfaces]
        write_contact_table(self.comm, output_folder(self.comm, folder), tables)


class _AtPoints:
    """Statuses and memory of the points of all surfaces, for any number of ranks. Collective.

    A surface has them in the order of its table: by place, and points at one place (the sides of a
    crack) by their nodes in the mesh as it was given to DOLFINx.

    Args:
        problem: whose surfaces have them.
    """

    def __init__(self, problem: ContactProblem):
        self._problem = problem
        self._surfaces = [Gathered(s.comm, s.positions, s.points.ids) for s in problem.surfaces]

    def gathered(self, accepted: AcceptedState) -> Arrays:
        """What the points of all ranks have at a state, by name, on every rank. Collective."""
        found: Arrays = {}
        every = zip(self._surfaces, accepted.shown, accepted.memory, strict=True)
        for i, (surface, codes, memory) in enumerate(every):
            found[f"{i}.statuses"] = surface(codes)
            for name, values in _arrays(memory).items():
                found[f"{i}.memory.{name}"] = surface(values)
        return found

    def statuses(self, found: Mapping[str, npt.NDArray[Any]]) -> list[npt.NDArray[np.int8]]:
        """The statuses of the points of this rank, surface by surface."""
        return [found[f"{i}.statuses"][s.mine] for i, s in enumerate(self._surfaces)]

    def memory(self, found: Mapping[str, npt.NDArray[Any]]) -> tuple[Memory | None, ...]:
        """The memory of the points of this rank, surface by surface.

        That of faces that slide has the displacement, and that on a rigid body that turns its
        motion, which are those of the problem.
        """
        u = self._problem.u.x.array.reshape(-1, self._problem.equations.dim)
        memories: list[Memory | None] = []
        for i, (surface, s) in enumerate(zip(self._surfaces, self._problem.surfaces, strict=True)):
            start = f"{i}.memory."
            names = [name for name in found if name.startswith(start)]
            arrays = {name.removeprefix(start): found[name][surface.mine] for name in names}
            jump = arrays.pop("jump", None)
            place = arrays.pop("place", None)
            displacement = u[: s.owned_nodes] if s.slides else None
            memory = None
            if jump is not None:
                body = s.rigid_body
                motion = body.values if body is not None and s.turns else None
                memory = Memory(jump, arrays, 0.0, None, displacement, place, motion)
            memories.append(memory)
        return tuple(memories)


def _arrays(memory: Memory | None) -> Arrays:
    """All arrays of a memory, whichever it has."""
    if memory is None:
        return {}
    place = {} if memory.place is None else {"place": memory.place}
    return {"jump": memory.jump, **place, **memory.fields}
