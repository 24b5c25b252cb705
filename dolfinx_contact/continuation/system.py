# SPDX-License-Identifier: LGPL-3.0-or-later
"""What can be followed: H(x, gamma) = 0 with H piecewise smooth.

A piece is H with the status of every point held; it is smooth beyond its own borders. Statuses are
small integers, one a point of this rank. The events of a piece are numbers that are positive inside
it and vanish where a point is about to change its status.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Protocol

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact.continuation.affine import AffineSystem

__all__ = [
    "Condensed",
    "Events",
    "Piece",
    "Preconditioner",
    "System",
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


class System:
    """H(x, gamma) = 0 in PETSc, with pieces: a base class. Every method is collective.

    ``piece=None`` means H itself, with the statuses that (x, gamma) determines. Nothing is
    remembered between two calls, but for `scales` and for `matrix`, which `jacobian` fills. Methods
    whose description names no default must be defined.
    """

    comm: MPI.Comm
    #: N x N, which `jacobian` fills: AIJ, but where there is a `preconditioner`.
    matrix: PETSc.Mat
    #: Measures that residuals are judged by; they may grow along a branch.
    scales: tuple[float, ...] = ()
    #: Whether kinks are passed in batches unless `StepControl.kinks` is given: where branches
    #: pass so many that not all need be located. By default not.
    has_many_pieces: bool = False
    #: Why H is not smooth on a piece, in words; "" if it is.
    kinks: str = ""
    #: Where H is not smooth in gamma alone, in words; "" if it is.
    kinks_in_gamma: str = ""
    #: Whether every piece is affine in (x, gamma), so that `condensed` is the whole problem.
    is_piecewise_affine: bool = False
    #: Of the Jacobian; None, the default, where that is to be factorised.
    preconditioner: Preconditioner | None = None

    def create_vector(self) -> PETSc.Vec:
        """A vector for x."""
        raise NotImplementedError

    def residual(self, x: PETSc.Vec, gamma: float, b: PETSc.Vec, piece: Piece | None) -> float:
        """H(x, gamma) into ``b``; its relative size."""
        raise NotImplementedError

    def jacobian(self, x: PETSc.Vec, gamma: float, piece: Piece | None) -> None:
        """The derivative of H by x into `matrix`.

        Raises:
            ArithmeticError: on all ranks, if the system is preconditioned and that cannot be done.
        """
        raise NotImplementedError

    def parameter_derivative(
        self, x: PETSc.Vec, gamma: float, c: PETSc.Vec, piece: Piece | None
    ) -> None:
        """The derivative of H by gamma into ``c``."""
        raise NotImplementedError

    def metric(self, x: PETSc.Vec, out: PETSc.Vec) -> None:
        """M x into ``out``, M symmetric and semi-definite: lengths in the space of x."""
        raise NotImplementedError

    def piece_at(self, x: PETSc.Vec, gamma: float) -> Piece:
        """The piece that (x, gamma) determines; by default the only one there is."""
        return Piece(np.zeros(0, dtype=np.int8))

    def events(self, x: PETSc.Vec, gamma: float, piece: Piece) -> Events:
        """Distances to the borders of ``piece``; by default it has none."""
        return Events(np.zeros(0), np.zeros(0, dtype=np.int32), np.zeros(0, dtype=np.int8))

    def probe(self, seed: int) -> PETSc.Vec:
        """A new vector with entries like random numbers, the same on any number of ranks."""
        raise NotImplementedError

    def statuses(self, point: int) -> Sequence[int]:
        """All statuses that the local ``point`` can have; by default none."""
        return ()

    def order(self) -> npt.NDArray[np.intp]:
        """Place of each local point in an order of all that no numbering decides, nor ranks (n,).

        It is used where one of several points is to be chosen on a path with memory.
        """
        raise NotImplementedError

    def correct(
        self,
        x: PETSc.Vec,
        gamma: float,
        residual: PETSc.Vec,
        correction: PETSc.Vec,
        piece: Piece | None,
    ) -> bool:
        """What to subtract from x to solve a few rows of H for their own unknowns.

        Args:
            x: the state.
            gamma: there.
            residual: H(x, gamma).
            correction: receives the solution.
            piece: on which H is taken.

        Returns:
            Whether there is anything to correct; by default not.

        Raises:
            ArithmeticError: on all ranks, if the rows are singular.
        """
        return False

    def contact_rows(
        self, x: PETSc.Vec, gamma: float, piece: Piece | None
    ) -> npt.NDArray[np.float64] | None:
        """Rows of H on this rank at which its linear model errs, where they cost next to nothing.

        None, the default, if there are none: the same on every rank.
        """
        return None

    def condensed(self, x: PETSc.Vec, gamma: float, *, conic: bool = True) -> Condensed | None:
        """The points at (x, gamma) with all else eliminated.

        None, the default, if their pieces are no polyhedral cones.

        Args:
            x: the state.
            gamma: there.
            conic: whether they must be; what `prove` takes may be affine pieces of another kind.
        """
        return None

    def prove(self, condensed: Condensed, gamma: float, seconds: float) -> Proof | None:
        """All solutions at gamma, with a proof; None, the default, where none is possible.

        Args:
            condensed: the points at any state, exact.
            gamma: parameter.
            seconds: to give up after.
        """
        return None

    def obstacle_to_proof(self) -> str:
        """Why `prove` is not tried, human-readable; "", the default, if that is not known."""
        return ""

    def prove_rays(
        self,
        condensed: Condensed,
        cone: AffineSystem,
        known: Sequence[tuple[npt.NDArray[np.int8], float]],
    ) -> RayProof | None:
        """All rays of a tangent cone, with a proof; None, the default, where none is possible.

        Args:
            condensed: the points at the state whose cone it is.
            cone: its tangent cone.
            known: statuses (m,) and dgamma of rays that are known.
        """
        return None

    def solution_from(self, x: PETSc.Vec, gamma: float) -> tuple[PETSc.Vec | None, str]:
        """A solution at gamma by the system's own solver, and what it tried, human-readable.

        The solution is a new vector, or None if none was found. By default there is no solver, and
        nothing is tried: None and "".

        Args:
            x: start, which is left as it is.
            gamma: parameter.
        """
        return None, ""

    def validity_warning(self, x: PETSc.Vec, gamma: float, piece: Piece) -> str:
        """Reason why the model is not valid for a solution; by default "".

        Args:
            x: a solution.
            gamma: there.
            piece: its statuses.
        """
        return ""

    def put(self, x: PETSc.Vec, gamma: float, piece: Piece) -> None:
        """Show a state to the user; by default nowhere.

        So is every point shown that an observer is called with, and the last one of a branch.
        """

    def undisturbed(self) -> AbstractContextManager[None]:
        """A context in which nobody changes the data; by default it does nothing. Collective.

        A step of a branch runs in it: what depends on the data may be kept there. It raises
        ``ValueError`` if the mesh has been moved before.
        """
        return nullcontext()

    def check_parameter(self, gammas: Sequence[float]) -> None:
        """Raise ``ValueError`` if there is no problem at one of these, in order."""

    def restored(self, *, always: bool = False) -> AbstractContextManager[None]:
        """Restores what evaluations write to if the context raises; by default nothing.

        Args:
            always: also if the context does not raise.
        """
        return nullcontext()


class FoundState(Protocol):
    """A solution of the points that `Condensed` has."""

    @property
    def codes(self) -> npt.NDArray[np.int8]:
        """Statuses (m,)."""

    @property
    def state(self) -> npt.NDArray[np.float64]:
        """Numbers w of the points (m, k)."""


class Proof(Protocol):
    """What is proved of the solutions at one gamma."""

    @property
    def verdict(self) -> str:
        """Whether there are no others: then "complete"."""

    @property
    def solutions(self) -> Sequence[FoundState]:
        """Those that are certain."""

    @property
    def method(self) -> str:
        """How it was proved, human-readable."""


class RayProof(Protocol):
    """What is proved of the rays of a point."""

    @property
    def verdict(self) -> str:
        """Whether there are no others: then "complete"."""

    @property
    def rays(self) -> Sequence[tuple[npt.NDArray[np.int8], float]]:
        """Statuses (m,) and dgamma, 1 or -1, of those that are certain."""

    @property
    def method(self) -> str:
        """How it was proved, human-readable."""


class Preconditioner(Protocol):
    """An approximate inverse P^-1 of `System.matrix` as `System.jacobian` left it. Linear."""

    def apply(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """P^-1 r into ``z``. Collective."""

    def apply_exact(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Into ``z`` the unknowns that P^-1 finds exactly, for their rows of r; 0 elsewhere.

        Where r vanishes in these rows P^-1 needs no solve for them before its cycle. Collective.
        """

    def determinant_sign(self) -> float:
        """Sign of det P, up to a factor that is always the same. Collective."""

    def age(self, iterations: int, digits: float) -> None:
        """Take notice of the iterations of a solve and the decimal digits gained. Collective."""


class Condensed(Protocol):
    """The kinked points of a system, everything else eliminated: the same on every rank.

    Every method is collective, but `piece`.
    """

    #: The pieces at the points.
    system: AffineSystem
    #: Whether they are those of H everywhere, not only its linearisation at a state.
    exact: bool

    @property
    def guided(self) -> bool:
        """Whether points have other statuses in H, since what they do is prescribed in part."""

    def require_finite(self) -> None:
        """Raise ``ValueError`` if a number is not finite."""

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
