# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bifurcation diagrams: all branches that are connected, as a graph.

From every start branches are followed in both senses of gamma; where pieces meet there, along every
outgoing ray, and with more than two of them the start is a node itself. A branch ends at its first
bifurcation, which becomes a node with all of its rays; from every ray that no branch has taken yet
a new one starts. A branch that comes to a node that is known takes the ray by which it comes, so
that none is followed twice. Where the range of gamma ends at a kink, rays that lead back into the
range are followed as well. Points and branches that are found again are merged.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from petsc4py import PETSc

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._validate import count, positive
from dolfinx_contact.continuation.arguments import (
    check_listeners,
    check_states,
    check_steps,
    check_system,
    check_vectors,
    checked_gamma,
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
from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.continuation.follow import Follower, Route, follower_for
from dolfinx_contact.continuation.observer import (
    BranchStep,
    CollectiveObserver,
    Observer,
    ObserverLike,
    Observers,
    Stop,
)
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.continuation.pivoting import Pivoting
from dolfinx_contact.continuation.system import System
from dolfinx_contact.continuation.walk import leaves_range

__all__ = ["explore"]

logger = logging.getLogger(__name__)

_SAME = 1e-6  # distance at which two points are one
_SAME_RAY = 1e-3  # distance of unit tangents at which two rays of a nonsmooth point are one
_ALL = "every ray has been followed"


def _check(a: Arguments) -> None:
    check_system(a.system)
    try:
        a.starts = [(x, checked_gamma(gamma, "gamma of a start")) for x, gamma in a.starts]
    except TypeError:
        raise ValueError("the starts must be pairs of a state and its gamma") from None
    if not a.starts:
        raise ValueError("at least one start is needed")
    check_vectors([x for x, _ in a.starts], "a start")
    a.gamma_range = checked_range(a.gamma_range, [gamma for _, gamma in a.starts])
    check_steps(a.control, a.max_steps)
    check_listeners(observer=a.observer, record=a.record, progress=a.progress, stop=a.stop)
    count(a.max_branches, "max_branches")
    positive(a.max_seconds, "max_seconds", infinite=True)


@collective("explore", _check)
def explore(
    system: System,
    starts: Iterable[tuple[PETSc.Vec, float]],
    *,
    gamma_range: tuple[float, float],
    control: StepControl | None = None,
    max_steps: int = 1000,
    max_branches: int = 100,
    max_seconds: float = float("inf"),
    route: Route = "auto",
    stop: Stop[BranchStep] | None = None,
    observer: ObserverLike[BranchStep] | None = None,
    record: Observer | None = None,
    progress: bool | None = None,
) -> Diagram:
    """Find all branches that are connected with some solutions. Collective.

    What the system writes to (of a contact problem Functions, statuses, gamma) is left as it was.

    Args:
        system: H with its pieces.
        starts: approximate solutions x with their gamma, inside the range. They are corrected at
            fixed gamma; `Diagram.start_correction` reports the largest change.
        gamma_range: branches end where gamma reaches either end.
        control: step lengths.
        max_steps: budget of every branch.
        max_branches: budget of branches.
        max_seconds: no branch is begun later than this.
        route: see `follower_for`.
        stop: see `follow`: a branch ends where it gives a reason, and the diagram is incomplete.
        observer: called with the points of all branches, as that of `follow`; an `Observer` knows
            the branches by their numbers.
        record: see `follow`.
        progress: see `follow`.

    Returns:
        The diagram, which is partial if a budget is exhausted; `Diagram.reason` names it.

    Raises:
        ValueError: on every rank, if an argument does not fit or differs between ranks, the range
            is empty or does not contain a start, or a start is no solution.
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
        explorer.run(pairs, max_branches, max_seconds)
        return explorer.diagram


class _Explorer:
    def __init__(
        self,
        follower: Follower | Pivoting,
        gamma_range: tuple[float, float],
        max_steps: int,
        listeners: Mapping[str, Any],
    ):
        self.follower = follower
        self.range = gamma_range
        self.max_steps = max_steps
        self.listeners = listeners
        self.diagram = Diagram()
        comm = follower.bordered.comm
        observers = (listeners["record"], listeners["observer"])
        self._observers = Observers(*(CollectiveObserver(comm, given) for given in observers))
        #: Points from which branches are to be followed, that begin at no node.
        self._waiting: list[BranchPoint] = []
        #: Whether all rays are known of the kinks on branches and at their ends that are no nodes.
        self._all_rays_known = True

    def run(
        self, starts: Sequence[tuple[PETSc.Vec, float]], max_branches: int, max_seconds: float
    ) -> None:
        diagram = self.diagram
        begun = time.monotonic()
        comm = self.follower.bordered.comm
        left = list(starts)
        while left or self._waiting or diagram.open_rays():
            late = comm.bcast(time.monotonic() - begun > max_seconds)
            if late or len(diagram.edges) >= max_branches:
                what = f"{max_seconds:g} s" if late else f"{max_branches} branches"
                diagram.end(Ending.BUDGET, f"the budget of {what} is exhausted")
                break
            if self._waiting:
                point = self._waiting.pop(0)
                if not self._known(point):
                    self._follow(point, None)
                continue
            if left:
                x, gamma = left.pop(0)
                departures = self.follower.departures(x, gamma)
                moved = [self.follower.correction(x, p) for p in departures.rays[:1]]
                diagram.start_correction = max([diagram.start_correction, *moved])
                self._depart(departures)
                continue
            i, j = diagram.open_rays()[0]
            node = diagram.nodes[i]
            node.edges[j] = len(diagram.edges)
            try:
                point = self.follower.branch_off(node.point, node.rays[j])
            except ValueError as error:
                # The ray stays without a branch, and the diagram incomplete.
                if comm.rank == 0:
                    logger.warning("gamma = %.10g: %s", node.point.gamma, error)
                branch = Branch()
                branch.end(Ending.NOT_FOUND, str(error))
                diagram.edges.append(Edge(branch, i, None))
                self._observers.explored(diagram)
                continue
            if self._leaves(point):
                branch = Branch([point])
                branch.end(Ending.REACHED)
                diagram.edges.append(Edge(branch, i, None))
                self._observers.explored(diagram)
                continue
            self._follow(point, i)
        else:
            short = [(k, e.branch) for k, e in enumerate(diagram.edges) if _is_cut_off(e.branch)]
            if short:
                number, branch = short[0]
                assert branch.ending is not None
                more = f" (and {len(short) - 1} more)" if len(short) > 1 else ""
                words = f"branch {number} was cut off{more}: {branch.reason}"
                diagram.end(branch.ending, words)
            else:
                diagram.end(Ending.REACHED, _ALL)
            known = all(node.point.complete for node in diagram.nodes)
            diagram.complete = known and self._all_rays_known and not short
        self._observers.explored(diagram)
        if comm.rank == 0:
            found = len(diagram.edges), len(diagram.nodes), diagram.reason
            logger.info("%d branches, %d bifurcations: %s", *found)

    def _follow(self, point: BranchPoint, start: int | None) -> None:
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
            last = branch.bifurcations[-1]
            if last.incoming is not None:
                end = self._arrive(last, number)
            else:  # steps have crossed it, and its rays are not known: it is no node
                self._all_rays_known = False
        if branch.ending is Ending.REACHED:
            end = self._at_the_end(branch.points[-1], start, number)
        self.diagram.edges.append(Edge(branch, start, end))
        self._observers.explored(self.diagram)

    def _depart(self, found: FoundRays[BranchPoint]) -> None:
        """Set out from a start along its rays, those that leave the range of gamma excepted."""
        inside = [p for p in found.rays if not self._leaves(p)]
        if len(found.rays) > 2 and inside:
            self._node_of(found, inside)
        else:
            self._all_rays_known = self._all_rays_known and found.complete
            self._waiting += inside

    def _at_the_end(self, point: BranchPoint, start: int | None, number: int) -> int | None:
        """The node at which branch ``number`` reached the end of the range, if there is one.

        Where pieces meet there rays may lead back into the range, beside that by which it came.
        """
        found = self.follower.rays_at(point)
        if found is None:
            return None
        inside = [p for p in found.rays if not self._leaves(p)]
        back = point.tangent.copy()
        back.scale(-1.0)
        if len(found.rays) <= 2:
            self._all_rays_known = self._all_rays_known and found.complete
            self._waiting += [p for p in inside if not self._is_ray(p.tangent, back)]
            return None
        if not inside:
            return None
        node = self._node_of(found, inside)
        if node == start:  # the branch has left the range where it left the node
            return None
        self._take_ray(node, Ray(point.piece, back), number)
        return node

    def _node_of(self, found: FoundRays[BranchPoint], inside: Sequence[BranchPoint]) -> int:
        """The node where more than two rays lead out, of which some lead into the range."""
        point = inside[0]
        known = self._node_at(point.y)
        if known is not None:
            return known
        rays = tuple(Ray(p.piece, p.tangent) for p in inside)
        special = SpecialPoint(
            "bifurcation",
            False,
            point.gamma,
            point.y,
            0,
            others=rays,
            complete=found.complete,
            method=found.method,
        )
        self.diagram.nodes.append(Node(special, list(rays), [None] * len(rays)))
        return len(self.diagram.nodes) - 1

    def _leaves(self, point: BranchPoint) -> bool:
        """Whether gamma leaves its range at once on a branch that begins at a point."""
        return leaves_range(self.follower.bordered, point, self.range)

    def _arrive(self, special: SpecialPoint, number: int) -> int:
        """The node at which branch ``number`` ends, made if it is new."""
        incoming = special.incoming
        onwards = special.onwards
        assert incoming is not None  # it has been looked at
        assert onwards is not None
        back = incoming.tangent.copy()
        back.scale(-1.0)
        known = self._node_at(special.y)
        if known is not None:
            self._take_ray(known, Ray(incoming.piece, back), number)
            return known
        rays = [Ray(incoming.piece, back), onwards, *special.others]
        self.diagram.nodes.append(Node(special, rays, [number, *[None] * (len(rays) - 1)]))
        return len(self.diagram.nodes) - 1

    def _node_at(self, y: PETSc.Vec) -> int | None:
        """The number of the node at a point; None if there is none. Collective."""
        for i, node in enumerate(self.diagram.nodes):
            if self._is_at(node.point.y, y):
                return i
        return None

    def _take_ray(self, number: int, ray: Ray, edge: int) -> None:
        """Let an edge have the ray of a node by which it came. Collective.

        Rays of a nonsmooth point are known as they are, those of a smooth one as far as the kernel
        shows them: then the closest of those that are free.
        """
        b = self.follower.bordered
        node = self.diagram.nodes[number]
        free = [j for j, taken in enumerate(node.edges) if taken is None]
        close = [(b.inner(node.rays[j].tangent, ray.tangent), j) for j in free]
        if node.point.smooth:
            found = max(close)[1] if close and max(close)[0] > 0.5 else None
        else:
            same = [j for _, j in sorted(close) if self._is_ray(node.rays[j].tangent, ray.tangent)]
            found = same[-1] if same else None
        if found is None:
            node.rays.append(ray)
            node.edges.append(edge)
        else:
            node.edges[found] = edge

    def _known(self, point: BranchPoint) -> bool:
        """Whether a branch that was followed passes the point, or leaves it by the same ray."""
        b = self.follower.bordered
        for branch in self.diagram.branches:
            if not branch.points:
                continue
            first, *beyond = branch.points
            if self._is_at(first.y, point.y) and self._is_ray(first.tangent, point.tangent):
                return True
            if beyond and branch.ending is Ending.REACHED:
                # It came to its last point by one ray, and passes none of the others.
                last = beyond.pop()
                if not beyond and self._is_at(last.y, first.y):
                    continue  # too short to tell by which ray it came
                if self._is_at(last.y, point.y):
                    back = last.tangent.copy()
                    back.scale(-1.0)
                    came = self._is_ray(back, point.tangent)
                    back.destroy()
                    if came:
                        return True
                    continue
            # Its own points too: at a kink gamma may turn, and be passed by round-off.
            near = [p for p in beyond if abs(p.gamma - point.gamma) <= _SAME * b.gamma_scale]
            # What is not found is not known: at worst a branch is followed twice.
            found = self.follower.at(branch, point.gamma, skip_missing=True)
            passed = [p for p in found if p is not first]
            if any(self._is_at(p.y, point.y) for p in [*near, *passed]):
                return True
        return False

    def _is_at(self, y: PETSc.Vec, other: PETSc.Vec) -> bool:
        """Whether two points are one. Collective."""
        away = y - other
        square = self.follower.bordered.inner(away, away)
        away.destroy()
        return square <= _SAME**2

    def _is_ray(self, t: PETSc.Vec, other: PETSc.Vec) -> bool:
        """Whether two tangents at a nonsmooth point, or of one branch, have one direction.

        They are compared in the metric of now, which need not be that of their units. Collective.
        """
        b = self.follower.bordered
        away = t.copy()
        away.scale(1.0 / math.sqrt(b.inner(t, t)))
        away.axpy(-1.0 / math.sqrt(b.inner(other, other)), other)
        square = b.inner(away, away)
        away.destroy()
        return bool(square <= _SAME_RAY**2)


def _is_cut_off(branch: Branch) -> bool:
    """Whether a branch may continue beyond what was followed of it."""
    stopped = branch.ending is Ending.STOPPED and not branch.bifurcations
    return stopped or branch.ending in (Ending.BUDGET, Ending.NOT_SOLVED, Ending.NOT_FOUND)
