# SPDX-License-Identifier: LGPL-3.0-or-later
r"""How far a point has slipped along a curved surface, from two places on it and their normals.

A point was opposite to the place y_o of the surface, where this has the normal o, and is opposite
to y, with the normal n. Of two normals at an angle theta the arc of constant curvature between the
places is longer than its chord by theta/2 / sin(theta/2). Its tangents make half that angle with
the chord, in the plane of both normals; across that plane nothing turns. So the slip along the
surface, in its tangent plane at y and turned there by the smallest rotation that takes o to n, is

    s = P c - (A c.(n - o) + D c.(n + o)) P o,    c = y - y_o,    P = I - n n^T,
    A = (a - C)/(4 C q),    D = 1/(4 C^2),    q = sin^2(theta/2),    C = cos(theta/2),
    a = theta/2 / sin(theta/2).

It is the arc itself on planes, circles, spheres and circular cylinders, however long up to half a
turn; elsewhere varying curvature leaves an error of higher order. It is zero where y = y_o.
"""

from __future__ import annotations

from typing import Any

import ufl

__all__ = ["slip_along"]

_SMALL = 3e-3  # q below which the series is exact to round-off
# coefficients of (a - C)/q in powers of q
_SERIES = (2 / 3, 1 / 5, 3 / 28, 5 / 72, 35 / 704)


def slip_along(way: Any, before: Any, normal: Any) -> Any:
    """The slip s in UFL, a vector across the present normal.

    Args:
        way: c, from the place on the surface that was opposite to the one that is now.
        before: unit normal o there.
        normal: unit normal n here.
    """
    turned = normal - before
    both = normal + before
    q = ufl.dot(turned, turned) / 4
    cosine = ufl.sqrt(1.0 - q)
    # What is not taken is differentiated as well, and has to be finite.
    large = ufl.conditional(ufl.gt(q, _SMALL), q, _SMALL)
    sine = ufl.sqrt(large)
    exact = (ufl.asin(sine) / sine - ufl.sqrt(1.0 - large)) / large
    series = sum(c * q**k for k, c in enumerate(_SERIES) if k) + _SERIES[0]
    stretch = ufl.conditional(ufl.gt(q, _SMALL), exact, series)
    part = stretch / (4 * cosine) * ufl.dot(way, turned)
    part += ufl.dot(way, both) / (4 * (1.0 - q))
    along = before - ufl.dot(before, normal) * normal
    return way - ufl.dot(way, normal) * normal - part * along
