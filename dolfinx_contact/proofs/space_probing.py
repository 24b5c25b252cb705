# SPDX-License-Identifier: LGPL-3.0-or-later
"""What linear programs tell of a region in space: cells that are impossible, and bounds.

Every answer is a step that the checker takes, or none.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from dolfinx_contact.proofs.check_proof import (
    IN_CLOSED,
    IN_OPEN,
    IN_SLIP,
    IN_STICK,
    MOST,
    OF_RK,
    OF_RN,
    OF_S,
    OF_UN,
    Certificate,
    SpaceDual,
    SpaceRegion,
)
from dolfinx_contact.proofs.hull import Hull

__all__ = ["Probing"]

Array = npt.NDArray[np.float64]

_KEPT = 40  # vectors of earlier regions that are tried first
_MARGIN = 4.0  # times the round-off that a proof is to have left
_WIDE = 1.2  # arcs, in diamond angles, beyond which slips are not bounded
_GAIN = 1e-3  # of a bound, relative


class Probing:
    """Probes regions, and keeps the vectors that excluded something.

    Args:
        certificate: receives the steps.
        late: whether time is over.

    Attributes:
        programs: number of linear programs solved.
    """

    def __init__(self, certificate: Certificate, late: Callable[[], bool]):
        self._certificate = certificate
        self._late = late
        self._pool: list[Array] = []
        self.programs = 0

    def exclude(self, region: SpaceRegion, y: Array) -> bool:
        """Take out of a region the cells that y excludes; whether there were any."""
        excluded = region.excluded(y, margin=_MARGIN)
        if not excluded.any():
            return False
        number = self._certificate.vector(y)
        if np.logical_and.reduceat(excluded, region.cells.first).any():
            self._certificate.steps.append({"do": "empty", "y": number})
            region.cells = region.cells.kept(np.zeros(len(excluded), dtype=bool))
            return True
        what = np.flatnonzero(excluded).tolist()
        self._certificate.steps.append({"do": "exclude", "y": number, "what": what})
        region.cells = region.cells.kept(~excluded)
        return True

    def known(self, region: SpaceRegion) -> bool:
        """Try vectors of earlier regions; whether nothing is left."""
        for y in self._pool[-_KEPT:]:
            self.exclude(region, y)
            if not len(region.cells):
                return True
        return False

    def whole(self, region: SpaceRegion) -> Hull | None:
        """The hull of a region; None if nothing is left of it."""
        hull = Hull(region.problem, region.cells, region.most)
        y = hull.empty()
        self.programs += 1
        if y is not None and self.exclude(region, y):
            self._keep(y)
            if not len(region.cells):
                return None
            return self.whole(region)
        return hull

    def cells(self, region: SpaceRegion, hull: Hull) -> bool:
        """Try every cell of points that are not decided; whether nothing is left."""
        whole = hull.cells
        alive = hull.alive
        for k in np.argsort(-whole.kind, kind="stable"):
            node = whole.node[k]
            if not alive[k] or (alive & (whole.node == node)).sum() == 1:
                continue
            if self._late():
                return False
            y = hull.empty(int(k))
            self.programs += 1
            if y is None:
                continue
            before = np.flatnonzero(alive)
            excluded = region.excluded(y, margin=_MARGIN)
            if not self.exclude(region, y):
                continue
            self._keep(y)
            if not len(region.cells):
                return True
            alive[before[excluded]] = False
        return False

    def bounds(self, region: SpaceRegion, hull: Hull, *, all_points: bool) -> float:
        """Bound the quantities of points of a decided type; the gain, as a sum of logarithms."""
        gained = 0.0
        for i, kinds in enumerate(region.kinds):
            if len(kinds) > 1 and not all_points:
                continue
            for quantity, of_kinds in self._quantities(region, i, kinds):
                if self._late():
                    return gained
                gained += self._bound(region, hull, quantity, i, of_kinds)
        return gained

    def _quantities(
        self, region: SpaceRegion, i: int, kinds: frozenset[int]
    ) -> list[tuple[int, tuple[int, ...]]]:
        wanted: list[tuple[int, tuple[int, ...]]] = []
        coulomb = region.problem.friction[i] > 0
        if IN_OPEN in kinds or not coulomb:
            of = (IN_OPEN,) if coulomb else (IN_OPEN, IN_CLOSED)
            wanted += [(q, of) for q in range(OF_UN)]
        if IN_OPEN in kinds:
            wanted.append((OF_UN, (IN_OPEN,)))
        if IN_STICK in kinds:
            wanted.append((OF_RK, (IN_STICK,)))
        if IN_SLIP in kinds or IN_CLOSED in kinds:
            of = (IN_SLIP, IN_CLOSED)
            wanted += [(OF_RN + 1, of), (OF_RN, of)]
        hull = region.cells.hull(i)
        if hull is not None and hull[1] < _WIDE:
            wanted += [(OF_S + 1, (IN_SLIP,)), (OF_S, (IN_SLIP,))]
        return wanted

    def _bound(
        self, region: SpaceRegion, hull: Hull, quantity: int, i: int, kinds: tuple[int, ...]
    ) -> float:
        assert quantity < MOST
        y = hull.most(quantity, i, kinds)
        self.programs += 1
        if y is None:
            return 0.0
        dual = SpaceDual(region.problem, y)
        other = SpaceDual(region.problem, -y)
        value, y = min(
            ((d.most(region.cells, region.most, quantity, i), d.y) for d in (dual, other)),
            key=lambda pair: pair[0],
        )
        old = float(region.most[quantity, i])
        size = float(np.abs(region.most[:, i]).max())
        if not value < old - _GAIN * size:
            return 0.0
        number = self._certificate.vector(y)
        step = {"do": "bound", "y": number, "quantity": quantity, "point": i, "value": value}
        self._certificate.steps.append(step)
        region.limit(quantity, i, value)
        if quantity in (OF_RN, OF_S) or old <= 0:
            return 0.0
        return float(np.clip(np.log((old + 1e-9) / (max(value, 0.0) + 1e-9)), 0.0, 2.0))

    def _keep(self, y: Array) -> None:
        self._pool.append(y)
        del self._pool[:-200]
