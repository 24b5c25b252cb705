# SPDX-License-Identifier: LGPL-3.0-or-later
"""Who holds the body: contact, the support of Dirichlet data, and what acts from outside.

The rows of the displacement are R = R_bulk - C with the contact forces C. Where no Dirichlet data
are they vanish; elsewhere they are the reactions of the support. Internal forces do no work on
translations, so that minus the sum of R_bulk is the resultant of all that acts in the bulk form
from outside (loads, springs). Of a solution

    contact + support + external = 0

where contact is summed from the tables, support from the rows of Dirichlet dofs, and external from
the bulk form alone: nothing is inferred from the rest. Moments are not compared.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import fem, la

from dolfinx_contact.trace import facet_closures

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.surface import ContactSurface
    from dolfinx_contact.tables import ContactTable

__all__ = ["Balance", "balance", "support_at_nodes", "support_at_vertices"]

logger = logging.getLogger(__name__)

_LARGEST_IMBALANCE = 1e-6  # of all forces, above which there is a warning
_NO_STRAIN = 1e-9


@dataclass(frozen=True)
class Balance:
    """Resultants of the forces on a body.

    Attributes:
        support: of the reactions of all Dirichlet data (dim,).
        external: of all else that acts in the bulk form (dim,).
        imbalance: |contact + support + external| over the sum of the sizes of all forces.
    """

    support: npt.NDArray[np.float64]
    external: npt.NDArray[np.float64]
    imbalance: float


def balance(
    problem: ContactProblem, tables: Iterable[ContactTable], displacement: float
) -> Balance:
    """The balance of forces at the problem's Functions and last residual. Collective.

    Logs a warning if the imbalance is above 1e-6.

    Args:
        problem: the contact problem.
        tables: of all its surfaces.
        displacement: size of the largest, for what counts as round-off.
    """
    comm, n = problem.comm, problem.V.dofmap.index_map.size_local
    reactions = support_at_nodes(problem)[:n]
    support = comm.allreduce(reactions.sum(axis=0))
    external = -comm.allreduce(_bulk_rows(problem).sum(axis=0))
    contact, size = np.zeros_like(support), 0.0
    for t in tables:
        contact += t.force.sum(axis=0)
        size += float(np.linalg.norm(t.force, axis=1).sum())
    size += comm.allreduce(float(np.linalg.norm(reactions, axis=1).sum()))
    size += float(np.linalg.norm(external))
    # Stresses at a strain of nothing, (I + grad u) less I, are round-off of the moduli.
    nothing = _NO_STRAIN * problem.stiffness_scale * problem.body_size
    size = max(size, nothing, problem.round_off_force(displacement))
    imbalance = float(np.linalg.norm(contact + support + external)) / size
    if not imbalance <= _LARGEST_IMBALANCE and comm.rank == 0:
        logger.warning(
            "the forces on the body are out of balance by %.1e of their size: contact %s, support "
            "%s, external %s; a smaller snes_rtol may be wanted",
            imbalance,
            contact,
            support,
            external,
        )
    return Balance(support, external, imbalance)


def _bulk_rows(problem: ContactProblem) -> npt.NDArray[np.float64]:
    """Rows of the bulk form, whose sum over all ranks is that over all nodes (n, dim). Collective.

    Of a linear body by its stiffness where that is kept, which is cheaper than assembly.
    """
    bs = problem.V.dofmap.index_map_bs
    rows = problem.bulk.affine_residual(problem.u.x.array)
    if rows is None:
        # Every rank's contributions count once, whoever owns the rows.
        b = la.vector(problem.V.dofmap.index_map, bs)
        b.array[:] = 0.0
        fem.assemble_vector(b.array, problem.bulk.residual_form)
        rows = b.array
    return np.asarray(rows).reshape(-1, bs)


def support_at_nodes(problem: ContactProblem) -> npt.NDArray[np.float64]:
    """Reactions of Dirichlet data on the body at the local nodes (n, dim). Collective.

    They are 0 in the components that none fix.
    """
    reaction, owned = fem.Function(problem.V), problem.owned_sizes[0]
    fixed = problem.constraints.fixed.reshape(-1)[:owned]
    reaction.x.array[:owned] = np.where(fixed, problem.reactions, 0.0)
    reaction.x.scatter_forward()
    return reaction.x.array.reshape(-1, problem.V.dofmap.index_map_bs).copy()


def support_at_vertices(problem: ContactProblem, s: ContactSurface) -> npt.NDArray[np.float64]:
    """Reactions of Dirichlet data at the local vertices of a surface (n, dim). Collective.

    The reaction of a node between vertices goes to these by their hat functions, so that the sum is
    that of all nodes of the surface.
    """
    reactions = support_at_nodes(problem)
    if s.degrees[0] == 1:
        return reactions[s.vertex_trace_dofs]
    V, tdim = problem.V, s.dim
    topology, index_map = V.mesh.topology, V.dofmap.index_map
    facets = s.submesh.parent_facets[: s.submesh.mesh.topology.index_map(tdim - 1).size_local]
    to_cells = topology.connectivity(tdim - 1, tdim)
    nodes, closures = (
        V.dofmap.list[to_cells.array[to_cells.offsets[facets]]],
        facet_closures(V, facets),
    )
    # A node of several facets is shared among these first, whichever rank has them.
    count = la.vector(index_map, 1)
    count.array[:] = 0.0
    np.add.at(count.array, closures, 1.0)
    count.scatter_reverse(la.InsertMode.add)
    count.scatter_forward()
    share = reactions / np.maximum(count.array, 1.0)[:, None]
    on_facet = (nodes[:, :, None] == closures[:, None, :]).any(axis=2)
    hats, corners = _hats(V)
    parts = np.einsum("pv,cp,cpd->cvd", hats, on_facet, share[nodes])
    sums = la.vector(index_map, tdim)
    sums.array[:] = 0.0
    np.add.at(sums.array.reshape(-1, tdim), nodes[:, corners], parts)
    sums.scatter_reverse(la.InsertMode.add)
    sums.scatter_forward()
    return np.asarray(sums.array.reshape(-1, tdim)[s.vertex_trace_dofs])


def _hats(V: fem.FunctionSpace) -> tuple[npt.NDArray[np.float64], list[int]]:
    """Hat functions of a cell at its nodes (nodes, vertices), and the nodes at its vertices."""
    cell = V.mesh.basix_cell()
    corners = basix.geometry(cell)
    linear = basix.create_element(basix.ElementFamily.P, cell, 1)
    layout = V.dofmap.dof_layout
    nodes = [int(layout.entity_dofs(0, i)[0]) for i in range(len(corners))]
    points = V.ufl_element().sub_elements[0].basix_element.points
    return np.round(linear.tabulate(0, points)[0, :, :, 0], 12), nodes
