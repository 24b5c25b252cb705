# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bifurcation diagrams: the graph of all connected branches.

1. From every start, branches are traced in both directions of gamma. If pieces of H meet at the
   start, every outgoing ray is traced; with more than two rays, the start is a node.
2. A branch ends at its first bifurcation, which becomes a node with all of its rays. A branch that
   arrives at an existing node occupies the ray of its arrival, so that no branch is traced twice.
3. Where the range of gamma ends at a kink, rays leading back into the range are traced as well.
4. New branches start along rays without a branch until all rays have one.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from petsc4py import PETSc

from dolfinx_contact._ending import Ending
from dolfinx_contact._mpi import Arguments, collective
from dolfinx_contact._validate import count, number
from dolfinx_contact.continuation.arguments import (
    check_listeners,
    check_states,
    check_steps,
    check_system,
    checked_range,
    samples_of,
)
from dolfinx_contact.continuation.branch import (
    Branch,
    BranchPoint,
    Diagram,
    Edge,
    FoundRays,
    Node,
    Ray,
    SpecialPoint,
)
from dolfinx_contact.continuation.follow import Route, follower_for
from dolfinx_contact.continuation.observer import (
    BranchStep,
    CollectiveObserver,
    Observer,
    ObserverLike,
    Stop,
)
from dolfinx_contact.continuation.step_control import StepControl
from dolfinx_contact.continuation.system import System
from dolfinx_contact.continuation.tracing import Tracer, leaves_range

__all__ = ["explore"]

logger = logging.getLogger(__name__)

_SAME = 1e-6  # distance at which two points coincide
_SAME_RAY = 1e-3  # distance at which unit tangents at a nonsmooth point coincide
_SAME_KERNEL = 0.5  # least cosine of a tangent and the direction of a smooth bifurcation


def _check(a: Arguments) -> None:
    check_system(a.system)
    try:
        a.starts = [(x, number(gamma, "gamma of a start")) for x, gamma in a.starts]
    except TypeError:
        raise ValueError("the starts must be pairs of a state and its gamma") from None
    if not a.starts:
        raise ValueError("at least one start is needed")
    a.gamma_range = checked_range(a.gamma_range, [gamma for _, gamma in a.starts])
    check_steps(a.control, a.max_steps)
    check_listeners(observer=a.observer, record=a.record, progress=a.progress, stop=a.stop)
    count(a.max_branches, "max_branches")


@collective("explore", _check)
def explore(
    system: System,
    starts: Iterable[tuple[PETSc.Vec, float]],
    *,
    gamma_range: tuple[float, float],
    control: StepControl | None = None,
    max_steps: int = 1000,
    max_branches: int = 100,
    route: Route = "auto",
    stop: Stop[BranchStep] | None = None,
    observer: ObserverLike[BranchStep] | None = None,
    record: Observer | None = None,
    progress: bool | None = None,
) -> Diagram:
    """Compute all branches that are connected with the starts. Collective.

    The data of the system (Functions, statuses and gamma of a contact problem) are restored.

    Args:
        system: piecewise smooth system H(x, gamma) = 0.
        starts: approximate solutions x with their gamma, inside the range. They are corrected at
            fixed gamma; `Diagram.start_correction` reports the largest change.
        gamma_range: range of gamma, at whose ends branches end.
        control: step lengths and other parameters.
        max_steps: largest number of steps of a branch.
        max_branches: largest number of branches in the diagram.
        route: ``"pivoting"`` traces systems that are affine for fixed statuses from one change of
            status to the next; ``"steps"`` uses predictor and corrector; ``"auto"`` (default) uses
            pivoting where possible.
        stop: function of every accepted step returning the reason to end the branch there, or ""
            to continue. A stopped branch leaves the diagram incomplete.
        observer: function of every step of all branches, or an `Observer`. `BranchStep.branch` is
            the number of the branch.
        record: observer storing every point before ``observer`` is called, such as a
            `records.BranchRecord`.
        progress: True to show the progress on the standard error stream of rank 0; by default after
            some seconds.

    Returns:
        Diagram. It is partial if the budget of steps or branches is exhausted (`Diagram.reason`).

    Raises:
        ValueError: on every rank, if an argument is invalid or differs between ranks, or no
            solution is found near a start.
    """
    pairs = list(starts)
    check_states(system, [x for x, _ in pairs], "a start")
    low, high = gamma_range
    system.check_parameter(samples_of(low, high))
    scale = high - low
    with (
        system.restored(always=True),
        follower_for(system, *pairs[0], control, gamma_scale=scale, route=route) as follower,
    ):
        listeners = dict(stop=stop, observer=observer, record=record, progress=progress)
        explorer = _Explorer(follower, (low, high), max_steps, listeners)
        explorer.run(pairs, max_branches)
        return explorer.diagram


class _Explorer:
    """Search for the branches of a diagram. All methods are collective."""

    def __init__(
        self,
        follower: Tracer,
        gamma_range: tuple[float, float],
        max_steps: int,
        listeners: Mapping[str, Any],
    ):
        self.follower = follower
        self.bordered = follower.bordered
        self.comm = follower.bordered.comm
        self.range = gamma_range
        self.max_steps = max_steps
        self.listeners = listeners
        self.diagram = Diagram()
        observers = (listeners["record"], listeners["observer"])
        self._observers = CollectiveObserver(self.comm, lambda: None, *observers)
        #: Starts of branches that do not begin at a node.
        self._waiting: list[BranchPoint] = []
        #: Whether all rays are known at the kinks that are not nodes.
        self._all_rays_known = True

    def run(self, starts: Sequence[tuple[PETSc.Vec, float]], max_branches: int) -> None:
        """Trace branches until every ray has a branch or the budget is exhausted."""
        diagram = self.diagram
        pending = list(starts)
        while pending or self._waiting or diagram.open_rays():
            if len(diagram.edges) >= max_branches:
                diagram.end(Ending.BUDGET, f"the budget of {max_branches} branches is exhausted")
                break
            if self._waiting:
                point = self._waiting.pop(0)
                if not self._is_traced(point):
                    self._follow(point, None)
            elif pending:
                self._depart(*pending.pop(0))
            else:
                self._follow_ray(*diagram.open_rays()[0])
        else:
            self._conclude()
        self._observers.explored(diagram)
        if self.comm.rank == 0:
            numbers = len(diagram.edges), len(diagram.nodes), diagram.reason
            logger.info("%d branches, %d bifurcations: %s", *numbers)

    def _conclude(self) -> None:
        """Record the end of the search, and whether the diagram is complete."""
        diagram = self.diagram
        short = [(k, b) for k, b in enumerate(diagram.branches) if _is_cut_off(b)]
        diagram.end(Ending.REACHED, "every ray has been followed")
        if short:
            number, branch = short[0]
            assert branch.ending is not None
            more = f" (and {len(short) - 1} more)" if len(short) > 1 else ""
            diagram.end(branch.ending, f"branch {number} was cut off{more}: {branch.reason}")
        known = self._all_rays_known and all(node.point.complete for node in diagram.nodes)
        diagram.complete = known and not short

    # -- branches --------------------------------------------------------------------------------

    def _depart(self, x: PETSc.Vec, gamma: float) -> None:
        """Queue the outgoing rays of a start along which gamma stays in its range.

        A start with more than two rays becomes a node instead.
        """
        departures = self.follower.departures(x, gamma)
        moved = [self.follower.correction(x, p) for p in departures.rays[:1]]
        self.diagram.start_correction = max([self.diagram.start_correction, *moved])
        inside = [p for p in departures.rays if not self._leaves(p)]
        if len(departures.rays) > 2 and inside:
            self._node_of(departures, inside)
        else:
            self._all_rays_known = self._all_rays_known and departures.complete
            self._waiting += inside

    def _follow_ray(self, i: int, j: int) -> None:
        """Trace the branch of ray ``j`` of node ``i``."""
        node = self.diagram.nodes[i]
        node.edges[j] = len(self.diagram.edges)
        branch = Branch()
        try:
            point = self.follower.branch_off(node.point, node.rays[j])
        except ValueError as error:  # the ray stays without a branch, and the diagram incomplete
            if self.comm.rank == 0:
                logger.warning("gamma = %.10g: %s", node.point.gamma, error)
            branch.end(Ending.NOT_FOUND, str(error))
        else:
            if not self._leaves(point):
                self._follow(point, i)
                return
            branch.points.append(point)
            branch.end(Ending.REACHED)
        self._add(Edge(branch, i, None))

    def _follow(self, point: BranchPoint, start: int | None) -> None:
        """Trace a branch from a point to the first bifurcation or to the end of the branch."""
        number = len(self.diagram.edges)
        branch = self.follower.run(
            point,
            gamma_range=self.range,
            max_steps=self.max_steps,
            to_node=True,
            branch_id=number,
            **self.listeners,
        )
        kinks = [s for s in branch.special if s.kind != "bifurcation" and s.method]
        self._all_rays_known = self._all_rays_known and all(s.complete for s in kinks)
        end = None
        if branch.bifurcations:
            end = self._arrive(branch.bifurcations[-1], number)
        if branch.ending is Ending.REACHED:
            end = self._at_the_end(branch.points[-1], start, number)
        self._add(Edge(branch, start, end))

    def _add(self, edge: Edge) -> None:
        self.diagram.edges.append(edge)
        self._observers.explored(self.diagram)

    def _arrive(self, special: SpecialPoint, number: int) -> int | None:
        """Return the node at the end of branch ``number``; None if the rays there are unknown.

        The rays of a kink are unknown if a step has passed the kink without locating it.
        """
        if special.incoming is None or special.onwards is None:
            self._all_rays_known = False
            return None
        back = Ray(special.incoming.piece, -special.incoming.tangent)
        existing = self._node_at(special.y)
        if existing is None:
            return self._new_node(special, [back, special.onwards, *special.others], number)
        self._take_ray(existing, back, number)
        return existing

    def _at_the_end(self, point: BranchPoint, start: int | None, number: int) -> int | None:
        """Return the node at which branch ``number`` left the range of gamma; None without a node.

        If a status can change there, further rays may lead back into the range.
        """
        outgoing = self.follower.rays_at(point)
        if outgoing is None:
            return None
        inside = [p for p in outgoing.rays if not self._leaves(p)]
        back = -point.tangent
        if len(outgoing.rays) <= 2:
            self._all_rays_known = self._all_rays_known and outgoing.complete
            self._waiting += [p for p in inside if not self._is_ray(p.tangent, back)]
            return None
        if not inside:
            return None
        node = self._node_of(outgoing, inside)
        if node == start:  # the branch left the range at its start
            return None
        self._take_ray(node, Ray(point.piece, back), number)
        return node

    def _leaves(self, point: BranchPoint) -> bool:
        """Return True if gamma leaves its range immediately on a branch from a point."""
        return leaves_range(self.bordered, point, self.range)

    # -- nodes -----------------------------------------------------------------------------------

    def _node_of(self, found: FoundRays[BranchPoint], inside: Sequence[BranchPoint]) -> int:
        """Return the node at a point with more than two rays; create the node if necessary.

        Args:
            found: all outgoing rays of the point.
            inside: rays leading into the range of gamma.
        """
        point = inside[0]
        existing = self._node_at(point.y)
        if existing is not None:
            return existing
        rays = [Ray(p.piece, p.tangent) for p in inside]
        special = SpecialPoint(
            "bifurcation",
            False,
            point.gamma,
            point.y,
            others=tuple(rays),
            complete=found.complete,
            method=found.method,
        )
        return self._new_node(special, rays)

    def _new_node(self, special: SpecialPoint, rays: list[Ray], incoming: int | None = None) -> int:
        """Add a node and return its index; an incoming branch occupies its first ray."""
        edges: list[int | None] = [incoming, *[None] * (len(rays) - 1)]
        self.diagram.nodes.append(Node(special, rays, edges))
        return len(self.diagram.nodes) - 1

    def _node_at(self, y: PETSc.Vec) -> int | None:
        """Return the index of the node at a point; None without a node."""
        for i, node in enumerate(self.diagram.nodes):
            if self._is_at(node.point.y, y):
                return i
        return None

    def _take_ray(self, number: int, ray: Ray, edge: int) -> None:
        """Mark the ray along which a branch arrived at a node as occupied by the branch.

        At a smooth bifurcation, rays are only as accurate as the kernel; therefore the closest free
        ray is chosen.

        Args:
            number: index of the node.
            ray: reverse of the ray by which the branch arrived.
            edge: index of the branch.
        """
        node = self.diagram.nodes[number]
        close = [
            (self.bordered.inner(r.tangent, ray.tangent), j)
            for j, r in enumerate(node.rays)
            if node.edges[j] is None
        ]
        for cosine, j in sorted(close, reverse=True):
            same = cosine > _SAME_KERNEL
            if not node.point.smooth:
                same = self._is_ray(node.rays[j].tangent, ray.tangent)
            if same:
                node.edges[j] = edge
                return
        node.rays.append(ray)
        node.edges.append(edge)

    # -- comparisons -----------------------------------------------------------------------------

    def _is_traced(self, point: BranchPoint) -> bool:
        """Return True if a traced branch passes the point, or has an end there on the same ray."""
        for branch in self.diagram.branches:
            if not branch.points:
                continue
            first, *beyond = branch.points
            if self._is_at(first.y, point.y) and self._is_ray(first.tangent, point.tangent):
                return True
            if beyond and branch.ending is Ending.REACHED:
                # a branch arrives at its last point by one ray and passes none of the others
                last = beyond.pop()
                if not beyond and self._is_at(last.y, first.y):
                    continue  # too short to determine that ray
                if self._is_at(last.y, point.y):
                    if self._is_ray(-last.tangent, point.tangent):
                        return True
                    continue
            # Compare the stored points, too: at a kink gamma may turn just before a value.
            # If a point is missed, a branch is traced twice at worst.
            least = _SAME * self.bordered.gamma_scale
            near = [p for p in beyond if abs(p.gamma - point.gamma) <= least]
            passed = self.follower.at(branch, point.gamma, skip_missing=True)
            near += [p for p in passed if p is not first]
            if any(self._is_at(p.y, point.y) for p in near):
                return True
        return False

    def _is_at(self, y: PETSc.Vec, other: PETSc.Vec) -> bool:
        """Return True if two points coincide."""
        return self.bordered.length(y - other) <= _SAME

    def _is_ray(self, t: PETSc.Vec, other: PETSc.Vec) -> bool:
        """Return True if two tangents have the same direction, up to a tolerance."""
        length = self.bordered.length
        away = t / length(t) - other / length(other)
        return length(away) <= _SAME_RAY


def _is_cut_off(branch: Branch) -> bool:
    """Return True if a branch may continue beyond its last point."""
    stopped = branch.ending is Ending.STOPPED and not branch.bifurcations
    return stopped or branch.ending in (Ending.BUDGET, Ending.NOT_SOLVED, Ending.NOT_FOUND)
