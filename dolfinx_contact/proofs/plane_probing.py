# SPDX-License-Identifier: LGPL-3.0-or-later
"""Taking statuses out that linear programs find impossible.

Each point is held in each of its statuses in turn. Where the relaxation has no point its
multipliers are a proof (`check_proof.py`), and mostly one for other statuses of other points as
well: all that they exclude goes. Statuses that a point of a relaxation shows to be possible are
left.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from dolfinx_contact.proofs.check_proof import Certificate, StatusRegion, has_status, used
from dolfinx_contact.proofs.relaxation import Relaxation

__all__ = ["probe", "prove_empty"]

Array = npt.NDArray[np.float64]

_MARGIN = 4.0  # times the round-off, so that another machine comes to the same
_NOTHING = 1e-7


def probe(region: StatusRegion, certificate: Certificate, late: Callable[[], bool]) -> bool:
    """Take statuses out of a region; whether it is proved empty.

    Args:
        region: changed.
        certificate: receives the steps.
        late: whether the time is over.
    """
    relaxation = Relaxation(region.problem, region.allowed, region.ub)
    possible = np.zeros((region.problem.points, 7), dtype=bool)
    y = relaxation.infeasible()
    if y is not None and take_out(region, certificate, y):
        return True
    changed = True
    while changed:
        changed = False
        _see(relaxation, possible)
        for i in _order(region):
            for s in range(7):
                mask = int(region.allowed[i])
                if not mask >> s & 1 or mask == 1 << s or possible[i, s]:
                    continue
                if late():
                    return False
                relaxation.hold(i, 1 << s)
                y = relaxation.infeasible()
                if y is None:
                    possible[i, s] = True
                    _see(relaxation, possible)
                before = region.allowed.copy()
                if y is not None and take_out(region, certificate, y):
                    return True
                for k in {i, *map(int, np.flatnonzero(before != region.allowed))}:
                    relaxation.hold(k, int(region.allowed[k]))
                changed |= bool((before != region.allowed).any())
        possible[:] = False
        if changed:
            relaxation = Relaxation(region.problem, region.allowed, region.ub)
            y = relaxation.infeasible()
            if y is not None and take_out(region, certificate, y):
                return True
    return False


def prove_empty(region: StatusRegion, certificate: Certificate) -> int | None:
    """The number of a vector that proves a region empty; None if there is none."""
    y = Relaxation(region.problem, region.allowed, region.ub).infeasible()
    if y is None or not region.excluded(y, margin=_MARGIN).any(axis=1).any():
        return None
    return certificate.vector(y)


def take_out(region: StatusRegion, certificate: Certificate, y: Array) -> bool:
    """Exclude what the multipliers exclude; whether nothing is left."""
    while True:
        excluded = region.excluded(y, margin=_MARGIN)
        if not excluded.any():
            return False
        has = has_status(region.allowed)
        number = certificate.vector(y)
        if (excluded == has).all(axis=1).any():
            certificate.steps.append({"do": "empty", "y": number})
            return True
        what = [[int(i), int(s)] for i, s in np.argwhere(excluded)]
        certificate.steps.append({"do": "exclude", "y": number, "what": what})
        for i, s in what:
            region.exclude(i, s)


def _order(region: StatusRegion) -> npt.NDArray[np.int64]:
    """Points, from the middle of those that are not decided, by halves."""
    left = [i for i, c in enumerate(region.choices) if len(c) > 1]
    order: list[int] = []
    spans = [(0, len(left))]
    while spans:
        a, b = spans.pop(0)
        if a < b:
            k = (a + b) // 2
            order.append(left[k])
            spans += [(a, k), (k + 1, b)]
    return np.array(order, dtype=np.int64)


def _see(relaxation: Relaxation, possible: npt.NDArray[np.bool_]) -> None:
    """Mark the statuses in which points of the relaxation are."""
    positive = relaxation.point > _NOTHING
    uses = used(relaxation.problem)
    off = (positive.T[:, None, :] & ~uses).any(axis=2)
    possible |= ~off
