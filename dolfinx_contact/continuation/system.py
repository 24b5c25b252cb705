# SPDX-License-Identifier: LGPL-3.0-or-later
"""What can be followed: H(x, gamma) = 0 with H piecewise smooth.

A piece is H with the status of every point held; it is smooth beyond its own borders. Statuses are
small integers, one a point of this rank. The events of a piece are numbers that are positive inside
it and vanish where a point is about to change its status.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact.continuation.affine import AffineSystem

__all__ = [
    "Condensable",
    "Condensed",
    "Events",
    "ManyPieces",
    "Piece",
    "Preconditioned",
    "Preconditioner",
    "System",
    "as_condensable",
    "as_many_pieces",
    "as_preconditioned",
]


@dataclass(frozen=True, eq=False)
class Piece:
    """One smooth piece of H: the status of every point of this rank."""

    codes: npt.NDArray[np.int8]

    def with_codes(
        self, points: npt.NDArray[np.int32], codes: npt.NDArray[np.int8] | Sequence[int]
    ) -> Piece:
        """The piece in which the local ``points`` have the status ``codes``."""
        changed = self.codes.copy()
        changed[points] = np.asarray(codes, dtype=np.int8)
        return Piece(changed)


@dataclass(frozen=True)
class Events:
    """Distances of a state to the borders of a piece, on this rank.

    Attributes:
        distance: positive inside the piece, in one unit for all events.
        point: local point that each event belongs to.
        target: status that the point takes when the distance vanishes.
    """

    distance: npt.NDArray[np.float64]
    point: npt.NDArray[np.int32]
    target: npt.NDArray[np.int8]


class System(Protocol):
    """H(x, gamma) = 0 in PETSc, with pieces. Every method is collective.

    ``piece=None`` means H itself, with the status that (x, gamma) asks for.
    """

    comm: MPI.Comm

    @property
    def matrix(self) -> PETSc.Mat:
        """N x N, which `jacobian` fills: AIJ, but for a system that is `Preconditioned`."""

    def create_vector(self) -> PETSc.Vec:
        """A vector for x."""

    def residual(self, x: PETSc.Vec, gamma: float, b: PETSc.Vec, piece: Piece | None) -> None:
        """H(x, gamma) into ``b``."""

    def jacobian(self, x: PETSc.Vec, gamma: float, piece: Piece | None) -> None:
        """The derivative of H by x into `matrix`.

        Raises:
            ArithmeticError: on all ranks, if the system is preconditioned and that cannot be done.
        """

    def parameter_derivative(
        self, x: PETSc.Vec, gamma: float, c: PETSc.Vec, piece: Piece | None
    ) -> None:
        """The derivative of H by gamma into ``c``."""

    def error(self, b: PETSc.Vec) -> float:
        """Relative size of the residual ``b`` that was evaluated last."""

    def metric(self, x: PETSc.Vec, out: PETSc.Vec) -> None:
        """M x into ``out``, M symmetric and semi-definite: lengths in the space of x."""

    def piece_at(self, x: PETSc.Vec, gamma: float) -> Piece:
        """The piece that (x, gamma) asks for."""

    def events(self, x: PETSc.Vec, gamma: float, piece: Piece) -> Events:
        """Distances to the borders of ``piece``."""

    def probe(self, seed: int) -> PETSc.Vec:
        """A new vector with entries like random numbers, the same on any number of ranks."""

    def statuses(self, point: int) -> Sequence[int]:
        """All statuses that the local ``point`` can have."""


@runtime_checkable
class ManyPieces(Protocol):
    """A system that says whether its branches pass so many kinks that not all need be located."""

    @property
    def has_many_pieces(self) -> bool:
        """Whether kinks are passed in batches unless `StepControl.kinks` says otherwise."""


class Preconditioner(Protocol):
    """An approximate inverse P^-1 of `System.matrix` as `System.jacobian` left it. Linear."""

    def apply(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """P^-1 r into ``z``. Collective."""

    def determinant_sign(self) -> float:
        """Sign of det P, up to a factor that is always the same. Collective."""

    def correct(self, residual: PETSc.Vec, correction: PETSc.Vec) -> bool:
        """What to subtract from x to solve a few rows of H for their own unknowns. Collective.

        Args:
            residual: of H, as `System.residual` evaluated it last.
            correction: receives the solution.

        Returns:
            Whether there is anything to correct.

        Raises:
            ArithmeticError: on all ranks, if the rows are singular.
        """

    def wear(self, iterations: int, digits: float) -> None:
        """Be told that a solve took so many iterations for so many decimal digits. Collective."""


@runtime_checkable
class Preconditioned(Protocol):
    """A system that may be too large for its Jacobian to be factorised."""

    @property
    def preconditioner(self) -> Preconditioner | None:
        """Of the Jacobian; None where that is to be factorised. Collective."""


class Condensed(Protocol):
    """The kinked points of a system, everything else eliminated: the same on every rank.

    Every method is collective, but `piece`.
    """

    #: The pieces at the points.
    system: AffineSystem
    #: Whether they are those of H everywhere, not only its linearisation at a state.
    exact: bool

    def codes(self, piece: Piece) -> npt.NDArray[np.int8]:
        """Statuses of all points."""

    def piece(self, codes: npt.NDArray[np.int8]) -> Piece:
        """The piece in which the points have these statuses."""

    def point(self, i: int) -> tuple[int, int]:
        """The rank that owns point ``i``, and its local number there."""

    @property
    def always_solvable(self) -> bool:
        """Whether it is known that there is a solution at every gamma; needs no communication."""

    def contract(self, x: PETSc.Vec) -> npt.NDArray[np.float64]:
        """The numbers w of all points, (m, k)."""

    def expand(self, w: npt.NDArray[np.float64], gamma: float, x: PETSc.Vec) -> None:
        """The state in which the points have the numbers ``w`` into ``x``."""

    def destroy(self) -> None:
        """Free the PETSc objects."""


@runtime_checkable
class Condensable(Protocol):
    """A system that can be condensed onto its kinked points."""

    @property
    def is_piecewise_affine(self) -> bool:
        """Whether every piece is affine in (x, gamma)."""

    def condensed(self, x: PETSc.Vec, gamma: float) -> Condensed | None:
        """The points at (x, gamma); None if their pieces are no polyhedral cones. Collective."""


# `isinstance` with a protocol may evaluate the properties of the system, which are collective and
# may build what they return; these ask its class.


def as_condensable(system: Any) -> Condensable | None:
    """The system if it is `Condensable`."""
    return system if _has(system, "condensed", "is_piecewise_affine") else None


def as_preconditioned(system: Any) -> Preconditioned | None:
    """The system if it is `Preconditioned`."""
    return system if _has(system, "preconditioner") else None


def as_many_pieces(system: Any) -> ManyPieces | None:
    """The system if it is one with `ManyPieces`."""
    return system if _has(system, "has_many_pieces") else None


def _has(system: Any, *names: str) -> bool:
    return all(hasattr(type(system), name) for name in names)
