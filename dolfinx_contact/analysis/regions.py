# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells of the parameter plane in which the number and statuses of solutions are constant.

Curves of folds and of events (`event_curves`, with ``folds_only=False``) divide the plane of two
parameters into cells. The values of the second parameter at which curves end, meet or cross define
strips. Within a strip the curves lie one above the other, and a cell lies between two of them. If
no curve is missing, the number and statuses of the solutions are constant in a cell. They are
determined at its midpoint, with a proof of completeness (`proofs`).

Completeness of the curves is not proved. A missing curve is detected as a change of the solutions
between neighbouring cells without a curve between them (`Chart.explained`), unless the curve lies
inside a single cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, pairwise

from dolfinx_contact._mpi import Arguments, collective
from dolfinx_contact._validate import positive
from dolfinx_contact.analysis.charts import Chart, ChartCell, letters, solutions_at
from dolfinx_contact.analysis.event_curves import EventCurves, layers, strips
from dolfinx_contact.analysis.family import ContactFamily
from dolfinx_contact.continuation.arguments import checked_range

__all__ = ["solution_regions"]

_SAME = 1e-9  # distance of curves that count as one, relative to the range of gamma
_SIDE = 1e-6  # shortest part of a side that cells share, relative to the range of gamma


def _check(a: Arguments) -> None:
    a.mu_range = checked_range(a.mu_range, [], "mu")
    a.gamma_range = checked_range(a.gamma_range, [])
    positive(a.proof_seconds, "proof_seconds", infinite=True)


@collective("regions", _check)
def solution_regions(
    family: ContactFamily,
    curves: EventCurves,
    *,
    mu_range: tuple[float, float],
    gamma_range: tuple[float, float],
    proof_seconds: float = 20.0,
) -> Chart:
    """Find the solutions in each cell between curves. Collective; ranks share the cells.

    Args:
        family: problem with two parameters, the same on all ranks of its communicator.
        curves: all curves of folds and events, found with the same ranges.
        mu_range: smallest and largest value of the second parameter mu.
        gamma_range: smallest and largest value of the load parameter gamma.
        proof_seconds: time limit of the proof in each cell, in seconds. Default 20.

    Raises:
        ValueError: on every rank, if an argument is not valid.
    """
    low, high = gamma_range
    near = _SAME * (high - low)
    bare = []
    for span in strips(curves.curves, mu_range):
        middle = (span[0] + span[1]) / 2
        inside = [
            g
            for g in layers(curves.curves, span, near)
            if low + near < g[0].at(middle) < high - near
        ]
        for below, above in pairwise([(), *inside, ()]):
            bare.append(ChartCell(span, gamma_range, below=below, above=above))
    none = [()] * len(bare)
    found = solutions_at(family, [cell.middle for cell in bare], none, proof_seconds, "regions")
    cells = tuple(
        replace(cell, solutions=letters(statuses), proved=proved)
        for cell, (statuses, proved) in zip(bare, found, strict=True)
    )
    bounds = dict.fromkeys(curve for cell in cells for curve in (*cell.below, *cell.above))
    return Chart(cells, tuple(bounds), _are_explained(cells))


def _are_explained(cells: Sequence[ChartCell]) -> bool:
    """Return whether the solutions of neighbouring cells differ only as curves require."""
    stacked = [(a, b) for a, b in pairwise(cells) if a.mu == b.mu]
    neighbours = [(a, b) for a, b in combinations(cells, 2) if a.mu[1] == b.mu[0] and _touch(a, b)]
    return all(_differ_as_required(a, b) for a, b in stacked) and all(
        a.solutions == b.solutions for a, b in neighbours
    )


def _touch(left: ChartCell, right: ChartCell) -> bool:
    """Return whether two cells in neighbouring strips share a part of an edge."""
    low, high = left.ends(left.mu[1])
    least, most = right.ends(right.mu[0])
    return min(high, most) - max(low, least) > _SIDE * (left.gamma[1] - left.gamma[0])


def _differ_as_required(below: ChartCell, above: ChartCell) -> bool:
    """Return whether the solutions of two cells differ as the curves between them require.

    Two solutions appear or vanish across a fold; one solution changes its statuses across an event.
    """
    mu = below.middle[0]
    lower = set(below.solutions)
    upper = set(above.solutions)
    if len(below.above) == 1:
        (curve,) = below.above
        statuses = set(curve.statuses_at(mu))
        sides = (statuses <= lower, statuses <= upper)
        # a fold has both solutions on one side, an event has one on each side
        fits = any(sides) if curve.kind == "fold" else not any(sides)
        return lower ^ upper == statuses and fits
    return lower ^ upper <= set().union(*(curve.statuses_at(mu) for curve in below.above))
