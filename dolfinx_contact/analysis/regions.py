# SPDX-License-Identifier: LGPL-3.0-or-later
"""Regions of two parameters with the same number and statuses of solutions.

Curves of folds and of events (`event_curves`, with ``folds_only=False``) divide the plane of two
parameters into cells. Between the values of the second parameter at which curves end, meet or
cross, the curves lie one above the other, and a cell lies between two of them. If no curve is
missing, the number of solutions and their statuses are constant in a cell. They are determined in
its middle, with a proof of completeness (`solutions`).

Completeness of the curves is not proved. A missing curve shows as a change of the solutions between
neighbouring cells without a curve between them (`Chart.explained`), unless it lies inside a single
cell.
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
        curves: all its curves of folds and events in the ranges, found with the same ranges.
        mu_range: least and largest mu.
        gamma_range: least and largest gamma.
        proof_seconds: time of the proof in a cell.

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
    """Return whether solutions change across each curve as required, and only there."""
    stacked = [(a, b) for a, b in pairwise(cells) if a.mu == b.mu]
    neighbours = [(a, b) for a, b in combinations(cells, 2) if a.mu[1] == b.mu[0] and _touch(a, b)]
    return all(_differ_as_required(a, b) for a, b in stacked) and all(
        a.solutions == b.solutions for a, b in neighbours
    )


def _touch(left: ChartCell, right: ChartCell) -> bool:
    """Return whether two cells in neighbouring strips share a part of their sides."""
    low, high = left.ends(left.mu[1])
    least, most = right.ends(right.mu[0])
    return min(high, most) - max(low, least) > _SIDE * (left.gamma[1] - left.gamma[0])


def _differ_as_required(below: ChartCell, above: ChartCell) -> bool:
    """Return whether two cells differ as the curves between them require.

    Across a fold, two solutions appear or vanish; across an event, one solution is replaced.
    """
    mu = below.middle[0]
    lower = set(below.solutions)
    upper = set(above.solutions)
    if len(below.above) == 1:
        (curve,) = below.above
        statuses = set(curve.statuses_at(mu))
        sides = (statuses <= lower, statuses <= upper)
        # both solutions of a fold are on one side, those of an event on different sides
        fits = any(sides) if curve.kind == "fold" else not any(sides)
        return lower ^ upper == statuses and fits
    return lower ^ upper <= set().union(*(curve.statuses_at(mu) for curve in below.above))
