# SPDX-License-Identifier: LGPL-3.0-or-later
"""The last strategy of a solve: follow the load from nothing to the whole, through folds.

The load grows as in `increments.py`, with s from 0 to 1. Following the branch of solutions goes on
where increments of s get stuck because it turns back.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact.continuation import Follower, Piece, StepControl
from dolfinx_contact.parametric import ParametricContact

if TYPE_CHECKING:
    from dolfinx_contact.condensed import CondensedContact
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.solvers.history import Attempt

__all__ = ["follow_load"]

_MOST_STEPS = 400


class _Loaded(ParametricContact):
    """H(x, s) - (1 - s) H(x_0, 0): the contact problem with a part s of its load."""

    def __init__(self, problem: ContactProblem, x0: PETSc.Vec):
        super().__init__(problem, fem.Constant(problem.V.mesh, 0.0))
        self._start = problem.prescribed.values()
        self._rest = problem.create_vector()
        problem.residual(x0, self._rest)

    def residual(self, x: PETSc.Vec, gamma: float, b: PETSc.Vec, piece: Piece | None) -> None:
        self.problem.prescribed.part = gamma
        super().residual(x, gamma, b, piece)
        b.axpy(gamma - 1.0, self._rest)

    def parameter_derivative(
        self, x: PETSc.Vec, gamma: float, c: PETSc.Vec, piece: Piece | None
    ) -> None:
        self.problem.prescribed.part = gamma
        super().parameter_derivative(x, gamma, c, piece)
        c.axpy(1.0, self._rest)

    def _dirichlet_rates(self) -> npt.NDArray[np.float64]:
        prescribed = self.problem.prescribed
        part, prescribed.part = prescribed.part, 1.0
        rates = prescribed.values() - self._start
        prescribed.part = part
        return rates.reshape(-1)

    @property
    def is_piecewise_affine(self) -> bool:
        return False

    def condensed(self, x: PETSc.Vec, gamma: float) -> CondensedContact | None:
        return None  # the rest has entries in the contact rows

    def destroy(self) -> None:
        super().destroy()
        self._rest.destroy()


def follow_load(problem: ContactProblem, x: PETSc.Vec, attempt: Attempt, most: int) -> bool:
    """Follow the load from ``x``, which becomes the solution at full load if that is reached.

    A point of the branch takes ``most`` iterations at most.
    """
    if most < 1:
        attempt.reason = "no convergence in 0 iterations"
        return False
    control = StepControl(corrections=min(most, StepControl().corrections))
    problem.read(x)
    start = problem.u.x.array.reshape(problem.constraints.fixed.shape)
    with problem.prescribed.ramped(start):
        problem.prescribed.part = 0.0
        return _follow(_Loaded(problem, x), x, attempt, control)


def _follow(system: _Loaded, x: PETSc.Vec, attempt: Attempt, control: StepControl) -> bool:
    try:
        with Follower(system, control, gamma_scale=1.0) as follower:
            branch = follower.run(follower.start(x, 0.0), (0.0, 1.0), max_steps=_MOST_STEPS)
            last = branch.points[-1]
            if last.gamma < 1.0:
                attempt.reason = f"{branch.reason}, at {last.gamma:.4g} of the load"
                return False
            x.array[:] = last.y.array_r[: x.getLocalSize()]
    except ValueError as error:
        attempt.reason = str(error)
        return False
    finally:
        system.destroy()
    return True
