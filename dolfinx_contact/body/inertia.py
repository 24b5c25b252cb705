# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Inertia of a body: its mass matrix, consistent, lumped, or without mass at some nodes.

consistent
    M_ij = integral of rho phi_i phi_j.
lumped
    diagonal: the sums of its rows (P1), or its diagonal times a factor that keeps the mass (P2,
    whose row sums vanish at vertices; Hinton, Rock and Zienkiewicz, Earthq. Eng. Struct. Dyn. 4,
    1976, with one factor for all cells).
redistributed
    no mass at the nodes that may touch (Khenous, Laborde and Renard, Eur. J. Mech. A 27, 2008).
    What they had goes to the diagonal of the nodes around, in the proportions of the entries of M:
    the whole mass stays, its centre moves by a part of a cell.
"""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import dolfinx.fem.petsc
import ufl
from dolfinx import fem

from dolfinx_contact._errors import require
from dolfinx_contact._forms import compiled_form

__all__ = ["Mass", "mass_matrix"]

#: How the mass of a body is put into a matrix.
Mass: TypeAlias = Literal["consistent", "lumped", "redistributed"]

Array = npt.NDArray[np.float64]


def mass_matrix(
    V: fem.FunctionSpace, density: Any, kind: Mass, touching: npt.NDArray[np.bool_]
) -> PETSc.Mat:
    """The mass matrix of a body. Collective.

    Args:
        V: space of its displacement.
        density: mass per volume (per area in 2D, of unit thickness): a number, Constant, Function
            or UFL expression.
        kind: of the matrix.
        touching: owned dofs of the nodes that may touch something.

    Raises:
        ValueError: on every rank, if the density is not positive in all cells, or no node is left
            that could have mass.
    """
    _check_density(V, density)
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    consistent = dolfinx.fem.petsc.assemble_matrix(
        compiled_form(density * ufl.inner(u, v) * ufl.dx)
    )
    consistent.assemble()
    if kind == "consistent":
        return consistent
    degree = V.ufl_element().embedded_superdegree
    M = _lumped(consistent, degree) if kind == "lumped" or degree > 1 else consistent.copy()
    if kind == "redistributed":
        _redistribute(M, consistent, touching)
    consistent.destroy()
    return M


def _check_density(V: fem.FunctionSpace, density: Any) -> None:
    """Refuse a density that is not positive. Collective."""
    comm, domain = V.mesh.comm, V.mesh
    W = fem.functionspace(domain, ("DG", 0))
    one = fem.Constant(domain, 1.0)
    mean = [
        fem.assemble_vector(compiled_form(e * ufl.TestFunction(W) * ufl.dx(domain)))
        for e in (density * one, one)
    ]
    n = W.dofmap.index_map.size_local
    values = mean[0].array[:n] / mean[1].array[:n]
    good = bool(np.isfinite(values).all() and (values > 0).all())
    require(comm, good, "the density must be positive everywhere")


def _lumped(M: PETSc.Mat, degree: int) -> PETSc.Mat:
    """A diagonal matrix with the mass of M. Collective."""
    total = M.getRowSum()
    masses = total
    if degree > 1:
        masses = M.getDiagonal()
        masses.scale(total.sum() / masses.sum())
    D = PETSc.Mat().createAIJ(M.getSizes(), nnz=1, comm=M.comm)
    D.setUp()
    D.setDiagonal(masses)
    D.assemble()
    return D


def _redistribute(M: PETSc.Mat, around: PETSc.Mat, touching: npt.NDArray[np.bool_]) -> None:
    """Move the mass in M of what touches to the diagonal of what is around. Collective."""
    start = M.getOwnershipRange()[0]
    weights = around.copy()
    indptr, indices, values = weights.getValuesCSR()
    weights.setValuesCSR(indptr, indices, np.abs(values))
    weights.assemble()
    mass = M.getRowSum()
    total = mass.sum()
    marked, added = M.createVecs()
    marked.array[:] = touching
    M.mult(marked, added)  # what the others have in common with what touches
    near = added.duplicate()
    marked.array[:] = ~touching
    weights.mult(marked, near)
    reached = touching & (near.array_r > 0)
    marked.array[:] = np.where(reached, mass.array_r / np.where(reached, near.array_r, 1.0), 0.0)
    weights.multAdd(marked, added, added)
    M.zeroRowsColumns((np.flatnonzero(touching) + start).astype(PETSc.IntType), diag=0.0)
    diagonal = M.getDiagonal()
    diagonal.array[:] += np.where(touching, 0.0, added.array_r)
    M.setDiagonal(diagonal)
    M.assemble()
    kept = M.getRowSum().sum()
    message = "no node is left that could have mass: all may touch"
    require(M.comm.tompi4py(), kept > 0, message)
    M.scale(total / kept)
    for thing in (weights, mass, marked, added, near, diagonal):
        thing.destroy()
