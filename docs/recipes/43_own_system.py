# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I follow branches of an equation that is not a contact problem?
#
# Define a `System`: H(x, gamma) and its derivatives in PETSc. `dolfinx_contact.continuation` needs
# nothing else, neither DOLFINx nor UFL. Here Bratu's problem, -u'' = gamma exp(u) on (0, 1) with
# u = 0 at both ends, is followed around its fold. A smooth system has one piece; systems with kinks
# also define `piece_at`, `events` and `statuses`.

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation import System, follow


class Bratu(System):
    def __init__(self, n, comm=MPI.COMM_WORLD):
        self.comm, self.h = comm, 1.0 / (n + 1)
        self.laplacian = PETSc.Mat().createAIJ(n, nnz=3, comm=comm)
        for i in range(*self.laplacian.getOwnershipRange()):
            for j, value in ((i - 1, -1.0), (i, 2.0), (i + 1, -1.0)):
                if 0 <= j < n:
                    self.laplacian[i, j] = value / self.h**2
        self.laplacian.assemble()
        self.matrix = self.laplacian.copy()

    def create_vector(self):
        return self.laplacian.createVecRight()

    def residual(self, x, gamma, b, piece):
        self.laplacian.mult(x, b)
        b.array[:] -= gamma * np.exp(x.array_r)
        return b.norm(PETSc.NormType.INFINITY)

    def jacobian(self, x, gamma, piece):
        diagonal = self.laplacian.getDiagonal()
        diagonal.array[:] -= gamma * np.exp(x.array_r)
        self.matrix.setDiagonal(diagonal)

    def parameter_derivative(self, x, gamma, c, piece):
        c.array[:] = -np.exp(x.array_r)

    def metric(self, x, out):  # lengths of x: the norm of L2
        x.copy(out)
        out.scale(self.h)

    def probe(self, seed):  # any vector without symmetries
        x = self.create_vector()
        x.array[:] = np.sin(seed + 1.7 * np.arange(*x.getOwnershipRange()))
        return x


# ## The branch
#
# The start is corrected at gamma = 1. The branch turns back at the fold and ends where gamma is 1
# again, with the second solution.

system = Bratu(99)
branch = follow(system, system.create_vector(), 1.0, gamma_range=(1.0, 4.0))
x = system.create_vector()
for point in branch.points[::6]:
    x.array[:] = point.y.array_r[: x.getLocalSize()]
    print(f"gamma = {point.gamma:.4f}   max u = {x.norm(PETSc.NormType.INFINITY):.4f}")
(fold,) = branch.folds
print(f"fold at gamma = {fold.gamma:.4f}; exact, for the differential equation: 3.5138")
assert abs(fold.gamma - 3.513831) < 1e-3
assert branch.complete
