# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Weighted gaps and slips of the slave nodes at a state, and their derivatives.

With quadrature points q on the common parts of slave and master facets, weights w of the reference
configuration, the gap g along the ray of each point, and the reference coordinates eta at which the
ray meets the master (`cast`), a node a of the slave has

    W_a = sum_q w N_a,    g_a = sum_q w N_a g / W_a,    d_a = sum_q w N_a R_aq d / W_a,

where the slip is the vector, in the tangent plane of the last accepted state, between the two
material points that face each other now,

    d = (I - n_o n_o^T) (y_o(eta) - x_o),

with x_o, y_o and n_o of that state. A common rotation of both bodies does not change it, so that
the tractions of sticking points turn with the bodies. The law of node a is evaluated at the jump

    j_a = -g_a n_a + S_a R_a d_a

with the present normal n_a and the smallest rotation R_a from the normal of the last state to n_a;
R_aq is the smallest rotation from n_o at the point to n_o at the node, so that slips on curved
faces keep their lengths. In 3D S_a is the rotation about n_a by the mean angle by which both faces
have turned about it since the last state,

    psi_a = sum_q w N_a (psi_slave + psi_master)/2 / W_a,

where psi_slave and psi_master are the angles of their facets (`spins`). Thus the slip turns with
the bodies, and by half of their relative rotation: d is the chord of the arc that a point has
followed, but friction acts along the tangent at its end.

The tractions t of the nodes are nominal; their forces are w N_a t on the slave, and -w N_b(eta) t
on the master, t = sum_a N_a t_a (Puso and Laursen, CMAME 193, 2004; Poulios and Renard, Comput.
Struct. 153, 2015). Changes of the boundaries of the common parts are not differentiated.

At a node that is barely covered, for example near the edge of the master, the gap is known only at
that edge. Its law therefore gets the weight s = min(1, W_a / (c A_a)), with its area A_a and a
fixed fraction c; the remainder of its traction is the mean of the tractions around it,

    s (t_a - tau_a) + (1 - s) (t_a - sum_b m_ab t_b / sum_b m_ab) = 0,    m_ab = sum_q w N_a N_b,

so that tractions are continuous at the edge, also when a node becomes covered or uncovered.

For bodies of revolution w has the factor 2 pi R with the radius R of the point of the slave in the
reference configuration: tractions are nominal there too, so that w is constant when bodies move
and needs no derivatives. Forces act on the whole circumference; axial forces of slave and master
balance because sum_a N_a = sum_b N_b = 1. On the axis n_a has no radial part.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import count
from typing import NamedTuple

import numpy as np

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._geometry import (
    area_vector_rates,
    area_vectors,
    dot,
    edges_of,
    ratio,
    tangential,
    transformed,
    unit,
    unit_rates,
)
from dolfinx_contact.points.clipping import linear_basis, tangents
from dolfinx_contact.points.kinematics import rotation
from dolfinx_contact.points.sliding_master import Candidates

__all__ = ["CastRays", "Facing", "Nodal", "RayRates", "Spins", "cast", "spins"]


_STEPS = 25
_FOUND = 1e-12  # relative to the facet, last step of Newton's method


@dataclass(frozen=True, eq=False)
class CastRays:
    """Rays from pieces p of slave facets, with q points each.

    Attributes:
        normal: normals n, shape (p, q, dim).
        length: lengths of m, shape (p, q).
        gap: gaps g, shape (p, q).
        weights: weights N_b(eta) of the master nodes, shape (p, q, b).
        slopes: derivatives of the weights with respect to eta, shape (p, q, b, dim - 1).
        inverse: inverse of [Y | -n], shape (p, q, dim, dim).
    """

    normal: Array
    length: Array
    gap: Array
    weights: Array
    slopes: Array
    inverse: Array

    @property
    def by_normal(self) -> Array:
        """Derivative dn/dm, shape (p, q, dim, dim)."""
        return unit_rates(self.normal, self.length)


def cast(x: Array, m: Array, y: Array, eta: Array) -> CastRays:
    r"""Intersect rays along slave normals with master facets.

    A point x = sum_a N_a x_a of a slave facet has the normal n = m / |m|, m = sum_a N_a m_a, of the
    vectors m_a at its nodes, each the sum of the area vectors of the facets around it. The ray from
    x along n meets the facet y(eta) = sum_b N_b(eta) y_b of the master at

        x + g n = y(eta),

    which gives the gap g and the reference coordinates eta. With the columns Y_i = dy/deta_i the
    derivatives along displacements dx_a, dy_b and changes dm_a solve

        [Y | -n] (deta, dg) = dx - sum_b N_b dy_b + g dn,    dn = (I - n n^T) dm / |m|

    (Poulios and Renard, Comput. Struct. 153, 2015, section 3, with the normals of the slave).

    Args:
        x: starting points of the rays, shape (p, q, dim).
        m: directions of the slave normals at these points, of any length, shape (p, q, dim).
        y: nodes of the master facets, shape (p, b, dim).
        eta: initial guesses of the reference coordinates, shape (p, q, dim - 1).
    """
    length = np.linalg.norm(m, axis=-1)
    n = m / length[..., None]
    place = np.concatenate([eta, np.zeros((*eta.shape[:-1], 1))], axis=-1)  # eta and g
    largest = np.inf
    for steps in count():
        basis = linear_basis(place[..., :-1], y.shape[1])
        matrix = np.concatenate([tangents(y, basis.slopes), -n[..., None]], axis=-1)
        if largest <= _FOUND or steps == _STEPS:
            break
        off = x + place[..., -1:] * n - basis.values @ y
        step = np.linalg.solve(matrix, off[..., None])[..., 0]
        place += step
        largest = np.max(np.abs(step[..., :-1]), initial=0.0)
    return CastRays(
        normal=n,
        length=length,
        gap=place[..., -1],
        weights=basis.values,
        slopes=basis.slopes,
        inverse=np.linalg.inv(matrix),
    )


class Spins(NamedTuple):
    """Angles by which facets have turned about their outward normals; zero in 2D.

    Attributes:
        angle: angles, shape (n,).
        by_corners: derivatives with respect to the present corners, shape (n, k, dim).
    """

    angle: Array
    by_corners: Array


def spins(before: Array, now: Array, sense: Array) -> Spins:
    r"""Return angles by which facets have turned about their normals, and their derivatives.

    Before, a facet has two vectors a_i perpendicular to its normal o, with the reciprocal vectors
    a^i. The smallest rotation R from o to the present normal n turns these into g_i = R a^i. With
    the present vectors e_i the facet has been deformed by F = sum_i e_i g_i^T. The rotation in its
    polar decomposition is about n, by the angle

        tan psi = s / c,    s = n . sum_i g_i x e_i,    c = sum_i g_i . e_i.

    Normal parts of changes of e_i do not count. Where n turns, R turns about it by the angle
    n.(o x dn)/(1 + o.n), by which psi is smaller.

    Args:
        before: corners of the facets before, shape (n, k, dim).
        now: present corners, shape (n, k, dim).
        sense: signs of the area vectors, shape (n,).
    """
    n, k, dim = now.shape
    if dim == 2:
        return Spins(np.zeros(n), np.zeros((n, k, dim)))
    m = sense[:, None] * area_vectors(now)
    length = np.linalg.norm(m, axis=1, keepdims=True)
    normal = m / length
    o = unit(sense[:, None] * area_vectors(before))
    a, b = edges_of(before)
    volume = np.sum(o * np.cross(a, b), axis=1)[:, None]
    reciprocal = np.stack([np.cross(b, o) / volume, np.cross(o, a) / volume], axis=1)
    g = reciprocal @ rotation(o, normal).transpose(0, 2, 1)
    e = np.stack(edges_of(now), axis=1)
    across = np.cross(normal[:, None], g)
    c = np.sum(g * e, axis=(1, 2))
    s = np.sum(across * e, axis=(1, 2))
    by_edges = (c[:, None, None] * across - s[:, None, None] * g) / (c**2 + s**2)[:, None, None]
    by_corners = np.zeros((n, k, dim))
    starts, ends = ((0, 0), (1, 2)) if k == 3 else ((0, 1), (3, 2))
    for i, (start, end) in enumerate(zip(starts, ends, strict=True)):
        by_corners[:, end] += by_edges[:, i]
        by_corners[:, start] -= by_edges[:, i]
    by_normal = np.cross(o, normal) / (1.0 + dot(o, normal))[:, None]
    rates = sense[:, None, None, None] * area_vector_rates(now)
    by_corners += np.einsum("ni,nikj->nkj", by_normal / length, rates)
    return Spins(np.arctan2(s, c), by_corners)


@dataclass(frozen=True, eq=False)
class Nodal:
    """Values at the local vertices of the slave.

    Attributes:
        weight: covered areas W, 0 at nodes without an opposing part, shape (n,).
        share: weights s of the laws, shape (n,).
        around: sum of m_ab over the other nodes b at each vertex a, shape (n,).
        gap: gaps g, shape (n,).
        slip: slips d along the surface of the last accepted state, shape (n, dim).
        normal: unit normals n, shape (n, dim).
        length: lengths of m, shape (n,).
        before: normals of the last accepted state, shape (n, dim).
        spin: angles psi, 0 in 2D, shape (n,).
        apart: relative rotations psi_slave - psi_master of the faces, 0 in 2D, shape (n,).
    """

    weight: Array
    share: Array
    around: Array
    gap: Array
    slip: Array
    normal: Array
    length: Array
    before: Array
    spin: Array
    apart: Array

    @cached_property
    def inverse(self) -> Array:
        """1/W, 0 without an opposing part, shape (n,)."""
        return ratio(np.ones_like(self.weight), self.weight)

    @cached_property
    def _turned(self) -> Array:
        """Rotation R, shape (n, dim, dim)."""
        return rotation(self.before, self.normal)

    @cached_property
    def _spun(self) -> Array:
        """Rotation S of vectors along the surface, shape (n, dim, dim)."""
        n, dim = self.normal.shape
        if dim == 2:
            return np.broadcast_to(np.eye(dim, dtype=np.float64), (n, dim, dim)).copy()
        across = np.cross(self.normal[:, None], np.eye(dim)).transpose(0, 2, 1)
        c, s = (f(self.spin)[:, None, None] for f in (np.cos, np.sin))
        return c * np.eye(dim) + s * across

    @cached_property
    def rotation(self) -> Array:
        """Rotation S R from the tangent plane of the last accepted state to the present one.

        Shape (n, dim, dim).
        """
        return self._spun @ self._turned

    @property
    def slip_now(self) -> Array:
        """Slip S R d, shape (n, dim)."""
        return transformed(self.rotation, self.slip)

    @property
    def by_spin(self) -> Array:
        """Derivative of S R d with respect to psi, shape (n, dim)."""
        if self.normal.shape[1] == 2:
            return np.zeros_like(self.normal)
        return np.asarray(np.cross(self.normal, self.slip_now), dtype=np.float64)

    @property
    def jump(self) -> Array:
        """Jump j, shape (n, dim)."""
        return self.slip_now - self.gap[:, None] * self.normal

    @cached_property
    def by_normal(self) -> Array:
        """Derivative dn/dm, shape (n, dim, dim)."""
        return unit_rates(self.normal, self.length)

    @cached_property
    def by_turning(self) -> Array:
        """Derivative of S R d with respect to n, without the part that merely turns S R d with n.

        Shape (n, dim, dim). It is zero in 2D, and if the normal has not changed since the last
        accepted state.
        """
        n = self.normal
        o = self.before
        d = tangential(self.slip, o)
        b = dot(n, d)[:, None]
        c = (1.0 + dot(n, o))[:, None]
        turned = -(n + o)[:, :, None] * (d / c - b * o / c**2)[:, None]
        turned -= (b / c)[:, :, None] * np.eye(n.shape[1])
        slip = transformed(self._turned, self.slip)
        return self._spun @ (turned + n[:, :, None] * slip[:, None])


class RayRates(NamedTuple):
    """Changes of the rays, or derivatives of these changes, shape (p, q, ...).

    Attributes:
        place: changes of the reference coordinates eta, shape (p, q, dim - 1, ...).
        gap: changes of the gaps, shape (p, q, ...).
    """

    place: Array
    gap: Array


@dataclass(frozen=True, eq=False)
class Facing:
    """Opposing parts p of slave and master, with q quadrature points each.

    In shapes, a is the number of corners of a slave facet, b that of a master facet, and c = a + b.

    Attributes:
        found: candidates of the last search.
        facet: slave facet of each part, shape (p,).
        master: master facet of each part, an index of the candidates, shape (p,).
        nodes: global nodes at the corners of both facets, slave first, shape (p, c).
        signs: signs of the vector components at the corners, -1 if mirrored, otherwise 1, shape
            (p, c, dim).
        basis: basis N_a at the points, shape (p, q, a).
        areas: weights w of the reference configuration, shape (p, q).
        rays: rays at the points.
        along: R_aq (I - n_o n_o^T) Y_o of the last accepted state, shape (p, q, a, dim, dim - 1).
        spins: derivatives of psi with respect to the corners of both facets, shape (p, c, dim).
        nodal: values at the vertices.
    """

    found: Candidates
    facet: Ints
    master: Ints
    nodes: Ints
    signs: Array
    basis: Array
    areas: Array
    rays: CastRays
    along: Array
    spins: Array
    nodal: Nodal

    @cached_property
    def weighted(self) -> Array:
        """Weighted basis w N_a, shape (p, a, q)."""
        return (self.areas[..., None] * self.basis).transpose(0, 2, 1)

    @cached_property
    def jumps(self) -> Array:
        """Weights of the corners in the jumps at the quadrature points, shape (p, q, c)."""
        return np.concatenate([self.basis, -self.rays.weights], axis=2)

    @property
    def mass(self) -> Array:
        """Contributions of each part to m_ab, 0 for a = b, shape (p, a, a)."""
        found = self.weighted @ self.basis
        return found * (1.0 - np.eye(found.shape[1]))

    def moved(self, v: Array, m: Array) -> RayRates:
        """Return the changes of the rays due to displacements.

        Args:
            v: displacements of the corners of both facets, shape (p, c, dim).
            m: changes of the vectors m at the slave corners, shape (p, a, dim).
        """
        rays = self.rays
        turned = rays.gap[..., None] * transformed(rays.by_normal, self.basis @ m)
        found = transformed(rays.inverse, self.jumps @ v + turned)
        return RayRates(found[..., :-1], found[..., -1])

    def slopes(self) -> RayRates:
        """Return the derivatives of `moved` with respect to v and m.

        The last two axes have shape (c + a, dim).
        """
        rays = self.rays
        by_m = rays.gap[..., None, None] * (rays.inverse @ rays.by_normal)
        parts = (rays.inverse, self.jumps), (by_m, self.basis)
        every = [by[..., :, None, :] * weights[..., None, :, None] for by, weights in parts]
        both = np.concatenate(every, axis=3)
        return RayRates(both[..., :-1, :, :], both[..., -1, :, :])
