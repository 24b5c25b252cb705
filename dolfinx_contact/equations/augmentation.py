# SPDX-License-Identifier: LGPL-3.0-or-later
"""The typical stiffness of a body, and the augmentation parameter that it suggests."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._errors import require
from dolfinx_contact.points.surface import ContactSurface

__all__ = ["automatic_augmentation", "require_hoop_stiffness", "softness"]

_NO_HOOP = 1e-12  # of the stiffness, a resistance that is none


def automatic_augmentation(
    K: PETSc.Mat, V: fem.FunctionSpace, surfaces: Sequence[ContactSurface], body_size: float
) -> tuple[float, list[npt.NDArray[np.float64]], list[npt.NDArray[np.float64]]]:
    """Mean diagonal entry of the stiffness; at the local vertices of each surface r, and stiffness.

    The stiffness of a vertex is that of its node alone, over its area: a traction over it is what
    the node would give way under that traction.

    The automatic r is near Young's modulus over the size of the body, taken from the diagonal of
    the stiffness. A small r sends a point that slips the wrong way to stick; a large one (the nodal
    stiffness, say) sends it to slip the other way, and Newton's method into a cycle. The diagonal
    of a nearly incompressible body is that of its resistance to compression, by which it hardly
    yields to a contact: beyond Poisson's ratio 0.4 r falls with the square root of the `softness`,
    between the two stiffnesses. At 0.499 full steps then converge where they cycled (measured).

    Raises:
        ValueError: if the stiffness is zero or not finite. Collective.
    """
    comm = V.mesh.comm
    bs = V.dofmap.index_map_bs
    n = V.dofmap.index_map.size_local * bs
    diagonal = fem.Function(V)
    diagonal.x.array[:n] = np.abs(K.getDiagonal().array)
    diagonal.x.scatter_forward()
    size = comm.allreduce(float(np.sum(diagonal.x.array[:n])))
    require(
        comm,
        bool(np.isfinite(size)) and size > 0,
        "the stiffness of the bulk is zero or not finite at the starting displacement",
    )
    per_node = diagonal.x.array.reshape(-1, bs).mean(axis=1)
    around = surfaces[0].axisymmetric
    automatic = []
    at_vertices = []
    soft = np.sqrt(min(2.0 * softness(K, V, axisymmetric=around), 1.0))
    for s in surfaces:
        # Of two bodies that touch both yield.
        other = s._opposite(per_node)
        pair = np.divide(per_node * other, per_node + other, where=other > 0, out=per_node.copy())
        width = (s.points.vertex_areas / s.points.circumferences) ** (1 / (s.dim - 1))
        stiffness = pair[s.points.vertex_trace_dofs] / s.points.vertex_areas
        automatic.append(soft * stiffness * width / body_size)
        at_vertices.append(stiffness)
    return size / (V.dofmap.index_map.size_global * bs), automatic, at_vertices


def require_hoop_stiffness(K: PETSc.Mat) -> None:
    """``ValueError`` if a stiffness resists no radial translation, as that of a plane body does.

    Collective.
    """
    u, f = K.createVecs()
    u.array.reshape(-1, 2)[:, 0] = 1.0
    K.mult(u, f)
    resists = f.norm(PETSc.NormType.NORM_INFINITY)
    u.destroy(), f.destroy()
    require(
        K.comm.tompi4py(),
        resists > _NO_HOOP * K.norm(PETSc.NormType.NORM_INFINITY),
        "the contact surfaces are axisymmetric, but the bulk is that of a plane body: take "
        "materials.Axisymmetric, and circumference(mesh) as the weight of its energy",
    )


def softness(K: PETSc.Mat, V: fem.FunctionSpace, *, axisymmetric: bool = False) -> float:
    """Median over mean eigenvalue of the stiffness of the body to uniform strains. Collective.

    The energies of displacements E x with a constant symmetric E are those of Voigt's average of
    the elasticity tensor (Hill, Proc. Phys. Soc. A 65, 1952), whose eigenvalues are 2 mu
    (five times in 3D) and 3 lambda + 2 mu for an isotropic body: 4 mu / (4 mu + lambda), which is
    0.73 for Poisson's ratio 0.3 and 0.008 for 0.499. Of a body of revolution they are (r, 0), with
    the same strain around, (0, z) and (0, r).
    """
    dim = V.mesh.geometry.dim
    n = V.dofmap.index_map.size_local
    x = V.tabulate_dof_coordinates()[:n, :dim]
    gradients = [np.diag(row) for row in np.eye(dim)]
    for i, j in combinations(range(dim), 2):
        gradients.append(np.zeros((dim, dim)))
        gradients[-1][i, j] = gradients[-1][j, i] = np.sqrt(0.5)
    if axisymmetric:
        gradients = [np.diag([np.sqrt(0.5), 0.0]), gradients[1], np.sqrt(2.0) * np.eye(2, k=1)]
    fields = [(x @ gradient).reshape(-1) for gradient in gradients]
    u, f = K.createVecs()
    energies = np.empty((len(fields), len(fields)))
    for column, a in enumerate(fields):
        u.array[:] = a
        K.mult(u, f)
        energies[:, column] = [b @ f.array_r for b in fields]
    u.destroy(), f.destroy()
    energies = V.mesh.comm.allreduce(energies)
    eigenvalues = np.linalg.eigvalsh(0.5 * (energies + energies.T))
    share = np.median(eigenvalues) / np.mean(eigenvalues)
    # A body on the way to instability has no typical stiffness in this sense.
    return float(max(share, 1e-4)) if eigenvalues[0] > 0 else 1.0
