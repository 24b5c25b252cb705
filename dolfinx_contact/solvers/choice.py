# SPDX-License-Identifier: LGPL-3.0-or-later
"""Choice of the linear solver.

The option ``linear_solver`` is auto, direct or amg. direct is any KSP and PC on the assembled
Jacobian, by default MUMPS; amg is `multigrid.Multigrid`. auto chooses direct up to 10^5 unknowns in
2D and 5 10^3 in 3D, with rigid bodies, and if the user has chosen a ``ksp_type`` or ``pc_type``;
otherwise amg. If multigrid stagnates, the direct solver takes over if the free memory suffices.
"""

from __future__ import annotations

import logging
from pathlib import Path

from mpi4py import MPI

import numpy as np

from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.solvers.linear import Direct, LinearSolver

__all__ = ["LinearSolverChoice", "predicted_gigabytes"]

logger = logging.getLogger(__name__)

_KINDS = ("auto", "direct", "amg")
_MEMORY = Path("/proc/meminfo")
_LARGEST_DIRECT = {2: 100_000, 3: 5_000}

#: Factor and power of the number of unknowns that predict the gigabytes of MUMPS, by dimension;
#: measured with 9 10^3 and 7 10^4 unknowns in 2D, and with 4 10^3 and 10^4 in 3D.
_DIRECT_MEMORY = {2: (6.5e-7, 1.1), 3: (3.8e-7, 4 / 3)}
_AMG_MEMORY = 4.2e-6  # gigabytes per unknown, measured at 10^6 and 5 10^6 unknowns in 3D


class LinearSolverChoice:
    """Linear solver of a problem, created when it is first needed. Collective.

    It is created again if options other than those of SNES have changed. The previous one is freed
    unless a branch is followed with it.

    Args:
        equations: contact problem.
    """

    def __init__(self, equations: ContactEquations):
        self._equations = equations
        self._solver: LinearSolver | None = None
        self._options: dict[str, str] = {}

    def __call__(self) -> LinearSolver:
        """Return the solver; ``ValueError`` for an unknown kind."""
        options = self._equations.options.beside_newton()
        if self._equations.comm.allreduce(int(options != self._options)):
            self._leave()
            self._options = options
        if self._solver is None:
            self._solver = self._create()
        return self._solver

    def replace(self, solver: LinearSolver) -> None:
        """Use another solver from now on."""
        self._leave()
        self._solver = solver

    def _create(self) -> LinearSolver:
        eq = self._equations
        size = sum(eq.global_sizes)
        dim = eq.dim
        kind = eq.options.value("linear_solver") or "auto"
        if kind not in _KINDS:
            raise ValueError(f"unknown linear solver {kind!r}; known: {', '.join(_KINDS)}")
        bodies = [body.name for body in eq.rigid.bodies]
        if kind == "amg" and bodies:
            raise ValueError(f"{bodies[0]}: with rigid bodies there is no multigrid, only direct")
        if kind == "auto":
            chosen = any(eq.options.value(name) for name in ("ksp_type", "pc_type"))
            small = size <= _LARGEST_DIRECT[dim]
            kind = "direct" if bodies or chosen or small else "amg"
        solver: LinearSolver = Direct(eq) if kind == "direct" else _multigrid(eq)
        seconds = solver.predicted = solver.predicted_seconds()
        if eq.comm.rank == 0:
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

    def direct_instead(self) -> bool:
        """Replace multigrid by the direct solver if the user chose neither and memory allows it."""
        eq = self._equations
        given = (eq.options.value("linear_solver") or "auto") != "auto"
        if given or self().name == "direct":
            return False
        needed = predicted_gigabytes("direct", sum(eq.global_sizes), eq.dim)
        free = available_gigabytes(eq.comm)
        root = eq.comm.rank == 0
        if needed > free:
            if root:
                words = "a direct solver needs about %.2g GB, of which %.2g are free"
                logger.warning(words, needed, free)
            return False
        if root:
            logger.warning("the direct solver takes over: about %.2g GB", needed)
        self.replace(Direct(eq))
        return True

    def _leave(self) -> None:
        """Free the solver unless a branch is followed with it."""
        if self._solver is not None and self._solver.is_followed_with:
            self._solver = None
        self.destroy()

    def destroy(self) -> None:
        """Free the solver."""
        if self._solver is not None:
            self._solver.destroy()
        self._solver = None


def _multigrid(eq: ContactEquations) -> LinearSolver:
    """Create multigrid, whose module only large problems load."""
    from dolfinx_contact.solvers.multigrid import Multigrid

    return Multigrid(eq)


def available_gigabytes(comm: MPI.Comm) -> float:
    """Return the free memory of all hosts in 10^9 bytes; inf if unknown. Collective."""
    host = comm.Split_type(MPI.COMM_TYPE_SHARED)
    mine = 0.0
    if host.rank == 0:
        lines = _MEMORY.read_text().splitlines() if _MEMORY.exists() else []
        found = [int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
        mine = 1024e-9 * found[0] if found else np.inf
    host.Free()
    return float(comm.allreduce(mine))


def predicted_gigabytes(kind: str, size: int, dim: int) -> float:
    """Predict the memory of a linear solver for ``size`` unknowns, in 10^9 bytes."""
    if kind == "direct":
        factor, power = _DIRECT_MEMORY[dim]
        return float(factor * size**power)
    return _AMG_MEMORY * size
