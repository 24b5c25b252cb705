"""An elastic bar over a floor in plain numpy: an oracle of the library's schemes and levels.

Linear elements of equal length and a unit section. The one contact node is settled by hand: a step
is linear in the velocity at its end, and the contact force either vanishes or is that which keeps
the law's equation. Nothing here is the library's.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded


class Tridiagonal:
    """A symmetric tridiagonal matrix with its diagonal and off-diagonal."""

    def __init__(self, diagonal, beside):
        self.diagonal = np.asarray(diagonal, float)
        self.beside = np.asarray(beside, float)

    def __matmul__(self, x):
        y = self.diagonal * x
        y[:-1] += self.beside * x[1:]
        y[1:] += self.beside * x[:-1]
        return y

    def plus(self, factor, other):
        sums = (self.diagonal + factor * other.diagonal, self.beside + factor * other.beside)
        return Tridiagonal(*sums)

    def inverse(self):
        factor = cholesky_banded([np.append(0.0, self.beside), self.diagonal])
        return lambda b: cho_solve_banded((factor, False), b)


@dataclass
class Bar:
    """The bar of `cases.bouncing_bar`, or one of other numbers, without initial displacement."""

    n: int
    mass: str = "redistributed"
    young: float = 900.0
    density: float = 1.0
    length: float = 10.0
    weight: float = 10.0
    height: float = 5.0
    velocity: float = 0.0
    damping: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self):
        n = self.n
        h = self.length / self.n
        part = self.density * h
        ones = np.ones(n)
        ends = np.append(np.append(1.0, 2 * np.ones(n - 1)), 1.0)
        self.K = Tridiagonal(self.young / h * ends, -self.young / h * ones)
        consistent = Tridiagonal(part / 3 * ends, part / 6 * ones)
        self.C = Tridiagonal(0 * ends, 0 * ones)
        self.C = self.C.plus(self.damping[0], consistent).plus(self.damping[1], self.K)
        self.M = consistent
        if self.mass == "lumped":
            self.M = Tridiagonal(part / 2 * ends, 0 * ones)
        elif self.mass == "redistributed":
            self.M.diagonal[0] = self.M.beside[0] = 0.0
            self.M.diagonal[1] = part * 4 / 3
        self.load = -self.weight * part / 2 * ends

    def run(self, times, scheme="theta", theta=0.5, level="position", restitution=0.0):
        """Return mean forces of the steps between times, and gaps and total energies at their ends.

        The energy contains motion, strain, and height over the undeformed start.
        """
        n = self.n
        e = restitution
        u = np.zeros(n + 1)
        v = np.full(n + 1, self.velocity)
        known = (
            0.0 if scheme == "theta-euler" else 1.0 - theta
        )  # u_1 = u_0 + h (known v_0 + new v_1)
        new = 1.0 if scheme == "theta-euler" else theta
        inverse = None
        length = 0.0
        found = []
        for h in np.diff(times):
            if inverse is None or h != length:
                matrix = self.M.plus(theta * h, self.C).plus(theta * new * h**2, self.K)
                inverse = matrix.inverse()
                length = h
                unit = inverse(h * np.eye(n + 1)[0])  # velocity by a unit force
            inner = theta * (self.K @ (u + h * known * v))
            inner = inner + (1 - theta) * (self.K @ u + self.C @ v) - self.load
            free = inverse(self.M @ v - h * inner)
            if level == "velocity":
                force = max(0.0, -(free[0] + e * v[0]) / unit[0])
                if self.height + u[0] + h / 2 * v[0] > 0:
                    force = 0.0
            elif scheme == "modified-theta":  # the gap of u_1 + h (1 - theta) v_1
                ahead = self.height + u[0] + h * (1 - theta) * v[0] + h * free[0]
                force = max(0.0, -ahead / (h * unit[0]))
            else:
                ahead = self.height + u[0] + h * (known * v[0] + new * free[0])
                force = max(0.0, -ahead / (h * new * unit[0]))
            v1 = free + force * unit
            u = u + h * (known * v + new * v1)
            v = v1
            energy = v @ (self.M @ v) / 2 + u @ (self.K @ u) / 2 - self.load @ u
            found.append((force, self.height + u[0], energy))
        return tuple(np.array(found).T)
