# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Vectors y = (x, gamma), and linear systems with the bordered matrix.

    J = [ H_x  H_gamma ]
        [ w^T  w_gamma ]

x is distributed as in the system; gamma is the last entry, on the last rank.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import AbstractContextManager
from typing import Any, Protocol

from petsc4py import PETSc

from dolfinx_contact._petsc import options_in_database
from dolfinx_contact.continuation.system import Piece, System

__all__ = ["BorderedSolver", "Enough", "Layout"]


class Layout:
    """Creates vectors y and splits them.

    Args:
        system: system that x belongs to.

    Attributes:
        local: number of entries of x on this rank.
        size: number of entries of x on all ranks.
        last: whether gamma is stored on this rank.
    """

    def __init__(self, system: System):
        self.system = system
        self.comm = system.comm
        self.last = self.comm.rank == self.comm.size - 1
        self.x = system.create_vector()
        self.local, self.size = self.x.getLocalSize(), self.x.getSize()

    def vector(self) -> PETSc.Vec:
        """Create a vector y."""
        return PETSc.Vec().createMPI((self.local + int(self.last), self.size + 1), comm=self.comm)

    def gamma(self, y: PETSc.Vec) -> float:
        """Return gamma of ``y`` on every rank."""
        gamma = float(y.array_r[-1]) if self.last else 0.0
        return float(self.comm.bcast(gamma, root=self.comm.size - 1))

    def split(self, y: PETSc.Vec) -> tuple[PETSc.Vec, float]:
        """Return x and gamma of ``y``; x is a work vector that the next call overwrites."""
        self.x.array[:] = y.array_r[: self.local]
        return self.x, self.gamma(y)

    def join(self, x: PETSc.Vec, gamma: float, y: PETSc.Vec) -> None:
        """Write x and gamma into ``y``."""
        y.array[: self.local] = x.array_r
        if self.last:
            y.array[-1] = gamma

    def joined(self, x: PETSc.Vec, gamma: float) -> PETSc.Vec:
        """Create a vector y with the values of x and gamma."""
        y = self.vector()
        self.join(x, gamma, y)
        return y

    def last_unit(self) -> PETSc.Vec:
        """Create the vector (0, 1), the right-hand side of tangents."""
        e = self.vector()
        e.set(0.0)
        if self.last:
            e.array[-1] = 1.0
        return e


class Enough(Protocol):
    """Test that may end an iterative solve early. Collective."""

    def is_due(self, reduction: float) -> bool:
        """Return True if the test is due at this relative residual."""

    def __call__(self, reduction: float, size: float, solution: PETSc.Vec) -> bool:
        """Return True if the solution suffices.

        Args:
            reduction: residual, relative to ``size``.
            size: norm of the right-hand side in the rows of H.
            solution: iterate.
        """


class BorderedSolver(ABC):
    """Solves linear systems with J.

    Attributes:
        defaults: default PETSc options.
        precision: relative error of solutions.
        many_sides: whether every further right-hand side is cheap. Otherwise solves are iterative,
            and their cost grows with the accuracy.
        corrects: whether to call `System.correct`, because a correction is cheaper than a step.
        matrix: J, for SNES.
        factorisations: number of factorised matrices.
        solves: number of applications of an inverse or of the preconditioner.
    """

    defaults: dict[str, Any]
    precision: float
    many_sides: bool
    corrects: bool
    matrix: PETSc.Mat

    def __init__(self, layout: Layout, prefix: str):
        self.layout = layout
        self.comm = layout.comm
        self.prefix = prefix
        self.factorisations = self.solves = 0

    @property
    def system(self) -> System:
        """System whose derivatives are in J."""
        return self.layout.system

    def options(self) -> AbstractContextManager[None]:
        """Options of the solver; MUMPS reads them at every set-up."""
        return options_in_database(self.prefix, self.defaults)

    @abstractmethod
    def assemble(
        self, y: PETSc.Vec, row: PETSc.Vec, piece: Piece | None, *, along: PETSc.Vec | None = None
    ) -> None:
        """Use J at ``y`` from now on. Collective.

        Args:
            y: state.
            row: last row (w, w_gamma), a dual vector.
            piece: piece on which H is linearised.
            along: approximate direction of the branch at ``y``; default: unknown.
        """

    @abstractmethod
    def factorise(self) -> bool:
        """Prepare for solves; False if J is singular. Collective."""

    @abstractmethod
    def solve(
        self,
        rhs: PETSc.Vec,
        out: PETSc.Vec,
        *,
        rtol: float = 0.0,
        near: PETSc.Vec | None = None,
        enough: Enough | None = None,
    ) -> bool:
        """Solve with J; False if that fails. The options concern iterative solves. Collective.

        Args:
            rhs: right-hand side.
            out: receives the solution.
            rtol: sufficient relative residual.
            near: initial guess.
            enough: test that may end the solve earlier.
        """

    @abstractmethod
    def probe(self, rhs: PETSc.Vec, out: PETSc.Vec) -> bool:
        """Solve with a right-hand side that has components along all eigenvectors. Collective.

        An iterative solver also determines the sign of det J from this solve.
        """

    @abstractmethod
    def determinant_sign(self) -> float:
        """Return the sign of det J up to a constant factor; 0 if J is singular. Collective."""

    @abstractmethod
    def destroy(self) -> None:
        """Free the PETSc objects."""
