# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which solver takes the linear systems of Newton's method: by size, or as the user says.

``<prefix>linear_solver`` is ``auto`` (default), ``direct`` or ``amg``. Direct is any KSP and PC on
the assembled Jacobian, by default MUMPS; amg is `multigrid.Multigrid`. Automatically, problems up
to 10^5 unknowns in 2D and 5 10^3 in 3D are solved directly, and so are those for which the user
has chosen a ``ksp_type`` or ``pc_type``. Where multigrid stagnates the direct solver takes over, if
the memory that is free suffices.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact._petsc import logged

if TYPE_CHECKING:
    from dolfinx_contact.continuation import Preconditioner
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.solvers.history import Step

__all__ = ["Direct", "LinearSolver", "create_linear_solver", "predicted_gigabytes"]

logger = logging.getLogger(__name__)

_KINDS = ("auto", "direct", "amg")
_MEMORY = Path("/proc/meminfo")
_LARGEST_DIRECT = {2: 100_000, 3: 5_000}

#: Factor and power of the number of unknowns, by dimension, that give the gigabytes of MUMPS:
#: measured at 9 10^3 and 7 10^4 unknowns in 2D and at 4 10^3 and 10^4 in 3D.
_DIRECT_MEMORY = {2: (6.5e-7, 1.1), 3: (3.8e-7, 4 / 3)}
_AMG_MEMORY = 5.3e-6  # gigabytes per unknown, measured at 10^6 and 3 10^6 unknowns in 3D

#: Factor and power of the number of unknowns, by dimension, that give the seconds of a Newton step
#: with MUMPS on one core: measured on an idle machine, per step of cold solves, with 3 10^3 to 10^5
#: unknowns in 2D and 2 10^3 to 3.3 10^4 in 3D. Assembly of a bulk that is not linear comes on top.
_DIRECT_SECONDS = {2: (3.5e-7, 1.19), 3: (2.5e-7, 1.47)}
_NEWTON_STEPS = 9  # of a cold solve

#: Products with the stiffness that take as long as a cold solve by multigrid, but for the contact
#: surface: measured 430 to 1000 in 2D, 350 to 600 in 3D, P1 and P2, on one rank and two.
_PRODUCTS = {2: 900, 3: 550}
#: Factor and power of the number of contact points that give what the surface adds, in products
#: over the number of unknowns: measured with 2 10^3 and 6 10^3 contact points in 3D.
_SURFACE = (640.0, 1.37)
_TRIES = 3  # products that are timed
_DOUBTFUL = 1e-2  # relative residual of a linear solve beyond which it leads nowhere


class LinearSolver:
    """What Newton's method asks of a linear solver.

    Attributes:
        name: ``direct`` or ``amg``.
        matrix: the Jacobian, for SNES.
        defaults: PETSc options of the KSP.
        corrects: whether `correct` may do anything.
        predicted: seconds of a cold solve, if it was predicted.
    """

    name: str
    corrects = False
    predicted = np.inf
    matrix: PETSc.Mat
    defaults: dict[str, Any]

    @property
    def preconditioner(self) -> Preconditioner | None:
        """For systems that contain the Jacobian; None where it is to be factorised."""
        return None

    def attach(self, ksp: PETSc.KSP) -> None:
        """Prepare a KSP, before it reads its options."""

    def update(self) -> None:
        """Assemble the Jacobian at the Functions and the status as they are. Collective."""
        raise NotImplementedError

    def predicted_seconds(self) -> float:
        """What a cold solve may take, from measured runs. Collective."""
        raise NotImplementedError

    def prepare(self, ksp: PETSc.KSP, step: Step, target: float, *, warm: bool) -> None:
        """See to tolerances and preconditioner for the step from the iterate ``step``. Collective.

        Args:
            ksp: to prepare.
            step: the iterate.
            target: relative residual at which Newton's method ends.
            warm: whether it began from a state in contact.
        """

    def correct(self, residual: PETSc.Vec, correction: PETSc.Vec) -> bool:
        """What to subtract to solve the rows of the contact surface for its unknowns. Collective.

        Args:
            residual: at the Functions and the status as they are.
            correction: receives the solution, zero off the surface.

        Returns:
            Whether there is anything to correct, and a solver for it.
        """
        return False

    def retry(self, ksp: PETSc.KSP) -> bool:
        """Whether there is something better to try after a linear solve that failed. Collective."""
        return False

    def explain(self, ksp: PETSc.KSP) -> str:
        """A failed linear solve in words. Collective."""
        raise NotImplementedError

    def doubt(self, ksp: PETSc.KSP) -> str:
        """What is wrong with a solve that PETSc takes for a success; "" if nothing. Collective."""
        return ""

    def tighten(self) -> bool:
        """Solve more exactly, if that has not been tried: statuses may cycle for want of it."""
        return False

    def destroy(self) -> None:
        """Free the PETSc objects."""


class Direct(LinearSolver):
    """A KSP on the assembled Jacobian, by default MUMPS."""

    name = "direct"
    defaults = {
        "ksp_type": "preonly",
        "pc_type": "lu",
        "pc_factor_mat_solver_type": "mumps",
        "mat_mumps_icntl_14": 80,
    }

    def __init__(self, problem: ContactProblem):
        self._problem, self.matrix = problem, problem.matrix
        self._residual = 0.0  # of the last solve, over its right-hand side
        if (_option(problem, "pc_type") or "lu") not in ("lu", "cholesky"):
            factor = ("pc_factor_mat_solver_type", "mat_mumps_icntl_14")
            self.defaults = {k: v for k, v in Direct.defaults.items() if k not in factor}

    def attach(self, ksp: PETSc.KSP) -> None:
        ksp.setPostSolve(self._measure)

    def _measure(self, ksp: PETSc.KSP, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Take the true residual: what a KSP looks at is that of its preconditioned system."""
        r = b.duplicate()
        self.matrix.mult(x, r)
        r.axpy(-1.0, b)
        self._residual = r.norm() / (b.norm() or 1.0)
        r.destroy()

    def update(self) -> None:
        with logged("ContactJacobian"):
            self._problem.assemble_jacobian(self.matrix)

    def predicted_seconds(self) -> float:
        problem = self._problem
        factor, power = _DIRECT_SECONDS[problem.V.mesh.geometry.dim]
        steps = _NEWTON_STEPS * factor * sum(problem.global_sizes) ** power
        return float(steps + _seconds_of_assembly(problem))

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

    def doubt(self, ksp: PETSc.KSP) -> str:
        if self._residual <= _DOUBTFUL:
            return ""
        return (
            f"the linear solver did not solve: its relative residual is {self._residual:.1e} "
            f"({reasons_of(ksp)})"
        )


def create_linear_solver(problem: ContactProblem) -> LinearSolver:
    """The linear solver that options or size ask for. Collective.

    Raises:
        ValueError: for an unknown kind.
    """
    from dolfinx_contact.solvers.multigrid import Multigrid

    solver: LinearSolver
    size, dim = sum(problem.global_sizes), problem.V.mesh.geometry.dim
    kind = _option(problem, "linear_solver") or "auto"
    if kind not in _KINDS:
        raise ValueError(f"unknown linear solver {kind!r}; known: {', '.join(_KINDS)}")
    if kind == "auto":
        chosen = any(_option(problem, name) for name in ("ksp_type", "pc_type"))
        kind = "direct" if chosen or size <= _LARGEST_DIRECT[dim] else "amg"
    solver = Direct(problem) if kind == "direct" else Multigrid(problem)
    seconds = solver.predicted = solver.predicted_seconds()
    if problem.comm.rank == 0:
        logger.info(
            "%d unknowns, linear solver %s: about %.2g s from a cold start and %.2g GB on all "
            "ranks (direct: %.2g GB)",
            size,
            kind,
            seconds,
            predicted_gigabytes(kind, size, dim),
            predicted_gigabytes("direct", size, dim),
        )
    return solver


def reasons_of(ksp: PETSc.KSP) -> str:
    """Why a KSP ended, in PETSc's names: its own reason, its PC's, and MUMPS'. Collective."""
    comm, pc = ksp.comm.tompi4py(), ksp.getPC()
    words = [f"{ksp.getType()} with {pc.getType()}"]
    words.append(f"KSP {_name(PETSc.KSP.ConvergedReason, ksp.getConvergedReason())}")
    failed = max(comm.allgather(int(pc.getFailedReason())), key=abs)
    if failed != PETSc.PC.FailedReason.NOERROR:
        words.append(f"PC {_name(PETSc.PC.FailedReason, failed)}")
    if pc.getType() in ("lu", "cholesky"):
        words.append(str(pc.getFactorSolverType()))
        if pc.getFactorSolverType() == "mumps":
            info = [pc.getFactorMatrix().getMumpsInfog(i) for i in (1, 2)]
            if info[0] != 0:
                words[-1] += f" INFOG(1:2) = {info[0]}, {info[1]}"
    return ", ".join(words)


def _name(reasons: Any, value: int) -> str:
    names = [k for k, v in vars(reasons).items() if v == value and not k.startswith("_")]
    return max(names, key=len, default=str(value))


def direct_instead(problem: ContactProblem) -> bool:
    """Let the direct solver take over from multigrid, if that was no wish and memory allows.

    Collective.
    """
    asked = (_option(problem, "linear_solver") or "auto") != "auto"
    if asked or problem.linear_solver.name == "direct":
        return False
    size, dim = sum(problem.global_sizes), problem.V.mesh.geometry.dim
    needed, free = predicted_gigabytes("direct", size, dim), available_gigabytes(problem.comm)
    root = problem.comm.rank == 0
    if needed > free:
        if root:
            words = "a direct solver needs about %.2g GB, of which %.2g are free"
            logger.warning(words, needed, free)
        return False
    if root:
        logger.warning("the direct solver takes over: about %.2g GB", needed)
    problem.linear_solver = Direct(problem)
    return True


def available_gigabytes(comm: MPI.Comm) -> float:
    """Memory that is free on all hosts, 10^9 bytes; inf if they do not say. Collective."""
    host = comm.Split_type(MPI.COMM_TYPE_SHARED)
    mine = 0.0
    if host.rank == 0:
        lines = _MEMORY.read_text().splitlines() if _MEMORY.exists() else []
        found = [int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
        mine = 1024e-9 * found[0] if found else np.inf
    host.Free()
    return float(comm.allreduce(mine))


def seconds_of_multigrid(problem: ContactProblem) -> float:
    """What a cold solve by multigrid may take, from the time of a product. Collective."""
    dim = problem.V.mesh.geometry.dim
    points = sum(s.points.dofmap.index_map.size_global for s in problem.surfaces)
    factor, power = _SURFACE
    surface = factor * points**power / sum(problem.global_sizes) if dim == 3 else 0.0
    product = problem.comm.allreduce(problem.bulk.seconds[1], op=max)
    return float((_PRODUCTS[dim] + surface) * product + _seconds_of_assembly(problem))


def _seconds_of_assembly(problem: ContactProblem) -> float:
    """What assembling a stiffness that changes takes in a cold solve. Collective."""
    once = problem.comm.allreduce(problem.bulk.seconds[0], op=max)
    return 0.0 if problem.bulk.linear else float(_NEWTON_STEPS * once)


def predicted_gigabytes(kind: str, size: int, dim: int) -> float:
    """Memory of a linear solver for ``size`` unknowns, from measured runs, in 10^9 bytes."""
    if kind == "direct":
        factor, power = _DIRECT_MEMORY[dim]
        return float(factor * size**power)
    return _AMG_MEMORY * size


def _option(problem: ContactProblem, name: str) -> str | None:
    """An option of the problem: from the database, else from its own dictionary."""
    database = PETSc.Options()
    if database.hasName(problem.prefix + name):
        return str(database.getString(problem.prefix + name))
    value = problem.petsc_options.get(name)
    return None if value is None else str(value)
