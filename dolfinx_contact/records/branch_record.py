# SPDX-License-Identifier: LGPL-3.0-or-later
"""Record of branches, from which an interrupted continuation can be resumed.

The journal contains gamma, functionals, statuses, step data and special points of every accepted
point. Checkpoints with unknowns and tangent are written at some points only. This is sufficient,
because a branch that is resumed from a checkpoint passes through the same points again.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from dolfinx_contact._mpi import require, same_everywhere
from dolfinx_contact.continuation import (
    Branch,
    BranchPoint,
    BranchStep,
    Diagram,
    Ending,
    Ends,
    ObserverLike,
    Route,
    StepControl,
    Stepping,
    Stop,
    Task,
    follower_for,
)
from dolfinx_contact.continuation.arguments import check_listeners, check_steps
from dolfinx_contact.equations.data import data_within
from dolfinx_contact.records.branch_entries import BranchEntries
from dolfinx_contact.records.functionals import Functional, evaluators
from dolfinx_contact.records.journal import Explored, Journal
from dolfinx_contact.records.manifest import manifest_of, memory_of, values_of
from dolfinx_contact.records.record import Record, Resume

if TYPE_CHECKING:
    from dolfinx_contact.parametric import ParametricContact

__all__ = ["BranchRecord"]


class BranchRecord(Record[Journal]):
    """Record of branches of a contact problem in a folder. Collective.

    An open record holds a file lock, so that no other process can write to it. If ``mpirun`` is
    killed and some of its ranks survive, they keep the lock until they are terminated.

    A record can only be resumed with the same problem. It stores a manifest: the mesh, the forms
    and their domains of integration, Dirichlet conditions and expressions of gamma in them,
    surfaces and laws, the values of all Constants and Functions, the memory of a step, and the
    names of the functionals. The manifest is compared once on resumption; an error names the first
    difference.

    Args:
        folder: folder of the record, created if necessary.
        system: contact problem with a parameter whose branches are followed.
        functionals: functions by name, which are called on every rank with the contact problem and
            return a real number. A record must be resumed with the same functionals, but only their
            names are compared.
        every: number of points between two checkpoints; default: 10. Checkpoints are also written
            at special points and at both ends.
        surface_displacement: whether the displacement of the outer surface is recorded at every
            point, in single precision, for the explorer. Ignored if a record is resumed, which
            keeps its original setting.
        resume: True to continue an existing record, False to begin a new one, "if_exists" for
            either.

    Attributes:
        journal: content of the journal, on every rank.

    Raises:
        OSError: on every rank, if the folder cannot be written to, another run records there, or
            the existence of a record contradicts ``resume``. Later, during the continuation, if a
            point cannot be written: the record then ends with the previous point and can be
            resumed.
        ValueError: on every rank, if the journal is corrupt or belongs to another problem, or if
            arguments differ between ranks. Nothing is written in this case.

    Example:
        Follow a branch with a record, and read the record::

            push = {"push": total("rt")}
            with BranchRecord("output/branch", system, push) as record:
                branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0), record=record)
            table = read_journal("output/branch").to_pandas()  # one row per point

        If the run is interrupted, a script with the same system continues it::

            with BranchRecord("output/branch", system, push, resume=True) as record:
                branch = record.go_on()
    """

    _part = "branch {}"

    def __init__(
        self,
        folder: str | os.PathLike[str],
        system: ParametricContact,
        functionals: Mapping[str, Functional] | None = None,
        *,
        every: int = 10,
        surface_displacement: bool = False,
        resume: Resume = False,
    ):
        if not (functionals is None or isinstance(functionals, Mapping)):
            raise ValueError(f"functionals must be a dictionary by name, got {functionals!r}")
        comm = system.comm
        valid = isinstance(every, int | np.integer) and every >= 1
        require(comm, valid, f"every must be an integer of at least 1, got {every!r}")
        same_everywhere(comm, every=int(every))
        self.system = system
        self.every = every
        self._functionals = dict(functionals or {})
        self._entries = BranchEntries(system, evaluators(system.problem, self._functionals))
        self._last: tuple[BranchPoint, int] | None = None  # last point, and its number
        super().__init__(
            folder,
            system.problem,
            Journal,
            surface_displacement=surface_displacement,
            resume=resume,
        )

    def _header(self) -> dict[str, Any]:
        system = self.system
        driven = system._driven_expressions
        recorded = self.journal.header
        new = manifest_of(system.problem, driven=driven)
        new["parts"]["the functionals"] = list(self._functionals)
        # data may depend on gamma: compare them at the gamma of the first session
        gamma = float(recorded.get("gamma", system.constant.value))
        with system.restored(always=True):
            system._set(gamma)
            new["values"] = values_of(
                system.problem,
                more=data_within(driven),
                but=[*(d.function for d in system._driven), system.constant],
            )
        new["values"] |= memory_of(system.problem)
        self._require_same(recorded, new)
        return {**new, "functionals": list(self._functionals), "gamma": gamma}

    # -- Observer --------------------------------------------------------------------------------

    def begin(self, task: Task, state: Stepping) -> None:
        """Record the beginning of a branch, or compare it with the recorded beginning."""
        self._branch = task.branch
        self._last = None
        self._begin(vars(task), free=("max_steps", "to_node"))

    def step(self, step: BranchStep, state: Stepping) -> None:
        """Record a point, unless it was recorded before an interruption."""
        point = step.point
        number = len(self.journal.branches[self._branch].points)
        self._last = point, step.index
        if step.index < number:
            return
        message = f"point {step.index} cannot follow the {number} recorded of branch {self._branch}"
        require(self.comm, step.index == number, message)
        entry = self._entries.point(step.index, point, step.special, state.x_scale)
        name = _name(self._branch, step.index)
        keys: dict[str, str] = {}
        if step.index % self.every == 0 or step.special or state.ending is not None:
            keys = self._write_point_fields(name, point)
        more = {
            "next_step": state.next_step,
            "x_scale": state.x_scale,
            "largest_distance": state.largest_distance,
            "scales": state.scales,
            "ending": state.ending,
            "reason": state.reason,
        }
        self._write_point(name, {**entry, **more, **keys}, self.problem)

    def end(self, ended: Ends) -> None:
        """Record the end of a branch, with a checkpoint of its last point."""
        points = self.journal.branches[self._branch].points
        # if later points are already recorded, the branch does not end here
        if self._last is None or ended.ending is None or self._last[1] < len(points) - 1:
            return
        point, index = self._last
        keys: dict[str, str] = {}
        if points[-1].checkpoint is None:
            keys = self._write_point_fields(_name(self._branch, index), point)
        self._write_end(ended, keys)

    def explored(self, diagram: Diagram) -> None:
        """Record the new nodes and edges of a diagram and the end of the exploration."""
        journal = self.journal
        for number, node in enumerate(diagram.nodes):
            # a resumed exploration repeats the recorded nodes, with fewer rays at first
            entry = self._entries.node(node)
            known = journal.nodes[number] if number < len(journal.nodes) else None
            if known is None or _size(entry) > _size(known):
                self._append({"type": "node", "node": number, **entry})
        for number, edge in list(enumerate(diagram.edges))[len(journal.edges) :]:
            ends = {"branch": number, "start": edge.start, "end": edge.end}
            self._append({"type": "edge", **ends})
        ended = Explored(diagram.ending, diagram.reason, diagram.complete)
        if diagram.ending is not None and ended != journal.explored:
            self._append({"type": "explored", **vars(ended)})

    def _write_point_fields(self, name: str, point: BranchPoint) -> dict[str, str]:
        """Write a checkpoint of a point; return its name and fingerprint. Collective."""
        arrays = self._states.of_vectors(self._entries.split(point))
        keys = self._write_arrays("checkpoint", name, arrays)
        self._entries.put(point)  # observers are called with the point in the problem
        return keys

    # -- continuing --------------------------------------------------------------------------------

    def last_state(self, branch: int = 0) -> tuple[BranchPoint, Stepping] | None:
        """Return the last point of a branch with a checkpoint, and its step data. Collective.

        None if there is none. A corrupt checkpoint is skipped, with a warning in the log.

        Raises:
            ValueError: on every rank, if all checkpoints are corrupt.
        """
        known = self.journal.branches.get(branch)
        if known is None or not known.kept:
            return None
        return self._last_undamaged(known.kept[::-1], lambda index: self.state(branch, index))

    def state(self, branch: int, index: int) -> tuple[BranchPoint, Stepping]:
        """Return a point with unknowns and tangent, and its data for continuation. Collective.

        Raises:
            ValueError: on every rank, if the point has no checkpoint, or the checkpoint is corrupt.
        """
        p = self.journal.branches[branch].points[index]
        if p.checkpoint is None:
            raise ValueError(f"point {index} of branch {branch} has no checkpoint")
        self._read_checkpoint(p, self._entries.vectors, {})
        point = self._entries.joined(p)
        stepping = Stepping(index, p.next_step, p.x_scale, p.largest_distance, tuple(p.scales))
        return point, stepping

    def points(self, branch: int = 0) -> list[BranchPoint]:
        """Return the points of a branch that have a checkpoint, with unknowns. Collective."""
        return [self.state(branch, index)[0] for index in self.journal.branches[branch].kept]

    def go_on(
        self,
        branch: int = 0,
        *,
        max_steps: int | None = None,
        stop: Stop[BranchStep] | None = None,
        observer: ObserverLike[BranchStep] | None = None,
        progress: bool | None = None,
    ) -> Branch:
        """Continue a branch with its recorded task. Collective.

        A branch that has ended is not continued, unless it ended at the maximum number of steps and
        ``max_steps`` is larger.

        Args:
            branch: number of the branch.
            max_steps: new maximum number of steps, counted from the start of the branch; default:
                the recorded number.
            stop: stop condition of the original run, if any.
            observer: function called with every point computed by this call, after the point has
                been recorded.
            progress: whether rank 0 shows the progress, see `follow`.

        Returns:
            Part of the branch from the last checkpoint; the journal contains the whole branch.

        Raises:
            ValueError: on every rank, if no point of the branch was recorded, or if all checkpoints
                are corrupt.
        """
        if max_steps is not None:
            check_steps(None, max_steps)
        check_listeners(observer=observer, progress=progress, stop=stop)
        same_everywhere(self.comm, branch=branch, max_steps=max_steps)
        state = self.last_state(branch)
        if state is None:
            raise ValueError(
                f"no point of branch {branch} is in {self.folder}: follow it from its start, with "
                "BranchRecord(..., resume=True), or remove the folder"
            )
        point, stepping = state
        known = self.journal.branches[branch]
        task = known.task
        budget = task["max_steps"] if max_steps is None else max_steps
        exhausted = known.ending is Ending.BUDGET and budget >= len(known.points)
        if known.ending is not None and not exhausted:
            return Branch([point], ending=known.ending, reason=known.reason)
        origin = self.state(branch, 0)[0] if stepping.index else None
        # pivoting has no step length
        route: Route = "steps" if stepping.next_step > 0 else "pivoting"
        x = self._entries.split(point)["x"]
        control, scale = StepControl(**task["control"]), task["gamma_scale"]
        with (
            self.system.restored(),
            follower_for(
                self.system, x, point.gamma, control, gamma_scale=scale, route=route
            ) as follower,
        ):
            return follower.run(
                point,
                gamma_range=tuple(task["gamma_range"]),
                max_steps=budget,
                to_node=task["to_node"],
                stop=stop,
                observer=observer,
                record=self,
                progress=progress,
                branch_id=branch,
                stepping=stepping,
                origin=origin,
            )


def _size(node: Mapping[str, Any]) -> int:
    """Return the number of rays of a recorded node plus the number of rays already followed."""
    return len(node["rays"]) + sum(edge is not None for edge in node["edges"])


def _name(branch: int, index: int) -> str:
    """Return the name of the array files of a point of a branch."""
    return f"branch_{branch:04d}_point_{index:06d}"
