"""Small piecewise smooth systems with known diagrams, for the continuation."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact.continuation import Events, Piece, System
from dolfinx_contact.continuation.affine import AffineSystem
from dolfinx_contact.laws import Coulomb, LawAtPoints, PointData
from dolfinx_contact.reduced.gathered import PointLaws


class SymmetricGuess:
    """A preconditioner knowing nothing of the system: symmetric, positive, and not diagonal."""

    def apply(self, r, z):
        total = r.sum()
        z.array[:] = 2.0 * r.array_r + 0.3 * total

    def apply_exact(self, r, z):
        z.set(0.0)

    def determinant_sign(self):
        return 1.0

    def age(self, iterations, digits):
        pass


class Textbook(System):
    """A dense system with kinked points, on any number of ranks.

    ``H(x, g, codes)``, ``J``, ``c`` are the pieces and their derivatives with respect to x and g;
    ``distances(x, g, codes)`` lists, point by point, pairs (distance, status beyond).
    """

    def __init__(
        self, n, H, J, c, distances=None, codes=None, statuses=(), moves=None, comm=MPI.COMM_WORLD
    ):
        self.comm = comm
        self.n = n
        self._H = H
        self._J = J
        self._c = c
        self._distances = distances
        self._codes = codes
        self._statuses = statuses
        self._moves = np.ones(n) if moves is None else np.asarray(moves, float)
        local = n // comm.size + (comm.rank < n % comm.size)
        self.matrix = PETSc.Mat().createAIJ([[local, n], [local, n]], nnz=n, comm=comm)
        self.matrix.setUp()
        v = self.create_vector()
        self._start, self._end = v.getOwnershipRange()
        self._scatter, self._all = PETSc.Scatter.toAll(v)

    def create_vector(self):
        return self.matrix.createVecRight()

    def _values(self, x):
        self._scatter.scatter(x, self._all)
        return self._all.array_r.copy()

    def _codes_of(self, x, gamma, piece):
        """Statuses of the kinked points on every rank; they live on the last rank."""
        if self._codes is None:
            return None
        mine = None
        if piece is not None and self.comm.rank == self.comm.size - 1:
            mine = piece.codes.copy()
        if piece is None:
            return np.asarray(self._codes(self._values(x), gamma), dtype=np.int8)
        return self.comm.bcast(mine, root=self.comm.size - 1)

    def residual(self, x, gamma, b, piece):
        codes = self._codes_of(x, gamma, piece)
        b.array[:] = self._H(self._values(x), gamma, codes)[self._start : self._end]
        return float(b.norm(PETSc.NormType.NORM_INFINITY))

    def correct(self, x, gamma, residual, correction, piece):
        raise ArithmeticError("a correction that cannot be made is left out")

    def jacobian(self, x, gamma, piece):
        codes = self._codes_of(x, gamma, piece)
        rows = np.arange(self._start, self._end, dtype=np.int32)
        J = np.asarray(self._J(self._values(x), gamma, codes), dtype=float)
        self.matrix.setValues(rows, np.arange(self.n, dtype=np.int32), J[rows])
        self.matrix.assemble()

    def parameter_derivative(self, x, gamma, c, piece):
        codes = self._codes_of(x, gamma, piece)
        values = np.asarray(self._c(self._values(x), gamma, codes), dtype=float)
        c.array[:] = values[self._start : self._end]

    def metric(self, x, out):
        out.array[:] = self._moves[self._start : self._end] * x.array_r

    def piece_at(self, x, gamma):
        codes = self._codes_of(x, gamma, None)
        last = self.comm.rank == self.comm.size - 1 and codes is not None
        return Piece(codes if last else np.zeros(0, dtype=np.int8))

    def events(self, x, gamma, piece):
        if self._codes is None:
            return Events(np.zeros(0), np.zeros(0, np.int32), np.zeros(0, np.int8))
        codes = self._codes_of(x, gamma, piece)
        pairs = self._distances(self._values(x), gamma, codes)
        if self.comm.rank < self.comm.size - 1:
            pairs = []
        flat = [(d, i, target) for i, events in enumerate(pairs) for d, target in events]
        d, i, target = zip(*flat, strict=True) if flat else ((), (), ())
        return Events(np.array(d, float), np.array(i, np.int32), np.array(target, np.int8))

    def probe(self, seed):
        x = self.create_vector()
        x.array[:] = np.sin(seed + 1.7 * np.arange(self.n))[self._start : self._end]
        return x

    def statuses(self, _point):
        return self._statuses


def one_node(kt, kn, k, F, load, rate):
    """Klarbring's and Hild's model: x = (ut, un, rt, rn), statuses 0 open, 1 stick, 2 +, 3 -."""
    S = np.array([[kt, k], [k, kn]])
    load = np.asarray(load, float)
    rate = np.asarray(rate, float)

    def rows(code):
        law = np.zeros((2, 4))
        if code == 0:
            law[0, 2] = law[1, 3] = 1
        elif code == 1:
            law[0, 0] = law[1, 1] = 1
        else:
            law[0, 2] = 1
            law[0, 3] = F if code == 2 else -F
            law[1, 1] = 1
        return law

    def J(_x, _g, codes):
        return np.vstack([np.hstack([S, -np.eye(2)]), rows(codes[0])])

    def H(x, g, codes):
        return J(x, g, codes) @ x - np.concatenate([load + g * rate, [0, 0]])

    def c(_x, _g, _codes):
        return -np.concatenate([rate, [0, 0]])

    def distances(x, _g, codes):
        ut, un, rt, rn = x
        return [
            {
                0: [(un, 2 if ut > 0 else 3)],
                1: [((F * rn + rt) / kn, 2), ((F * rn - rt) / kn, 3), (rn / kn, 0)],
                2: [(ut, 1), (rn / kn, 0)],
                3: [(-ut, 1), (rn / kn, 0)],
            }[int(codes[0])]
        ]

    def codes(x, _g, r=1.0):
        ut, un, rt, rn = x
        p = rn - r * un
        s = rt - r * ut
        if p <= 0:
            return [0]
        return [1] if abs(s) <= F * p else [3 if s > 0 else 2]

    return Textbook(4, H, J, c, distances, codes, (0, 1, 2, 3), moves=[1, 1, 0, 0])


def smooth(n, H, J, c):
    """A smooth system."""
    return Textbook(n, lambda x, g, _: H(x, g), lambda x, g, _: J(x, g), lambda x, g, _: c(x, g))


def pitchfork():
    """The pitchfork x (g - x^2) = 0."""
    return smooth(
        1, lambda x, g: x * (g - x**2), lambda x, g: [[g - 3 * x[0] ** 2]], lambda x, g: [x[0]]
    )


def circle():
    """The circle x^2 + g^2 = 1."""
    return smooth(1, lambda x, g: x**2 + g**2 - 1, lambda x, g: [[2 * x[0]]], lambda x, g: [2 * g])


def coulomb_system(S, load, rate, friction, *, r=1.0):
    """S a - r = load + gamma rate with Coulomb's law at every point, a = (ut, un), ..."""
    m = len(S) // 2
    M = np.zeros((2 * m, m, 4))
    M[:, :, :2] = S.reshape(2 * m, m, 2)
    M.reshape(m, 2, m, 4)[np.arange(m), :, np.arange(m), 2:] = -np.eye(2)
    data = PointData(
        np.tile([0.0, -1.0], (m, 1)),
        np.zeros(m),
        np.full(m, r),
        {"friction": np.full(m, float(friction))},
    )
    law = LawAtPoints(Coulomb(0.0), 2, m, MPI.COMM_SELF)
    frames = np.tile(np.eye(2), (m, 1, 1))
    laws = PointLaws(m, frames, np.ones(m), [(np.arange(m), law, data)])
    B, C, exists = laws.cones()
    load = np.asarray(load, float)
    rate = np.asarray(rate, float)
    return AffineSystem(M, load, rate, B, C, laws.classify, exists)


def start(system, values):
    """The vector with the values, on every rank its part."""
    x = system.create_vector()
    x.array[:] = np.asarray(values, float)[slice(*x.getOwnershipRange())]
    return x


def state(system, values):
    x = system.create_vector()
    x.array[:] = np.asarray(values, float)[slice(*x.getOwnershipRange())]
    return x


def gould():
    """KKT points of min -2(x1-1/4)^2 + 2(x2-1/2)^2, x1+x2 <= 1, 6x1+2x2 <= 3, x >= 0.

    Complementarity by min(a, b) = 0; unknowns x1, x2 and the multipliers of the two constraints.
    """
    A = np.array([[1.0, 1.0], [6.0, 2.0]])
    b = np.array([1.0, 3.0])
    Q = np.diag([-4.0, 4.0])
    c = np.array([1.0, -2.0])

    def pairs(z):
        x = z[:2]
        m = z[2:]
        first = np.concatenate([x, m])
        second = np.concatenate([Q @ x + c + A.T @ m, b - A @ x])
        slope = np.vstack([np.hstack([Q, A.T]), np.hstack([-A, np.zeros((2, 2))])])
        return first, second, slope

    def H(z, _g):
        first, second, _ = pairs(z)
        return np.minimum(first, second)

    def J(z, _g):
        first, second, slope = pairs(z)
        return np.where((first <= second)[:, None], np.eye(4), slope)

    return smooth(4, H, J, lambda z, g: np.zeros(4))
