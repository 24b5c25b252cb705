# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Weighted gap and slip of the nodes of a slave at a state, and their derivatives.

With quadrature points q on the parts that facets of slave and master have in common, weights w of
the reference configuration, and the gap g and the place eta of the ray of each (`rays`), a node a
of the slave has

    W_a = sum_q w N_a,    g_a = sum_q w N_a g / W_a,    d_a = sum_q w N_a R_aq d / W_a,

in which the slip is the way of the two material points that face each other now, along the surface
of the last accepted state,

    d = (I - n_o n_o^T) (y_o(eta) - x_o),

with x_o, y_o and n_o of that state. It does not change where both bodies turn as one, so that
points that stick keep their tractions turned with them. The law of node a sees the jump

    j_a = -g_a n_a + S_a R_a d_a

with the normal n_a of now and the smallest rotation R_a that takes the normal of the last state to
it; R_aq is that from n_o at the point to n_o at the node, so that slips on curved faces keep their
lengths. In space S_a is the rotation about n_a by the mean angle by which both faces have turned
about it since,

    psi_a = sum_q w N_a (psi_slave + psi_master)/2 / W_a,

of their facets (`spins`): the slip turns with the bodies, and by half of what one turns over the
other, since d is the chord of the arc that a point has followed, and friction acts along its end.

The tractions t of the nodes are nominal; their forces are w N_a t on the slave, and -w N_b(eta) t
on the master, t = sum_a N_a t_a (Puso and Laursen, CMAME 193, 2004; Poulios and Renard, Comput.
Struct. 153, 2015). Limits of the parts are not differentiated.

A node of which hardly anything is covered, as at the edge of a master that moves over it, has a gap
that is known at the edge alone. Its law counts by the share s = W_a / (c A_a), 1 at most, of a part
c of its area A_a; for the rest its traction is the mean of those around it,

    s (t_a - tau_a) + (1 - s) (t_a - sum_b m_ab t_b / sum_b m_ab) = 0,    m_ab = sum_q w N_a N_b,

so that tractions continue to the edge, and nothing jumps when a node comes to be covered or ceases
to be.

Of bodies of revolution w has the factor 2 pi R with the radius R of the point of the slave in the
reference configuration: tractions are nominal there too, so that w stays what it is when bodies
move, and there are no other derivatives. Forces are those of the whole circumference; the axial
ones of slave and master balance as sum_a N_a = sum_b N_b = 1 do. On the axis n_a has no radial
part.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from dolfinx_contact.points.kinematics import rotation
from dolfinx_contact.points.sliding.candidates import Candidates
from dolfinx_contact.points.sliding.rays import CastRays

__all__ = ["Facing", "Nodal"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Nodal:
    """What the local vertices of the slave have.

    Attributes:
        weight: W (n,), 0 where nothing is opposite.
        share: s, by which the law counts (n,).
        around: sum_b m_ab over the other nodes b (n,).
        gap: g (n,).
        slip: d (n, dim), along the surface of the last accepted state.
        normal: n (n, dim).
        length: |m| (n,).
        before: normal of the last accepted state (n, dim).
        spin: psi (n,), 0 in the plane.
        apart: psi_slave - psi_master, by which one has turned over the other (n,), likewise.
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
    def _turned(self) -> Array:
        """R (n, dim, dim)."""
        return rotation(self.before, self.normal)

    @cached_property
    def _spun(self) -> Array:
        """S (n, dim, dim), of vectors along the surface."""
        n, dim = self.normal.shape
        if dim == 2:
            return np.broadcast_to(np.eye(dim, dtype=np.float64), (n, dim, dim)).copy()
        across = np.cross(self.normal[:, None], np.eye(dim)).transpose(0, 2, 1)
        c, s = (f(self.spin)[:, None, None] for f in (np.cos, np.sin))
        return np.asarray(c * np.eye(dim) + s * across)

    @cached_property
    def rotation(self) -> Array:
        """S R (n, dim, dim), of vectors along the surface of the last accepted state."""
        return np.asarray(self._spun @ self._turned)

    @property
    def slip_now(self) -> Array:
        """S R d (n, dim)."""
        return np.einsum("nij,nj->ni", self.rotation, self.slip)

    @property
    def by_spin(self) -> Array:
        """Derivative of S R d by psi (n, dim)."""
        if self.normal.shape[1] == 2:
            return np.zeros_like(self.normal)
        return np.asarray(np.cross(self.normal, self.slip_now), dtype=np.float64)

    @property
    def jump(self) -> Array:
        """J (n, dim)."""
        return self.slip_now - self.gap[:, None] * self.normal

    @cached_property
    def by_normal(self) -> Array:
        """dn/dm (n, dim, dim)."""
        n = self.normal
        along = n[:, :, None] * n[:, None]
        return np.asarray((np.eye(n.shape[1]) - along) / self.length[:, None, None])

    @cached_property
    def by_turning(self) -> Array:
        """d(S R d)/dn less what a rotation with the normal makes of S R d (n, dim, dim).

        Zero in the plane, and where the normal is that of the last accepted state.
        """
        n = self.normal
        o = self.before
        d = self.slip - np.sum(self.slip * o, axis=1)[:, None] * o
        b = np.sum(n * d, axis=1)[:, None]
        c = (1.0 + np.sum(n * o, axis=1))[:, None]
        turned = -(n + o)[:, :, None] * (d / c - b * o / c**2)[:, None]
        turned -= (b / c)[:, :, None] * np.eye(n.shape[1])
        slip = np.einsum("nij,nj->ni", self._turned, self.slip)
        return np.asarray(self._spun @ (turned + n[:, :, None] * slip[:, None]))


@dataclass(frozen=True, eq=False)
class Facing:
    """Parts of slave and master that face each other, p, with q quadrature points each.

    Attributes:
        found: the candidates.
        facet: of the slave (p,).
        master: of the master, among the candidates (p,).
        basis: N_a at the points (p, q, a).
        areas: w, weights of the reference configuration (p, q).
        rays: at the points.
        along: R_aq (I - n_o n_o^T) Y_o, of the last accepted state (p, q, a, dim, dim - 1).
        spins: derivatives of psi by the corners of the slave, and the nodes of the master: (p, a,
            dim) and (p, b, dim).
        nodal: what the vertices have.
    """

    found: Candidates
    facet: Nodes
    master: Nodes
    basis: Array
    areas: Array
    rays: CastRays
    along: Array
    spins: tuple[Array, Array]
    nodal: Nodal

    @property
    def master_nodes(self) -> Nodes:
        """Global nodes of the facets of the master (p, b)."""
        return self.found.nodes[self.master]

    @property
    def mirrors(self) -> Array:
        """1, or -1 along axes across which these are images of the facets of the nodes (p, dim)."""
        return self.found.mirrors[self.master]

    @property
    def weighted(self) -> Array:
        """W N_a (p, q, a)."""
        return self.areas[..., None] * self.basis

    @property
    def mass(self) -> Array:
        """Parts of m_ab of other nodes (p, a, b), 0 of a node itself."""
        found = np.einsum("pqa,pqb->pab", self.weighted, self.basis)
        return found * (1.0 - np.eye(found.shape[1]))

    def moved(self, x: Array, m: Array, y: Array) -> tuple[Array, Array]:
        """Changes of places (p, q, dim - 1) and gaps (p, q).

        Args:
            x: displacements of the corners of the slave (p, a, dim).
            m: changes of the vectors m there (p, a, dim).
            y: displacements of the nodes of the master (p, b, dim).
        """
        rays = self.rays
        at = np.einsum("pqa,pad->pqd", self.basis, x)
        at -= np.einsum("pqb,pbd->pqd", rays.weights, y)
        turned = np.einsum("pqa,pad->pqd", self.basis, m)
        at += rays.gap[..., None] * np.einsum("pqij,pqj->pqi", rays.by_normal, turned)
        found = np.einsum("pqij,pqj->pqi", rays.inverse, at)
        return found[..., :-1], found[..., -1]

    def spun(self, x: Array, y: Array) -> Array:
        """Changes of psi at the pieces (p,), of displacements as those of `moved`."""
        mine, theirs = self.spins
        return np.asarray(np.sum(mine * x, axis=(1, 2)) + np.sum(theirs * y, axis=(1, 2)))

    def spin_slopes(self) -> Array:
        """Derivatives of `spun`, numbered as `slopes` are (p, c, dim)."""
        mine, theirs = self.spins
        return np.concatenate([mine, np.zeros_like(mine), theirs], axis=1)

    def slopes(self) -> tuple[Array, Array]:
        """Derivatives of `moved` by its arguments, of all corners and nodes one after the other.

        Returns:
            Of places (p, q, dim - 1, c, dim) and gaps (p, q, c, dim), in which c numbers the
            corners of x, those of m, the nodes of y.
        """
        rays = self.rays
        inverse = rays.inverse[..., :, None, :]
        by_x = inverse * self.basis[..., None, :, None]
        turning = (rays.gap[..., None, None] * (rays.inverse @ rays.by_normal))[..., :, None, :]
        by_m = turning * self.basis[..., None, :, None]
        by_y = -inverse * rays.weights[..., None, :, None]
        every = np.concatenate([by_x, by_m, by_y], axis=3)
        return every[..., :-1, :, :], every[..., -1, :, :]
