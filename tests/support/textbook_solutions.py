"""TODO."""

import numpy as np

from support.textbook import smooth


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
