"""Unknowns with all statuses, and Taylor remainders of the residual."""

import numpy as np

from dolfinx_contact.equations.jacobian import Jacobian


def randomise(problem, seed, displacement, traction):
    """Unknowns that do not depend on the number of ranks; a mix of all statuses."""
    x = problem.create_vector()
    u = problem.u
    multiplier = problem.surfaces[0].multiplier

    def wave(amplitude, phase):
        return lambda y: (
            amplitude
            * np.array(
                [
                    np.sin((17 + 3 * i + seed) * y[0] + (5 + i) * y[1] + 3 * y[2] + phase + i)
                    for i in range(problem.V.mesh.geometry.dim)
                ]
            )
        )

    u.interpolate(wave(displacement, 0.3))
    multiplier.interpolate(wave(traction, 1.1))
    problem.write(x)
    problem.read(x)
    return x


def remainders(problem, x, seed):
    """|H(x + h d) - H(x) - h J d| over |H(x)| for shrinking h, the status held."""
    d = randomise(problem, seed, 1.0, 500.0)
    # Dirichlet columns are lifted, so H is differentiable along what leaves Dirichlet data alone.
    fixed = problem.equations.constraints.fixed.reshape(-1)[: problem.u.x.petsc_vec.getLocalSize()]
    values = problem.equations.constraints.values().reshape(-1)[: len(fixed)]
    d.array[: len(fixed)][fixed] = 0.0
    d.scale(1e-3)
    x.array[: len(fixed)][fixed] = values[fixed]
    b0, b1, y, Jd = (problem.create_vector() for _ in range(4))
    state = problem.residual(x, b0)
    jacobian = Jacobian(problem.equations)
    jacobian.update(state)
    jacobian.matrix.mult(d, Jd)
    sizes = []
    for h in (1.0, 0.5, 0.25):
        y.waxpy(h, d, x)
        problem.residual(y, b1, state.statuses)
        b1.axpy(-1.0, b0)
        b1.axpy(-h, Jd)
        sizes.append(b1.norm() / b0.norm())
    return np.array(sizes)
