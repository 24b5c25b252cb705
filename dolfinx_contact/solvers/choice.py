# SPDX-License-Identifier: LGPL-3.0-or-later
"""Choice of the linear solver of Newton's method.

The option ``linear_solver`` is auto, direct (`linear.Direct`) or amg (`multigrid.Multigrid`). auto
chooses direct up to 10^5 unknowns in 2D and 5 10^3 in 3D, with rigid bodies, and if the user has
chosen a ``ksp_type`` or ``pc_type``; otherwise amg. If multigrid stagnates, the direct solver takes
over if the free memory suffices.
"""

from __future__ import annotations

import logging
from pathlib import Path

from mpi4py import MPI

import numpy as np

from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.solvers.linear import Direct, LinearSolver

__all__ = ["LinearSolverChoice"]

logger = logging.getLogger(__name__)

_KINDS = ("auto", "direct", "amg")
_MEMORY = Path("/proc/meminfo")
_LARGEST_DIRECT = {2: 100_000, 3: 5_000}
#: Factor and power of the number of unknowns that predict the gigabytes of MUMPS, by dimension;
#: measured with 9 10^3 and 7 10^4 unknowns in 2D, and with 4 10^3 and 10^4 in 3D.
_DIRECT_MEMORY = {2: (6.5e-7, 1.1), 3: (3.8e-7, 4 / 3)}


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
            return Direct(eq)
        from dolfinx_contact.solvers.multigrid import Multigrid  # for large problems only

        return Multigrid(eq)

    def direct_instead(self) -> bool:
        """Replace multigrid by the direct solver if the user chose neither and memory allows it."""
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
        self._leave()
        self._solver = Direct(eq)
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


def _gigabytes(size: int, dim: int) -> float:
    """Predict the memory of the direct solver for ``size`` unknowns, in 10^9 bytes."""
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
