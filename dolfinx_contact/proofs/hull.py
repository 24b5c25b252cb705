# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Linear program over the convex hull of a region of cells (`check_proof.Cells`).

Every cell is contained in a polytope of states (a, r), the displacement and the force of a point: a
box for open points; a cone over an octagon around the friction disc for stick; and for slip, the
convex hull of the smallest and largest slip distances and normal forces in the directions of both
ends of the arc and of the intersection of their tangents. A tangential force with a prescribed
bound has its own octagon.

At a solution, the state of every point is a convex combination of the corners, and the equilibrium
S a - r = p holds with the stiffness matrix S and the load p. Multipliers of an infeasible program
are candidates for `check_proof.SpaceDual`, which uses the curved sets instead of the polytopes.
"""

from __future__ import annotations

import numpy as np

from dolfinx_contact._arrays import Array, Ints, Mask
from dolfinx_contact.proofs.check_proof import (
    IN_CLOSED,
    IN_OPEN,
    IN_SLIP,
    IN_STICK,
    OF_RK,
    OF_RN,
    OF_S,
    OF_UN,
    Cells,
    ReducedProblem,
    directions,
    ends_of,
)
from dolfinx_contact.proofs.simplex import Simplex

__all__ = ["Hull"]

_SIDES = directions(np.arange(8) / 2)
_CORNERS = _SIDES + np.roll(_SIDES, -1, axis=0)
#: Corners of a regular octagon about the unit disc.
_OCTAGON = _CORNERS * (2 / (_CORNERS**2).sum(axis=1))[:, None]


class Hull:
    """Linear program for the states in a region, with warm starts from the last basis.

    Args:
        problem: reduced problem with m points, scaled by `ReducedProblem.scaled`.
        cells: cells of the region.
        most: upper bounds of the quantities of `check_proof.bounded_in_space`, shape (MOST, m).

    Attributes:
        corners: displacement and force of a point for each of the k columns, shape (k, 6).
        cell: index of the cell of each column, shape (k,); -1 for prescribed friction bounds.
        node: index of the contact point of each column, shape (k,).
    """

    def __init__(self, problem: ReducedProblem, cells: Cells, most: Array):
        self.problem = problem
        self.cells = cells
        m = problem.points
        self.corners, self.cell = _corners(problem, cells, most)
        self.node = cells.node[self.cell]
        group = self.node
        given = np.flatnonzero(problem.g > 0)
        if len(given):
            shears = np.zeros((len(given), 8, 6))
            shears[:, :, 3:5] = problem.g[given, None, None] * _OCTAGON
            self.corners = np.concatenate([self.corners, shears.reshape(-1, 6)])
            self.cell = np.concatenate([self.cell, np.full(8 * len(given), -1)])
            self.node = np.concatenate([self.node, np.repeat(given, 8)])
            group = np.concatenate([group, np.repeat(m + np.arange(len(given)), 8)])
        k = len(self.node)
        A = np.zeros((3 * m + m + len(given), k))
        S = problem.S.reshape(3 * m, m, 3)
        A[: 3 * m] = np.einsum("nkc,kc->nk", S[:, self.node], self.corners[:, :3])
        for c in range(3):
            A[3 * self.node + c, np.arange(k)] -= self.corners[:, 3 + c]
        A[3 * m + group, np.arange(k)] = 1.0
        b = np.concatenate([problem.p, np.ones(m + len(given))])
        self._simplex = Simplex(A, b, np.flatnonzero(np.diff(group, prepend=-1)))
        self.alive = np.ones(len(cells), dtype=bool)

    def empty(self, cell: int | None = None) -> Array | None:
        """Return multipliers that exclude all solutions, shape (3 m,) for m points.

        None if the program is feasible.

        Args:
            cell: index of the only cell allowed at its point; by default all cells are allowed.
        """
        allowed = self.alive.copy()
        if cell is not None:
            allowed[self.cells.node == self.cells.node[cell]] = False
            allowed[cell] = True
        y = self._simplex.solve(self._usable(allowed))
        return None if y is None else self._scaled(-y)

    def most(self, quantity: int, point: int, kinds: tuple[int, ...]) -> Array | None:
        """Return multipliers bounding a quantity from above, shape (3 m,); None if not found.

        Args:
            quantity: index of the quantity of `check_proof.bounded_in_space`.
            point: index of the contact point.
            kinds: kinds of cells in which the quantity is bounded.
        """
        here = self.cells.node == point
        allowed = self.alive & (~here | np.isin(self.cells.kind, kinds))
        if not (allowed & here).any():
            return None
        cost = np.zeros(len(self.node))
        mine = (self.node == point) & (self.cell >= 0)
        cost[mine] = -_value(self.corners[mine], quantity)
        y = self._simplex.least(cost, self._usable(allowed))
        return None if y is None else np.asarray(-y[: 3 * self.problem.points])

    def _usable(self, allowed: Mask) -> Mask:
        return np.where(self.cell >= 0, allowed[self.cell], True)

    def _scaled(self, y: Array) -> Array:
        y = y[: 3 * self.problem.points]
        return np.asarray(y / (np.abs(y).max(initial=0.0) or 1.0))

    @property
    def point(self) -> tuple[Array, Array]:
        """Displacements and forces at the solution of the last program, shape (m, 3) each."""
        x = self._simplex.point[:, None] * self.corners
        found = np.zeros((self.problem.points, 6))
        np.add.at(found, self.node, x)
        return found[:, :3], found[:, 3:]


def _value(corners: Array, quantity: int) -> Array:
    """Return the quantity with a given index (`check_proof.bounded_in_space`) at each corner."""
    if quantity == OF_UN:
        return corners[:, 2]
    if quantity < OF_UN:
        return corners[:, quantity // 2] * (1 if quantity % 2 else -1)
    if quantity < OF_RN:
        return np.hypot(corners[:, 0], corners[:, 1]) * (-1 if quantity == OF_S else 1)
    return corners[:, 5] * (-1 if quantity == OF_RN else 1)


def _corners(problem: ReducedProblem, cells: Cells, most: Array) -> tuple[Array, Ints]:
    """Return displacements and forces at the corners, shape (k, 6), and their cells, shape (k,)."""
    parts = []
    numbers = []
    made = (_of_open, _of_stick, _of_slip, _of_closed)
    for kind, here in enumerate(cells.of_kind):
        if len(here):
            corners = made[kind](problem, cells, most, here)
            parts.append(corners.reshape(-1, 6))
            numbers.append(np.repeat(here, corners.shape[1]))
    table = np.concatenate(parts)
    number = np.concatenate(numbers)
    order = np.argsort(number, kind="stable")
    return table[order], number[order]


def _of_open(problem: ReducedProblem, cells: Cells, most: Array, here: Ints) -> Array:
    return _boxes(cells.node[here], most, 2, np.zeros(len(most[0])), np.maximum(most[OF_UN], 0))


def _of_closed(problem: ReducedProblem, cells: Cells, most: Array, here: Ints) -> Array:
    return _boxes(cells.node[here], most, 5, *ends_of(most, OF_RN))


def _boxes(nodes: Ints, most: Array, column: int, low: Array, high: Array) -> Array:
    """Return the corners of boxes of tangential displacement and one normal component.

    For k points the shape is (k, 8, 6). ``column`` is 2 for the normal displacement or 5 for the
    normal force, between ``low`` and ``high``, shape (m,) each.
    """
    found = np.zeros((len(nodes), 8, 6))
    corner = np.arange(8)
    for c in (0, 1):
        chosen = (corner >> c) & 1
        found[:, :, c] = np.where(
            chosen, most[2 * c + 1, nodes][:, None], -most[2 * c, nodes, None]
        )
    chosen = (corner >> 2) & 1
    found[:, :, column] = np.where(chosen, high[nodes, None], low[nodes, None])
    return found


def _of_stick(problem: ReducedProblem, cells: Cells, most: Array, here: Ints) -> Array:
    nodes = cells.node[here]
    found = np.zeros((len(here), 9, 6))
    rn = np.maximum(most[OF_RK, nodes], 0)
    found[:, 1:, 5] = rn[:, None]
    found[:, 1:, 3:5] = (problem.friction[nodes] * rn)[:, None, None] * _OCTAGON
    return found


def _of_slip(problem: ReducedProblem, cells: Cells, most: Array, here: Ints) -> Array:
    nodes = cells.node[here]
    first, last = cells.sides
    meet = first + last
    meet = meet * (2 / (meet**2).sum(axis=1))[:, None]
    found = []
    for s in ends_of(most, OF_S):
        for rn in ends_of(most, OF_RN):
            for e in (first, last, meet):
                corner = np.zeros((len(here), 6))
                corner[:, :2] = s[nodes, None] * e
                corner[:, 3:5] = -(problem.friction * rn)[nodes, None] * e
                corner[:, 5] = rn[nodes]
                found.append(corner)
    return np.stack(found, axis=1)


assert (IN_OPEN, IN_STICK, IN_SLIP, IN_CLOSED) == (0, 1, 2, 3)  # the order of `_corners`
