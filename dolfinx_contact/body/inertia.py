# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Mass matrix of a body: consistent, lumped, or redistributed from potential contact nodes.

consistent
    M_ij = integral of rho phi_i phi_j, with the density rho and the basis functions phi_i.
lumped
    diagonal: row sums of the consistent matrix for P1; for P2, where row sums vanish at vertices,
    its scaled diagonal (Hinton, Rock and Zienkiewicz, Earthq. Eng. Struct. Dyn. 4, 1976). One
    scaling factor for all cells preserves the total mass.
redistributed
    no mass at potential contact nodes (Khenous, Laborde and Renard, Eur. J. Mech. A 27, 2008).
    Their mass is moved to the diagonal entries of neighbouring nodes, in proportion to the entries
    of M. The total mass is preserved, and the centre of mass moves by a fraction of a cell.
"""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

from petsc4py import PETSc

import numpy as np
import scipy.linalg

import dolfinx.fem.petsc
import ufl
from dolfinx import fem

from dolfinx_contact._arrays import Mask
from dolfinx_contact._forms import compiled_form
from dolfinx_contact._mpi import require
from dolfinx_contact._petsc import destroy, product
from dolfinx_contact.body.rigid import Parts, combine

__all__ = ["Mass", "inertia_error", "mass_matrix"]

#: Kinds of mass matrices.
Mass: TypeAlias = Literal["consistent", "lumped", "redistributed"]

_FINE = 6  # degree of the quadrature rule for the sign of a density
_ROUND_OFF = 1e-12  # mass relative to the mass of a cell, below which it counts as zero


def mass_matrix(V: fem.FunctionSpace, density: Any, kind: Mass, touching: Mask) -> PETSc.Mat:
    """Return the mass matrix of a body. Collective.

    Args:
        V: space of the displacement.
        density: mass per volume (per area in 2D, for unit thickness), a number, Constant, Function
            or UFL expression.
        kind: kind of the mass matrix: ``"consistent"``, ``"lumped"`` or ``"redistributed"``.
        touching: mask of the owned dofs of potential contact nodes.

    Raises:
        ValueError: on every rank, if the density is not positive in all cells, or if all nodes are
            potential contact nodes, so that no node could carry mass.
    """
    _check_density(V, density)
    u = ufl.TrialFunction(V)
    v = ufl.TestFunction(V)
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


def inertia_error(
    V: fem.FunctionSpace,
    M: PETSc.Mat,
    consistent: PETSc.Mat,
    fixed: Mask,
    *,
    axisymmetric: bool,
) -> float:
    """Return the largest relative error of rigid accelerations by a mass matrix M. Collective.

    Let the columns of R be the rigid motions permitted by the Dirichlet conditions, G = R^T M R,
    and G_0 = R^T M_0 R with the consistent mass matrix M_0, which is exact for rigid motions. A
    force that causes the rigid acceleration R a with M_0 causes R G^-1 G_0 a with M. The relative
    error is the largest abs(c - 1) of all eigenvalues c of G_0 a = c G a.

    Args:
        V: space of the displacement.
        M: mass matrix whose error is computed.
        consistent: consistent mass matrix M_0.
        fixed: mask of components with Dirichlet conditions, shape (local nodes, dim).
        axisymmetric: whether the body is a body of revolution.
    """
    comm = V.mesh.comm
    n = V.dofmap.index_map.size_local
    parts = Parts(V, axisymmetric=axisymmetric)
    modes = parts.motions()
    modes = combine(parts.gram_at_fixed(modes, fixed), modes)
    if not len(modes):
        return 0.0
    rows = modes[:, :n].reshape(len(modes), -1)
    G, G0 = (
        comm.allreduce(rows @ np.array([product(A, row) for row in rows]).T)
        for A in (M, consistent)
    )
    ratios = 1.0 / np.maximum(scipy.linalg.eigh(G, G0, eigvals_only=True), 1e-300)
    return float(np.max(np.abs(ratios - 1.0)))


def _check_density(V: fem.FunctionSpace, density: Any) -> None:
    """Raise ``ValueError`` if a density is not positive. Collective.

    A density may vanish at points of a cell, but not in the mean, and must not be negative.
    """
    domain = V.mesh
    W = fem.functionspace(domain, ("DG", 0))
    n = W.dofmap.index_map.size_local
    rho = density * fem.Constant(domain, 1.0)
    dx = ufl.dx(domain, metadata={"quadrature_degree": _FINE})
    mass, negative = (
        fem.assemble_vector(compiled_form(e * ufl.TestFunction(W) * dx)).array[:n]
        for e in (rho, ufl.min_value(rho, 0.0))
    )
    # comparisons with NaN are False
    positive = (mass > 0) & (mass < np.inf) & (negative >= -_ROUND_OFF * mass)
    require(domain.comm, bool(positive.all()), "the density must be positive everywhere")


def _lumped(M: PETSc.Mat, degree: int) -> PETSc.Mat:
    """Return the diagonal lumped mass matrix with the same total mass as M. Collective."""
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


def _redistribute(M: PETSc.Mat, around: PETSc.Mat, touching: Mask) -> None:
    """Move the mass of potential contact nodes in M to neighbouring nodes. Collective."""
    start = M.getOwnershipRange()[0]
    weights = around.copy()
    indptr, indices, values = weights.getValuesCSR()
    weights.setValuesCSR(indptr, indices, np.abs(values))
    weights.assemble()
    mass = M.getRowSum()
    total = mass.sum()
    marked, added = M.createVecs()
    marked.array[:] = touching
    M.mult(marked, added)  # mass that is shared with potential contact nodes
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
    destroy(weights, mass, marked, added, near, diagonal)
