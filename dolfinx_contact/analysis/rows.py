# SPDX-License-Identifier: LGPL-3.0-or-later
"""Components of the jumps at contact points, as rows at the displacement.

Components of jumps and columns of displacements that are fixed by Dirichlet data are left out. The
points of a rank are those of all surfaces, one surface after the other.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact._mpi import on_root
from dolfinx_contact._petsc import Entries, as_raised, matrix_of, options_in_database, stacked
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
    """Contact problem with equations and an evaluation."""

    @property
    def equations(self) -> ContactEquations:
        """H."""

    def evaluate(self) -> Evaluation:
        """Evaluate H at the state in the Functions. Collective."""


def static_equations(problem: Any) -> ContactEquations:
    """Return the equations of a contact problem whose laws do not depend on time. Collective.

    Raises:
        ValueError: on every rank, for another object, for a law depending on time, or if the
            present data of laws and material are not admissible (`equations.validation`).
    """
    eq = getattr(problem, "equations", None)
    if not isinstance(eq, ContactEquations):
        raise ValueError(f"a ContactProblem is needed, got {type(problem).__name__}")
    validate_data(eq)
    return eq


def point_normals(eq: ContactEquations) -> Array:
    """Return unit normals into the obstacle at the points of this rank (n, dim)."""
    return np.concatenate([s.points.data.n for s in eq.surfaces])


def free_components(eq: ContactEquations) -> Mask:
    """Return flags of the components of jumps without Dirichlet data, on this rank (n, dim)."""
    parts = zip(eq.constraints.removed, eq.surfaces, strict=True)
    return np.concatenate([~removed[: s.points.number] for removed, s in parts])


def is_free(eq: ContactEquations, axes: Array, least: float = 0.5) -> Mask:
    """Return whether Dirichlet data leave motion along unit axes (n, dim) free (n,).

    Args:
        eq: contact problem.
        axes: axes at the points of this rank.
        least: smallest length of the free part of an axis.
    """
    return np.asarray(np.linalg.norm(axes * free_components(eq), axis=1) > least)


def split(n: Array, vectors: Array) -> tuple[Array, Array]:
    """Return components along unit normals (k,) and tangential parts (k, dim) of vectors."""
    normal = np.sum(vectors * n, axis=1)
    return normal, vectors - normal[:, None] * n


def unit(vectors: Array, least: float = 0.0) -> Array:
    """Return vectors (k, dim) divided by their lengths; 0 for lengths up to ``least``."""
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(size > least, vectors / np.where(size > least, size, 1.0), 0.0)


def on_gathered(comm: MPI.Comm, compute: Callable[..., R], *parts: npt.NDArray[Any]) -> R:
    """Return ``compute`` of the arrays of all ranks, concatenated on rank 0. Collective."""
    gathered = comm.gather(parts)
    return on_root(comm, lambda: compute(*map(np.concatenate, zip(*gathered, strict=True))))


def free_tangents(eq: ContactEquations) -> tuple[npt.NDArray[np.intp], Array]:
    """Return all free unit tangents (k, dim) and the indices of their points (k,)."""
    n = point_normals(eq)
    return free_axes(eq, np.eye(eq.dim) - np.einsum("ni,nj->nij", n, n))


def free_axes(eq: ContactEquations, projectors: Array) -> tuple[npt.NDArray[np.intp], Array]:
    """Return the free unit axes (k, dim) of projectors (n, dim, dim), after their points (k,)."""
    free = free_components(eq)
    sizes, axes = np.linalg.eigh(projectors * free[:, :, None] * free[:, None, :])
    point, which = np.nonzero(sizes > 0.5)
    return point, axes[point, :, which]


def component_rows(eq: ContactEquations, places: npt.NDArray[np.intp], along: Array) -> PETSc.Mat:
    """Return rows of jumps along unit vectors, without columns of Dirichlet data. Collective.

    Args:
        eq: contact problem.
        places: indices of points of this rank (k,).
        along: vectors at these points (k, dim).
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
    """Return a square matrix defined by its product. Collective.

    Args:
        comm: communicator.
        size: number of rows of this rank.
        product: function of x and y writing A x to y.
    """
    A = PETSc.Mat().createPython(((size, None), (size, None)), _Product(product), comm=comm)
    A.setUp()
    return A


def solve_eigenproblem(solver: Any, defaults: dict[str, Any]) -> None:
    """Solve an eigenproblem of SLEPc with the options of prefix ``analysis_``. Collective.

    Args:
        solver: EPS or PEP with its operators.
        defaults: values of options that the user has not set.
    """
    solver.setOptionsPrefix("analysis_")
    with options_in_database("analysis_", defaults), as_raised():
        solver.setFromOptions()
        solver.solve()


def require_nodes(eq: ContactEquations) -> None:
    """Raise ``ValueError`` unless contact is at nodes, with small sliding and a local law."""
    for s in eq.surfaces:
        for fits, need in (
            (s.rigid_body is None, "not with rigid bodies that have unknowns of their own"),
            (s.linear, "this needs small sliding"),
            (s.points.E is None, f"this needs nodal or mixed contact, not {s.method}"),
            (s.law.averaging is None, f"this needs a local law, not {s.law.name}"),
            (
                not s.law_at_points.compiled.bonded,
                f"this needs a law without adhesion, not {s.law.name}",
            ),
        ):
            if not fits:
                raise ValueError(f"{s.name}: {need}")
