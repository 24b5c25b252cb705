# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear solvers of Newton's method: their interface, and the direct solver.

`Direct` is any KSP and PC on the assembled Jacobian, by default MUMPS; the other solver is
`multigrid.Multigrid`. `choice` selects one of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

from dolfinx_contact._petsc import DEFAULTS, logged
from dolfinx_contact.equations.jacobian import Jacobian, JacobianSolver

if TYPE_CHECKING:
    from dolfinx_contact.equations.contact import ContactEquations
    from dolfinx_contact.equations.evaluation import Evaluation
    from dolfinx_contact.solvers.history import Step

__all__ = ["Direct", "LinearSolver", "reason_name", "reasons_of"]

_INACCURATE = 1e-2  # relative residual from which a linear solve counts as failed


class LinearSolver(JacobianSolver):
    """Interface of the linear solvers of Newton's method.

    Attributes:
        name: ``direct`` or ``amg``.
        defaults: PETSc options of the KSP.
        reduction: reduction of the residual by the last solve; 0 if unknown.
        is_iterative: whether the user's options choose an iterative method.
    """

    name: str
    reduction = 0.0
    is_iterative = False
    defaults: dict[str, Any]

    def attach(self, ksp: PETSc.KSP, remainder: Callable[[PETSc.Vec], float]) -> None:
        """Prepare a KSP before it reads its options.

        Args:
            ksp: linear solver of SNES.
            remainder: function of a correction returning the norm of H after it, in the rows of
                the contact conditions; collective.
        """

    def prepare(
        self, ksp: PETSc.KSP, step: Step, target: float, state: Evaluation, *, warm: bool
    ) -> None:
        """Set tolerances and preconditioner for the step from an iterate. Collective.

        Args:
            ksp: linear solver of SNES.
            step: iterate.
            target: relative residual at which Newton's method ends.
            state: evaluation at the iterate.
            warm: whether Newton's method began from a state in contact.
        """

    def retry(self, ksp: PETSc.KSP, state: Evaluation) -> bool:
        """Return whether another preconditioner is available after a failed solve. Collective."""
        return False

    def explain(self, ksp: PETSc.KSP) -> str:
        """Return the reason of a failed linear solve as text. Collective."""
        raise NotImplementedError

    def inaccuracy(self, ksp: PETSc.KSP) -> str:
        """Return a message about an inaccurate solve that PETSc accepted, or "". Collective."""
        return ""

    def tighten(self) -> bool:
        """Tighten the tolerances, and return whether this was possible; statuses may cycle."""
        return False

    def destroy(self) -> None:
        """Free the PETSc objects."""


class Direct(LinearSolver):
    """A KSP on the assembled Jacobian, by default MUMPS."""

    name = "direct"
    defaults = DEFAULTS

    def __init__(self, equations: ContactEquations):
        self._equations = equations
        self._jacobian = Jacobian(equations)
        self.matrix = self._jacobian.matrix
        self._residual = 0.0  # relative residual of the last solve
        self.is_iterative = (equations.options.value("pc_type") or "lu") not in ("lu", "cholesky")
        if self.is_iterative:
            factor = ("pc_factor_mat_solver_type", "mat_mumps_icntl_14")
            self.defaults = {k: v for k, v in Direct.defaults.items() if k not in factor}

    def attach(self, ksp: PETSc.KSP, remainder: Callable[[PETSc.Vec], float]) -> None:
        ksp.setPostSolve(self._measure)

    def _measure(self, ksp: PETSc.KSP, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Compute the true residual; a KSP tests that of its preconditioned system."""
        r = b.duplicate()
        self.matrix.mult(x, r)
        r.axpy(-1.0, b)
        self._residual = r.norm() / (b.norm() or 1.0)
        r.destroy()

    def update(self, state: Evaluation) -> None:
        with logged("ContactJacobian"):
            self._jacobian.update(state)
        self.matrix = self._jacobian.matrix  # a new one if its pattern has changed

    def destroy(self) -> None:
        self._jacobian.destroy()

    def explain(self, ksp: PETSc.KSP) -> str:
        reasons = reasons_of(ksp)
        if ksp.getConvergedReason() == PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT:
            number = ksp.getIterationNumber()
            return f"the linear solver did not converge in {number} iterations ({reasons})"
        if ksp.getConvergedReason() != PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED:
            return f"the linear solver failed ({reasons})"
        return (
            f"the linear solver failed ({reasons}): a singular matrix, by an unheld part of the "
            "mesh, a zero stiffness, or contact conditions that contradict Dirichlet data; or "
            "a solver that does not cope with this matrix"
        )

    def inaccuracy(self, ksp: PETSc.KSP) -> str:
        if self._residual <= _INACCURATE:
            return ""
        return (
            f"the linear solver did not solve: its relative residual is {self._residual:.1e} "
            f"({reasons_of(ksp)})"
        )


def reasons_of(ksp: PETSc.KSP) -> str:
    """Return the reasons of KSP, PC and MUMPS in PETSc's names. Collective."""
    comm = ksp.comm.tompi4py()
    pc = ksp.getPC()
    words = [f"{ksp.getType()} with {pc.getType()}"]
    words.append(f"KSP {reason_name(PETSc.KSP.ConvergedReason, ksp.getConvergedReason())}")
    failed = max(comm.allgather(int(pc.getFailedReason())), key=abs)
    if failed != PETSc.PC.FailedReason.NOERROR:
        words.append(f"PC {reason_name(PETSc.PC.FailedReason, failed)}")
    if pc.getType() in ("lu", "cholesky"):
        words.append(str(pc.getFactorSolverType()))
        if pc.getFactorSolverType() == "mumps":
            info = [pc.getFactorMatrix().getMumpsInfog(i) for i in (1, 2)]
            if info[0] != 0:
                words[-1] += f" INFOG(1:2) = {info[0]}, {info[1]}"
    return ", ".join(words)


def reason_name(reasons: Any, value: int) -> str:
    """Return PETSc's name of a reason."""
    names = [k for k, v in vars(reasons).items() if v == value and not k.startswith("_")]
    return max(names, key=len, default=str(value))
