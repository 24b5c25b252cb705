# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Mortar weights between faces of different meshes, with the biorthogonal basis (2D).

On every facet of the slave the parts that a master facet covers are found in the line of the slave
facet, along its normal. One quadrature on these parts gives all integrals of the facet: its mass
M = int N N^T and areas d = int N, the dual basis psi = diag(d) M^-1 N, with int psi_p N_q = d_p
delta_pq, and the coupling int psi_p N_k of the master's basis. With W = sum d the jump of node p is

    j_p = u_p - 1/W_p sum_k (int psi_p N_k) u_k,

whose weights sum to zero: constants and, on faces that coincide, linear fields are reproduced to
round-off however the faces are cut, and so uniform tractions are (Wohlmuth, SIAM J. Numer. Anal.
38, 2000; Popp, Gee and Wall, Int. J. Numer. Methods Eng. 79, 2009).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["Coupling", "Faces", "coupling"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]

_LEAST_COVER = 0.05  # of a slave facet, below which it is dropped
_STEEP = 0.5  # cosine between the normals of opposite facets from which on they do not face
_GAUSS = np.polynomial.legendre.leggauss(2)


@dataclass(frozen=True)
class Faces:
    """Facets as segments.

    Attributes:
        x: ends (n, 2, 2).
        normals: outward (n, 2).
        nodes: global nodes of the ends (n, 2).
    """

    x: Array
    normals: Array
    nodes: Nodes


@dataclass(frozen=True)
class Coupling:
    """What the facets of a slave contribute.

    Attributes:
        slave: global nodes of the slave (entries,).
        master: global nodes of the master (entries,).
        values: int psi_p N_k (entries,).
        areas: int N of the covered part, at the ends of the slave's facets (n, 2).
    """

    slave: Nodes
    master: Nodes
    values: Array
    areas: Array


def coupling(slave: Faces, master: Faces, pairs: Nodes, deepest: float) -> Coupling:
    """Integrals over the covered parts of the slave's facets. Not collective.

    Args:
        slave: facets of this rank.
        master: facets that may be opposite to some.
        pairs: numbers of slave and master facets that may be opposite to each other (n, 2).
        deepest: how far the bodies may overlap.
    """
    i, k = pairs.T
    along = slave.x[:, 1] - slave.x[:, 0]
    length = np.linalg.norm(along, axis=1)
    offset = master.x[k] - slave.x[i, :1]
    s = np.einsum("pjd,pd->pj", offset, along[i]) / length[i, None] ** 2
    gap = np.einsum("pjd,pd->pj", offset, slave.normals[i])
    faces = np.sum(slave.normals[i] * master.normals[k], axis=1) < -_STEEP
    low, high = np.maximum(s.min(axis=1), 0.0), np.minimum(s.max(axis=1), 1.0)
    # Gaps at the ends of the common part.
    slope = (gap[:, 1] - gap[:, 0]) / np.where(faces, s[:, 1] - s[:, 0], 1.0)
    middle = gap[:, 0] + slope * ((low + high) / 2 - s[:, 0])
    kept = np.flatnonzero(faces & (high - low > 1e-10) & (middle > -deepest))
    parts = _nearest_parts(i[kept], low[kept], high[kept], middle[kept])
    which, low, high = kept[parts[0]], parts[1], parts[2]
    i, k, s = i[which], k[which], s[which]
    t = (_GAUSS[0] + 1) / 2
    at = low[:, None] + (high - low)[:, None] * t
    weights = (high - low)[:, None] * _GAUSS[1] / 2 * length[i, None]
    mine = np.stack([1 - at, at], axis=2)  # (parts, points, 2)
    xi = (at - s[:, :1]) / (s[:, 1:] - s[:, :1])
    theirs = np.stack([1 - xi, xi], axis=2)
    n = len(slave.x)
    mass, areas, cover = np.zeros((n, 2, 2)), np.zeros((n, 2)), np.zeros(n)
    np.add.at(mass, i, np.einsum("pq,pqa,pqb->pab", weights, mine, mine))
    np.add.at(areas, i, np.einsum("pq,pqa->pa", weights, mine))
    np.add.at(cover, i, high - low)
    dropped = cover < _LEAST_COVER
    mass[dropped], areas[dropped] = np.eye(2), 0.0
    dual = np.linalg.solve(mass, areas[:, :, None] * np.eye(2)).transpose(0, 2, 1)
    psi = np.einsum("pab,pqb->pqa", dual[i], mine)
    values = np.einsum("pq,pqa,pqk->pak", weights, psi, theirs)
    shape = values.shape
    return Coupling(
        np.broadcast_to(slave.nodes[i][:, :, None], shape).reshape(-1),
        np.broadcast_to(master.nodes[k][:, None, :], shape).reshape(-1),
        values.reshape(-1),
        areas,
    )


def _nearest_parts(i: Nodes, low: Array, high: Array, gap: Array) -> tuple[Nodes, Array, Array]:
    """Parts of facets, where several lie over each other the nearest alone.

    Returns:
        Numbers of the given parts, and their ends, perhaps several of one.
    """
    total = np.zeros(int(i.max(initial=-1)) + 1)
    np.add.at(total, i, high - low)
    several = total[i] > 1 + 1e-9
    once = np.flatnonzero(~several)
    found = [(int(p), float(low[p]), float(high[p])) for p in once]
    for facet in np.unique(i[several]):
        free = [(0.0, 1.0)]
        here = np.flatnonzero(i == facet)
        for p in here[np.argsort(np.abs(gap[here]), kind="stable")]:
            rest = []
            for a, b in free:
                c, d = max(a, low[p]), min(b, high[p])
                if d - c > 1e-10:
                    found.append((int(p), c, d))
                    rest += [(a, c), (d, b)]
                else:
                    rest.append((a, b))
            free = [(a, b) for a, b in rest if b - a > 1e-10]
    table = np.array(found, dtype=np.float64).reshape(-1, 3)
    return table[:, 0].astype(np.int64), table[:, 1], table[:, 2]
