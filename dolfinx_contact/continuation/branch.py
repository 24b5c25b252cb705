# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results of continuation: points, special points, branches and diagrams."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Generic, Literal, TypeVar

from petsc4py import PETSc

from dolfinx_contact._arrays import as_text
from dolfinx_contact._ending import Ending, Ends
from dolfinx_contact.continuation.system import Piece

__all__ = [
    "Branch",
    "BranchPoint",
    "Change",
    "Diagram",
    "Edge",
    "FoundRays",
    "Node",
    "Ray",
    "SpecialPoint",
    "kind_of_kink",
]

R = TypeVar("R")
Kind = Literal["event", "fold", "bifurcation", "end"]


@dataclass(frozen=True)
class BranchPoint:
    """A point of a branch.

    Attributes:
        y: unknowns and parameter, vector (x, gamma).
        tangent: unit tangent in the direction of tracing.
        piece: piece of H (statuses of all points) on which the branch continues.
        gamma: parameter.
        step: length of the step to this point.
        corrections: Newton iterations of the corrector.
        tau: value of the test function, which changes its sign at smooth bifurcations.
    """

    y: PETSc.Vec = field(repr=False)
    tangent: PETSc.Vec = field(repr=False)
    piece: Piece
    gamma: float
    step: float = 0.0
    corrections: int = 0
    tau: float = float("nan")


@dataclass(frozen=True)
class Change:
    """A change of status of one point.

    Attributes:
        rank: rank owning the point.
        point: local number of the point on this rank.
        before: status before the change.
        after: status after the change.
    """

    rank: int
    point: int
    before: int
    after: int


@dataclass(frozen=True)
class Ray:
    """Direction in which a branch can leave a state at which statuses change.

    Attributes:
        piece: piece of H (statuses of all points) into which the ray leads.
        tangent: one-sided unit tangent, a vector (x, gamma) that points away from the state.
    """

    piece: Piece
    tangent: PETSc.Vec


def kind_of_kink(meets: bool, turned: bool) -> Kind:
    """Return the kind of a point at which statuses change: bifurcation, fold or event.

    Args:
        meets: True if other branches meet at the point.
        turned: True if gamma turns back.
    """
    return "bifurcation" if meets else "fold" if turned else "event"


@dataclass(frozen=True)
class FoundRays(Generic[R]):
    """Result of a search for the rays along which branches leave a point.

    Attributes:
        rays: rays in any order: `Ray`, `AffineRay`, or `BranchPoint` (the point with the tangent of
            the ray). A point passed by one smooth branch has two rays, one for each direction.
        complete: True if it is proved that there are no other rays.
        method: description of the search; "" if one smooth branch passes the point.
    """

    rays: tuple[R, ...]
    complete: bool = True
    method: str = ""


@dataclass(frozen=True)
class SpecialPoint:
    """Point of a branch at which a status changes, gamma turns back, or branches meet.

    Attributes:
        kind: ``"event"`` if a status changes and gamma continues in its direction, ``"fold"`` if
            gamma turns back, ``"bifurcation"`` if other outgoing rays exist, ``"end"`` if no
            outgoing ray was found.
        smooth: False if a status changes at the point.
        gamma: parameter; at an event that is not located, an estimate.
        y: vector (x, gamma); at an event that is not located, the following point of the branch.
        index: index of the following point of the branch.
        changes: changes of status along the branch.
        parity: sign of the ratio of the bordered determinants det [grad H; t^T] (t: unit tangent)
            after and before the point, -1 at a simple bifurcation; 0 if it was not evaluated.
        others: outgoing rays not taken by the branch.
        complete: True if `others` is provably complete.
        incoming: incoming ray at a bifurcation; its tangent points to the bifurcation.
        onwards: outgoing ray along which the branch continues at a bifurcation.
        method: description of the search for rays.
        bracket: values of gamma that enclose an event that is not located; None if located.
    """

    kind: Kind
    smooth: bool
    gamma: float
    y: PETSc.Vec
    index: int = 0
    changes: tuple[Change, ...] = ()
    parity: int = 0
    others: tuple[Ray, ...] = ()
    complete: bool = False
    incoming: Ray | None = None
    onwards: Ray | None = None
    method: str = ""
    bracket: tuple[float, float] | None = None

    @property
    def located(self) -> bool:
        """Whether the point was located to round-off; otherwise `gamma` is only an estimate."""
        return self.bracket is None


@dataclass
class Branch(Ends):
    """Solution branch, or a part of it.

    Attributes:
        points: points in order, the start first.
        special: events, folds and bifurcations in order.
        ending: kind of the end of the branch.
        reason: description of the end of the branch.
        factorisations: number of factorisations of bordered matrices.
        solves: number of linear solves.
        start_correction: largest change of an unknown when the given start was corrected at fixed
            gamma. The unknowns of a contact problem are lengths.
    """

    points: list[BranchPoint] = field(default_factory=list, repr=False)
    special: list[SpecialPoint] = field(default_factory=list, repr=False)
    ending: Ending | None = None
    reason: str = ""
    factorisations: int = 0
    solves: int = 0
    start_correction: float = 0.0

    def __str__(self) -> str:
        scale = max((abs(p.gamma) for p in self.points), default=0.0)
        ends = [as_text(p.gamma, scale) for p in self.points[:: max(len(self.points) - 1, 1)]]
        return (
            f"{len(self.points)} points, gamma from {' to '.join(ends)}, folds: {len(self.folds)}, "
            f"bifurcations: {len(self.bifurcations)}; {self.reason}"
        )

    @property
    def complete(self) -> bool:
        """True if the branch ends at an end of the range of gamma."""
        return self.ending is Ending.REACHED

    @property
    def folds(self) -> list[SpecialPoint]:
        """Points at which gamma turns back, with or without a change of status."""
        return [s for s in self.special if s.kind == "fold"]

    @property
    def bifurcations(self) -> list[SpecialPoint]:
        """Points at which other branches meet."""
        return [s for s in self.special if s.kind == "bifurcation"]

    def summary(self) -> dict[str, Any]:
        """Return the numbers and lists that are written to ``summary.json``, by name."""
        return {
            "converged": self.complete,
            "reason": self.reason,
            "newton_iterations": sum(p.corrections for p in self.points),
            "points": len(self.points),
            "gammas": [p.gamma for p in self.points],
            "gamma_end": self.points[-1].gamma if self.points else None,
            "folds": [s.gamma for s in self.folds],
            "bifurcations": [s.gamma for s in self.bifurcations],
            "located_events": [s.gamma for s in self.special if s.changes and s.located],
            "factorisations": self.factorisations,
            "solves": self.solves,
        }


@dataclass(eq=False)
class Node:
    """Node of a bifurcation diagram: a point at which branches meet.

    Attributes:
        point: special point, as computed on the first branch that reached it. At a start of the
            exploration its `incoming` and `onwards` are None, and `others` contains all rays.
        rays: all outgoing rays, including the reverse of the incoming ray.
        edges: index of the branch that leaves or arrives along each ray; None for a ray that has
            not been traced.
    """

    point: SpecialPoint
    rays: list[Ray]
    edges: list[int | None]


@dataclass(frozen=True)
class Edge:
    """Edge of a bifurcation diagram: a branch between two nodes.

    Attributes:
        branch: branch from ``start`` to ``end``.
        start: index of a node; None at a start of the exploration.
        end: index of a node; None if the branch does not end at a node, see `Branch.reason`.
    """

    branch: Branch
    start: int | None
    end: int | None


@dataclass
class Diagram(Ends):
    """A bifurcation diagram.

    Attributes:
        edges: branches with their nodes.
        nodes: bifurcations.
        complete: True if it is proved that the nodes have no other rays, and all rays have been
            traced to the ends of their branches.
        ending: kind of the end of the exploration; if branches ended prematurely, the ending of the
            first of them.
        reason: description of the end of the exploration.
        start_correction: largest change of an unknown when the starts were corrected at fixed
            gamma.
    """

    edges: list[Edge] = field(default_factory=list, repr=False)
    nodes: list[Node] = field(default_factory=list, repr=False)
    complete: bool = False
    ending: Ending | None = None
    reason: str = ""
    start_correction: float = 0.0

    def __str__(self) -> str:
        numbers = f"branches: {len(self.edges)}, bifurcations: {len(self.nodes)}"
        lines = [f"{numbers}; {self.reason}"]
        return "\n".join([*lines, *(f"{k}: {branch}" for k, branch in enumerate(self.branches))])

    @property
    def branches(self) -> list[Branch]:
        """Branches of all edges."""
        return [edge.branch for edge in self.edges]

    def open_rays(self) -> list[tuple[int, int]]:
        """Return the indices (node, ray) of the rays that have not been traced."""
        return [
            (i, j)
            for i, node in enumerate(self.nodes)
            for j, edge in enumerate(node.edges)
            if edge is None
        ]

    def summary(self) -> dict[str, Any]:
        """Return the numbers and lists of ``summary.json``, branches in the order of `edges`."""
        return {
            "converged": self.ending is Ending.REACHED,
            "reason": self.reason,
            "complete": self.complete,
            "methods": sorted({node.point.method for node in self.nodes}),
            "bifurcation_gamma": [node.point.gamma for node in self.nodes],
            "rays": [len(node.rays) for node in self.nodes],
            "points": [len(b.points) for b in self.branches],
            "gammas": [[p.gamma for p in b.points] for b in self.branches],
            "factorisations": sum(b.factorisations for b in self.branches),
        }
