# SPDX-License-Identifier: LGPL-3.0-or-later
"""Journals of branches in memory: the content of a record without the disk."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dolfinx_contact._errors import everywhere, same_everywhere
from dolfinx_contact.continuation import Branch, SpecialPoint
from dolfinx_contact.continuation.points import require_solutions
from dolfinx_contact.records.columns import PointEntry
from dolfinx_contact.records.functionals import Functional, compiled
from dolfinx_contact.records.journal import FORMAT, Journal, JournalBranch
from dolfinx_contact.records.points import entry_of, places

if TYPE_CHECKING:
    from dolfinx_contact.parametric import ParametricContact

__all__ = ["journal_of"]


def journal_of(
    system: ParametricContact,
    branches: Iterable[Branch],
    functionals: Mapping[str, Functional] | None = None,
) -> Journal:
    """The journal of branches that have been followed, for tables and `draw_diagram`. Collective.

    It is in memory only, and nothing can be resumed from it; `BranchRecord` writes one.

    Args:
        system: the problem that the branches belong to; it is left as it was.
        branches: their numbers in the journal are their places here.
        functionals: functionals by name, as for `BranchRecord`.

    Returns:
        The journal, on every rank. ``norm`` is that of the metric of the system.

    Raises:
        ValueError: on every rank, as for `BranchRecord`, if the numbers of branches or points
            differ between ranks, or a point is not a solution of the system as it is now.

    Example:
        ::

            branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0))
            journal = journal_of(system, [branch], {"force": total("rt"), "energy": problem.energy})
            draw_diagram("branch.png", journal, ["force", "energy"])
    """
    with everywhere(system.comm, "journal_of"):
        branches = list(branches)
        if not all(isinstance(b, Branch) for b in branches):
            raise ValueError("branches must be Branches, as `follow` and `explore` return them")
    same_everywhere(system.comm, points_of_the_branches=[len(b.points) for b in branches])
    system.equations.require_same_mesh()
    for branch in branches:
        require_solutions(system, branch)
    values = compiled(system.problem, functionals or {})
    header = {"functionals": list(values), "points": places(system.problem), "format": FORMAT}
    journal = Journal(header=header)
    x = system.create_vector()
    mx = system.create_vector()
    with system.restored(always=True):
        for number, branch in enumerate(branches):
            entries: list[PointEntry] = []
            for index, point in enumerate(branch.points):
                x.array[:] = point.y.array_r[: x.getLocalSize()]
                system.put(x, point.gamma, point.piece)
                system.metric(x, mx)
                norm = float(np.sqrt(max(float(x.dot(mx)), 0.0)))
                entry = entry_of(system, index, point, _before(branch, index), norm)
                functionals_there = {name: f() for name, f in values.items()}
                entries.append(replace(entry, functionals=functionals_there))
            journal.branches[number] = JournalBranch(
                ending=branch.ending, reason=branch.reason, points=entries
            )
    x.destroy()
    mx.destroy()
    return journal


def _before(branch: Branch, index: int) -> list[SpecialPoint]:
    """Special points on the way to a point of the branch."""
    return [s for s in branch.special if s.index == index]
