# SPDX-License-Identifier: LGPL-3.0-or-later
"""Last strategy of a solve: follow the branch of solutions from no load to the whole load.

The load grows as in `strategies.raise_load`, with s from 0 to 1. Where the branch turns back, load
increments fail, but the branch can be followed through its folds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from petsc4py import PETSc

import numpy as np

from dolfinx import fem

from dolfinx_contact._arrays import Array
from dolfinx_contact.continuation import Follower, Piece, StepControl
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.equations.parametric import ParametricEquations
from dolfinx_contact.solvers.history import Attempt
from dolfinx_contact.solvers.linear import LinearSolver

__all__ = ["Loaded", "follow_load"]

_MOST_STEPS = 400
_ROUND_OFF = 1e-8  # contact rows, relative to stiffness times displacement, that are round-off


class Loaded(ParametricEquations):
    """H(x, s) - (1 - s) H(x_0, 0): the contact problem with a fraction s of its load.

    It must be created and used within `ContactEquations.ramped` from x_0, at first with s = 0.

    Args:
        equations: contact problem under the whole load.
        linear: function returning its linear solver.
        x0: solution x_0 at s = 0.
    """

    def __init__(
        self, equations: ContactEquations, linear: Callable[[], LinearSolver], x0: PETSc.Vec
    ):
        super().__init__(equations, fem.Constant(equations.V.mesh, 0.0), linear)
        equations.read_data()
        self._start = equations.prescribed.values()
        self._motions = equations.prescribed.motions()
        self._x0 = x0
        self._rest = equations.unknowns.create_vector()
        equations.residual(x0, self._rest)

    def leaves_surfaces_alone(self) -> bool:
        """Return whether the load does not change the data of the surfaces. Collective."""
        eq = self.equations
        size = max(float(np.abs(f).max(initial=0.0)) for f in eq.unknowns.blocks(self._x0))
        rows = [float(np.abs(f).max(initial=0.0)) for f in eq.unknowns.blocks(self._rest)[1:-1]]
        size, off = (float(eq.comm.allreduce(v, op=max)) for v in (size, max(rows)))
        return off <= _ROUND_OFF * eq.stiffness_scale * size

    def _set(self, gamma: float) -> None:
        self.equations.prescribed.fraction = gamma

    def _evaluate(
        self, x: PETSc.Vec, gamma: float, b: PETSc.Vec, piece: Piece | None
    ) -> Evaluation:
        state = super()._evaluate(x, gamma, b, piece)
        b.axpy(gamma - 1.0, self._rest)
        return replace(state, rows=self.equations.unknowns.blocks(b))

    def contact_rows(self, x: PETSc.Vec, gamma: float, piece: Piece | None) -> Array | None:
        rows = super().contact_rows(x, gamma, piece)
        assert rows is not None
        first = self.equations.owned_sizes[0]
        return np.asarray(rows + (gamma - 1.0) * self._rest.array_r[first : first + len(rows)])

    def parameter_derivative(
        self, x: PETSc.Vec, gamma: float, c: PETSc.Vec, piece: Piece | None
    ) -> None:
        super().parameter_derivative(x, gamma, c, piece)
        c.axpy(1.0, self._rest)

    def _data_rates(self) -> tuple[Array, Array, Array]:
        prescribed = self.equations.prescribed
        fraction = prescribed.fraction
        prescribed.fraction = 1.0
        displacements = prescribed.values() - self._start
        motions = self.equations.prescribed.motions() - self._motions
        prescribed.fraction = fraction
        return displacements.reshape(-1), np.zeros_like(motions), motions

    def destroy(self) -> None:
        super().destroy()
        self._rest.destroy()


def follow_load(
    equations: ContactEquations,
    linear: Callable[[], LinearSolver],
    x: PETSc.Vec,
    attempt: Attempt,
    most: int,
) -> bool:
    """Follow the load from ``x``, which receives the solution at full load, and return success.

    Args:
        equations: contact problem under the whole load.
        linear: function returning its linear solver.
        x: start; receives the solution.
        attempt: attempt recording the reason of a failure.
        most: largest number of iterations at a point of the branch.
    """
    if most < 1:
        attempt.reason = "no convergence in 0 iterations"
        return False
    control = StepControl(corrections=min(most, StepControl().corrections))
    with equations.ramped(x):
        return _follow(Loaded(equations, linear, x), x, attempt, control)


def _follow(system: Loaded, x: PETSc.Vec, attempt: Attempt, control: StepControl) -> bool:
    try:
        with Follower(system, control, gamma_scale=1.0) as follower:
            branch = follower.run(
                follower.start(x, 0.0), gamma_range=(0.0, 1.0), max_steps=_MOST_STEPS
            )
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
