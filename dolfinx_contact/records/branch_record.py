# SPDX-License-Identifier: LGPL-3.0-or-later
"""The record of a continuation, from which a killed run is resumed.

A record is a folder with the journal (gamma, functionals, statuses, step data and special points of
every accepted point) and checkpoints (unknowns and tangent of some points). A resumed run continues
from the last checkpoint to the same points; points that were recorded after it are computed again
and not recorded again.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._errors import require, same_everywhere
from dolfinx_contact.continuation import (
    Branch,
    BranchPoint,
    BranchStep,
    Diagram,
    Ending,
    Ends,
    ObserverLike,
    Route,
    Stepping,
    Stop,
    Task,
    follower_for,
)
from dolfinx_contact.continuation.arguments import check_listeners, check_steps
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.equations.data import data_within
from dolfinx_contact.records.columns import (
    BranchTask,
    EndEntry,
    JournalEdge,
    JournalNode,
    plain,
)
from dolfinx_contact.records.functionals import Functional, compiled, functional_forms
from dolfinx_contact.records.journal import Explored, Journal
from dolfinx_contact.records.manifest import manifest_of, values_of
from dolfinx_contact.records.points import entry_of, node_of
from dolfinx_contact.records.record import Record, Resume

if TYPE_CHECKING:
    from dolfinx_contact.parametric import ParametricContact

__all__ = ["BranchRecord", "resume"]


#: Items of a task that may change when a branch is continued.
_MAY_CHANGE = ("max_steps", "to_node")


class BranchRecord(Record[Journal]):
    """A record of branches of a contact problem in a folder. Collective.

    While the record is open no other process can write to it; ranks that outlive a killed
    ``mpirun`` hold it until they are ended.

    A record is resumed with the same problem only. It stores a manifest: the mesh, the forms and
    their domains of integration, Dirichlet conditions and the expressions that drive them, surfaces
    and laws, the values of all Constants and Functions, and the forms of the functionals. On
    resumption the manifest is compared once, and the error names the first item that differs.

    Args:
        folder: folder of the record, created if necessary.
        system: contact problem with a parameter whose branches are followed.
        functionals: scalar UFL forms in the problem's Functions, or functions of the problem that
            return a real number, by name; functions are called on every rank. A record is resumed
            with the same functionals; of functions only the names are compared.
        every: number of points between two checkpoints; special points and both ends have one as
            well.
        surface_displacement: whether the displacement of the outer surface is kept at every
            point, in single precision, for `plot.draw_record`. A record that is resumed continues
            as it began.
        resume: True to continue a record that exists, False to begin one where there is none,
            "if_exists" for either.

    Attributes:
        journal: content of the journal, on every rank.

    Raises:
        OSError: on every rank, if the folder cannot be written to, another run records there,
            there is a record and it is not to be resumed, or the other way round. Later, from
            whatever follows a branch, if a point cannot be written: the record then ends with the
            point before, and can be resumed.
        ValueError: on every rank, if the journal is damaged or that of another problem, or
            arguments differ between ranks. Nothing has been written then.

    Example:
        Follow a branch with a record, and read it::

            push = {"push": ufl.dot(traction, u) * ds}
            with BranchRecord("output/branch", system, push) as record:
                branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0), record=record)
            table = read_journal("output/branch").to_pandas()  # pandas, a row a point

        If the run is killed, the same script continues with ``resume``::

            branch = resume("output/branch", system, push)
    """

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
            raise ValueError(f"functionals are a dictionary by their names, got {functionals!r}")
        comm = system.comm
        whole = isinstance(every, int | np.integer) and every >= 1
        require(comm, whole, f"fields must be kept at every 1 or more points, got {every!r}")
        same_everywhere(comm, every=int(every))
        self.system = system
        self.every = every
        self._functionals = compiled(system.problem, functionals or {})
        super().__init__(
            folder,
            system.problem,
            Journal,
            surface_displacement=surface_displacement,
            resume=resume,
        )
        self._layout = Layout(system)
        self._x = system.create_vector()
        self._mx = system.create_vector()
        self._last: tuple[BranchPoint, Stepping] | None = None
        self._branch = 0
        try:
            self._open(functionals or {})
        except Exception:
            self.close()
            raise

    def _open(self, functionals: Mapping[str, Functional]) -> None:
        """Compare the manifest with that of the problem, and begin a session. Collective."""
        system = self.system
        driven = system._driven_expressions
        header = self.journal.header
        now = manifest_of(system.problem, driven=driven)
        now["parts"]["the functionals"] = list(functionals)
        now["forms"] |= functional_forms(system, functionals)
        gamma = float(header.get("gamma", system.constant.value))
        with system.restored(always=True):
            system._set(gamma)
            now["values"] = values_of(
                system.problem,
                more=data_within(driven),
                but=[*system._driven_functions, system.constant],
            )
        if header:
            self._require_same(header, now)
        self._begin_session(now, functionals=list(functionals), gamma=gamma)

    def close(self) -> None:
        """Close the journal; the record can then be resumed."""
        super().close()
        for v in (self._x, self._mx):
            v.destroy()

    # -- Observer --------------------------------------------------------------------------------

    def begin(self, task: Task, state: Stepping) -> None:
        branch = self._branch = task.branch
        new = BranchTask(
            gamma_range=[float(g) for g in task.gamma_range],
            gamma_scale=float(task.gamma_scale),
            control=task.control,
            max_steps=task.max_steps,
            to_node=task.to_node,
        )
        known = self.journal.branches.get(branch)
        if known is None:
            self._append({"type": "branch", "branch": branch, "task": plain(new)})
            return
        tasks = [plain(self._task(branch)), plain(new)]
        recorded, now = ({k: v for k, v in t.items() if k not in _MAY_CHANGE} for t in tasks)
        self._require_same({"task": recorded}, {"task": now}, f" in the task of branch {branch}")

    def step(self, step: BranchStep, state: Stepping) -> None:
        branch = step.branch
        index = step.index
        point = step.point
        recorded = self.journal.branches[branch].points
        self._last = point, state
        if index < len(recorded):  # recorded before the run was killed
            return
        norm = self._norm(point.y, state)
        entry = entry_of(self.system, index, point, step.special, norm)
        follows = index == len(recorded)
        message = f"point {index} cannot follow the {len(recorded)} recorded of branch {branch}"
        require(self.comm, follows, message)
        ends = state.ending is not None
        if index % self.every == 0 or step.special or ends:
            name, check_sum = self._checkpoint(branch, index, point)
            entry = replace(entry, checkpoint=name, sum=check_sum)
        values = {}
        for name, functional in self._functionals.items():
            self._put(point)  # a functional may have written to the Functions
            values[name] = functional()
        self._put(point)
        surface = self._write_surface(_name(branch, index), self.problem) if self._shows else None
        entry = replace(
            entry,
            functionals=values,
            next_step=state.next_step,
            x_scale=state.x_scale,
            largest_distance=state.largest_distance,
            scales=list(self.system.scales),
            tangent_gamma=self._layout.gamma(point.tangent),
            surface=_name(branch, index) if self._shows else None,
            surface_sum=surface,
            ending=state.ending,
            reason=state.reason if ends else None,
        )
        line = plain(entry)
        if recorded and recorded[-1].status == entry.status:
            del line["status"]
        self._append({"type": "point", "branch": branch, **line})

    def end(self, ended: Ends) -> None:
        branch = self._branch
        known = self.journal.branches[branch]
        if known.ending is ended.ending or self._last is None or ended.ending is None:
            return
        point, stepping = self._last
        if stepping.index < len(known.points) - 1:
            return  # more was recorded before, after which this is not the end
        end = EndEntry(ending=ended.ending, reason=ended.reason)
        if known.points[-1].checkpoint is None:
            name, check_sum = self._checkpoint(branch, stepping.index, point)
            end = replace(end, checkpoint=name, sum=check_sum)
        self._append({"type": "end", "branch": branch, **plain(end)})

    def explored(self, diagram: Diagram) -> None:
        journal = self.journal
        for number, node in enumerate(diagram.nodes):
            self._keep_node(number, node_of(self.system, self._layout, node))
        for number, edge in enumerate(diagram.edges):
            found = JournalEdge(branch=number, start=edge.start, end=edge.end)
            if number < len(journal.edges):
                continue
            self._append({"type": "edge", **plain(found)})
        ended = Explored(diagram.ending, diagram.reason, diagram.complete)
        if diagram.ending is not None and ended != journal.explored:
            self._append({"type": "explored", **plain(ended)})

    def _keep_node(self, number: int, found: JournalNode) -> None:
        """Write a node, unless all of it is recorded. Collective."""
        nodes = self.journal.nodes
        if number < len(nodes):
            known = nodes[number]
            # A repeated exploration knows fewer rays at first.
            edges = zip(found.edges, known.edges, strict=False)
            if len(found.rays) <= len(known.rays) and all(e in (None, k) for e, k in edges):
                return
        self._append({"type": "node", "node": number, **plain(found)})

    def _checkpoint(self, branch: int, index: int, point: BranchPoint) -> tuple[str, str]:
        """Write unknowns and tangent of a point; name and fingerprint of the checkpoint."""
        name = _name(branch, index)
        t = self.system.create_vector()
        t.array[:] = point.tangent.array_r[: t.getLocalSize()]
        self._unknowns(point.y)
        check_sum = self._write_fields(name, {"tangent": t, "x": self._x})
        t.destroy()
        return name, check_sum

    def _task(self, branch: int) -> BranchTask:
        task = self.journal.branches[branch].task
        assert task is not None
        return task

    # -- continuing --------------------------------------------------------------------------------

    def last_state(self, branch: int = 0) -> tuple[BranchPoint, Stepping] | None:
        """The last point of a branch whose fields were kept; None if there is none. Collective.

        A damaged checkpoint is passed over, with a warning in the log.

        Raises:
            ValueError: on every rank, if all are damaged.
        """
        known = self.journal.branches.get(branch)
        kept = known.kept if known else []
        if not kept:
            return None
        return self._last_undamaged(kept[::-1], lambda index: self.state(branch, index))

    def state(self, branch: int, index: int) -> tuple[BranchPoint, Stepping]:
        """A point whose fields were kept, and what is needed to continue from it. Collective.

        Raises:
            ValueError: on every rank, if there are none, or they are damaged.
        """
        system = self.system
        p = self.journal.branches[branch].points[index]
        if p.checkpoint is None or p.sum is None:
            raise ValueError(f"no fields were kept at point {index} of branch {branch}")
        x, t = (system.create_vector() for _ in range(2))
        self._read_fields(p.checkpoint, p.sum, {"tangent": t, "x": x})
        y = self._layout.joined(x, p.gamma)
        tangent = self._layout.joined(t, p.tangent_gamma)
        piece = system.piece_of(p.status)
        for v in (x, t):
            v.destroy()
        system.scales = tuple(p.scales)
        point = BranchPoint(y, tangent, piece, p.gamma, p.step, p.corrections, p.tau)
        stepping = Stepping(index, p.next_step, p.x_scale, p.largest_distance)
        return point, stepping

    def points(self, branch: int = 0) -> list[BranchPoint]:
        """All points of a branch whose fields were kept. Collective."""
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
        """Continue a branch as it was begun; one that has ended stays as it is. Collective.

        Args:
            branch: number of the branch.
            max_steps: another budget, counted from the start of the branch.
            stop: the same stop condition as at the beginning, if there was one.
            observer: called with every point after the last checkpoint, beside the record.
            progress: see `follow`.

        Returns:
            The branch from the last checkpoint on; the journal has all of it.

        Raises:
            ValueError: on every rank, if nothing of the branch was recorded, its checkpoints are
                damaged, or the problem is not that of the record.
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
        task = self._task(branch)
        budget = task.max_steps if max_steps is None else max_steps
        exhausted = known.ending is Ending.BUDGET and budget >= len(known.points)
        if known.ending is not None and not exhausted:
            return Branch([point], ending=known.ending, reason=known.reason)
        origin = self.state(branch, 0)[0] if stepping.index else None
        self.system.scales = tuple(known.points[stepping.index].scales)
        # Pivoting has no length of steps.
        route: Route = "steps" if stepping.next_step > 0 else "pivoting"
        self._unknowns(point.y)
        with (
            self.system.restored(),
            follower_for(
                self.system,
                self._x,
                point.gamma,
                task.control,
                gamma_scale=task.gamma_scale,
                route=route,
            ) as follower,
        ):
            return follower.run(
                point,
                gamma_range=(task.gamma_range[0], task.gamma_range[1]),
                max_steps=budget,
                to_node=task.to_node,
                stop=stop,
                observer=observer,
                record=self,
                progress=progress,
                branch_id=branch,
                stepping=stepping,
                origin=origin,
            )

    # -- vectors ---------------------------------------------------------------------------------

    def _put(self, point: BranchPoint) -> None:
        """Put a point into the Functions of the problem. Collective."""
        self._unknowns(point.y)
        self.system.put(self._x, point.gamma, point.piece)

    def _unknowns(self, y: PETSc.Vec) -> None:
        """The unknowns of y = (x, gamma) into a vector that is reused."""
        self._x.array[:] = y.array_r[: self._x.getLocalSize()]

    def _norm(self, y: PETSc.Vec, stepping: Stepping) -> float:
        """Length of the unknowns in the units of steps; 0 while these are not known."""
        if stepping.x_scale == 0:
            return 0.0
        self._unknowns(y)
        self.system.metric(self._x, self._mx)
        return float(np.sqrt(max(float(self._x.dot(self._mx)), 0.0) / stepping.x_scale))


def _name(branch: int, index: int) -> str:
    """Name of the checkpoint of a point, and of the file with its outer surface."""
    return f"branch_{branch:04d}_point_{index:06d}"


def resume(
    folder: str | os.PathLike[str],
    system: ParametricContact,
    functionals: Mapping[str, Functional] | None = None,
    *,
    branch: int = 0,
    every: int = 10,
    max_steps: int | None = None,
    stop: Stop[BranchStep] | None = None,
    observer: ObserverLike[BranchStep] | None = None,
    progress: bool | None = None,
) -> Branch:
    """Continue a recorded branch as if the run had never been killed. Collective.

    Args:
        folder: folder of the record.
        system: the same problem, on any number of ranks.
        functionals: the recorded functionals.
        branch: see `BranchRecord.go_on`, as for the budget, the observer, errors and the result.
        every: number of points between two checkpoints.
        max_steps: another budget of steps.
        stop: the same stop condition as at the beginning.
        observer: called with every point, beside the record.
        progress: see `follow`.
    """
    with BranchRecord(folder, system, functionals, every=every, resume=True) as record:
        return record.go_on(
            branch, max_steps=max_steps, stop=stop, observer=observer, progress=progress
        )
