# SPDX-License-Identifier: LGPL-3.0-or-later
"""The contact problem u = W r + q of FCLib and Siconos, whose compliance W may be singular.

At m points (Acary and Brogliato, Numerical Methods for Nonsmooth Dynamical Systems, Springer 2008)

    u = W r + q,    0 <= u_n  against  r_n >= 0,    |r_t| <= F r_n,    r_t = -F r_n u_t/|u_t| .

u are relative velocities, r forces on the body. W is singular if equilibrium does not determine the
contact forces, as in many systems of rigid bodies.

Files of FCLib (Acary, Bremond, Koziara and Perignon, INRIA RT-0444, 2014) are HDF5; a global
problem M v = H r + f, u = H^T v + w is condensed to W = H^T M^-1 H and q = H^T M^-1 f + w. A text
file of Siconos holds dim, m, the storage of W (0 dense by columns, 1 sparse blocks, 2 printed by
CSparse), the size of W twice, W, q and F. In both, the normal comes before the tangents.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array
from scipy.sparse.linalg import splu

from dolfinx_contact.algorithms import PointProblem
from dolfinx_contact.algorithms.lemke import forces_by_lemke, tangents
from dolfinx_contact.algorithms.one_point import OnePoint
from dolfinx_contact.laws import coulomb

ZERO = 1e-12  # eigenvalues of W, relative to the largest one, that count as zero


@dataclass(eq=False)
class LocalProblem:
    """u = W r + q with Signorini's conditions and Coulomb friction at m points.

    Attributes:
        W: compliance, shape (dim m, dim m), ordered point by point, tangents before the normal;
            symmetrised.
        q: relative velocities without contact forces, shape (dim m,).
        friction: friction coefficients F, shape (m,).
    """

    W: np.ndarray
    q: np.ndarray
    friction: np.ndarray

    def __post_init__(self):
        away = np.abs(self.W - self.W.T).max() / np.abs(self.W).max()
        if not away <= 1e-3:
            raise ValueError(f"W is not symmetric: it differs from its transpose by {away:.2g}")
        self.W = (self.W + self.W.T) / 2
        if self.eigenvalues[0] < -1e-6 * self.eigenvalues[-1]:
            raise ValueError(f"W has the negative eigenvalue {self.eigenvalues[0]:.3g}")
        if np.linalg.eigvalsh(self.blocks).min() <= 0:
            raise ValueError("the compliance of a point is not positive definite")

    @cached_property
    def eigenvalues(self):
        return np.linalg.eigvalsh(self.W)

    @property
    def number(self):
        return len(self.friction)

    @property
    def dim(self):
        return len(self.q) // self.number

    @property
    def rank(self):
        return int((self.eigenvalues > ZERO * self.eigenvalues[-1]).sum())

    @property
    def blocks(self):
        """Compliance of each point alone, shape (m, dim, dim)."""
        every = np.arange(self.number)
        return self.W.reshape(self.number, self.dim, self.number, self.dim)[every, :, every]

    def points(self):
        """Return the same problem in terms of the stiffness S = W^-1; W must be regular."""
        S = np.linalg.inv(self.W)
        return PointProblem((S + S.T) / 2, S @ self.q, self.friction)

    def velocities(self, r):
        """Return u = W r + q for forces r of shape (m, dim)."""
        return (self.W @ r.reshape(-1) + self.q).reshape(r.shape)

    def violation(self, r):
        """Return |r - P(r - k u)| over the largest force, with the projection P onto the cone.

        k is the mean stiffness of the points.
        """
        k = 1.0 / np.diag(self.W).mean()
        answer = coulomb.allowed(r - k * self.velocities(r), self.friction, 0 * self.friction)
        size = max(np.abs(r).max(), k * np.abs(self.q).max()) or 1.0
        return float(np.abs(r - answer).max() / size)

    def by_sweeps(self, most, tolerance=1e-10):
        """Return forces (m, dim) by nonsmooth Gauss-Seidel (Jean, CMAME 177, 1999), and the sweeps.

        Each point is solved exactly for its own force, with the other forces held. The violation
        is measured in every tenth sweep.
        """
        stiffness = np.linalg.inv(self.blocks)
        points = [OnePoint(K, F, 0.0) for K, F in zip(stiffness, self.friction, strict=True)]
        d = self.dim
        r = np.zeros(len(self.q))
        sweep = 0
        while self.violation(r.reshape(-1, d)) > tolerance and sweep < most:
            for _ in range(10):
                for i, (K, point) in enumerate(zip(stiffness, points, strict=True)):
                    place = slice(d * i, d * i + d)
                    # Equilibrium of the point, K a = r + K c, with c from the forces of the others.
                    c = self.q[place] + self.W[place] @ r - self.W[place, place] @ r[place]
                    r[place] = K @ np.array(point.solve(K @ c)) - K @ c
            sweep += 10
        return r.reshape(-1, d), sweep

    def by_lemke(self):
        """Return forces (m, 2) by Lemke's method, and the number of pivots; in 2D only.

        If W is singular, it may end in a ray, which says nothing about the existence of solutions.
        """
        k = 1.0 / np.diag(self.W).mean()
        length = np.abs(self.q).max() or 1.0
        free = (self.q / length).reshape(-1, 2)
        friction = self.friction
        r, pivots = forces_by_lemke(self.W * k, free, friction, 0 * friction, tangents(2, 2))
        return r * k * length, pivots

    def reaction_freedom(self, r, tolerance=1e-8):
        """Return the dimension of the set of forces near a solution with the same velocities.

        This is the dimension of the kernel of W in the directions that the statuses leave: none at
        open points, along the edge of the cone at slipping points, and all at sticking points.
        Forces and velocities below ``tolerance`` times the largest one count as zero.
        """
        u = self.velocities(r)
        moving = tolerance * max(np.abs(u).max(), np.abs(self.q).max())
        columns = []
        for i in np.flatnonzero(r[:, -1] > tolerance * np.abs(r).max()):
            speed = np.linalg.norm(u[i, :-1])
            directions = np.eye(self.dim)
            if self.friction[i] == 0:
                directions = directions[:, -1:]
            elif speed > moving:
                directions = np.append(-self.friction[i] * u[i, :-1] / speed, 1.0)[:, None]
            columns.append(np.zeros((len(self.q), directions.shape[1])))
            columns[-1][self.dim * i : self.dim * (i + 1)] = directions
        if not columns:
            return 0
        B = np.hstack(columns)
        return int((np.linalg.eigvalsh(B.T @ self.W @ B) <= ZERO * self.eigenvalues[-1]).sum())


def read(file: Path) -> LocalProblem:
    """Read a problem of FCLib (``.hdf5``) or Siconos; raises ValueError for other content."""
    if file.suffix == ".hdf5":
        dim, W, q, friction = _of_fclib(file)
    else:
        dim, W, q, friction = _of_siconos(file.read_text())
    order = np.roll(np.arange(len(q)).reshape(-1, dim), -1, axis=1).reshape(-1)
    return LocalProblem(W[np.ix_(order, order)], q[order], friction)


def _of_fclib(file):
    import h5py

    with h5py.File(file) as data:
        group = data["fclib_local" if "fclib_local" in data else "fclib_global"]
        if {"G", "V", "R"} & set(group):
            raise ValueError("equality constraints are not supported")
        if "W" in group:
            W, q = _matrix(group["W"]).toarray(), group["vectors/q"][()]
        else:
            H = _matrix(group["H"]).tocsc()
            solve = splu(_matrix(group["M"]).tocsc()).solve
            W = H.T @ solve(H.toarray())
            q = H.T @ solve(group["vectors/f"][()]) + group["vectors/w"][()]
        return int(group["spacedim"][0]), W, q, group["vectors/mu"][()]


def _matrix(group):
    """Return a sparse matrix of FCLib: compressed rows (nz = -2) or columns (-1), or triplets."""
    rows, columns, kind = (int(group[name][0]) for name in ("m", "n", "nz"))
    p, i, x = (group[name][()] for name in ("p", "i", "x"))
    if kind < 0:
        return {-2: csr_array, -1: csc_array}[kind]((x, i, p), shape=(rows, columns))
    return coo_array((x[:kind], (i[:kind], p[:kind])), shape=(rows, columns))


def _of_siconos(text):
    words = iter(text.split())

    def numbers(count, kind=float):
        return np.array(list(islice(words, count)), dtype=kind)

    dim, contacts, storage, rows, columns = numbers(5, int)
    if storage == 0:
        numbers(2)  # the size once more
        W = numbers(rows * columns).reshape(columns, rows).T
    elif storage == 1:
        W = np.zeros((rows, columns))
        _, down, across = numbers(3, int)
        row_ends, column_ends = ([0, *numbers(count, int)] for count in (down, across))
        starts, block_columns = (numbers(count, int) for count in numbers(2, int))
        for row, (first, last) in enumerate(pairwise(starts)):
            for column in block_columns[first:last]:
                numbers(1)  # the number of the block
                place = slice(*row_ends[row : row + 2]), slice(*column_ends[column : column + 2])
                W[place] = numbers(W[place].size).reshape(W[place].T.shape).T
    else:
        W, text = _of_csparse(text, rows, columns)
        words = iter(text.split())
    q, friction = numbers(rows), numbers(contacts)
    if len(friction) < contacts or len(list(words)) > 1:  # some files end with one more number
        raise ValueError("there is other text than W, q and F, as in a global problem")
    return dim, W, q, friction


def _of_csparse(text, rows, columns):
    """Return a matrix printed by CSparse, and the remaining text.

    Lines are ``col <column> : ...``, ``<row> : <entry>`` or ``<row> <column> : <entry>``.
    """
    W = np.zeros((rows, columns))
    lines = text.partition("nnz:")[2].splitlines()[1:]
    end = next((k for k, line in enumerate(lines) if ":" not in line), len(lines))
    for line in lines[:end]:
        place, _, entry = line.partition(":")
        words = place.split()
        if words[0] == "col":
            column = int(words[1])
        else:
            W[int(words[0]), int(words[1]) if len(words) == 2 else column] += float(entry)
    return W, "\n".join(lines[end:])
