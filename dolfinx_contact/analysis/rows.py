# SPDX-License-Identifier: LGPL-3.0-or-later
"""Components of the jumps at contact points, as rows of matrices that act on the displacement.

Components and columns fixed by Dirichlet data are omitted. The contact points of a rank are
concatenated over all surfaces.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, Protocol, TypeVar

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact._mpi import on_root
from dolfinx_contact._petsc import (
    Entries,
    as_raised,
    destroy,
    matrix_of,
    options_in_database,
    stacked,
)
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.equations.validation import validate_data

__all__ = [
    "Problem",
    "component_rows",
    "free_axes",
    "free_components",
    "free_tangents",
    "is_free",
    "matrix_of_product",
    "on_gathered",
    "point_normals",
    "require_nodes",
    "solve_eigenproblem",
    "split",
    "static_equations",
    "unit",
]

R = TypeVar("R")


class Problem(Protocol):
    """Protocol of contact problems that an analysis accepts."""

    @property
    def equations(self) -> ContactEquations:
        """Equations H(x) = 0 of the problem, with body, contact surfaces and Dirichlet data."""

    def evaluate(self) -> Evaluation:
        """Evaluate the equations at the state in the Functions. Collective."""


def static_equations(problem: Any) -> ContactEquations:
    """Return the equations of a contact problem after validating its data. Collective.

    Raises:
        ValueError: on every rank, if ``problem`` is not a contact problem, if a law depends on the
            duration of a step, or if the present data are not admissible (`equations.validation`).
    """
    eq = getattr(problem, "equations", None)
    if not isinstance(eq, ContactEquations):
        raise ValueError(f"a ContactProblem is required, got {type(problem).__name__}")
    validate_data(eq)
    return eq


def point_normals(eq: ContactEquations) -> Array:
    """Return unit normals pointing into the obstacle at the points of this rank, shape (n, dim)."""
    return np.concatenate([s.points.data.n for s in eq.surfaces])


def free_components(eq: ContactEquations) -> Mask:
    """Return a mask of the jump components on this rank without Dirichlet data, shape (n, dim)."""
    parts = zip(eq.constraints.surfaces, eq.surfaces, strict=True)
    return np.concatenate([~c.removed[: s.points.number] for c, s in parts])


def is_free(eq: ContactEquations, axes: Array, least: float = 0.5) -> Mask:
    """Return a mask of the unit axes along which Dirichlet data allow motion, shape (n,).

    Args:
        eq: contact problem.
        axes: unit axes at the points of this rank, shape (n, dim).
        least: length that the components of an axis without Dirichlet data must exceed. Default
            0.5.
    """
    return np.asarray(np.linalg.norm(axes * free_components(eq), axis=1) > least)


def split(n: Array, vectors: Array) -> tuple[Array, Array]:
    """Split vectors into normal components, shape (k,), and tangential parts, shape (k, dim).

    Args:
        n: unit normals, shape (k, dim).
        vectors: vectors at the same points, shape (k, dim).
    """
    normal = np.sum(vectors * n, axis=1)
    return normal, vectors - normal[:, None] * n


def unit(vectors: Array, least: float = 0.0) -> Array:
    """Normalise vectors of shape (k, dim); vectors with lengths up to ``least`` become 0."""
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(size > least, vectors / np.where(size > least, size, 1.0), 0.0)


def on_gathered(comm: MPI.Comm, compute: Callable[..., R], *parts: npt.NDArray[Any]) -> R:
    """Call ``compute`` on rank 0 with the concatenated arrays of all ranks. Collective.

    Returns:
        Result of the call, on every rank.
    """
    gathered = comm.gather(parts)
    return on_root(comm, lambda: compute(*map(np.concatenate, zip(*gathered, strict=True))))


def free_tangents(eq: ContactEquations) -> tuple[npt.NDArray[np.intp], Array]:
    """Return unit tangents that span the tangential motions allowed by Dirichlet data.

    Returns:
        Indices of the points on this rank, shape (k,), and tangents, shape (k, dim).
    """
    n = point_normals(eq)
    return free_axes(eq, np.eye(eq.dim) - np.einsum("ni,nj->nij", n, n))


def free_axes(eq: ContactEquations, projectors: Array) -> tuple[npt.NDArray[np.intp], Array]:
    """Return unit axes spanning the ranges of projectors, without Dirichlet components.

    Args:
        eq: contact problem.
        projectors: orthogonal projectors at the points of this rank, shape (n, dim, dim).

    Returns:
        Indices of the points on this rank, shape (k,), and axes, shape (k, dim).
    """
    free = free_components(eq)
    sizes, axes = np.linalg.eigh(projectors * free[:, :, None] * free[:, None, :])
    point, which = np.nonzero(sizes > 0.5)
    return point, axes[point, :, which]


def component_rows(eq: ContactEquations, places: npt.NDArray[np.intp], along: Array) -> PETSc.Mat:
    """Return the matrix that maps displacements to jump components along unit vectors.

    Collective.

    Columns with Dirichlet data are zero.

    Args:
        eq: contact problem.
        places: indices of points of this rank, shape (k,).
        along: unit vectors at these points, shape (k, dim).
    """
    B = stacked([s.constant_operator("an analysis of jumps by rows").B for s in eq.surfaces])
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
    destroy(B, weights, free)
    return rows


def matrix_of_product(
    comm: MPI.Comm, size: int, product: Callable[[PETSc.Vec, PETSc.Vec], None]
) -> PETSc.Mat:
    """Return a matrix-free square matrix. Collective.

    Args:
        comm: communicator.
        size: number of local rows.
        product: function of vectors x and y that writes the product of the matrix and x to y.
    """
    context = SimpleNamespace(mult=lambda _A, x, y: product(x, y))
    A = PETSc.Mat().createPython(((size, None), (size, None)), context, comm=comm)
    A.setUp()
    return A


def solve_eigenproblem(solver: Any, defaults: dict[str, Any]) -> None:
    """Solve an eigenproblem by SLEPc (option prefix ``analysis_``). Collective.

    Args:
        solver: EPS or PEP object with its operators.
        defaults: values of options that the user has not set.
    """
    solver.setOptionsPrefix("analysis_")
    with options_in_database("analysis_", defaults), as_raised():
        solver.setFromOptions()
        solver.solve()


def require_nodes(eq: ContactEquations) -> None:
    """Raise `ValueError` unless contact is at nodes, with small sliding and a local law.

    Adhesion and rigid bodies with unknowns are not supported either.
    """
    for s in eq.surfaces:
        for fits, need in (
            (s.rigid_body is None, "rigid bodies with unknowns are not supported"),
            (s.linear, "this needs small sliding"),
            (not s.is_weak, f"this needs nodal or mixed contact, got {s.method}"),
            (s.law.averaging is None, f"this needs a local law, got {s.law.name}"),
            (
                not s.law_at_points.compiled.bonded,
                f"this needs a law without adhesion, got {s.law.name}",
            ),
        ):
            if not fits:
                raise ValueError(f"{s.name}: {need}")
