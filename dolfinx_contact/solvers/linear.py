# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear solvers of Newton's method: the direct solver, and the choice between it and multigrid.

The solver ``direct`` (`AssembledSolver`) is any KSP and PC on the assembled Jacobian, by default
the LU factorisation of MUMPS. The solver ``amg`` is `multigrid.Multigrid`. The option
``linear_solver`` is ``auto`` (default), ``direct`` or ``amg``. ``auto`` chooses the direct solver
for up to 10^5 unknowns in 2D or 5 10^3 in 3D, for rigid bodies, and if the user sets ``ksp_type``
or ``pc_type``; otherwise it chooses multigrid. If this stagnates, the direct solver is used
instead, provided that the free memory suffices.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact._mpi import any_rank
from dolfinx_contact._petsc import DEFAULTS, reasons_of
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.jacobian import Jacobian
from dolfinx_contact.solvers.newton import LinearSolver

__all__ = ["AssembledSolver", "LinearSolverChoice"]

logger = logging.getLogger(__name__)

_INACCURATE = 1e-2  # relative residual from which a linear solve counts as failed
_KINDS = ("auto", "direct", "amg")
_MEMORY = Path("/proc/meminfo")
_LARGEST_DIRECT = {2: 100_000, 3: 5_000}
#: Factor and power of the number of unknowns that predict the gigabytes of MUMPS, by dimension;
#: measured with 9 10^3 and 7 10^4 unknowns in 2D, and with 4 10^3 and 10^4 in 3D.
_DIRECT_MEMORY = {2: (6.5e-7, 1.1), 3: (3.8e-7, 4 / 3)}


class AssembledSolver(Jacobian, LinearSolver):
    """Linear solver of Newton's method on the assembled Jacobian, by default MUMPS.

    Args:
        equations: contact problem.
    """

    matrix: PETSc.Mat
    name = "direct"
    defaults = DEFAULTS

    def __init__(self, equations: ContactEquations):
        super().__init__(equations)
        self._residual = 0.0  # relative residual of the last solve
        pc = equations.options.value("pc_type") or "lu"
        self.iterates_on_request = pc not in ("lu", "cholesky")
        if self.iterates_on_request:
            factor = ("pc_factor_mat_solver_type", "mat_mumps_icntl_14")
            self.defaults = {k: v for k, v in DEFAULTS.items() if k not in factor}

    def attach(self, ksp: PETSc.KSP, remainder: Callable[[PETSc.Vec], float]) -> None:
        ksp.setPostSolve(self._measure)

    def _measure(self, ksp: PETSc.KSP, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Compute the true relative residual; the KSP monitors only the preconditioned one."""
        r = b.duplicate()
        self.matrix.mult(x, r)
        r.axpy(-1.0, b)
        self._residual = r.norm() / (b.norm() or 1.0)
        r.destroy()

    def explain(self, ksp: PETSc.KSP) -> str:
        reasons = reasons_of(ksp)
        if ksp.getConvergedReason() == PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT:
            number = ksp.getIterationNumber()
            return f"the linear solver did not converge in {number} iterations ({reasons})"
        if ksp.getConvergedReason() != PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED:
            return f"the linear solver failed ({reasons})"
        return (
            f"the linear solver failed ({reasons}): the matrix is singular (a part of the mesh "
            "without support, a zero stiffness, or contact conditions that contradict Dirichlet "
            "data), or the solver is not suitable for it"
        )

    def inaccuracy(self, ksp: PETSc.KSP) -> str:
        if self._residual <= _INACCURATE:
            return ""
        return (
            f"the linear solve is inaccurate: its relative residual is {self._residual:.1e} "
            f"({reasons_of(ksp)})"
        )


class LinearSolverChoice:
    """Linear solver of a problem, created when it is first needed. Methods are collective.

    The solver is created again if PETSc options other than those of SNES have changed. The previous
    solver is then released; a branch that is being traced with it keeps it until the branch ends.

    Args:
        equations: contact problem.
    """

    def __init__(self, equations: ContactEquations):
        self._equations = equations
        self._solver: LinearSolver | None = None
        self._options: dict[str, str] = {}

    def __call__(self) -> LinearSolver:
        """Return the linear solver, creating it if necessary.

        Raises:
            ValueError: for an unknown value of the option ``linear_solver``, or multigrid with
                rigid bodies.
        """
        options = self._equations.options.beside_newton()
        if any_rank(self._equations.comm, options != self._options):
            self.release()
            self._options = options
        if self._solver is None:
            self._solver = self._create()
        return self._solver

    def _create(self) -> LinearSolver:
        eq = self._equations
        size = sum(eq.unknowns.global_sizes)
        kind = eq.options.value("linear_solver") or "auto"
        if kind not in _KINDS:
            raise ValueError(f"unknown linear solver {kind!r}; known: {', '.join(_KINDS)}")
        bodies = eq.rigid.bodies
        if kind == "amg" and bodies:
            raise ValueError(
                f"{bodies[0].name}: problems with rigid bodies require linear_solver='direct'; "
                f"got {kind!r}"
            )
        if kind == "auto":
            chosen = eq.options.value("ksp_type") or eq.options.value("pc_type")
            small = size <= _LARGEST_DIRECT[eq.dim]
            kind = "direct" if bodies or chosen or small else "amg"
        if eq.comm.rank == 0:
            words = "%d unknowns, linear solver %s (the direct one takes about %.2g GB)"
            logger.info(words, size, kind, _gigabytes(size, eq.dim))
        if kind == "direct":
            return AssembledSolver(eq)
        from dolfinx_contact.solvers.multigrid import Multigrid  # for large problems only

        return Multigrid(eq)

    def fall_back_to_direct(self) -> bool:
        """Replace multigrid, if chosen by ``auto``, by the direct solver if the memory suffices.

        Returns:
            Whether it was replaced.
        """
        eq = self._equations
        given = (eq.options.value("linear_solver") or "auto") != "auto"
        if given or self().name == "direct":
            return False
        needed = _gigabytes(sum(eq.unknowns.global_sizes), eq.dim)
        free = _free_gigabytes(eq.comm)
        if eq.comm.rank == 0:
            log = logger.warning if needed > free else logger.info
            log("a direct solver needs about %.2g GB; %.2g GB are free", needed, free)
        if needed > free:
            return False
        self.release()
        self._solver = AssembledSolver(eq)
        return True

    def release(self) -> None:
        """Release the solver; the next call of this object creates a new one."""
        if self._solver is not None:
            self._solver.release()
        self._solver = None


def _gigabytes(size: int, dim: int) -> float:
    """Return the predicted memory of the direct solver for ``size`` unknowns, in 10^9 bytes."""
    factor, power = _DIRECT_MEMORY[dim]
    return float(factor * size**power)


def _free_gigabytes(comm: MPI.Comm) -> float:
    """Return the free memory of all hosts in 10^9 bytes; inf if unknown. Collective."""
    host = comm.Split_type(MPI.COMM_TYPE_SHARED)
    mine = 0.0
    if host.rank == 0:
        lines = _MEMORY.read_text().splitlines() if _MEMORY.exists() else []
        found = [int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
        mine = 1024e-9 * found[0] if found else np.inf
    host.Free()
    return float(comm.allreduce(mine))
