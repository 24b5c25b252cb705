# SPDX-License-Identifier: LGPL-3.0-or-later
"""Weighted gaps and slips of the slave nodes at a state, and their derivatives.

Let N_a and N_b be the linear basis functions of the slave and master nodes. The common parts of
slave and master facets have quadrature points q with weights w in the reference configuration. From
each point, a ray along the slave normal meets the master at the reference coordinates eta, at a
distance that is the gap g of the point (`cast`). A slave node a has the covered area W_a, the gap
g_a and the slip d_a,

    W_a = sum_q w N_a,    g_a = sum_q w N_a g / W_a,    d_a = sum_q w N_a R_aq d / W_a.

The slip d of a quadrature point is the vector, in the tangent plane of the last accepted state,
between the two material points that face each other now,

    d = (I - n_o n_o^T) (y_o(eta) - x_o),

with the slave point x_o, the master point y_o and the normal n_o in that state. A common rotation
of both bodies does not change d, so that the tractions of sticking points turn with the bodies. The
law of node a is evaluated at the jump

    j_a = -g_a n_a + S_a R_a d_a

with the present normal n_a and the smallest rotation R_a from the normal of the last state to n_a;
R_aq is the smallest rotation from n_o at the point to n_o at the node, so that slips on curved
faces keep their lengths. In 3D, S_a is the rotation about n_a by the mean of the angles by which
the two faces have turned about n_a since the last accepted state (in 2D it is the identity),

    psi_a = sum_q w N_a (psi_slave + psi_master)/2 / W_a,

where psi_slave and psi_master are the angles of their facets (`spins`). Thus the slip turns with
the bodies, and by half of their relative rotation: d is the chord of the arc that a point has
followed, but friction acts along the tangent at its end.

The tractions t of the nodes are nominal; their forces are w N_a t on the slave, and -w N_b(eta) t
on the master, t = sum_a N_a t_a (Puso and Laursen, CMAME 193, 2004; Poulios and Renard, Comput.
Struct. 153, 2015). Changes of the boundaries of the common parts are not differentiated.

At a node that is barely covered, for example near the edge of the master, the gap can be determined
only near that edge. The contact law of the node therefore gets the weight
s = min(1, W_a / (c A_a)), with the area A_a of the node and a fixed fraction c. Otherwise its
traction t_a approaches the mean of the tractions t_b of the surrounding slave nodes b,

    s (t_a - tau_a) + (1 - s) (t_a - sum_b m_ab t_b / sum_b m_ab) = 0,    m_ab = sum_q w N_a N_b,

where tau_a is the traction required by the law. Tractions are thus continuous at the edge, also
when a node becomes covered or uncovered.

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
    """Rays from points of slave facets along the slave normal to master facets (`cast`).

    In the shapes, p is the number of common parts of facets, and q that of points on each.

    Attributes:
        normal: unit normals at the points, the directions of the rays, shape (p, q, dim).
        length: lengths of the normals m before normalisation, shape (p, q).
        gap: gaps along the rays, shape (p, q).
        weights: basis functions of the b master nodes where the rays meet the master, shape
            (p, q, b).
        slopes: derivatives of these basis functions with respect to the reference coordinates,
            shape (p, q, b, dim - 1).
        inverse: inverse of the matrix [Y | -n] of `cast`, shape (p, q, dim, dim).
    """

    normal: Array
    length: Array
    gap: Array
    weights: Array
    slopes: Array
    inverse: Array

    @property
    def by_normal(self) -> Array:
        """Derivatives of the unit normals with respect to the normals before normalisation.

        The shape is (p, q, dim, dim).
        """
        return unit_rates(self.normal, self.length)


def cast(x: Array, m: Array, y: Array, eta: Array) -> CastRays:
    """Intersect rays along slave normals with master facets.

    Let m_a be the sum of the area vectors of the facets around the slave node a at x_a, and N_a the
    linear basis function of the node. The point x = sum_a N_a x_a of a slave facet then has the
    normal n = m / |m| with m = sum_a N_a m_a. The ray from x along n meets the master facet with
    the points y(eta) = sum_b N_b(eta) y_b at

        x + g n = y(eta),

    which gives the gap g and the reference coordinates eta. With the columns dy/deta_i of the
    matrix Y, the derivatives of eta and g along displacements dx_a, dy_b and changes dm_a solve

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
        by_corners: derivatives of the angles with respect to the current corners, shape
            (n, k, dim).
    """

    angle: Array
    by_corners: Array


def spins(before: Array, now: Array, sense: Array) -> Spins:
    """Return the angles by which facets have turned about their normals, with derivatives.

    Let a_1 and a_2 be two edge vectors of the facet before, with the reciprocal vectors a^i in its
    plane, o its unit normal before, e_i the current edge vectors and n the current unit normal. The
    smallest rotation R from o to n turns the reciprocal vectors into g_i = R a^i. In addition to
    this rotation, the facet has been deformed by F = sum_i e_i g_i^T. The rotation in the polar
    decomposition of F is about n, by the angle psi with

        tan psi = s / c,    s = n . sum_i g_i x e_i,    c = sum_i g_i . e_i.

    Changes of e_i along n do not change psi. If n changes by dn, R turns about n by the angle
    n.(o x dn)/(1 + o.n), by which psi decreases.

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
    """Weighted gaps, slips, normals and spins at the local vertices of the slave.

    Attributes:
        weight: covered areas, 0 at nodes without an opposing part, shape (n,).
        share: weights of the contact laws, less than 1 at barely covered nodes, shape (n,).
        around: integrals of products of the basis function of each vertex with those of all other
            vertices, shape (n,).
        gap: gaps, shape (n,).
        slip: slips d along the surface of the last accepted state, shape (n, dim).
        normal: unit normals n, shape (n, dim).
        length: lengths of the sums m of area vectors around the vertices, shape (n,).
        before: unit normals of the last accepted state, shape (n, dim).
        spin: mean angles psi by which both faces have turned about the normal, 0 in 2D, shape (n,).
        apart: differences of the angles by which slave and master have turned, 0 in 2D, shape (n,).
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
        """Inverses of the covered areas, 0 at nodes without an opposing part, shape (n,)."""
        return ratio(np.ones_like(self.weight), self.weight)

    @cached_property
    def _turned(self) -> Array:
        """Smallest rotations R from the normals of the last accepted state to the current ones.

        The shape is (n, dim, dim).
        """
        return rotation(self.before, self.normal)

    @cached_property
    def _spun(self) -> Array:
        """Rotations S about the normals by the angles `spin`, shape (n, dim, dim)."""
        n, dim = self.normal.shape
        if dim == 2:
            return np.broadcast_to(np.eye(dim, dtype=np.float64), (n, dim, dim)).copy()
        across = np.cross(self.normal[:, None], np.eye(dim)).transpose(0, 2, 1)
        c, s = (f(self.spin)[:, None, None] for f in (np.cos, np.sin))
        return c * np.eye(dim) + s * across

    @cached_property
    def rotation(self) -> Array:
        """Rotations S R from the tangent planes of the last accepted state to the current ones.

        They are the smallest rotations R from the earlier to the current normals, followed by
        rotations S about the normals by the angles `spin`; shape (n, dim, dim).
        """
        return self._spun @ self._turned

    @property
    def slip_now(self) -> Array:
        """Slips since the last accepted state, rotated to the current state (`rotation`).

        The shape is (n, dim).
        """
        return transformed(self.rotation, self.slip)

    @property
    def by_spin(self) -> Array:
        """Derivatives of `slip_now` with respect to the angles `spin`, shape (n, dim)."""
        if self.normal.shape[1] == 2:
            return np.zeros_like(self.normal)
        return np.asarray(np.cross(self.normal, self.slip_now), dtype=np.float64)

    @property
    def jump(self) -> Array:
        """Jumps passed to the law: slips `slip_now` minus gaps times normals, shape (n, dim)."""
        return self.slip_now - self.gap[:, None] * self.normal

    @cached_property
    def by_normal(self) -> Array:
        """Derivatives of the normals with respect to the sums of area vectors around vertices.

        The shape is (n, dim, dim).
        """
        return unit_rates(self.normal, self.length)

    @cached_property
    def by_turning(self) -> Array:
        """Derivatives of `slip_now` with respect to the normals, shape (n, dim, dim).

        The change of a vector that merely turns with the normal is not included. The derivatives
        are 0 in 2D, and if the normal has not changed since the last accepted state.
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
    """Changes of rays, or derivatives of these changes (further axes), shape (p, q, ...).

    In the shapes, p is the number of common parts of facets, and q that of points on each.

    Attributes:
        place: changes of the reference coordinates at which the rays meet the master, shape
            (p, q, dim - 1, ...).
        gap: changes of the gaps along the rays, shape (p, q, ...).
    """

    place: Array
    gap: Array


@dataclass(frozen=True, eq=False)
class Facing:
    """Common parts of slave and master facets with quadrature points, at a displacement.

    In the shapes, p is the number of common parts, q that of quadrature points on each, a the
    number of corners of a slave facet, b that of a master facet, and c = a + b.

    Attributes:
        found: candidates of the last search.
        facet: slave facet of each part, shape (p,).
        master: master facet of each part, an index of the candidates, shape (p,).
        nodes: global nodes at the corners of both facets, slave first, shape (p, c).
        signs: signs of the vector components at the corners, -1 if mirrored, otherwise 1, shape
            (p, c, dim).
        basis: linear basis functions of the slave corners at the points, shape (p, q, a).
        areas: quadrature weights in the reference configuration, shape (p, q).
        rays: rays from the points to the master.
        along: derivatives of the slips, as they enter the mean of each slave corner, with respect
            to the reference coordinates on the master, shape (p, q, a, dim, dim - 1).
        spins: derivatives of the mean angle by which both facets have turned with respect to their
            corners, shape (p, c, dim).
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
        """Basis functions of the slave corners times quadrature weights, shape (p, a, q)."""
        return (self.areas[..., None] * self.basis).transpose(0, 2, 1)

    @cached_property
    def jumps(self) -> Array:
        """Weights of the c corners in the jumps at q points of p pairs, shape (p, q, c)."""
        return np.concatenate([self.basis, -self.rays.weights], axis=2)

    @property
    def mass(self) -> Array:
        """Mass matrices of the slave facets on the common parts, shape (p, a, a).

        Entries are integrals of products of the basis functions of two slave corners over a common
        part; diagonal entries are set to 0.
        """
        found = self.weighted @ self.basis
        return found * (1.0 - np.eye(found.shape[1]))

    def moved(self, v: Array, m: Array) -> RayRates:
        """Return the changes of the rays due to displacements.

        Args:
            v: displacements of the corners of both facets, shape (p, c, dim).
            m: changes of the sums of area vectors at the slave corners, shape (p, a, dim).
        """
        rays = self.rays
        turned = rays.gap[..., None] * transformed(rays.by_normal, self.basis @ m)
        found = transformed(rays.inverse, self.jumps @ v + turned)
        return RayRates(found[..., :-1], found[..., -1])

    def slopes(self) -> RayRates:
        """Return the derivatives of the changes of the rays by the arguments of `moved`.

        The last two axes have shape (c + a, dim): displacements of the corners of both facets, then
        changes of the sums of area vectors at the slave corners.
        """
        rays = self.rays
        by_m = rays.gap[..., None, None] * (rays.inverse @ rays.by_normal)
        parts = (rays.inverse, self.jumps), (by_m, self.basis)
        every = [by[..., :, None, :] * weights[..., None, :, None] for by, weights in parts]
        both = np.concatenate(every, axis=3)
        return RayRates(both[..., :-1, :, :], both[..., -1, :, :])
