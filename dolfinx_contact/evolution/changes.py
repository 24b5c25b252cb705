# SPDX-License-Identifier: LGPL-3.0-or-later
"""How much a state changes in a step: the body, and the contact points one by one."""

from __future__ import annotations

import math
from typing import NamedTuple

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx_contact.evolution.step import AcceptedState, AtRest

__all__ = ["change", "changes", "largest_at_points"]

Array = npt.NDArray[np.float64]


def change(comm: MPI.Comm, a: AcceptedState, b: AcceptedState) -> float:
    """Change of the state from one to the other, a length. Collective."""
    d = b.unknowns - a.unknowns
    if isinstance(a, AtRest) and isinstance(b, AtRest):
        before = a.forces.covered
        after = b.forces.covered
        if before is not None and after is not None:
            d = d * np.minimum(before, after)
    return float(np.sqrt(comm.allreduce(float(np.dot(d, d)))))


def changes(comm: MPI.Comm, a: AcceptedState, b: AcceptedState) -> Array:
    """Changes of the body and its surfaces from one state to the other. Collective.

    Returns:
        The largest displacement of a node, a length, and `change`; between states of equilibrium
        then, surface by surface, the mean change of the jump at points that are not clamped, a
        length, and that of the variable by which bonds weaken. Where points move one after the
        other, such a mean over a time is the sum of those over its parts.
    """
    if not (isinstance(a, AtRest) and isinstance(b, AtRest)):
        return np.array([0.0, change(comm, a, b)])
    moved = float(np.abs(b.forces.u - a.forces.u).max(initial=0.0))
    moved = comm.allreduce(moved, op=MPI.MAX)
    points = _at_points(a, b)
    sums = np.array([[p.distances.sum(), p.weakened.sum(), len(p.distances)] for p in points])
    total, weakened, number = comm.allreduce(sums.reshape(-1, 3)).T
    means = np.array([total, weakened]) / np.maximum(number, 1.0)
    return np.array([moved, change(comm, a, b), *means.ravel()])


def largest_at_points(comm: MPI.Comm, a: AcceptedState, b: AcceptedState) -> tuple[Array, Array]:
    """Largest changes at a single point from one state to the other, per surface. Collective.

    Returns:
        The largest change of the jump at a point, a length; and the largest weakening of a bond, as
        a part of the strength that the strongest had left (0 where that is not known).
    """
    if not (isinstance(a, AtRest) and isinstance(b, AtRest)):
        return np.zeros(0), np.zeros(0)
    found = np.array(
        [
            [np.max(v, initial=0.0) for v in (p.distances, p.weakened, p.left)]
            for p in _at_points(a, b)
        ]
    )
    distances, weakened, left = comm.allreduce(found.reshape(-1, 3), op=np.maximum).T
    return distances, np.divide(weakened, left, out=np.zeros_like(left), where=left > 0)


class _AtPoints(NamedTuple):
    """Changes at the points of a surface (n,) from a state to another, on this rank.

    Attributes:
        distances: changes of the jump.
        weakened: changes of the variable by which bonds weaken.
        left: distances of that variable to its end, before.
    """

    distances: Array
    weakened: Array
    left: Array


def _at_points(a: AtRest, b: AtRest) -> list[_AtPoints]:
    """Changes at all points that are not clamped, surface by surface."""
    eq = a.forces.equations
    found = []
    for k, s in enumerate(eq.surfaces):
        distances = np.linalg.norm(b.forces.surfaces[k].jump - a.forces.surfaces[k].jump, axis=1)
        weakened = np.zeros_like(distances)
        left = np.zeros_like(distances)
        bond = s.law.weakening
        if bond is not None:
            before = a.memory[k].fields[bond.name]
            weakened = np.abs(b.memory[k].fields[bond.name] - before)
            end = bond.end
            if end is None:
                end = 0.0 if bond.sense < 0 else math.nan
            left = np.nan_to_num(np.abs(end - before))
        free = (
            slice(None) if s.method == "integral" else ~eq.constraints.clamped[k][: len(distances)]
        )
        found.append(_AtPoints(distances[free], weakened[free], left[free]))
    return found
