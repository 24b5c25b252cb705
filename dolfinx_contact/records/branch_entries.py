# SPDX-License-Identifier: LGPL-3.0-or-later
"""Journal entries of points and nodes of branches, and journals in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._geometry import by_coordinates
from dolfinx_contact._mpi import everywhere, same_everywhere
from dolfinx_contact.continuation import Branch, BranchPoint, Change, Node, SpecialPoint
from dolfinx_contact.continuation.follow import require_solutions
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.laws import status
from dolfinx_contact.records.functionals import Functional, evaluators
from dolfinx_contact.records.journal import FORMAT, Entry, Journal, RecordedRun, reread
from dolfinx_contact.records.states import places

if TYPE_CHECKING:
    from dolfinx_contact.parametric import ParametricContact

__all__ = ["BranchEntries", "journal_of"]


class BranchEntries:
    """Conversion of points of branches to journal entries and vectors, and back. Collective.

    Args:
        system: contact problem with a parameter.
        functionals: functions that evaluate the functionals, by name (`evaluators`); default: none.

    Attributes:
        vectors: work vectors by name, "tangent" for the tangent and "x" for the unknowns.
    """

    def __init__(
        self,
        system: ParametricContact,
        functionals: Mapping[str, Callable[[], float]] | None = None,
    ):
        self.vectors = {name: system.create_vector() for name in ("tangent", "x")}
        self._system = system
        self._functionals = functionals or {}
        self._layout = Layout(system)

    def split(self, point: BranchPoint) -> dict[str, PETSc.Vec]:
        """Copy the tangent and the unknowns of a point to `vectors`, and return `vectors`.

        Not collective.
        """
        for name, y in (("tangent", point.tangent), ("x", point.y)):
            self.vectors[name].array[:] = y.array_r[: self._layout.local]
        return self.vectors

    def columns(self, point: BranchPoint) -> dict[str, Any]:
        """Return the columns of the entry of a point; ``status`` has the letters of the piece."""
        return {
            "gamma": point.gamma,
            "step": point.step,
            "corrections": point.corrections,
            "tau": point.tau,
            "tangent_gamma": self._layout.gamma(point.tangent),
            "status": self._system.letters(point.piece),
        }

    def joined(self, columns: Entry) -> BranchPoint:
        """Return a branch point from the columns of its entry.

        The unknowns and the tangent are copied from `vectors`.
        """
        return BranchPoint(
            self._layout.joined(self.vectors["x"], columns.gamma),
            self._layout.joined(self.vectors["tangent"], columns.tangent_gamma),
            self._system.piece_of(columns.status),
            columns.gamma,
            columns.step,
            columns.corrections,
            columns.tau,
        )

    def put(self, point: BranchPoint) -> None:
        """Write a point to the Functions of the problem."""
        self._system.put(self.split(point)["x"], point.gamma, point.piece)

    def destroy(self) -> None:
        """Destroy the vectors."""
        for x in self.vectors.values():
            x.destroy()

    def point(
        self, index: int, point: BranchPoint, special: Sequence[SpecialPoint], x_scale: float = 1.0
    ) -> dict[str, Any]:
        """Write a branch point into the Functions of the problem and return its entry. Collective.

        Args:
            index: number of the point on its branch.
            point: point of a branch.
            special: special points between the previous point and this one.
            x_scale: square of the norm of the unknowns that counts as one unit step; 0 if it is
                unknown.
        """
        values = {}
        for name, functional in self._functionals.items():
            self.put(point)  # a functional may have written to the Functions
            values[name] = functional()
        self.put(point)
        x = self.vectors["x"]
        weighted = x.duplicate()
        self._system.metric(x, weighted)
        square = max(float(x.dot(weighted)), 0.0)
        weighted.destroy()
        return {
            "index": index,
            **self.columns(point),
            "special": [self._special(s) for s in special],
            "norm": float(np.sqrt(square / x_scale)) if x_scale else 0.0,
            "functionals": values,
        }

    def node(self, node: Node) -> dict[str, Any]:
        """Return the entry of a node of a diagram. Collective."""
        rays = [
            {"status": self._system.letters(ray.piece), "gamma": self._layout.gamma(ray.tangent)}
            for ray in node.rays
        ]
        point = self._special(node.point) | {"method": node.point.method}
        return {"point": point, "rays": rays, "edges": list(node.edges)}

    def _special(self, s: SpecialPoint) -> dict[str, Any]:
        """Return the entry of a special point. Collective."""
        return {
            "kind": s.kind,
            "smooth": s.smooth,
            "gamma": s.gamma,
            "parity": s.parity,
            "others": len(s.others),
            "complete": s.complete,
            "bracket": list(s.bracket) if s.bracket is not None else None,
            "changes": self._changes(s.changes),
        }

    def _changes(self, changes: Sequence[Change]) -> list[dict[str, Any]]:
        """Return the journal items for changes of statuses at a special point. Collective.

        They are sorted by the coordinates of the contact points.
        """
        if not changes:
            return []
        # every rank knows the positions of its own points only
        system = self._system
        places_here = {
            i: (system.positions[c.point], system._ids[c.point])
            for i, c in enumerate(changes)
            if c.rank == system.comm.rank
        }
        known = {i: v for part in system.comm.allgather(places_here) for i, v in part.items()}
        x, ids = (np.array([known[i][k] for i in range(len(changes))]) for k in (0, 1))
        letters = [str(letter) for letter in status.letters(x.shape[1])]
        surfaces = [s.name for s in system.problem.surfaces]
        return [
            {
                "surface": surfaces[ids[i, 0]],
                "x": x[i].tolist(),
                "before": letters[changes[i].before],
                "after": letters[changes[i].after],
            }
            for i in by_coordinates(x, ids)
        ]


def journal_of(
    system: ParametricContact,
    branches: Iterable[Branch],
    functionals: Mapping[str, Functional] | None = None,
) -> Journal:
    """Return the journal of branches in memory, for tables and `draw_diagram`. Collective.

    A run cannot be resumed from this journal; use `BranchRecord` for a journal on disk.

    Args:
        system: contact problem with a parameter to which the branches belong; its data are
            restored.
        branches: branches, numbered in the given order.
        functionals: functionals by name, as for `BranchRecord`.

    Returns:
        Journal, on every rank. ``norm`` uses the metric of the system.

    Raises:
        ValueError: on every rank, for the reasons listed in `BranchRecord`, if the numbers of
            branches or points differ between ranks, or if a point is not a solution of the system
            with its present data.

    Example:
        ::

            branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0))
            journal = journal_of(system, [branch], {"force": total("rt"), "ut": leftmost("ut")})
            draw_diagram("branch.png", journal, ["force", "ut"])
    """
    with everywhere(system.comm, "journal_of"):
        branches = list(branches)
        if not all(isinstance(b, Branch) for b in branches):
            raise ValueError("branches must be Branch objects, as returned by follow and explore")
    same_everywhere(system.comm, points_of_the_branches=[len(b.points) for b in branches])
    system.equations.require_same_mesh()
    for branch in branches:
        require_solutions(system, branch)
    values = evaluators(system.problem, functionals or {})
    header = {"functionals": list(values), "points": places(system.problem), "format": FORMAT}
    journal = Journal(header=header)
    entries = BranchEntries(system, values)
    with system.restored(always=True):
        for number, branch in enumerate(branches):
            points = [
                reread(entries.point(i, point, [s for s in branch.special if s.index == i]))
                for i, point in enumerate(branch.points)
            ]
            journal.branches[number] = RecordedRun(
                ending=branch.ending, reason=branch.reason, points=points
            )
    entries.destroy()
    return journal
