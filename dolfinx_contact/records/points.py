# SPDX-License-Identifier: LGPL-3.0-or-later
"""Entries of journals for points and nodes of branches, the same on any number of ranks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dolfinx_contact.continuation import BranchPoint, Change, Node, SpecialPoint
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.equations.order import Gathered, by_coordinates
from dolfinx_contact.laws import status
from dolfinx_contact.records.columns import (
    ChangeEntry,
    JournalNode,
    NodePoint,
    PointEntry,
    RayEntry,
    SpecialEntry,
)

if TYPE_CHECKING:
    from dolfinx_contact.parametric import ParametricContact
    from dolfinx_contact.problem import ContactProblem

__all__ = ["entry_of", "node_of", "places"]


def places(problem: ContactProblem) -> dict[str, list[list[float]]]:
    """Coordinates of the contact points by surface, in the order of `letters`. Collective."""
    return {
        s.name: Gathered(s.comm, s.positions, s.points.ids).positions.tolist()
        for s in problem.surfaces
    }


def entry_of(
    system: ParametricContact,
    index: int,
    point: BranchPoint,
    special: Sequence[SpecialPoint],
    norm: float,
) -> PointEntry:
    """The entry of the journal for a point, without its functionals. Collective.

    Args:
        system: contact problem with a parameter.
        index: number of the point on its branch.
        point: the point.
        special: special points on the way to it.
        norm: norm of the unknowns.
    """
    return PointEntry(
        index=index,
        gamma=point.gamma,
        step=point.step,
        corrections=point.corrections,
        tau=point.tau,
        status=system.letters(point.piece),
        special=[SpecialEntry(**_described(system, s)) for s in special],
        norm=norm,
        functionals={},
    )


def node_of(system: ParametricContact, layout: Layout, node: Node) -> JournalNode:
    """The entry of the journal for a node of a diagram. Collective."""
    rays = [
        RayEntry(status=system.letters(ray.piece), gamma=layout.gamma(ray.tangent))
        for ray in node.rays
    ]
    point = NodePoint(**_described(system, node.point), method=node.point.method)
    return JournalNode(point=point, rays=rays, edges=list(node.edges))


def _described(system: ParametricContact, s: SpecialPoint) -> dict[str, Any]:
    """Fields of the entry of a special point. Collective."""
    return {
        "kind": s.kind,
        "smooth": s.smooth,
        "gamma": s.gamma,
        "parity": s.parity,
        "others": len(s.others),
        "complete": s.complete,
        "bracket": list(s.bracket) if s.bracket is not None else None,
        "changes": _places(system, s.changes),
    }


def _places(system: ParametricContact, changes: Sequence[Change]) -> list[ChangeEntry]:
    """Changes of statuses by place, in the order of coordinates. Collective."""
    if not changes:
        return []
    known = list(zip(system.positions, system._ids, strict=True))
    mine = {i: known[c.point] for i, c in enumerate(changes) if c.rank == system.comm.rank}
    places = {i: place for part in system.comm.allgather(mine) for i, place in part.items()}
    x, ids = (np.array(v) for v in zip(*(places[i] for i in range(len(changes))), strict=True))
    names = [str(letter) for letter in status.letters(x.shape[1])]
    surfaces = [s.name for s in system.problem.surfaces]
    return [
        ChangeEntry(
            surface=surfaces[ids[i, 0]],
            x=x[i].tolist(),
            before=names[changes[i].before],
            after=names[changes[i].after],
        )
        for i in by_coordinates(x, ids)
    ]
