# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Eigenvalues of largest size by Davidson's method, a cycle of multigrid a step.

    E^T G w = mu A w

with A symmetric and positive definite, and rows E and G that see little of w; A^-1 is never
applied. On a basis W with W^T A W = 1 the eigenvalues are those of (E W)^T (G W). The residual r of
the one of largest size gives the next vector of the basis, M r with a cycle M of multigrid for A^-1
(E. R. Davidson, J. Comput. Phys. 17, 1975; R. B. Morgan and D. S. Scott, SIAM J. Sci. Stat.
Comput. 7, 1986). With M = A^-1 these are the steps of Arnoldi's method for A^-1 E^T G, each of
which takes a solve there, and they are hardly fewer.

A search begins with a random vector and leaves out what is kept of earlier ones, so that it meets
what they have missed, also of eigenvalues that are there several times.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._errors import on_root

__all__ = ["Davidson"]

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

_ROOM = 40  # vectors of a search
_RESTART = 10  # eigenvectors with which it goes on when there is no more room
_STEPS = 10  # from a random vector before a rough answer is believed
_MOST_STEPS = 2000
_TIGHT = 1e-10  # residual, over the largest size known, that is none
_NOTHING = 1e-11  # size that is none
_DEPENDENT = 1e-10  # share of a vector outside of the basis that adds nothing to it


class Davidson:
    """See the module. Collective, as all its methods are.

    Args:
        A: the matrix, symmetric and positive definite.
        cycle: M, symmetric and positive definite as well.
        E: rows at w, consumed.
        G: as many rows, consumed.
        loads: sizes of the entries of a random f (m,); a search begins with M E^T f.

    Attributes:
        cycles: M r so far.
        number: of vectors that are kept.
        size: |mu| of the search.
        off: size of its residual, (r^T M r)^(1/2) for w^T A w = 1.
    """

    def __init__(self, A: PETSc.Mat, cycle: PETSc.PC, E: PETSc.Mat, G: PETSc.Mat, loads: Array):
        self.comm = A.comm.tompi4py()
        self.cycles = 0
        self.number = 0
        self.size = 0.0
        self.off = np.inf
        self._A = A
        self._cycle = cycle
        self._E = E
        self._G = G
        self._loads = loads
        self._rng = np.random.default_rng(self.comm.rank)
        self._w, self._Aw = A.createVecs()
        self._e, self._g = (rows.createVecLeft() for rows in (E, G))
        #: W, A W, E W and G W, one below the other, of the first `_used` columns.
        rows = 2 * self._w.getLocalSize() + 2 * len(loads)
        self._columns = np.empty((rows, 0), order="F")
        self._used = 0
        self._steps = 0
        self._largest = 0.0
        self._leading: tuple[complex, Complex] = (0.0, np.zeros(0, dtype=complex))

    def begin(self) -> None:
        """Begin a search for what is largest outside of what is kept."""
        room = self.number + _ROOM + 2
        if room > self._columns.shape[1]:
            kept = self._columns[:, : self.number]
            self._columns = np.empty((len(kept), room), order="F")
            self._columns[:, : self.number] = kept
        self._used = self.number
        self._steps = 0
        self._add(self._random())

    def converge(self, tolerance: float) -> None:
        """Go on until the residual is small.

        Args:
            tolerance: of the residual, over `size`.

        Raises:
            RuntimeError: on every rank, if it takes too long, or A is not positive definite.
        """
        while True:
            values, vectors = self._ritz()
            self._leading = (complex(values[0]), vectors[:, 0])
            self.size = abs(self._leading[0])
            residuals = self._residuals()
            better = [self._improvement(r) for r in residuals]
            products = [r @ t for r, t in zip(residuals, better, strict=True)]
            self.off = self._root(self._sum(np.array(products)).sum())
            none = max(_TIGHT * max(self.size, self._largest), _NOTHING)
            if self.off <= none or (self.off <= tolerance * self.size and self._steps >= _STEPS):
                return
            if self._steps >= _MOST_STEPS:
                raise RuntimeError(
                    f"multigrid found no eigenvalue in {_MOST_STEPS} cycles (residual "
                    f"{self.off / self.size:.0e}); take solver='direct' if memory allows"
                )
            if self._used - self.number >= _ROOM:
                self._restart(vectors)
            if not any([self._add(t) for t in better]):
                self._add(self._random())
            self._steps += 1

    def keep(self) -> list[tuple[Array, Array]]:
        """Keep the vector of the search, or the two of a complex pair.

        Returns:
            Of each the forces f = G w, and A^-1 E^T f as far as the search knows it.
        """
        value, y = self._leading
        parts = np.stack([y.real, y.imag], axis=1)[:, : 2 if value.imag else 1]
        first = self.number
        self._combine(np.linalg.qr(parts)[0])
        self.number = self._used
        self._largest = max(self._largest, self.size)
        w, _, e, g = self._parts(0)
        answers = w @ self._sum(e.T @ g[:, first:])
        return [(f.copy(), x) for f, x in zip(g[:, first:].T, answers.T, strict=True)]

    def _ritz(self) -> tuple[Complex, Complex]:
        """Eigenvalues on the basis of the search by falling size, and their vectors."""
        _, _, e, g = self._parts(self.number)
        H = self._sum(e.T @ g)

        def by_size() -> tuple[Complex, Complex]:
            values, vectors = np.linalg.eig(H)
            order = np.argsort(-np.abs(values), kind="stable")
            return values[order].astype(complex), vectors[:, order].astype(complex)

        return on_root(self.comm, by_size)

    def _residuals(self) -> list[Array]:
        """E^T G w - mu A w without what is kept, its real part and, if there is one, the other."""
        value, y = self._leading
        _, Aw, _, g = self._parts(self.number)
        kept, A_kept = (part[:, : self.number] for part in self._parts(0)[:2])
        forces = g @ y
        rest = Aw @ (value * y)
        found = []
        for part in (np.real, np.imag)[: 2 if value.imag else 1]:
            r = self._load(part(forces)) - part(rest)
            found.append(r - A_kept @ self._sum(kept.T @ r))
        return found

    def _load(self, force: Array) -> Array:
        """E^T f."""
        self._e.array[:] = force
        self._E.multTranspose(self._e, self._w)
        return self._w.array_r.copy()

    def _improvement(self, r: Array) -> Array:
        """M r."""
        self._Aw.array[:] = r
        self._cycle.apply(self._Aw, self._w)
        self.cycles += 1
        return self._w.array_r.copy()

    def _random(self) -> Array:
        noise = self._rng.standard_normal(len(self._loads))
        return self._improvement(self._load(self._loads * noise))

    def _add(self, w: Array) -> bool:
        """Let a vector be one of the basis, and return whether it adds anything."""
        self._w.array[:] = w
        self._A.mult(self._w, self._Aw)
        self._E.mult(self._w, self._e)
        self._G.mult(self._w, self._g)
        x = np.concatenate([v.array_r for v in (self._w, self._Aw, self._e, self._g)])
        n = len(w)
        before = self._root(self._sum(x[:n] @ x[n : 2 * n]))
        basis = self._columns[:, : self._used]
        for _ in range(2):
            x -= basis @ self._sum(basis[n : 2 * n].T @ x[:n])
        after = self._root(self._sum(x[:n] @ x[n : 2 * n]))
        if after <= _DEPENDENT * before:
            return False
        self._columns[:, self._used] = x / after
        self._used += 1
        return True

    def _restart(self, vectors: Complex) -> None:
        """Go on with the leading eigenvectors alone."""
        leading = vectors[:, :_RESTART]
        left, sizes, _ = np.linalg.svd(np.hstack([leading.real, leading.imag]), full_matrices=False)
        self._combine(left[:, sizes > _DEPENDENT * sizes[0]])

    def _combine(self, weights: Array) -> None:
        """Let combinations of the basis of the search replace it."""
        first = self.number
        new = self._columns[:, first : self._used] @ weights
        self._used = first + weights.shape[1]
        self._columns[:, first : self._used] = new

    def _parts(self, first: int) -> list[Array]:
        """W, A W, E W and G W from a column on."""
        n = self._w.getLocalSize()
        cuts = [n, 2 * n, 2 * n + len(self._loads)]
        return np.split(self._columns[:, first : self._used], cuts)

    def _sum(self, mine: Array) -> Array:
        """Over all ranks."""
        return np.asarray(self.comm.allreduce(mine))

    @staticmethod
    def _root(squared: Array) -> float:
        if squared < 0:
            raise RuntimeError("the body is not stable where contact points stay closed")
        return float(np.sqrt(squared))

    def destroy(self) -> None:
        """Free the PETSc objects."""
        for thing in (self._E, self._G, self._w, self._Aw, self._e, self._g):
            thing.destroy()
