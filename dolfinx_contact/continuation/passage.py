# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stepping over kinks (T. Ligursky and Y. Renard, Comput. Mech. 56, 2015).

Steps are corrected on H itself. Where no step of at least h_min succeeds there is a kink within
h_min. Then the tangent t of the piece beyond, at y + h_1 T with h_1 a little larger than h_min, is
tried as the direction to continue, in both senses, but for the one that leads back along the
branch.

Nothing is located: a kink is known to h_min, and recorded as such. Other rays are not
looked for.
"""

from __future__ import annotations

import logging
from dataclasses import replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation.batch import Crossed, FreeSteps
from dolfinx_contact.continuation.branch import BranchPoint, SpecialPoint
from dolfinx_contact.continuation.system import Piece

__all__ = ["SteppingSteps"]

logger = logging.getLogger(__name__)

_BEYOND = (2.0, 4.0, 8.0)  # h_1 over h_min
_LONGER = (2.0, 8.0, 32.0)  # steps tried along the tangent beyond, over h_1


class SteppingSteps(FreeSteps):
    """Steps over kinks that shrink before those that turn the branch.

    Args:
        corrector: on the bordered system that is followed.
    """

    def step(
        self, point: BranchPoint, h: float
    ) -> tuple[BranchPoint | None, list[SpecialPoint], float]:
        while h >= self.control.minimum:
            step = self.try_step(point, h)
            new = step.new
            within = self.within_piece(point, step, h)
            if within is not None:
                return within
            if new is not None and not step.turned and step.parity > 0:
                return self.rescaled(new), self.events(point, new, step), self.longer(h, new)
            h *= self.control.decrease
        return self._pass(point)

    def _pass(self, point: BranchPoint) -> tuple[BranchPoint | None, list[SpecialPoint], float]:
        """Continue from the kink within h_min beyond ``point``."""
        b = self.bordered
        for factor in _BEYOND:
            h1 = factor * self.control.minimum
            beyond = point.y.copy()
            beyond.axpy(h1, point.tangent)
            piece = self.system.piece_at(*b.split(beyond))
            if self._same(piece, point.piece):
                beyond.destroy()
                continue
            t = self.corrector.tangent(beyond, point.tangent, piece)
            beyond.destroy()
            if t is None:
                continue
            for sense in (1.0, -1.0):
                onwards = t.copy()
                onwards.scale(sense)
                for longer in _LONGER:
                    new = self._try(point, onwards, longer * h1)
                    if new is not None:
                        kink = self._kink(point, new, h1)
                        return self.rescaled(new), [kink], self.control.initial
                onwards.destroy()
            t.destroy()
        return None, [], self.control.minimum

    def _try(self, point: BranchPoint, t: PETSc.Vec, h: float) -> BranchPoint | None:
        """The point at the distance ``h`` along ``t``, if it does not lie behind ``point``."""
        b = self.bordered
        y = point.y.copy()
        improved = t.copy()
        y.axpy(h, t)
        ok = self.corrector.moore_penrose(y, improved, None)
        improved.destroy()
        if not ok:
            return None
        piece = self.system.piece_at(*b.split(y))
        way = y - point.y
        back = self._same(piece, point.piece) and b.inner(way, point.tangent) < 0
        way.destroy()
        if back:
            return None
        tangent = self.corrector.tangent(y, t, piece, factorise=True)
        if tangent is None or not self.lands(replace(point, tangent=t), h, y, tangent):
            return None
        corrections = self.corrector.iterations
        return BranchPoint(y, tangent, piece, b.gamma(y), h, corrections, self.test(accepted=True))

    def _kink(self, point: BranchPoint, new: BranchPoint, h1: float) -> SpecialPoint:
        """What lies between ``point`` and ``new``, within ``h1`` of ``point``."""
        b = self.bordered
        t = self.corrector.tangent(new.y, new.tangent, new.piece, factorise=True)
        after = self.corrector.orientation() if t is not None else 0.0
        parity = int(self._orientation(point) * after)
        self._oriented = (new.y, after)
        step = Crossed(new, self.changes(point, new.y, new.piece))
        reach = abs(h1 * b.gamma(point.tangent))
        turned = self.turned(point.tangent, new.tangent)
        kind = "bifurcation" if parity < 0 else "fold" if turned else "event"
        return SpecialPoint(
            kind,  # type: ignore[arg-type]
            False,
            point.gamma,
            point.y,
            0,
            tuple(change for _, change in step.changes),
            parity,
            bracket=(point.gamma - reach, point.gamma + reach),
        )

    def _same(self, a: Piece, c: Piece) -> bool:
        same = bool(np.array_equal(a.codes, c.codes))
        return bool(self.bordered.comm.allreduce(same, op=MPI.LAND))
