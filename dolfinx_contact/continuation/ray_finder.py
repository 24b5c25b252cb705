# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Rays that lead out of a point at which pieces of H meet.

Three methods find them:

- *by the tangent cone*, where the system is condensed onto few points: its rays are all those of H
  (`rays`: by enumeration, or unfolded).
- *enumerated*: every point at a border takes each of its statuses. A piece has an outgoing ray if
  its tangent, in one of its two senses, stays inside its borders. Nothing is known of H but its
  pieces, and these must be few.
- *led by H*: near the point H = 0 is solved with the statuses recomputed, at a gamma a little
  larger or smaller. That finds one ray, also where more pieces meet than can be tried.

When a ray counts as inside, and in what norm two rays are one, is for the caller to define.
"""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact.continuation.branch import Ray
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.rays import distinct, number_of_pieces, outgoing
from dolfinx_contact.continuation.system import Piece

__all__ = ["FoundRays", "Kink", "RayFinder"]

logger = logging.getLogger(__name__)

_LENGTHS = (1e-3, 1e-2, 1e-4, 1e-5)  # of steps on H itself
_SAME = 1e-6  # of the size of a tangent
_PROBE = 1e-6  # size of the steps by which it is seen whether a piece is smooth
_BENT = 1e-3  # of the change of a row, by which it is not


@dataclass(frozen=True)
class Kink:
    """A point at a kink: where it lives, its status, and the statuses it may take."""

    rank: int
    point: int
    code: int
    target: int
    statuses: tuple[int, ...]


@dataclass(frozen=True)
class FoundRays:
    """Rays that lead out of a point.

    Attributes:
        rays: as they were found.
        complete: whether it is known that there are no others.
        method: how they were looked for, or why they were not, human-readable.
    """

    rays: tuple[Ray, ...]
    complete: bool
    method: str


class RayFinder:
    """Looks for the rays that lead out of a point. Collective, as its methods are.

    Args:
        corrector: on the bordered system.
        y: the point.
        inside: whether a ray stays inside the borders of its piece.
        norm: in which rays are one whose tangents differ by round-off.

    Attributes:
        inside: as given.
    """

    def __init__(
        self,
        corrector: Corrector,
        y: PETSc.Vec,
        inside: Callable[[Ray], bool],
        norm: Callable[[PETSc.Vec], float],
    ):
        self._corrector = corrector
        self._y = y
        self.inside = inside
        self._norm = norm

    def of_statuses(
        self, piece: Piece, kinks: Sequence[Kink], codes: Sequence[int], towards: PETSc.Vec
    ) -> list[Ray]:
        """Rays of the piece in which ``kinks`` have ``codes``: none, one, or two."""
        rank = self._corrector.bordered.comm.rank
        mine = [(k.point, c) for k, c in zip(kinks, codes, strict=True) if k.rank == rank]
        points = np.array([p for p, _ in mine], dtype=np.int32)
        new = piece.with_codes(points, [c for _, c in mine])
        tangent = self._corrector.tangent(self._y, towards, new)
        if tangent is None:
            return []
        rays = []
        for sense in (1.0, -1.0):
            t = tangent.copy()
            t.scale(sense)
            ray = Ray(new, t)
            if self.inside(ray):
                rays.append(ray)
            else:
                t.destroy()
        tangent.destroy()
        return rays

    def rough_statuses(self, piece: Piece, kinks: Sequence[Kink]) -> set[int]:
        """Statuses with which H has no derivative at the point, so that rays may be missed.

        As slip in 3D where nothing slips yet, and no shear tells in which direction it will: the
        sum of two small changes does not change H by the sum of what they do.
        """
        b = self._corrector.bordered
        mine = np.array([k.point for k in kinks if k.rank == b.comm.rank], dtype=np.int32)
        x, gamma = b.split(self._y)
        x = x.copy()
        changes = [b.system.probe(seed) for seed in (1, 2)]
        changes.append(changes[0] + changes[1])
        rough = set()
        for status in sorted({s for k in kinks for s in k.statuses}):
            held = piece.with_codes(mine, [status] * len(mine))
            rows = [self._rows(x, gamma, held)]
            for change in changes:
                there = x.copy()
                there.axpy(_PROBE, change)
                rows.append(self._rows(there, gamma, held) - rows[0])
                there.destroy()
            _, one, other, both = rows
            bent = np.abs(both - one - other) > _BENT * (np.abs(one) + np.abs(other))
            if b.comm.allreduce(int(bent.any()), op=max):
                rough.add(status)
        for v in (x, *changes):
            v.destroy()
        return rough

    def _rows(self, x: PETSc.Vec, gamma: float, piece: Piece) -> npt.NDArray[np.float64]:
        """H on this rank. Collective."""
        system = self._corrector.bordered.system
        out = system.create_vector()
        system.residual(x, gamma, out, piece)
        rows = out.array_r.copy()
        out.destroy()
        return np.asarray(rows, dtype=np.float64)

    def enumerated(
        self,
        piece: Piece,
        kinks: Sequence[Kink],
        towards: PETSc.Vec,
        *,
        most: int,
        tried: tuple[int, ...] | None = None,
    ) -> FoundRays:
        """Rays of all statuses of points at a kink; none if too many pieces meet.

        Args:
            piece: which the other points stay in.
            kinks: those points.
            towards: of the two senses of a tangent that which is tried first.
            most: pieces that are tried.
            tried: statuses that have been tried before.
        """
        number = number_of_pieces(len(k.statuses) for k in kinks)
        if number > most:
            return FoundRays((), False, f"{number} pieces meet there, too many to be tried")
        rays = tuple(
            ray
            for codes in itertools.product(*(k.statuses for k in kinks))
            if codes != tried
            for ray in self.of_statuses(piece, kinks, codes, towards)
        )
        return FoundRays(rays, True, f"enumeration of {number} pieces")

    def by_tangent_cone(self, tolerance: float) -> FoundRays | None:
        """Rays of the tangent cone; None where the system is not condensed.

        Args:
            tolerance: distances to borders that count as zero.
        """
        b = self._corrector.bordered
        x, gamma = b.split(self._y)
        x = x.copy()
        condensed = b.system.condensed(x, gamma)
        if condensed is None:
            x.destroy()
            return None
        w = condensed.contract(x)
        condensed.expand(w, gamma, x)
        base = b.vector()
        b.join(x, gamma, base)
        cone = condensed.system.tangent_cone(w, tolerance)
        found = outgoing(cone, prove=partial(b.system.prove_rays, condensed))
        rays = []
        for ray in found.rays:
            condensed.expand(w + ray.direction, gamma + ray.rate, x)
            tangent = b.vector()
            b.join(x, gamma + ray.rate, tangent)
            tangent.axpy(-1.0, base)
            tangent.scale(1.0 / np.sqrt(b.inner(tangent, tangent)))
            rays.append(Ray(condensed.piece(ray.codes), tangent))
        base.destroy()
        x.destroy()
        if not condensed.exact:
            condensed.destroy()
        if b.comm.rank == 0:
            logger.info("gamma = %.10g: %d rays by %s", gamma, len(rays), found.method)
        return FoundRays(tuple(rays), found.complete, found.method)

    def led_by_H(
        self,
        senses: Sequence[float],
        leads: Callable[[Ray, PETSc.Vec], bool],
        *,
        tangent_at_point: bool,
    ) -> FoundRays:
        """The ray on which H itself has a solution beside the point; others are not looked for.

        Args:
            senses: in which gamma is changed, in this order.
            leads: whether a ray leads out, towards a solution whose difference to the point is
                given with it.
            tangent_at_point: whether tangents are those at the point; else at the solution.
        """
        method = "one step of Newton's method on H"
        for there, away, piece in self._solutions_beside(senses):
            at = self._y if tangent_at_point else there
            tangent = self._corrector.tangent(at, away, piece)
            if tangent is not None and leads(ray := Ray(piece, tangent), away):
                return FoundRays((ray,), False, method)
        return FoundRays((), False, method)

    def _solutions_beside(
        self, senses: Sequence[float]
    ) -> Iterator[tuple[PETSc.Vec, PETSc.Vec, Piece]]:
        """Solutions of H itself, their differences to the point, and their pieces."""
        b = self._corrector.bordered
        gamma = b.gamma(self._y)
        for length, sense in itertools.product(_LENGTHS, senses):
            there = self._y.copy()
            if self._corrector.natural(there, gamma + sense * length * b.gamma_scale, None):
                yield there, there - self._y, b.system.piece_at(*b.split(there))

    def same(self, a: Ray, other: Ray) -> bool:
        """Whether two rays are one, as are those of two pieces that run along their border."""
        away = a.tangent - other.tangent
        distance = self._norm(away)
        away.destroy()
        return distance <= _SAME * self._norm(a.tangent)

    def distinct(self, rays: Sequence[Ray]) -> list[Ray]:
        """Rays without those that stand before."""
        return distinct(rays, self.same)
