# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface of piecewise smooth systems H(x, gamma) = 0 for continuation.

Each point has a status, a small integer such as the code of stick or slip. A piece is H with fixed
statuses of all points: a function that is smooth everywhere, and equal to H on the set of states
with these statuses. The events of a piece are the distances to the borders of this set: positive
inside, zero where a status is about to change.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array, Codes, Indices
from dolfinx_contact.continuation.affine import AffineSystem

__all__ = [
    "Condensed",
    "Events",
    "Piece",
    "Preconditioner",
    "ResidualScales",
    "System",
    "fractions_to_borders",
    "matched_distances",
]

#: Typical sizes of residuals; () if a system has none, or before its first residual.
ResidualScales: TypeAlias = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Piece:
    """Smooth piece of H, selected by fixed statuses of all points.

    Attributes:
        codes: statuses of the points of this rank, shape (n,).
    """

    codes: Codes

    def with_codes(self, points: Indices, codes: Codes | Sequence[int]) -> Piece:
        """Return the piece in which the local ``points`` have the statuses ``codes``."""
        changed = self.codes.copy()
        changed[points] = np.asarray(codes, dtype=np.int8)
        return Piece(changed)


@dataclass(frozen=True)
class Events:
    """Distances of a state to the borders of a piece, where statuses change, on this rank.

    Attributes:
        distance: distances to n borders, positive inside, all in one unit, shape (n,).
        point: local number of the point that changes its status at each border, shape (n,).
        target: status of this point beyond the border, shape (n,).
    """

    distance: Array
    point: Indices
    target: Codes


def matched_distances(here: Events, there: Events, missing: Array | None = None) -> Array:
    """Return the distances of a second state to the same borders. Not collective.

    Borders of some laws exist in some states only; for example, the border of stick exists only
    where there is friction. If both states have events of the same points, the events are matched
    in their order, even if the statuses beyond the borders differ.

    Args:
        here: n events of a piece at the first state, which define the borders.
        there: events of the same piece at the second state.
        missing: values for borders that do not exist at the second state, shape (n,); default:
            distances at the first state.
    """
    if np.array_equal(here.point, there.point):
        return there.distance
    distances: dict[tuple[int, int], list[float]] = {}
    for point, target, distance in zip(there.point, there.target, there.distance, strict=True):
        distances.setdefault((int(point), int(target)), []).append(float(distance))
    matched = np.array(here.distance if missing is None else missing)
    for i, (point, target) in enumerate(zip(here.point, here.target, strict=True)):
        if distances.get(key := (int(point), int(target))):
            matched[i] = distances[key].pop(0)
    return matched


def fractions_to_borders(
    low: Events, high: Events, weights: tuple[float, float] = (1.0, 1.0)
) -> Array:
    """Interpolate where the borders of a piece lie between two states. Not collective.

    Args:
        low: events of the piece at a state inside it, the start of the segment.
        high: n events of the same piece at another state, the end of the segment.
        weights: factors of the distances at the two states.

    Returns:
        Fraction of the segment at each border of ``high``, shape (n,): inf where the second state
        is inside, 1/2 where it is outside and the border does not exist at the first state.
    """
    distance = weights[1] * high.distance
    outside = distance < 0
    before = matched_distances(high, low, np.full_like(distance, np.inf))
    begins = outside & np.isinf(before)
    above = np.where(outside & ~begins, weights[0] * np.maximum(before, 0.0), 0.0)
    fraction = np.where(outside, above / np.where(outside, above - distance, 1.0), np.inf)
    return np.where(begins, 0.5, fraction)


class System:
    """Base class of systems H(x, gamma) = 0 in PETSc. Every method is collective.

    H is piecewise smooth. The argument ``piece`` fixes the statuses and thus selects a smooth piece
    of H; ``piece=None`` means H itself, with the statuses determined by (x, gamma). A system keeps
    no state between two calls, except `matrix`, which `jacobian` assembles. A smooth system defines
    `comm`, `matrix`, `create_vector`, `residual`, `jacobian`, `parameter_derivative`, `metric` and
    `probe`.
    """

    comm: MPI.Comm
    #: H_x, of size N x N: AIJ unless there is a `preconditioner`.
    matrix: PETSc.Mat
    #: Whether kinks are passed in batches unless `StepControl.kinks` is set, because branches have
    #: too many of them to locate each.
    has_many_pieces: bool = False
    #: Reason why H is not smooth on a piece; "" if it is.
    kinks: str = ""
    #: Whether every piece is affine in (x, gamma), so that `condensed` is the whole problem.
    is_piecewise_affine: bool = False
    #: Preconditioner of H_x; None if H_x is to be factorised.
    preconditioner: Preconditioner | None = None

    # -- H and its derivatives -------------------------------------------------------------------

    def create_vector(self) -> PETSc.Vec:
        """Create a vector of the unknowns x."""
        raise NotImplementedError

    def residual(self, x: PETSc.Vec, gamma: float, b: PETSc.Vec, piece: Piece | None) -> float:
        """Write H(x, gamma) into ``b``, and return its scaled norm."""
        raise NotImplementedError

    def measure(
        self, x: PETSc.Vec, gamma: float, b: PETSc.Vec, piece: Piece | None, scales: ResidualScales
    ) -> tuple[float, ResidualScales]:
        """Write H(x, gamma) into ``b``, and return its norm relative to scales of the branch.

        Args:
            x: state.
            gamma: parameter.
            b: vector that receives H.
            piece: fixed statuses of all points; None to determine them from the state.
            scales: scales of the branch so far.

        Returns:
            Scaled norm of H, and the scales updated by this state; default: the result of
            `residual`, and ``scales``.
        """
        return self.residual(x, gamma, b, piece), scales

    def jacobian(self, x: PETSc.Vec, gamma: float, piece: Piece | None) -> None:
        """Assemble the derivative of H with respect to x into `matrix`.

        Raises:
            ArithmeticError: on all ranks, if the preconditioner cannot be set up.
        """
        raise NotImplementedError

    def parameter_derivative(
        self, x: PETSc.Vec, gamma: float, c: PETSc.Vec, piece: Piece | None
    ) -> None:
        """Write the derivative of H with respect to gamma into ``c``."""
        raise NotImplementedError

    def metric(self, x: PETSc.Vec, out: PETSc.Vec) -> None:
        """Write M x into ``out``; the symmetric semi-definite matrix M defines lengths of x."""
        raise NotImplementedError

    def probe(self, seed: int) -> PETSc.Vec:
        """Create a vector of pseudo-random entries, independent of the number of ranks."""
        raise NotImplementedError

    # -- pieces ----------------------------------------------------------------------------------

    def piece_at(self, x: PETSc.Vec, gamma: float) -> Piece:
        """Return the piece of H that the state (x, gamma) determines; default: the only piece."""
        return Piece(np.zeros(0, dtype=np.int8))

    def events(self, x: PETSc.Vec, gamma: float, piece: Piece) -> Events:
        """Return the distances of a state to the borders of ``piece``; default: no borders."""
        return Events(np.zeros(0), np.zeros(0, dtype=np.int32), np.zeros(0, dtype=np.int8))

    def statuses(self, point: int) -> Sequence[int]:
        """Return all statuses that a local point can have; default: none."""
        return ()

    def order(self) -> npt.NDArray[np.intp]:
        """Return the position of each local point in a global order, shape (n,).

        The order must not depend on numberings or ranks. A path with memory uses it to choose
        between several points.
        """
        raise NotImplementedError

    # -- optional help for linear solves ---------------------------------------------------------

    def begin_solves(self) -> None:
        """Called before a branch is followed; default: do nothing.

        Until `end_solves`, `matrix` and `preconditioner` must remain the same objects. A contact
        problem shares its linear solver with the branch.
        """

    def end_solves(self) -> None:
        """Called when a branch has been followed; default: do nothing."""

    def correct(
        self,
        x: PETSc.Vec,
        gamma: float,
        residual: PETSc.Vec,
        correction: PETSc.Vec,
        piece: Piece | None,
    ) -> bool:
        """Solve a few rows of H for as many unknowns while all other unknowns are fixed.

        The corrector calls this method between its steps if linear solves are iterative. A contact
        problem solves the equations of its contact surfaces, with the displacement of the body
        fixed.

        Args:
            x: state.
            gamma: parameter.
            residual: H(x, gamma).
            correction: vector to subtract from x, which is set.
            piece: fixed statuses of all points; None to determine them from the state.

        Returns:
            Whether a correction was computed; default: False.

        Raises:
            ArithmeticError: on all ranks, if the matrix of these rows is singular.
        """
        return False

    def contact_rows(self, x: PETSc.Vec, gamma: float, piece: Piece | None) -> Array | None:
        """Return the local values of the nonlinear rows of H, if they are cheap to evaluate.

        The default is None on every rank: there are no such rows.
        """
        return None

    # -- optional condensation and proofs --------------------------------------------------------

    def condensed(self, x: PETSc.Vec, gamma: float, *, conic: bool = True) -> Condensed | None:
        """Return the system in the unknowns of the points, all others being eliminated.

        The default is None: the system cannot be condensed, because the sets of states with fixed
        statuses are not polyhedral cones.

        Args:
            x: state.
            gamma: parameter.
            conic: whether these sets must be cones; `prove` also accepts other polyhedra.
        """
        return None

    def prove(self, condensed: Condensed, gamma: float, seconds: float) -> Proof | None:
        """Compute all solutions at gamma with a proof; default: None, no proof is available.

        Args:
            condensed: exact condensation onto the points, at any state.
            gamma: parameter.
            seconds: time limit.
        """
        return None

    def why_not_provable(self) -> str:
        """Return the reason why `prove` is not available; default: "" for an unknown reason."""
        return ""

    def prove_rays(
        self, condensed: Condensed, cone: AffineSystem, known: Sequence[tuple[Codes, float]]
    ) -> RayProof | None:
        """Compute all rays of a tangent cone with a proof; default: None, no proof is available.

        Args:
            condensed: condensation onto the points, at the state from which the rays lead.
            cone: tangent cone at this state.
            known: computed rays: statuses of the points, shape (m,), and rate 1, -1 or 0 of gamma.
        """
        return None

    def validity_warning(self, x: PETSc.Vec, gamma: float, piece: Piece) -> str:
        """Return the reason why the model is not valid for a solution; default: "", it is valid.

        No proofs are given for invalid solutions.

        Args:
            x: solution.
            gamma: parameter.
            piece: statuses of the solution.
        """
        return ""

    # -- optional connection to the user's problem -----------------------------------------------

    def solution_from(self, x: PETSc.Vec, gamma: float) -> tuple[PETSc.Vec | None, str]:
        """Solve at gamma using the solver of the system. Default: no solver is available.

        Args:
            x: initial guess, not changed.
            gamma: parameter.

        Returns:
            Solution, a new vector, or None; description of the attempts, "" without a solver.
        """
        return None, ""

    def put(self, x: PETSc.Vec, gamma: float, piece: Piece) -> None:
        """Write a state into the user's data, such as Functions; default: do nothing.

        Called before observers, and with the last point of a branch.
        """

    def undisturbed(self) -> AbstractContextManager[None]:
        """Return a context in which the data do not change, so that values may be cached.

        Every step of a branch runs in this context. It raises `ValueError` if the mesh has moved.
        """
        return nullcontext()

    def set_parameter(self, gamma: float) -> None:
        """Set the parameter gamma of H for evaluations of another system that contains H.

        The default raises an error.
        """
        raise NotImplementedError

    def check_parameter(self, gammas: Sequence[float]) -> None:
        """Raise `ValueError` if the data are not valid at one of the values ``gammas``."""

    def restored(self, *, always: bool = False) -> AbstractContextManager[None]:
        """Return a context restoring the user's data after an error; the default does nothing.

        Args:
            always: whether to restore the data on every exit; default: only after an error.
        """
        return nullcontext()


class Preconditioner(Protocol):
    """Approximate inverse P^-1 of `System.matrix`, a linear map updated by `System.jacobian`."""

    def apply(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Apply the approximate inverse to ``r``; write the result into ``z``. Collective."""

    def apply_exact(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Write the unknowns that `apply` determines exactly into ``z``, 0 elsewhere. Collective.

        If the residual ``r`` vanishes in the corresponding rows, `apply` skips the solve for these
        unknowns before its multigrid cycle.
        """

    def determinant_sign(self) -> float:
        """Return the sign of det P up to a constant; `apply` is the inverse of P. Collective."""

    def age(self, iterations: int, digits: float) -> None:
        """Record the iterations of a solve and the decimal digits of its reduction. Collective."""


class Condensed(Protocol):
    """System in the unknowns of its points, all other unknowns being eliminated.

    It is equal on every rank. Every method except `piece` is collective.
    """

    #: Pieces at the points.
    system: AffineSystem
    #: Whether the pieces are exact pieces of H, not only pieces of its linearisation at a state.
    exact: bool

    @property
    def guided(self) -> bool:
        """Whether points with partly prescribed motion have other statuses here than in H."""

    def require_finite(self) -> None:
        """Raise ``ValueError`` if a coefficient or load of the condensed system is not finite."""

    def codes(self, piece: Piece) -> Codes:
        """Return the statuses of the points of all ranks, shape (m,)."""

    def piece(self, codes: Codes) -> Piece:
        """Return the piece of H with the given statuses of the points of all ranks."""

    def point(self, i: int) -> tuple[int, int]:
        """Return the rank that owns point ``i``, and the local number of the point there."""

    @property
    def always_solvable(self) -> bool:
        """Whether a theorem guarantees a solution at every gamma. Not collective."""

    def contract(self, x: PETSc.Vec) -> Array:
        """Return the variables of all m points in a state ``x``, shape (m, k)."""

    def expand(self, w: Array, gamma: float, x: PETSc.Vec) -> None:
        """Compute all unknowns from the variables ``w`` of the points and write them to ``x``."""

    def destroy(self) -> None:
        """Free the PETSc objects."""


class FoundState(Protocol):
    """Solution of a `Condensed` system: statuses and variables of its points."""

    @property
    def codes(self) -> Codes:
        """Statuses of the points of all ranks, shape (m,)."""

    @property
    def state(self) -> Array:
        """Variables of the m points, shape (m, k)."""


class ProvedSearch(Protocol):
    """Result of a search that may prove its completeness."""

    @property
    def verdict(self) -> str:
        """Verdict of the proof: "complete" if it excludes other solutions or rays."""

    @property
    def method(self) -> str:
        """Description of the method of the proof."""


class Proof(ProvedSearch, Protocol):
    """Result of a proof about the solutions at one gamma."""

    @property
    def solutions(self) -> Sequence[FoundState]:
        """Solutions whose existence is proved."""


class RayProof(ProvedSearch, Protocol):
    """Result of a proof about the rays along which solutions can continue from a state."""

    @property
    def rays(self) -> Sequence[tuple[Codes, float]]:
        """Rays proved to exist: statuses of the points, shape (m,), and rate of gamma, 1 or -1."""
