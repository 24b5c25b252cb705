# SPDX-License-Identifier: LGPL-3.0-or-later
"""Weighted gaps and slips of the slave nodes at a state, and their derivatives.

Let N_a and N_b be the linear basis functions of slave and master nodes. The common parts of slave
and master facets have quadrature points q with weights w in the reference configuration. A ray
along the slave normal meets the master at the reference coordinates eta, at a distance equal to the
gap g (`cast`). A slave node a has the covered area W_a, the gap g_a and the slip d_a,

    W_a = sum_q w N_a,    g_a = sum_q w N_a g / W_a,    d_a = sum_q w N_a R_aq d / W_a.

The slip d of a point is the vector, in the tangent plane of the last accepted state, between the
two material points that face each other now,

    d = (I - n_o n_o^T) (y_o(eta) - x_o),

with the slave point x_o, the master point y_o and the normal n_o in that state. A common rotation
of both bodies does not change d, so that the tractions of sticking points turn with the bodies. The
law of node a is evaluated at the jump

    j_a = -g_a n_a + S_a R_a d_a

with the present normal n_a and the smallest rotation R_a from the normal of the last state to n_a;
R_aq is the smallest rotation from n_o at the point to n_o at the node, so that slips on curved
faces keep their lengths. S_a, in 3D, is the rotation about n_a by the mean angle by which both
faces have turned about it since the last accepted state,

    psi_a = sum_q w N_a (psi_slave + psi_master)/2 / W_a,

where psi_slave and psi_master are the angles of their facets (`spins`). Thus the slip turns with
the bodies, and by half of their relative rotation: d is the chord of the arc that a point has
followed, but friction acts along the tangent at its end.

The tractions t of the nodes are nominal; their forces are w N_a t on the slave, and -w N_b(eta) t
on the master, t = sum_a N_a t_a (Puso and Laursen, CMAME 193, 2004; Poulios and Renard, Comput.
Struct. 153, 2015). Changes of the boundaries of the common parts are not differentiated.

At a node that is barely covered, for example near the edge of the master, the gap is known only
near that edge. Its law therefore gets the weight s = min(1, W_a / (c A_a)), with the area A_a of
the node and a fixed fraction c, and the mean of the tractions t_b of the slave nodes b around it
gets the rest,

    s (t_a - tau_a) + (1 - s) (t_a - sum_b m_ab t_b / sum_b m_ab) = 0,    m_ab = sum_q w N_a N_b,

with the traction tau_a required by the law. Tractions are thus continuous at the edge, also when a
node becomes covered or uncovered.

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

    There are p common parts of facets with q points each.

    Attributes:
        normal: unit normals at the points, the directions of the rays, shape (p, q, dim).
        length: lengths of the normals m before normalisation, shape (p, q).
        gap: gaps along the rays, shape (p, q).
        weights: basis functions of the b master nodes where rays meet the master, shape (p, q, b).
        slopes: their derivatives by the reference coordinates, shape (p, q, b, dim - 1).
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
        """Derivatives of the unit normals with respect to normals m of any length.

        Shape (p, q, dim, dim).
        """
        return unit_rates(self.normal, self.length)


def cast(x: Array, m: Array, y: Array, eta: Array) -> CastRays:
    """Intersect rays along slave normals with master facets.

    Let m_a be the sum of the area vectors of the facets around the slave node x_a with the linear
    basis function N_a. The point x = sum_a N_a x_a has the normal n = m / |m|, m = sum_a N_a m_a.
    The ray from x along n meets the master facet y(eta) = sum_b N_b(eta) y_b at

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

    Before, a facet has the unit normal o, and two edge vectors with the reciprocal vectors a^i in
    its plane; now it has the unit normal n and edge vectors e_i. The smallest rotation R from o to
    n turns a^i into g_i = R a^i; in addition, the facet is deformed by F = sum_i e_i g_i^T. The
    rotation in the polar decomposition of F is about n, by the angle psi with

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
        around: integrals of the basis function of each vertex times all others, shape (n,).
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
        """Smallest rotations R from normals of the last accepted state to current normals.

        Shape (n, dim, dim).
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

        The smallest rotations R from the earlier to the current normals are followed by rotations S
        about the normals by the angles `spin`; shape (n, dim, dim).
        """
        return self._spun @ self._turned

    @property
    def slip_now(self) -> Array:
        """Slips since the last accepted state, rotated to the current state, shape (n, dim)."""
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
        """Derivatives of the normals with respect to the sums m of area vectors.

        Shape (n, dim, dim).
        """
        return unit_rates(self.normal, self.length)

    @cached_property
    def by_turning(self) -> Array:
        """Derivatives of `slip_now` with respect to the normals, shape (n, dim, dim).

        The change of a vector that merely turns with the normal is not included. Zero in 2D, and if
        the normal has not changed since the last accepted state.
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
    """Changes of rays from q points on each of p common parts, or derivatives of these changes.

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

    There are p common parts with q points each; a slave facet has a corners, a master facet b, and
    c = a + b.

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
        """Mass matrices of slave facets on the common parts, 0 on the diagonal, shape (p, a, a)."""
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
        """Return the derivatives of `moved`, the changes of the rays, by its arguments.

        The last two axes, shape (c + a, dim), contain displacements of the c corners of both
        facets, then sums of area vectors at the a slave corners.
        """
        rays = self.rays
        by_m = rays.gap[..., None, None] * (rays.inverse @ rays.by_normal)
        parts = (rays.inverse, self.jumps), (by_m, self.basis)
        every = [by[..., :, None, :] * weights[..., None, :, None] for by, weights in parts]
        both = np.concatenate(every, axis=3)
        return RayRates(both[..., :-1, :, :], both[..., -1, :, :])
