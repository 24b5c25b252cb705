# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid motions of a body: which of them are left free."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

__all__ = ["free_motions", "rigid_motions"]

_NAMES = {
    2: ("translation x", "translation y", "rotation"),
    3: (
        "translation x",
        "translation y",
        "translation z",
        "rotation about x",
        "rotation about y",
        "rotation about z",
    ),
}


def rigid_motions(V: fem.FunctionSpace) -> npt.NDArray[np.float64]:
    """Infinitesimal rigid motions at the local nodes, shape (3 or 6, nodes, dim).

    Rotations are about the centre of the body and divided by its size, so that all motions have
    the units of a displacement.
    """
    comm, dim = V.mesh.comm, V.mesh.geometry.dim
    x = V.tabulate_dof_coordinates()[:, :dim]
    low = comm.allreduce(x.min(axis=0, initial=np.inf), op=_MIN)
    high = comm.allreduce(x.max(axis=0, initial=-np.inf), op=_MAX)
    x = (x - (low + high) / 2) / np.linalg.norm(high - low)
    axes = [(0, 1)] if dim == 2 else [(1, 2), (2, 0), (0, 1)]
    modes = np.zeros((dim + len(axes), len(x), dim))
    for i in range(dim):
        modes[i, :, i] = 1.0
    for k, (i, j) in enumerate(axes):
        modes[dim + k, :, i], modes[dim + k, :, j] = -x[:, j], x[:, i]
    return modes


def _MIN(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.minimum(a, b)


def _MAX(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.maximum(a, b)


def free_motions(
    K: PETSc.Mat, V: fem.FunctionSpace, fixed: npt.NDArray[np.bool_]
) -> npt.NDArray[np.float64]:
    """Combinations of rigid motions that neither the stiffness nor Dirichlet data resist.

    Args:
        K: stiffness of the body without Dirichlet rows.
        V: displacement space.
        fixed: local nodes x dim, components that Dirichlet data fix.

    Returns:
        Motions at the local nodes, shape (number of free motions, nodes, dim). Collective.
    """
    modes = rigid_motions(V)
    n = V.dofmap.index_map.size_local
    held = np.where(fixed[None, :n], modes[:, :n], 0.0).reshape(len(modes), -1)
    x, y = K.createVecRight(), K.createVecLeft()
    scale = K.norm(PETSc.NormType.NORM_INFINITY)
    forces = []
    for mode in modes:
        x.array[:] = mode[:n].reshape(-1)
        K.mult(x, y)
        forces.append(y.array.copy() / scale)
    x.destroy(), y.destroy()
    rows = np.hstack([held, np.array(forces)])
    return combine(V.mesh.comm.allreduce(rows @ rows.T), modes)


def combine(
    gram: npt.NDArray[np.float64], modes: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Combinations of ``modes`` on which the Gram matrix vanishes (to 1e-16 of one node)."""
    values, vectors = np.linalg.eigh(gram)
    return np.einsum("ab,bnd->and", vectors[:, values < 1e-14].T, modes)


def describe(free: npt.NDArray[np.float64], V: fem.FunctionSpace) -> str:
    """Which rigid motions take part in ``free``, in words. Collective."""
    modes = rigid_motions(V)
    n = V.dofmap.index_map.size_local
    comm = V.mesh.comm
    A = modes[:, :n].reshape(len(modes), -1)
    B = free[:, :n].reshape(len(free), -1)
    coefficients = np.linalg.solve(comm.allreduce(A @ A.T), comm.allreduce(A @ B.T))
    size = np.abs(coefficients).max(axis=1)
    names = _NAMES[V.mesh.geometry.dim]
    return ", ".join(name for name, s in zip(names, size, strict=True) if s > 1e-6 * size.max())
