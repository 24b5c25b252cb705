# SPDX-License-Identifier: LGPL-3.0-or-later
"""The typical stiffness of a body, and the augmentation parameter that it suggests."""

from __future__ import annotations

from collections.abc import Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._errors import require
from dolfinx_contact.surface import ContactSurface

__all__ = ["automatic_augmentation"]


def automatic_augmentation(
    K: PETSc.Mat, V: fem.FunctionSpace, surfaces: Sequence[ContactSurface], body_size: float
) -> tuple[float, list[npt.NDArray[np.float64]]]:
    """Mean diagonal entry of the stiffness, and r at the local vertices of each surface.

    The automatic r is near Young's modulus over the size of the body, taken from the diagonal of
    the stiffness. A small r sends a point that slips the wrong way to stick; a large one (the nodal
    stiffness, say) sends it to slip the other way, and Newton's method into a cycle.

    Raises:
        ValueError: if the stiffness is zero or not finite. Collective.
    """
    comm, bs = V.mesh.comm, V.dofmap.index_map_bs
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
    automatic = []
    for s in surfaces:
        width = s.vertex_areas ** (1 / (s.dim - 1))
        stiffness = per_node[s.vertex_trace_dofs] / s.vertex_areas
        automatic.append(stiffness * width / body_size)
    return size / (V.dofmap.index_map.size_global * bs), automatic
