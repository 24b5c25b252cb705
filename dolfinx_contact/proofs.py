# SPDX-License-Identifier: LGPL-3.0-or-later
"""What problems need of `analysis`, which is above them and loaded when first needed.

This is the one place where something imports from above.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from petsc4py import PETSc

    import numpy as np
    import numpy.typing as npt

    from dolfinx_contact.continuation.affine import AffineSystem
    from dolfinx_contact.continuation.system import Proof, RayProof
    from dolfinx_contact.equations.contact import ContactEquations
    from dolfinx_contact.equations.evaluation import Evaluation
    from dolfinx_contact.equations.state import State
    from dolfinx_contact.reduced.reduction import Reduction
    from dolfinx_contact.results.uniqueness import Theory, Uniqueness
    from dolfinx_contact.solvers.linear import LinearSolver

__all__ = ["obstacle_to_proof", "proved", "proved_rays", "theory_of", "uniqueness"]


def _analysis() -> Any:
    from dolfinx_contact.analysis import contact

    return contact


def obstacle_to_proof(equations: ContactEquations, condensed: Reduction | None) -> str:
    """See `analysis.contact`."""
    return str(_analysis().obstacle_to_proof(equations, condensed))


def proved(condensed: Reduction, gamma: float, seconds: float) -> Proof | None:
    """See `analysis.contact`."""
    found: Proof | None = _analysis().proved(condensed, gamma, seconds)
    return found


def proved_rays(
    condensed: Reduction,
    cone: AffineSystem,
    known: Sequence[tuple[npt.NDArray[np.int8], float]],
    seconds: float,
) -> RayProof:
    """See `analysis.contact`."""
    found: RayProof = _analysis().proved_rays(condensed, cone, known, seconds)
    return found


def theory_of(equations: ContactEquations) -> Theory:
    """See `analysis.theory`."""
    found: Theory = _analysis().theory_of(equations)
    return found


def uniqueness(
    equations: ContactEquations,
    linear: Callable[[], LinearSolver],
    x: PETSc.Vec,
    state: Evaluation,
    seconds: float,
    state_at: Callable[[PETSc.Vec], State],
) -> Uniqueness:
    """See `analysis.contact`."""
    found: Uniqueness = _analysis().uniqueness(equations, linear, x, state, seconds, state_at)
    return found
