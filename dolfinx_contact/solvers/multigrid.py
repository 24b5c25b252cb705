# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton steps by a Krylov method, preconditioned by multigrid and an exact surface solve.

A Newton step from an iterate x:

1. Assemble the contact terms S of the Jacobian at the statuses of x (`matrix_free`), and factorise
   the block of the contact surface (`surface_block`), in nodal contact with condensed multipliers.
   The stiffness of a linear body is kept.
2. Use the present multigrid hierarchy of the stiffness (`hierarchy`). It is built with the closed
   nodes fixed and the closed points of pairs joined by springs (`closed_points`). It outlives
   changes of status, because the exact surface solve corrects the contact nodes.
3. Build a new hierarchy only if the stiffness of a linear body has changed, or if the iterations
   saved exceed the cost of the set-up; costs are counted in iterations (`PLAIN`, `SMOOTHED`,
   measured in `benchmarks/settings_study.py`). Smoothed aggregates replace plain ones by the same
   rule.
4. Choose the relative tolerance by the forcing terms of Eisenstat and Walker (`_inexact`).
5. Solve by FGMRES, starting from one application of the preconditioner: a surface solve, a
   multigrid cycle, and another surface solve (`surface_filter`). Stop early if the residual of the
   contact conditions after the step, a measure of the nonlinearity, exceeds the linear residual.
6. After the full step, correct the surface unknowns for their own rows, with the body fixed
   (`_inexact`, `Multigrid.correct`).

The constants were chosen by measurements, whose tables are in `benchmarks/README.md`:

================================================  ================================================
constants                                         study
================================================  ================================================
aggregates, W-cycles, costs of set-up and         `settings_study.py`: 18 bodies, and 9 others
iterations (`hierarchy`)                          that were set aside until the end
forcing terms; test of the linear model from a    `settings_study.py`
reduction to 0.3; growth by 10 at most
(`_inexact`)
forcing terms in motion, polynomial instead of a  `motion_step.py`
hierarchy up to a condition number of 30
================================================  ================================================
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._inexact import Forcing
from dolfinx_contact._mpi import any_rank
from dolfinx_contact._petsc import destroy, has_package, logged, reasons_of
from dolfinx_contact.solvers.closed_points import ClosedPoints
from dolfinx_contact.solvers.hierarchy import PLAIN, SMOOTHED, Hierarchy
from dolfinx_contact.solvers.matrix_free import ContactOperator
from dolfinx_contact.solvers.newton import LinearSolver
from dolfinx_contact.solvers.surface_filter import SurfaceFilter

if TYPE_CHECKING:
    from dolfinx_contact.equations.contact import ContactEquations
    from dolfinx_contact.equations.evaluation import Evaluation
    from dolfinx_contact.solvers.attempts import Step

__all__ = ["Multigrid"]

logger = logging.getLogger(__name__)

#: Cost of a decimal digit of the residual with smoothed aggregates, in iterations with plain ones.
_SMOOTHED_PER_DIGIT = SMOOTHED.iteration * SMOOTHED.per_digit
_SOFT = 0.15  # softness of a body with Poisson's ratio 0.478
_SEEN = 0.3  # digits from which a solve indicates the iterations per digit
_NEGLIGIBLE = 0.01  # share of the residual on the surface below which it is not corrected


class Multigrid(LinearSolver):
    """Krylov solver of the Jacobian with all multipliers, preconditioned by `SurfaceFilter`.

    Operator (`matrix`) and preconditioner belong to the derivative of H with respect to x, so that
    bordered systems of the continuation can use them as leading blocks.

    Args:
        equations: contact problem.
    """

    name = "amg"
    corrects = True
    defaults: dict[str, Any] = {
        "ksp_type": "fgmres",
        "ksp_knoll": True,
        "ksp_gmres_restart": 60,
        "ksp_max_it": 200,
        # FGMRES cannot diverge, but its start, one application, may be inaccurate: with the body
        # fixed, the surface is nearly singular for large friction and nearly incompressible bodies.
        "ksp_divtol": 1e20,
    }

    def __init__(self, equations: ContactEquations):
        self._equations = equations
        self.comm = equations.comm
        prefix = equations.options.prefix
        with logged("ContactJacobian"):
            self.operator = ContactOperator(equations)
        self.matrix = self.operator.matrix
        self.filter = SurfaceFilter(self.operator, prefix)
        symmetric = equations.bulk.is_energy
        massive = equations.bulk.has_mass
        # In 2D smoothed aggregates are cheap, and plain ones fail for nearly incompressible bodies
        # (measured).
        smoothed = equations.dim == 2 or equations.scaling.softness < _SOFT
        self.hierarchy = Hierarchy(
            equations.V,
            prefix,
            symmetric=symmetric,
            massive=massive,
            interpolation=SMOOTHED if smoothed else PLAIN,
        )
        self.forcing = Forcing.in_motion() if massive else Forcing()
        self._correction = equations.unknowns.create_vector()  # step of the present Krylov iterate
        self._closed: ClosedPoints | None = None
        self._excess = 0.0  # iterations that a new hierarchy would have saved
        self._dearer = 0.0  # iterations that smoothed aggregates would have saved
        self._unused = True  # whether no solve has used the hierarchy
        self._changing = False  # whether many points changed their status in the last step
        self._measured = 0.0  # iterations per digit in the first solve with the hierarchy
        self._assemblies = 0  # assemblies of the stiffness when the hierarchy was built
        self._points = sum(s.points.number_everywhere for s in equations.surfaces)

    def attach(self, ksp: PETSc.KSP, remainder: Callable[[PETSc.Vec], float]) -> None:
        event = PETSc.Log.Event("ContactKrylov")
        start = 0.0

        def begin(ksp: PETSc.KSP, b: PETSc.Vec, x: PETSc.Vec) -> None:
            nonlocal start
            event.begin()
            start = b.norm()

        def end(ksp: PETSc.KSP, b: PETSc.Vec, x: PETSc.Vec) -> None:
            self.reduction = ksp.getTolerances()[0]
            if _knows_residual(ksp) and start > 0:
                self.reduction = ksp.getResidualNorm() / start
            event.end()

        def test(ksp: PETSc.KSP, iteration: int, norm: float) -> int:
            if not (start > 0 and _knows_residual(ksp)):
                return 0

            def left() -> float:
                return remainder(ksp.buildSolution(self._correction)) / start

            enough = self.forcing.suffices(norm / start, left)
            return int(PETSc.KSP.ConvergedReason.CONVERGED_ITS) if enough else 0

        ksp.setInitialGuessNonzero(False)
        ksp.setPreSolve(begin)
        ksp.setPostSolve(end)
        ksp.addConvergenceTest(test)
        pc = ksp.getPC()
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(SimpleNamespace(apply=lambda _pc, r, z: self.filter.apply(r, z)))

    # -- preconditioner of bordered systems ------------------------------------------------------

    @property
    def preconditioner(self) -> Multigrid:
        return self

    def apply(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Apply the preconditioner of the last `update` to ``r``; write to ``z``. Collective."""
        self.filter.apply(r, z)

    def apply_exact(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Solve the rows on the surface for its unknowns, with the body fixed. Collective."""
        s = self.filter.surface.local
        z.set(0.0)
        z.array[s] = self.filter.solve(r.array_r[s])

    def determinant_sign(self) -> float:
        """Return the sign of the preconditioner's determinant, up to a constant factor. Collective.

        The preconditioner eliminates the unknowns of the contact surface exactly. On the remaining
        unknowns it is a symmetric positive definite multigrid cycle, so that the surface block
        determines the sign.
        """
        assert self.filter.block is not None
        return self.filter.block.factor.determinant_sign

    def age(self, iterations: int, digits: float) -> None:
        """Record how many iterations a new hierarchy would have saved in a linear solve.

        A later step builds a new hierarchy if the total savings exceed its cost.

        Args:
            iterations: number of iterations of the solve.
            digits: decimal digits by which the solve has reduced the residual.
        """
        if self._unused and digits > _SEEN:
            # The iterations of a hierarchy built from a guess do not indicate those of the next.
            guessed = self.hierarchy.builds == 1 or self._closed is None or self._closed.guessed
            self._measured = 0.0 if guessed else iterations / digits
            self._unused = False
        self._excess += max(iterations - self._per_digit * digits, 0.0)
        self._dearer = max(self._dearer + iterations - _SMOOTHED_PER_DIGIT * digits, 0.0)

    @property
    def _per_digit(self) -> float:
        """Expected number of iterations per decimal digit of the residual with a new hierarchy.

        It is at least the number measured when the current hierarchy was new, because for nearly
        incompressible bodies every hierarchy needs many iterations.
        """
        return max(self.hierarchy.interpolation.per_digit, self._measured)

    # -- linear solver of Newton's method --------------------------------------------------------

    def update(self, evaluation: Evaluation) -> None:
        with logged("ContactJacobian"):
            self.operator.update(evaluation)
        self.filter.update()
        bulk = self._equations.bulk
        changed = bulk.linear and self._assemblies != bulk.assemblies
        now = self.hierarchy.interpolation
        dear = self._excess * now.iteration > now.set_up
        aged = dear and not self._changing and self._is_stale(evaluation)
        self._changing = False  # only for one step; continuation does not call `prepare`
        smooth = self._dearer > SMOOTHED.set_up and self._smooth()
        if self.hierarchy.pc is None or changed or aged or smooth:
            self.build(evaluation)

    def _smooth(self) -> bool:
        """Switch from plain to smoothed aggregates; return whether this was possible."""
        if not self.hierarchy.may_smooth:
            return False
        self.hierarchy.interpolation = SMOOTHED
        return True

    def build(self, evaluation: Evaluation) -> None:
        """Build the hierarchy for the closed points of an evaluation. Collective.

        Closed points are guessed for surfaces without any.
        """
        A = self.operator
        self._closed = ClosedPoints.of(self._equations, evaluation)
        fixed = np.union1d(A.fixed, np.flatnonzero(self._closed.fixed)).astype(np.int32)
        added = self._closed.springs(self._equations, A.stiffness, evaluation)
        products = self._equations.bulk.for_products
        half = products if products is not A.stiffness else None
        self.filter.cycle = self.hierarchy.build(A.stiffness, fixed, A.diagonal, added, half)
        self._assemblies = self._equations.bulk.assemblies
        self._excess = self._dearer = 0.0
        self._unused = True
        if self.comm.rank == 0:
            logger.info(
                "multigrid hierarchy %d built: %s", self.hierarchy.builds, self.hierarchy.kind
            )

    def prepare(
        self, ksp: PETSc.KSP, step: Step, target: float, evaluation: Evaluation, *, warm: bool
    ) -> None:
        if PETSc.Options().hasName((ksp.getOptionsPrefix() or "") + "ksp_rtol"):
            return
        if step.iteration == 0:
            self.forcing.restart(warm=warm)
        changed = step.flips / self._points if step.iteration > 0 else 1.0
        if step.iteration > 0:
            digits = -float(np.log10(max(self.reduction, 1e-16)))
            self.age(step.krylov, digits)
            # A hierarchy built while many points change would soon be outdated.
            self._changing = changed > self.forcing.many
            if not self._changing:
                self._rebuild_if_it_pays(step, digits, target, evaluation)
        ksp.setTolerances(rtol=self.forcing.tolerance(step.measures.worst, target, changed))

    def correct(self, evaluation: Evaluation, residual: PETSc.Vec, correction: PETSc.Vec) -> bool:
        if not self.filter.is_on_surface(residual, _NEGLIGIBLE):
            return False
        with logged("ContactJacobian"):
            self.operator.update_contact(evaluation)
        self.filter.update()
        self.apply_exact(residual, correction)
        return True

    def _rebuild_if_it_pays(
        self, step: Step, digits: float, target: float, evaluation: Evaluation
    ) -> None:
        """Build a new hierarchy if it is expected to save more than it costs. Collective.

        ``digits`` are the decimal digits by which the last linear solve has reduced the residual.
        """
        per_digit = step.krylov / max(digits, 1.0)
        left = max(np.log10(max(step.measures.worst, target) / target), 0.0) + 1
        now = self.hierarchy.interpolation
        smooth = (per_digit - _SMOOTHED_PER_DIGIT) * left > SMOOTHED.set_up and self._smooth()
        saved = (per_digit - self._per_digit) * left * now.iteration
        if smooth or (saved > now.set_up and self._is_stale(evaluation)):
            self.build(evaluation)

    def _is_stale(self, evaluation: Evaluation) -> bool:
        """Return whether a hierarchy built now would differ from the current one. Collective."""
        moved = ClosedPoints.of(self._equations, evaluation).differs(self._closed)
        other = self._assemblies != self._equations.bulk.assemblies
        return any_rank(self.comm, moved or other)

    def tighten(self) -> bool:
        return self.forcing.tighten()

    def retry(self, evaluation: Evaluation) -> bool:
        if not (self._smooth() or self._is_stale(evaluation)):
            return False
        self.build(evaluation)
        return True

    def explain(self, ksp: PETSc.KSP) -> str:
        prefix = self._equations.options.prefix
        other = f"another -{prefix}amg_pc_type (gamg, hypre), " if has_package("hypre") else ""
        return (
            f"the Krylov method stagnated after {ksp.getIterationNumber()} iterations "
            f"({reasons_of(ksp)}); try {other}"
            f"-{prefix}ksp_max_it, or -{prefix}linear_solver direct if memory allows"
        )

    def destroy(self) -> None:
        destroy(self.filter, self.hierarchy, self.operator, self._correction)


def _knows_residual(ksp: PETSc.KSP) -> bool:
    """Return whether a KSP provides the norm of the true residual, after its set-up."""
    return bool(ksp.getNormType() == PETSc.KSP.NormType.UNPRECONDITIONED)
