# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points that come through a rigid obstacle in a step.

The law holds at the end of a step, on whatever side of the obstacle that is: what lands behind a
thin tool, or behind a fin of a thick one, is in equilibrium there. So the way of each point is
examined, from where it was to where it is, both seen from the obstacle: straight in space, while a
rigid body turns by even parts of its rotation. It leads through where it is deeper within the
obstacle than at both ends, and comes out on another side: from the normal where it enters to one
within or behind it is more than a quarter of a turn, or between those at the ends. What is thinner
than a part of the way is found by halving, since normals are opposite on both sides of it. Where
they turn little by little, by an angle a within it, the way is a chord of what is round, as deep
for its length as d/l = tan(a/4)/2. What slips along the surface, as under a drum that spins, is
within its facets by less.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from dolfinx_contact.equations.evaluation import ContactState
from dolfinx_contact.points.surface import DiscreteSurface

if TYPE_CHECKING:
    from dolfinx_contact.points.displaced import DisplacedPoints
    from dolfinx_contact.points.rigid_body import RigidBody

__all__ = ["way_through"]

Array = npt.NDArray[np.float64]
Marks = npt.NDArray[np.bool_]

_PARTS = 8, 32  # least and most of the longest way, at whose ends points are located
_PART = 0.25  # of a facet, below which parts need not be
_HALVINGS = 12  # of a part in which normals turn round
_WITHIN = 1e-4  # of a facet, by which a point is within an obstacle
_CHORD = 0.1  # of its length, by which a chord of an eighth of a turn is deep


def way_through(s: DiscreteSurface, contact: ContactState) -> Array | None:
    """By how much points were within a curved obstacle on their way through it (n,). Collective.

    None where it is not known, and of surfaces that are not displaced.

    Args:
        s: a surface with an obstacle.
        contact: at the state.
    """
    now = contact.kinematics.place
    memory = contact.kinematics.memory
    shape = s.displaced
    if shape is None or now is None or (memory is not None and memory.place is None):
        return None
    way = _Way(s, contact)
    longest = s.comm.allreduce(way.longest, op=max)
    parts = int(np.clip(np.ceil(longest / (_PART * s.points.mean_width)), *_PARTS))
    gap, normal = shape.gaps_and_normals(way.at(0.0))
    end, normal_now = shape.gaps_and_normals(way.at(1.0))
    turned: Marks = np.sum(normal * normal_now, axis=1) < 0.0
    level = np.maximum(np.maximum(-gap, -end), 0.0) + _WITHIN * s.points.mean_width
    # The normal where a point was outside last, and how deep within it has been since.
    outside: Array = normal
    deep: Array = np.zeros(len(now))
    through: Array = np.zeros(len(now))
    # How far it has come within it, and whether normals have turned round at once.
    length: Array = np.zeros(len(now))
    jumped: Marks = np.zeros(len(now), dtype=bool)
    place = way.at(0.0)
    last, beyond = normal, turned
    for k in range(1, parts + 1):
        before, place = place, way.at(k / parts)
        was = gap
        gap, normal = (end, normal_now) if k == parts else shape.gaps_and_normals(place)
        within = np.maximum(-was, 0.0) + np.maximum(-gap, 0.0)
        whole = np.maximum(np.abs(was) + np.abs(gap), np.finfo(float).tiny)
        length = length + within / whole * np.linalg.norm(place - before, axis=1)
        round_ = np.sum(last * normal, axis=1) < 0.0
        if s.comm.allreduce(int(round_.any())):
            at = (k - 1) / parts, k / parts
            between = _between(shape, way, at, (last, round_))
            deep = np.maximum(deep, between)
        deep = np.maximum(deep, -gap)
        out = -gap <= level
        # Where it is out again another part of the obstacle may be the nearest.
        beyond = beyond | (np.sum(outside * normal, axis=1) < 0.0)
        jumped = jumped | round_
        crossed = jumped | (deep > _CHORD * length)
        through = np.maximum(through, np.where(out & (deep > level) & beyond & crossed, deep, 0.0))
        length = np.where(out, 0.0, length)
        jumped = jumped & ~out
        outside = np.where(out[:, None], normal, outside)
        deep = np.where(out, 0.0, deep)
        beyond = np.where(out, turned, beyond)
        last = normal
    return through


class _Way:
    """The ways of points of a surface in a step, in the frame of a curved obstacle.

    Args:
        s: the surface.
        contact: its points at the end, with the memory of the start.

    Attributes:
        longest: of the ways of this rank, a length.
    """

    def __init__(self, s: DiscreteSurface, contact: ContactState):
        at = contact.kinematics
        assert at.place is not None
        memory = at.memory
        self._start = np.zeros_like(at.place)
        if memory is not None and memory.place is not None:
            self._start = memory.place
        self._end = at.place
        #: Of a rigid body that turns: it, its motions at both ends, and points there in space.
        self._turning: tuple[RigidBody, tuple[Array, Array], tuple[Array, Array]] | None = None
        body = s.rigid_body
        if body is not None and at.motion is not None:
            was = None if memory is None else memory.motion
            before = np.zeros_like(at.motion) if was is None else was
            self._x = s.positions
            start, end = (
                x + body.carried(x, motion)
                for x, motion in ((self._x + self._start, before), (self._x + self._end, at.motion))
            )
            self._turning = body, (before, at.motion), (start, end)
        ends = [self.at(k / _PARTS[0]) for k in range(_PARTS[0] + 1)]
        lengths = [np.linalg.norm(b - a, axis=1) for a, b in pairwise(ends)]
        self.longest = float(np.max(np.sum(lengths, axis=0), initial=0.0))

    def at(self, part: float | Array) -> Array:
        """Displacements (n, dim) after a part of the step, the same for all points or (n,)."""
        if self._turning is None:
            return self._start + np.reshape(part, (-1, 1)) * (self._end - self._start)
        body, (first, last), (start, end) = self._turning
        parts = np.broadcast_to(part, len(start))[:, None]
        return body.seen(start + parts * (end - start), first + parts * (last - first)) - self._x


def _between(
    shape: DisplacedPoints,
    way: _Way,
    at: tuple[float, float],
    turning: tuple[Array, Marks],
) -> Array:
    """How deep points are within (n,) between two places where normals turn round. Collective.

    Args:
        shape: the obstacle.
        way: of the points.
        at: the two places, as parts of the ways.
        turning: normals at the first one (n, dim), and where they turn round (n,).
    """
    first, round_ = turning
    low: Array = np.full(len(first), at[0])
    high: Array = np.full(len(first), at[1])
    deep: Array = np.zeros(len(first))
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        gap, normal = shape.gaps_and_normals(way.at(middle))
        deep = np.maximum(deep, np.where(round_, -gap, 0.0))
        there = np.sum(first * normal, axis=1) < 0.0
        low, high = np.where(there, low, middle), np.where(there, middle, high)
    return deep
