# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Normals at the corners of facets that approximate a smooth surface.

The gradient g of a quadric is linear, so (g_a + g_b).(x_b - x_a) = 0 for any two of its points x_a
and x_b (the trapezoidal rule). The unit normals of planes, spheres and circular cylinders, and of
their smooth combinations along edges of facets, thus satisfy

    (n_a + n_b).(x_b - x_a) = 0    for every edge from x_a to x_b.

The normals of any other smooth surface satisfy this edge condition up to the order h^3, where h is
the facet size. In strips of facets the condition does not determine the normals. Normals are
therefore computed by least squares, as close to an initial guess as the condition allows. The guess
is the sum of e_1 x e_2 / (|e_1|^2 |e_2|^2) over the facets around a point, where e_1 and e_2 are
the edges meeting there; it is exact for a sphere through the points (Max, J. Graphics Tools 4(2),
1999). For segments with the length |s| and the unit normal n_s, the guess is the sum of n_s / |s|,
which is exact for a circle. Between a flat and a curved part the guess is the normal of the flat
part, which is preserved. Flat parts must have at least two triangles, because the normal of a
single triangle of a curved part also satisfies the condition.

If points are noisy, or facets do not approximate a smooth surface, for example around a rim that is
partly a crease, normals can differ strongly from those of all facets. Therefore a normal must not
deviate from the guess by more than the facet normals around the point or an adjacent point do.

At a *tip*, such as the vertex of a cone, the tangent plane is not defined. A tip x_a is detected if
n_a.(x_b - x_a) has the same sign for all its edges and n_b.(x_b - x_a) is much smaller; at the pole
of a sphere these products are equal and opposite instead.
"""

from __future__ import annotations

import numpy as np
import scipy

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._geometry import area_vectors, dot, unit, unit_tangents

__all__ = ["corner_normals", "crossed", "without_tips"]


_TIMES = 3  # number of searches for flat parts
_BENT = 0.45  # relative to the most bent facet of a fan: bend below which a facet is a flatter part
_FLATTEST = 1e-2  # relative to the most bent facet: lower bound of the bend of a facet
_POWER = 4  # exponent of the ratio of bends, the weight of flatter parts
_DAMPED = 3e-2  # damping of the least squares
_STEPS = 60  # iterations of the least squares
_ONE_SIGN = 0.5  # relative to the sum of magnitudes: sum of values of one sign
_STRAIGHT = 0.25  # relative to the slope at a tip: largest slope at the other ends of edges
#: Corners at the ends of the edges of a facet, by dimension.
_SIDES = {2: ((0, 1),), 3: ((0, 1), (1, 2), (2, 0))}
_SHALLOW = 1e-3  # slope below which a point is not a tip


def crossed(corners: Array) -> Array:
    """Return facet normals times segment length or twice the triangle area, shape (k, dim).

    Args:
        corners: corners of the facets, shape (k, dim, dim).
    """
    return (corners.shape[1] - 1) * area_vectors(corners)


def without_tips(corners: Array, fans: Ints) -> Ints:
    """Give every corner at a tip, such as the vertex of a cone, its own fan.

    A fan consists of the facets around a point that are not separated by creases; normals are
    averaged over it. The result contains the new fan of each corner, shape (k dim,).

    Args:
        corners: corners of the k facets, shape (k, dim, dim).
        fans: index of the fan of each corner, shape (k dim,).
    """
    k, dim = corners.shape[:2]
    if dim == 2:
        return fans
    normals = _averaged(_weights(corners), crossed(corners), fans)
    numbers = fans.reshape(k, dim)
    sums = np.zeros((int(fans.max()) + 1, 4))  # slopes here, magnitudes, slopes there, edges
    for i, j in ((i, j) for i in range(dim) for j in range(dim) if i != j):
        edge = unit(corners[:, j] - corners[:, i])
        here = dot(normals[:, i], edge)
        there = -dot(normals[:, j], edge)
        np.add.at(sums, numbers[:, i], np.stack([here, np.abs(here), there, np.ones(k)], axis=1))
    here, size, there, number = sums.T
    tip = np.abs(here) > np.maximum(_ONE_SIGN * size, _SHALLOW * number)
    tip &= np.abs(there) < _STRAIGHT * np.abs(here)
    own = np.where(tip[fans], len(sums) + np.arange(k * dim), fans)
    return np.asarray(np.unique(own, return_inverse=True)[1].reshape(-1), dtype=np.int64)


def corner_normals(corners: Array, fans: Ints, planes: Ints, turns: Array) -> Array:
    """Return unit normals at the corners of k facets, shape (k, dim, dim).

    The normals are equal within a fan, the facets around a point that are not separated by creases.
    The *bend* of a facet is the largest rotation of normals per length along its edges. If a facet
    bends much less than the most bent facet of its fan, like a flat part next to a rounded edge,
    its weight in the initial guess is increased by a power of the ratio of their bends, so that the
    surface continues this facet smoothly. For a facet at a crease, such as a chamfer, the bend at
    the crease is included.

    Args:
        corners: corners of the facets, shape (k, dim, dim).
        fans: index of the fan of each corner, shape (k dim,).
        planes: indices of the planes of adjacent coplanar facets, shape (k,).
        turns: bends of the facets at creases, equal within a plane, shape (k,).
    """
    dim = corners.shape[1]
    across = crossed(corners)
    weights = _weights(corners)
    size = np.linalg.norm(across, axis=1)[:, None]
    shares = size * weights
    guess = first = _averaged(weights, across, fans)
    edges = _edges(corners, fans)
    found = _along_edges(edges, guess, fans, np.ones(len(fans)))
    flat = (np.bincount(planes)[planes] > 1) | (dim == 2)
    for _ in range(_TIMES):
        # Neither suffices alone: the guess is inaccurate next to other curvatures, edges where
        # parts meet in a mitre.
        bends = np.sqrt(_bends(corners, guess) * _bends(corners, found))
        bends = np.maximum(_most(bends, planes), turns)
        most = _most(np.repeat(bends, dim), fans).reshape(-1, dim)
        part = np.divide(bends[:, None], most, out=np.ones_like(most), where=most > 0)
        part = np.where(flat[:, None], np.maximum(part, _FLATTEST), 1.0)
        heaviest = _most(shares.reshape(-1), fans).reshape(-1, dim) / size
        flatter = np.where(part < _BENT, heaviest * (_BENT / part) ** _POWER, weights)
        guess = _averaged(flatter, across, fans)
        found = _along_edges(edges, guess, fans, part.reshape(-1) ** 2)
    return _near(found, first, across, fans, edges)


def _near(
    found: Array, guess: Array, across: Array, fans: Ints, edges_of_fans: tuple[Ints, Ints, Array]
) -> Array:
    """Limit the deviation of normals from a guess to the deviation of adjacent facet normals."""
    a, b, _ = edges_of_fans
    off = np.linalg.norm(unit(across)[:, None] - guess, axis=2).reshape(-1)
    first, fans = np.unique(fans, return_index=True, return_inverse=True)[1:]
    here = _most(off, fans)[first]
    most = here.copy()
    np.maximum.at(most, a, here[b])
    np.maximum.at(most, b, here[a])
    turn = (found - guess).reshape(-1, guess.shape[1])
    size = np.maximum(np.linalg.norm(turn, axis=1), np.finfo(float).tiny)
    turn *= np.minimum(1.0, most[fans] / size)[:, None]
    return unit(guess + turn.reshape(guess.shape))


def _weights(corners: Array) -> Array:
    """Return the weights of facet normals in averages at their corners, shape (k, dim)."""
    dim = corners.shape[1]
    edges = np.sum((np.roll(corners, -1, axis=1) - corners) ** 2, axis=2)
    return 1.0 / (edges * np.roll(edges, 1, axis=1) if dim == 3 else edges)


def _averaged(weights: Array, across: Array, fans: Ints) -> Array:
    """Return the normalised weighted sum of facet normals over the fan of each corner.

    The shape is (k, dim, dim) for k facets.
    """
    k, dim = weights.shape
    sums = np.zeros((k * dim, dim))
    np.add.at(sums, fans, (weights[..., None] * across[:, None]).reshape(-1, dim))
    return unit(sums[fans]).reshape(k, dim, dim)


def _along_edges(
    edges_of_fans: tuple[Ints, Ints, Array], guess: Array, fans: Ints, part: Array
) -> Array:
    """Return unit normals, shape (k, dim, dim), by least squares from the edge condition.

    Args:
        edges_of_fans: result of `_edges`.
        guess: unit normals at the corners of facets, shape (k, dim, dim).
        fans: index of the fan of each corner, shape (k dim,).
        part: factors by which the deviation from the guess is multiplied, by corner, shape (k
            dim,); each fan uses the smallest factor of its corners.
    """
    a, b, edges = edges_of_fans
    dim = guess.shape[1]
    first = np.unique(fans, return_index=True)[1]
    free = np.ones(len(first))
    np.minimum.at(free, fans, part)
    normals = guess.reshape(-1, dim)[first]
    row = np.arange(len(a))[:, None] * np.ones((1, dim - 1), dtype=np.int64)
    for _ in range(2):  # unit vectors turn by slightly more than their tangential increment
        frames = unit_tangents(normals)
        off = -dot(normals[a] + normals[b], edges)
        values, columns = [], []
        for end in (a, b):
            values.append(free[end, None] * np.einsum("ei,eid->ed", edges, frames[end]))
            columns.append((dim - 1) * end[:, None] + np.arange(dim - 1))
        matrix = scipy.sparse.coo_array(
            (np.ravel(values), (np.ravel([row, row]), np.ravel(columns))),
            shape=(len(a), (dim - 1) * len(first)),
        ).tocsr()
        turn = scipy.sparse.linalg.lsmr(matrix, off, damp=_DAMPED, maxiter=_STEPS, atol=1e-8)[0]
        turn = free[:, None] * turn.reshape(len(first), dim - 1)
        normals = unit(normals + np.einsum("vid,vd->vi", frames, turn))
    return normals[fans].reshape(guess.shape)


def _edges(corners: Array, fans: Ints) -> tuple[Ints, Ints, Array]:
    """Return n distinct facet edges: fans at both ends, and unit vectors, shape (n, dim)."""
    k, dim = corners.shape[:2]
    numbers = fans.reshape(k, dim)
    ends, ways = [], []
    for i, j in _SIDES[dim]:
        ends.append(np.sort(numbers[:, [i, j]], axis=1))
        ways.append(unit(corners[:, j] - corners[:, i]))
    pairs, first = np.unique(np.concatenate(ends), axis=0, return_index=True)
    return pairs[:, 0], pairs[:, 1], np.concatenate(ways)[first]


def _bends(corners: Array, normals: Array) -> Array:
    """Return the largest rotation of normals per length along edges of a facet, shape (k,)."""
    i, j = np.transpose(_SIDES[corners.shape[1]])
    turn = np.linalg.norm(normals[:, j] - normals[:, i], axis=2)
    length = np.linalg.norm(corners[:, j] - corners[:, i], axis=2)
    return np.asarray((turn / length).max(axis=1))


def _most(values: Array, groups: Ints) -> Array:
    """Return, for each of n nonnegative values, the maximum over its group, shape (n,)."""
    most = np.zeros(int(groups.max()) + 1)
    np.maximum.at(most, groups, values)
    return most[groups]
