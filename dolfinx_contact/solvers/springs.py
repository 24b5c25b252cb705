# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Springs that hold bodies together where they touch, for a hierarchy of multigrid.

On a rigid obstacle closed nodes are held. Between bodies they move together, which coarse levels
have to know: the hierarchy is built from

    K + B_c^T kappa B_c

with the rows c of B at the closed points. The spring of a point is as stiff as the nodes that it
joins, in series: kappa = 1 / sum_k b_k^2 / K_kk, times its share of the area of a node where there
are more points than nodes. Stiffer ones spoil the smoother; and what springs leave open is some
compliance across one layer of cells, which the exact solve on the surface mends.
"""

from __future__ import annotations

from collections.abc import Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._entries import Entries, matrix_of
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.points.trace import at_global_places

__all__ = ["springs"]


def springs(
    equations: ContactEquations,
    stiffness: PETSc.Mat,
    closed: Sequence[npt.NDArray[np.bool_]],
) -> PETSc.Mat | None:
    """B_c^T kappa B_c in the numbering of the stiffness, None where there are no pairs. Collective.

    Args:
        equations: the contact problem.
        stiffness: K.
        closed: which points of this rank are closed, pair by pair.
    """
    pairs = [s for s in equations.surfaces if s.between_bodies]
    if not pairs:
        return None
    dim = equations.dim
    diagonal = stiffness.getDiagonal()
    compliance = 1.0 / diagonal.array_r.reshape(-1, dim).mean(axis=1)
    diagonal.destroy()
    rows = []
    columns = []
    values = []
    for s, points in zip(pairs, closed, strict=True):
        stencils = s.constant_operator("multigrid of bodies that touch").stencils
        b = stencils.weights
        nodes = stencils.nodes
        soft = at_global_places(equations.comm, compliance, nodes)
        share = points * s.points.areas / s.points.from_vertices(s.points.vertex_areas)
        kappa = share[stencils.points] / np.einsum("gpk,gk->gp", b**2, soft)
        joined = np.einsum("gp,gpk,gpl->gkl", kappa, b, b, optimize=True)
        shape = (*joined.shape, dim)
        places = dim * nodes[..., None] + np.arange(dim)
        rows.append(np.broadcast_to(places[:, :, None], shape).reshape(-1))
        columns.append(np.broadcast_to(places[:, None], shape).reshape(-1))
        values.append(np.repeat(joined.reshape(-1), dim))
    entries = Entries(np.concatenate(rows), np.concatenate(columns))
    size = stiffness.getLocalSize()
    A = matrix_of(equations.comm, size, entries)
    entries.add(np.concatenate(values), A)
    return A
