# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the continuation requires of a linear solver for the bordered matrix J."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import AbstractContextManager
from typing import Any, Protocol

from petsc4py import PETSc

from dolfinx_contact._petsc import options_in_database
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.continuation.system import Piece, System

__all__ = ["BorderedSolver", "Enough"]


class Enough(Protocol):
    """Whether a solution on the way to an exact one is good enough. Collective."""

    def is_due(self, reduction: float) -> bool:
        """Whether to ask where the residual has been reduced to a part of the right-hand side."""

    def __call__(self, reduction: float, size: float, solution: PETSc.Vec) -> bool:
        """Whether it is, the right-hand side of H having the norm ``size``."""


class BorderedSolver(ABC):
    """Solves with J = [H_x H_gamma; w^T w_gamma].

    Attributes:
        defaults: PETSc options where the database has no others.
        precision: relative error that solutions may have.
        many_sides: whether one set-up makes every further right-hand side cheap.
        corrects: whether `System.correct` pays: a correction costs less than a step.
        matrix: J, for SNES.
        factorisations, solves: matrices factorised and applications of their inverse so far, or of
            the preconditioner.
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
        """The system whose derivatives are in J."""
        return self.layout.system

    def options(self) -> AbstractContextManager[None]:
        """The options of the solver; MUMPS reads its own at every set-up."""
        return options_in_database(self.prefix, self.defaults)

    @abstractmethod
    def assemble(
        self, y: PETSc.Vec, row: PETSc.Vec, piece: Piece | None, *, along: PETSc.Vec | None = None
    ) -> None:
        """Take J at ``y`` with the dual vector ``row`` as its last row. Collective.

        Args:
            y: where.
            row: the last row.
            piece: on which H is taken.
            along: something near the direction in which the branch runs there.
        """

    @abstractmethod
    def factorise(self) -> bool:
        """Factorise J, if that is what the solver does; False if J is singular. Collective."""

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
        """Solve with J; False if that failed. Collective.

        Args:
            rhs: right-hand side.
            out: receives the solution.
            rtol: relative residual that is good enough, if exactness has a price.
            near: something near the solution.
            enough: says of a solution on the way that it is good enough, if exactness has a price.
        """

    @abstractmethod
    def probe(self, rhs: PETSc.Vec, out: PETSc.Vec) -> bool:
        """Solve with a right-hand side that has a part along every eigenvector. Collective."""

    @abstractmethod
    def determinant_sign(self) -> float:
        """Sign of det J, up to a factor that is always the same; 0 if singular. Collective."""

    @abstractmethod
    def determinant_quotient(
        self,
        y: PETSc.Vec,
        before: tuple[PETSc.Vec, Piece | None],
        after: tuple[PETSc.Vec, Piece | None],
    ) -> int:
        """Sign of det J_1 / det J_0 at ``y``, the two with their rows and pieces. Collective."""

    @abstractmethod
    def destroy(self) -> None:
        """Free the PETSc objects."""
