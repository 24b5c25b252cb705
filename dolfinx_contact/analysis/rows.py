# SPDX-License-Identifier: LGPL-3.0-or-later
"""Components of the jumps at contact points, as rows at the displacement.

What Dirichlet data fix is left out: components of jumps that cannot move, and columns of
displacements that do not. Points of a rank are those of all surfaces, one surface after the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._mpi import require
from dolfinx_contact._petsc import Entries, matrix_of
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.equations.validation import validate_data

__all__ = [
    "Problem",
    "component_rows",
    "free_axes",
    "free_components",
    "free_tangents",
    "matrix_of_product",
    "point_normals",
    "require_nodes",
    "stacked",
    "static_equations",
]

Array = npt.NDArray[np.float64]


class Problem(Protocol):
    """Contact problem with equations and an evaluation."""

    @property
    def equations(self) -> ContactEquations:
        """H."""

    def evaluate(self) -> Evaluation:
        """Evaluate H at the state in the Functions. Collective."""


def static_equations(problem: Any) -> ContactEquations:
    """The equations of a contact problem, whose laws need no time. Collective.

    Raises:
        ValueError: on every rank, if it is none, a law needs one, or the data of laws and material
            are not admissible as they are now (`equations.validation`).
    """
    eq = getattr(problem, "equations", None)
    if not isinstance(eq, ContactEquations):
        raise ValueError(f"a ContactProblem is needed, got {type(problem).__name__}")
    validate_data(eq)
    return eq


def point_normals(eq: ContactEquations) -> Array:
    """Unit normals, into the obstacle, at the points of this rank (n, dim)."""
    return np.concatenate([s.points.data.n for s in eq.surfaces])


def free_components(eq: ContactEquations) -> npt.NDArray[np.bool_]:
    """Components of jumps that Dirichlet data leave free at the points of this rank (n, dim)."""
    parts = zip(eq.constraints.removed, eq.surfaces, strict=True)
    return np.concatenate([~removed[: s.points.number] for removed, s in parts])


def free_tangents(eq: ContactEquations) -> tuple[npt.NDArray[np.intp], Array]:
    """Points of this rank and unit tangents (k, dim): all that Dirichlet data leave free."""
    n = point_normals(eq)
    return free_axes(eq, np.eye(eq.dim) - np.einsum("ni,nj->nij", n, n))


def free_axes(eq: ContactEquations, projectors: Array) -> tuple[npt.NDArray[np.intp], Array]:
    """Places of points and unit axes of projectors (n, dim, dim), as far as they are free."""
    free = free_components(eq)
    sizes, axes = np.linalg.eigh(projectors * free[:, :, None] * free[:, None, :])
    point, which = np.nonzero(sizes > 0.5)
    return point, axes[point, :, which]


def component_rows(eq: ContactEquations, places: npt.NDArray[np.intp], along: Array) -> PETSc.Mat:
    """Components of jumps along unit vectors, without columns of Dirichlet data. Collective.

    Args:
        eq: the contact problem.
        places: indices of points of this rank (k,).
        along: vectors at these points (k, dim).
    """
    B = stacked([s.constant_operator("what is known of jumps by rows").B for s in eq.surfaces])
    comm = eq.comm
    dim = eq.dim
    n, _ = B.getLocalSize()
    first = comm.exscan(len(places)) or 0
    column = B.getOwnershipRange()[0]
    i = np.repeat(first + np.arange(len(places), dtype=np.int64), dim)
    j = column + dim * places.astype(np.int64)[:, None] + np.arange(dim)
    entries = Entries(i, j.reshape(-1))
    weights = matrix_of(comm, (len(places), n), entries)
    entries.add(along.reshape(-1), weights)
    rows = weights.matMult(B)
    free = rows.createVecRight()
    free.array[:] = ~eq.fixed[: free.getLocalSize()]
    rows.diagonalScale(None, free)
    for thing in (B, weights, free):
        thing.destroy()
    return rows


class _Product:
    def __init__(self, product: Callable[[PETSc.Vec, PETSc.Vec], None]):
        self._product = product

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._product(x, y)


def matrix_of_product(
    comm: MPI.Comm, size: int, product: Callable[[PETSc.Vec, PETSc.Vec], None]
) -> PETSc.Mat:
    """Return a square matrix that is known by its product. Collective.

    Args:
        comm: communicator.
        size: number of rows of this rank.
        product: function of x and y that writes A x to y.
    """
    A = PETSc.Mat().createPython(((size, None), (size, None)), _Product(product), comm=comm)
    A.setUp()
    return A


def require_nodes(eq: ContactEquations) -> None:
    """Raise ``ValueError`` if points are no nodes, see others, stick together, or normals move.

    Collective.
    """
    for s in eq.surfaces:
        still = s.rigid_body is None
        require(eq.comm, still, f"{s.name}: not with rigid bodies that have unknowns of their own")
        require(eq.comm, s.linear, f"{s.name}: this needs small sliding")
        fits = s.points.E is None
        require(eq.comm, fits, f"{s.name}: this needs nodal or mixed contact, not {s.method}")
        local = s.law.averaging is None
        require(eq.comm, local, f"{s.name}: this needs a local law, not {s.law.name}")
        free = not s.law_at_points.compiled.bonded
        require(eq.comm, free, f"{s.name}: this needs a law without adhesion, not {s.law.name}")


def stacked(blocks: Sequence[PETSc.Mat]) -> PETSc.Mat:
    """Matrices with the same columns, rank by rank one below the other, AIJ. Collective."""
    nest = PETSc.Mat().createNest([[A] for A in blocks], comm=blocks[0].comm)
    whole = nest.convert("aij", PETSc.Mat())
    nest.destroy()
    return whole
