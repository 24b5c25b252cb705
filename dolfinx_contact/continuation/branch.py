# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is found: a branch with its points and special points, and a diagram of branches."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Generic, Literal, TypeVar

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation.ending import Ending, Ends
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
    "is_same_piece",
    "kind_of_kink",
]

R = TypeVar("R")
Kind = Literal["event", "fold", "bifurcation", "end"]


@dataclass(frozen=True)
class BranchPoint:
    """A point of a branch.

    Attributes:
        y: (x, gamma); a copy of its own.
        tangent: unit tangent in the sense in which the branch is followed.
        piece: the piece of H that the point lies on.
        gamma: parameter.
        step: length of the step to this point.
        corrections: Newton steps of the corrector.
        tau: test function of smooth bifurcations; it changes its sign there.
    """

    y: PETSc.Vec
    tangent: PETSc.Vec
    piece: Piece
    gamma: float
    step: float
    corrections: int
    tau: float = float("nan")


@dataclass(frozen=True)
class Change:
    """A point that changes its status, by the rank that owns it and its local number there."""

    rank: int
    point: int
    before: int
    after: int


@dataclass(frozen=True)
class Ray:
    """An outgoing ray of a nonsmooth point: the piece, and the one-sided unit tangent into it."""

    piece: Piece
    tangent: PETSc.Vec


def is_same_piece(comm: MPI.Comm, a: Piece, c: Piece) -> bool:
    """Return True if two pieces have the same statuses on all ranks. Collective."""
    return bool(comm.allreduce(bool(np.array_equal(a.codes, c.codes)), op=MPI.LAND))


def kind_of_kink(meets: bool, turned: bool) -> Kind:
    """Kind of a nonsmooth point.

    Args:
        meets: True if other branches meet there.
        turned: True if gamma turns back.
    """
    return "bifurcation" if meets else "fold" if turned else "event"


@dataclass(frozen=True)
class FoundRays(Generic[R]):
    """Rays that lead out of a point, as found by a search.

    Attributes:
        rays: rays in any order: `Ray`, `AffineRay`, or `BranchPoint`, the point with the tangent of
            the ray. A point passed by one smooth branch has two, one for each sense.
        complete: True if there are provably no others.
        method: description of the search; "" where one smooth branch passes.
    """

    rays: tuple[R, ...]
    complete: bool = True
    method: str = ""


@dataclass(frozen=True)
class SpecialPoint:
    """Where a branch kinks, folds or meets others.

    Attributes:
        kind: ``"event"`` a status changes and gamma continues, ``"fold"`` gamma turns back,
            ``"bifurcation"`` there are other outgoing rays.
        smooth: False at a change of status.
        gamma: parameter; at an event that is not located, estimated.
        y: (x, gamma); at an event that is not located, the point of the branch that follows it.
        index: of the point of the branch that follows it.
        changes: points that change status on the branch that is followed.
        parity: sign of the ratio of the determinants of the bordered systems before and after, -1
            at a simple bifurcation; 0 if it was not evaluated.
        others: outgoing rays that the branch does not take.
        complete: whether `others` has been enumerated completely; False if it was not looked for.
        incoming: at a bifurcation the ray along which the branch came; its tangent points to here.
        onwards: at a bifurcation the ray by which the branch continues.
        method: how the rays were looked for.
        bracket: the values of gamma between which an event lies that is not located; None if it
            is.
    """

    kind: Kind
    smooth: bool
    gamma: float
    y: PETSc.Vec
    index: int
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
        """Whether `gamma` and `y` are those of the special point to round-off."""
        return self.bracket is None


@dataclass
class Branch(Ends):
    """What was followed.

    Attributes:
        points: in order, the start first.
        special: events, folds and bifurcations, in order.
        ending: how it ended.
        reason: why, in words.
        factorisations: of bordered matrices.
        solves: right-hand sides.
        start_correction: largest change of an unknown by the correction of the start at fixed
            gamma; with a contact problem a length.
    """

    points: list[BranchPoint] = field(default_factory=list)
    special: list[SpecialPoint] = field(default_factory=list)
    ending: Ending | None = None
    reason: str = ""
    factorisations: int = 0
    solves: int = 0
    start_correction: float = 0.0

    @property
    def complete(self) -> bool:
        """Whether it was followed to the end of the range of gamma."""
        return self.ending is Ending.REACHED

    @property
    def folds(self) -> list[SpecialPoint]:
        """Where gamma turns back, smooth or not."""
        return [s for s in self.special if s.kind == "fold"]

    @property
    def bifurcations(self) -> list[SpecialPoint]:
        """Points where other branches lead out."""
        return [s for s in self.special if s.kind == "bifurcation"]

    def summary(self) -> dict[str, Any]:
        """Scalars and lists for `summary.json`."""
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
    """A bifurcation.

    Attributes:
        point: the special point, as it was found first. Nothing comes in at one that the
            exploration starts from: there `incoming` and `onwards` are None, and all rays `others`.
        rays: all outgoing rays, that by which it was found included.
        edges: number of the branch that leaves or arrives along each ray; None if none has yet.
    """

    point: SpecialPoint
    rays: list[Ray]
    edges: list[int | None]


@dataclass(frozen=True)
class Edge:
    """A branch between two nodes.

    Attributes:
        branch: its points; they start at ``start`` and end at ``end``.
        start: number of a node, None at a start of the exploration.
        end: number of a node, None where the branch ends otherwise; see `Branch.reason`.
    """

    branch: Branch
    start: int | None
    end: int | None


@dataclass
class Diagram(Ends):
    """What was found.

    Attributes:
        edges: branches.
        nodes: bifurcations.
        complete: whether every ray has been followed to the end of its branch, and every node
            knows all of its rays.
        ending: how the exploration ended; that of a branch which was cut off, if one was.
        reason: why, in words.
        start_correction: largest of the corrections of the starts, see `Branch.start_correction`.
    """

    edges: list[Edge] = field(default_factory=list)
    nodes: list[Node] = field(default_factory=list)
    complete: bool = False
    ending: Ending | None = None
    reason: str = ""
    start_correction: float = 0.0

    @property
    def branches(self) -> list[Branch]:
        """The branches of all edges."""
        return [edge.branch for edge in self.edges]

    def open_rays(self) -> list[tuple[int, int]]:
        """Node and ray number of the rays that no branch has taken."""
        return [
            (i, j)
            for i, node in enumerate(self.nodes)
            for j, edge in enumerate(node.edges)
            if edge is None
        ]

    def summary(self) -> dict[str, Any]:
        """Scalars and lists for `summary.json`; those of branches in the order of the edges."""
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
