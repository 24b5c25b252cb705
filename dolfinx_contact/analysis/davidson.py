# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Eigenvalues of largest modulus by Davidson's method with one multigrid cycle per step.

    E^T G w = mu A w

mu is an eigenvalue and w its eigenvector. A is symmetric and positive definite; E and G are
rectangular, and each of their rows has few nonzero entries. A^-1 is never applied. On a basis W
with W^T A W = 1, the Ritz values are the eigenvalues of (E W)^T (G W). The residual r of the Ritz
pair of largest modulus gives the next basis vector M r, where M is a multigrid cycle that
approximates A^-1 (E. R. Davidson, J. Comput. Phys. 17, 1975; R. B. Morgan and D. S. Scott, SIAM J.
Sci. Stat. Comput. 7, 1986). With M = A^-1 this is Arnoldi's method for A^-1 E^T G, which needs a
solve per step and hardly fewer steps.

A search begins with a random vector, A-orthogonal to the converged vectors of earlier searches, so
that it finds missed eigenvalues, including multiple ones. Its first basis vectors use r = E^T G w_k
with the previous vector w_k instead of the residual of a Ritz pair, which would lose large
components elsewhere in the random vector, for example in bodies that do not touch.

SLEPc's generalised Davidson method stops at the norm of the residual, which does not bound the
error of an eigenvalue of this problem. For the leaning cube of `benchmarks/critical_friction.py`
with 28 000 unknowns it took 82 cycles for the first critical friction coefficient (52 here), and
its search for the next one ended at 2.46, where 2.37 is found here. SLEPc's Jacobi-Davidson method
accepts no preconditioner without a Krylov method.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array
from dolfinx_contact._mpi import on_root, total
from dolfinx_contact._petsc import destroy

__all__ = ["Davidson"]

Complex = npt.NDArray[np.complex128]

_ROOM = 40  # largest number of vectors in a search
_FIRST = 20  # number of vectors generated from the random vector
_RESTART = 10  # number of Ritz vectors kept at a restart
_MOST = 2000  # largest number of multigrid cycles
_NONE = 1e-12  # residual of round-off, relative to the largest modulus
_NOTHING = 1e-11  # modulus that counts as zero
_DEPENDENT = 1e-10  # relative norm outside the basis below which a vector is dependent


class Davidson:
    """Davidson's method for E^T G w = mu A w with eigenpairs (mu, w). Collective.

    Args:
        A: symmetric positive definite matrix.
        cycle: multigrid cycle M that approximates A^-1, symmetric and positive definite.
        E: matrix with m rows, which `destroy` also destroys.
        G: matrix with m rows, which `destroy` also destroys.
        loads: magnitudes of the entries of the random vector f with which a search begins, in the
            rows of this rank; the first basis vector is M E^T f.

    Attributes:
        cycles: number of multigrid cycles so far.
        number: number of converged vectors, which `keep` has added to the basis.
        largest: largest |mu| of the converged vectors.
        size: |mu| of the leading Ritz pair in the current search.
        off: norm (r^T M r)^(1/2) of the residual r of this Ritz pair, for w^T A w = 1.
        error: estimated error of mu: residual norm times the condition number 1 / |z^T w| of the
            eigenvalue with the left Ritz vector z (G. W. Stewart and J. Sun, Matrix Perturbation
            Theory, 1990, ch. IV).
    """

    def __init__(self, A: PETSc.Mat, cycle: PETSc.PC, E: PETSc.Mat, G: PETSc.Mat, loads: Array):
        self.comm = A.comm.tompi4py()
        self.cycles = 0
        self.number = 0
        self.size = 0.0
        self.off = np.inf
        self.error = np.inf
        self._A = A
        self._cycle = cycle
        self._E = E
        self._G = G
        self._loads = loads
        self._rng = np.random.default_rng(self.comm.rank)
        self._w, self._Aw = A.createVecs()
        self._e, self._g = (rows.createVecLeft() for rows in (E, G))
        #: W, A W, E W and G W, stacked; the first `_used` columns are valid.
        rows = 2 * self._w.getLocalSize() + 2 * len(loads)
        self._columns = np.empty((rows, 0), order="F")
        self._used = 0
        self.largest = 0.0
        self._leading: tuple[complex, Complex] = (0.0, np.zeros(0, dtype=complex))

    def begin(self) -> None:
        """Begin a search for the largest eigenvalue outside the span of the converged vectors."""
        room = self.number + _ROOM + 2
        if room > self._columns.shape[1]:
            kept = self._columns[:, : self.number]
            self._columns = np.empty((len(kept), room), order="F")
            self._columns[:, : self.number] = kept
        self._used = self.number
        self._add(self._random())
        for _ in range(_FIRST):
            last = self._parts(self._used - 1)[3][:, 0]
            if not self._add(self._improvement(self._residual(last))):
                break

    def converge(self, tolerance: float) -> None:
        """Iterate until the error of the leading eigenvalue is small or the residual is round-off.

        Args:
            tolerance: largest error of the eigenvalue, relative to its magnitude.

        Raises:
            RuntimeError: on every rank, after too many cycles, or if A is not positive definite.
        """
        begun = self.cycles
        while True:
            values, vectors, condition = self._ritz()
            value, y = values[0], vectors[:, 0]
            force = self._parts(self.number)[3] @ y
            residuals = [self._residual(f) for f in _real_parts(value, force)]
            better = [self._improvement(r) for r in residuals]
            products = sum(float(r @ t) for r, t in zip(residuals, better, strict=True))
            self.size = abs(value)
            self.off = self._root(self._sum(products))
            self.error = condition * self.off
            self._leading = value, y
            none = max(_NONE * max(self.size, self.largest), _NOTHING)
            if self.off <= none or self.error <= tolerance * self.size:
                return
            if self.cycles - begun > _MOST:
                raise RuntimeError(
                    f"multigrid found no eigenvalue in {_MOST} cycles (size {self.size:.3e}, "
                    f"residual {self.off:.0e}); use solver='direct' if memory allows"
                )
            if self._used - self.number >= _ROOM:
                self._restart(vectors)
            added = sum(self._add(t) for t in better)
            if not added:
                self._add(self._random())

    def keep(self) -> tuple[Array, Array]:
        """Keep the leading Ritz vector of the search, or both vectors of a complex pair.

        Returns:
            Products f = G w for the new vectors w, shape (m, 1 or 2), and the approximations of
            A^-1 E^T f in the basis.
        """
        first = self.number
        parts = _real_parts(*self._leading)
        self._combine(np.linalg.qr(np.stack(parts, axis=1))[0])
        self.number = self._used
        self.largest = max(self.largest, self.size)
        w, _, e, g = self._parts(0)
        f = g[:, first:].copy()
        return f, w @ self._sum(e.T @ f)

    def _ritz(self) -> tuple[Complex, Complex, float]:
        """Return the Ritz pairs of the search in order of decreasing modulus.

        Returns:
            Ritz values; their vectors in the basis, as columns; and the condition number of the
            first.
        """
        _, _, e, g = self._parts(self.number)
        H = self._sum(e.T @ g)

        def by_size() -> tuple[Complex, Complex, float]:
            values, vectors = np.linalg.eig(H)
            order = np.argsort(-np.abs(values), kind="stable")
            vectors = vectors[:, order].astype(complex)
            left = np.linalg.pinv(vectors)[0]
            return values[order].astype(complex), vectors, float(np.linalg.norm(left))

        return on_root(self.comm, by_size)

    def _residual(self, force: Array) -> Array:
        """Return E^T f minus its projection on the basis: the residual if f = G w is ``force``."""
        _, Aw, e, _ = self._parts(0)
        return self._load(force) - Aw @ self._sum(e.T @ force)

    def _load(self, force: Array) -> Array:
        """Multiply a vector with m rows by E^T, where E is a matrix of the eigenproblem."""
        self._e.array[:] = force
        self._E.multTranspose(self._e, self._w)
        return self._w.array_r.copy()

    def _improvement(self, r: Array) -> Array:
        """Apply one multigrid cycle to a residual ``r``; the result is the next basis vector."""
        self._Aw.array[:] = r
        self._cycle.apply(self._Aw, self._w)
        self.cycles += 1
        return self._w.array_r.copy()

    def _random(self) -> Array:
        noise = self._rng.standard_normal(len(self._loads))
        return self._improvement(self._load(self._loads * noise))

    def _add(self, w: Array) -> bool:
        """Add a vector to the basis; return False if it is linearly dependent."""
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
        squared = float(self._sum(x[:n] @ x[n : 2 * n]))
        # If the basis is complete, only round-off remains, with either sign.
        if abs(squared) <= (_DEPENDENT * before) ** 2:
            return False
        self._columns[:, self._used] = x / self._root(squared)
        self._used += 1
        return True

    def _restart(self, vectors: Complex) -> None:
        """Reduce the basis of the search to the leading Ritz vectors."""
        leading = vectors[:, :_RESTART]
        left, sizes, _ = np.linalg.svd(np.hstack([leading.real, leading.imag]), full_matrices=False)
        self._combine(left[:, sizes > _DEPENDENT * sizes[0]])

    def _combine(self, weights: Array) -> None:
        """Replace the basis of the search by linear combinations of its vectors."""
        first = self.number
        new = self._columns[:, first : self._used] @ weights
        self._used = first + weights.shape[1]
        self._columns[:, first : self._used] = new

    def _parts(self, first: int) -> list[Array]:
        """Return W, A W, E W and G W without the columns of the ``first`` leading basis vectors."""
        n = self._w.getLocalSize()
        cuts = [n, 2 * n, 2 * n + len(self._loads)]
        return np.split(self._columns[:, first : self._used], cuts)

    def _sum(self, mine: npt.ArrayLike) -> Array:
        """Return the sum of an array over all ranks."""
        return total(self.comm, np.asarray(mine))

    @staticmethod
    def _root(squared: float | Array) -> float:
        if squared < 0:
            raise RuntimeError("the body is not stable where contact points stay closed")
        return float(np.sqrt(squared))

    def destroy(self) -> None:
        """Free the PETSc objects."""
        destroy(self._E, self._G, self._w, self._Aw, self._e, self._g)


def _real_parts(value: complex, vector: Complex) -> list[Array]:
    """Return the real part of an eigenvector, and its imaginary part if ``value`` is complex."""
    return [vector.real, vector.imag] if value.imag else [vector.real]
