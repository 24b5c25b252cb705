# SPDX-License-Identifier: LGPL-3.0-or-later
"""Last strategy of a solve: trace the solution branch from zero load to the full load.

The applied fraction s of the load grows from 0 to 1, as in `ContactEquations.ramped`. Where the
branch turns back in s, load increments fail, but the branch can be traced around the fold.
"""

from __future__ import annotations

from collections.abc import Callable

from petsc4py import PETSc

import numpy as np

from dolfinx import fem

from dolfinx_contact._arrays import Array
from dolfinx_contact._mpi import maximum
from dolfinx_contact.continuation import Follower, Piece, StepControl
from dolfinx_contact.equations.constraints import Ramp
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.parametric_equations import ParametricEquations
from dolfinx_contact.solvers.attempts import Attempt
from dolfinx_contact.solvers.newton import LinearSolver, Newton

__all__ = ["Loaded", "follow_load"]

_MOST_STEPS = 400
_ROUND_OFF = 1e-8  # contact rows, relative to stiffness times displacement, that are round-off


class Loaded(ParametricEquations):
    """H(x, s) = 0: contact problem with the applied fraction s of its load as parameter.

    Args:
        equations: contact problem under the full load, within `ContactEquations.ramped`.
        linear: function returning the linear solver of the problem.
        ramp: load as yielded by `ContactEquations.ramped`.
    """

    def __init__(self, equations: ContactEquations, linear: Callable[[], LinearSolver], ramp: Ramp):
        super().__init__(equations, fem.Constant(equations.V.mesh, 0.0), linear)
        self._ramp = ramp

    def leaves_surfaces_alone(self) -> bool:
        """Return whether the contact rows of H do not change with the load. Collective."""
        eq = self.equations
        size = maximum(eq.comm, np.abs(self._ramp.unknowns))
        off = maximum(eq.comm, np.abs(np.concatenate(self._ramp.rows[1:-1])))
        return off <= _ROUND_OFF * eq.scaling.stiffness * size

    def _set(self, gamma: float) -> None:
        self._ramp.fraction = gamma

    def parameter_derivative(
        self, x: PETSc.Vec, gamma: float, c: PETSc.Vec, piece: Piece | None
    ) -> None:
        super().parameter_derivative(x, gamma, c, piece)
        c.array[:] += np.concatenate(self._ramp.rows)

    def _data_rates(self) -> tuple[Array, Array, Array]:
        constraints, ramp = self.equations.constraints, self._ramp
        fraction, ramp.fraction = ramp.fraction, 1.0
        displacements = np.where(self.equations.fixed, constraints.displacement() - ramp.u, 0.0)
        motions = np.where(self.equations.rigid.fixed, constraints.motions() - ramp.q, 0.0)
        ramp.fraction = fraction
        return displacements, np.zeros_like(motions), motions


def follow_load(solver: Newton, x: PETSc.Vec, attempt: Attempt) -> bool:
    """Trace the branch of solutions under a growing load; return whether full load was reached.

    Args:
        solver: Newton's method; its maximum number of iterations also applies at points of the
            branch.
        x: start; receives the solution.
        attempt: attempt recording the reason for a failure.
    """
    most = solver.max_iterations
    if most < 1:
        attempt.reason = "no convergence in 0 iterations"
        return False
    control = StepControl(corrections=min(most, StepControl().corrections))
    with solver.equations.ramped(x) as ramp:
        system = Loaded(solver.equations, lambda: solver.linear, ramp)
        followed = _follow(system, x, attempt, control)
    return followed and solver.run(x, attempt)


def _follow(system: Loaded, x: PETSc.Vec, attempt: Attempt, control: StepControl) -> bool:
    try:
        with Follower(system, control, gamma_scale=1.0) as follower:
            branch = follower.run(
                follower.start(x, 0.0), gamma_range=(0.0, 1.0), max_steps=_MOST_STEPS
            )
            last = branch.points[-1]
            if last.gamma < 1.0:
                attempt.reason = f"{branch.reason}, at {last.gamma:.4g} of the load"
                if branch.complete:
                    attempt.reason = "the branch of solutions returns to the unloaded state"
                return False
            x.array[:] = last.y.array_r[: x.getLocalSize()]
    except ValueError as error:
        attempt.reason = str(error)
        return False
    finally:
        system.destroy()
    return True
