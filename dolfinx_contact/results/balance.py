# SPDX-License-Identifier: LGPL-3.0-or-later
"""Who holds the body: contact, the support of Dirichlet data, and what acts from outside.

The rows of the displacement are R = R_bulk - C with the contact forces C. Where no Dirichlet data
are they vanish; elsewhere they are the reactions of the support. Internal forces do no work on
translations, so that minus the sum of R_bulk is the resultant of all that acts in the bulk form
from outside (loads, springs). Of a solution

    contact + support + external = 0

where contact is summed from the tables, support from the rows of Dirichlet dofs, and external from
the bulk form alone: nothing is inferred from the rest. Moments are not compared. Of a body of
revolution the balance is that along the axis, across which forces cancel.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import fem

from dolfinx_contact._compat import FacetSubmesh
from dolfinx_contact._shared import SharedValues
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.points.trace import facet_closures

__all__ = ["Balance", "balance", "forces_at_vertices", "support_at_nodes"]

logger = logging.getLogger(__name__)

_LARGEST_IMBALANCE = 1e-6  # of all forces, above which there is a warning
_NO_STRAIN = 1e-9


class ContactForces(Protocol):
    """A table of contact points: forces on the body (n, dim)."""

    @property
    def force(self) -> npt.NDArray[np.float64]:
        """Contact force on the body."""

    def resultant(self, forces: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """The sum of forces at the points."""


@dataclass(frozen=True)
class Balance:
    """Resultants of the forces on a body.

    Attributes:
        support: of the reactions of all Dirichlet data (dim,).
        external: of all else that acts in the bulk form (dim,).
        imbalance: |contact + support + external| over the sum of the sizes of all forces, but for
            what is across planes of symmetry with images behind them.
    """

    support: npt.NDArray[np.float64]
    external: npt.NDArray[np.float64]
    imbalance: float


def balance(
    eq: ContactEquations,
    state: Evaluation,
    tables: Iterable[ContactForces],
    supports: npt.NDArray[np.float64],
) -> Balance:
    """The balance of forces at a state. Collective.

    Logs a warning if the imbalance is above 1e-6.

    Args:
        eq: the contact problem.
        state: with reactions.
        tables: of all surfaces, in their order.
        supports: reactions of Dirichlet data, as `support_at_nodes` has them.
    """
    comm = eq.comm
    n = eq.V.dofmap.index_map.size_local
    reactions = supports[:n]
    support = eq.resultant(reactions)
    external = eq.resultant(-eq.bulk.local_rows(state.u))
    contact = np.zeros_like(support)
    size = 0.0
    for s, t in zip(eq.surfaces, tables, strict=True):
        if not s.between_bodies:  # else it acts on both of what is one whole here
            contact += t.resultant(t.force)
        size += float(np.linalg.norm(t.force, axis=1).sum())
    size += comm.allreduce(float(np.linalg.norm(reactions, axis=1).sum()))
    size += float(np.linalg.norm(external))
    # Stresses at a strain of nothing, (I + grad u) less I, are round-off of the moduli.
    nothing = _NO_STRAIN * eq.stiffness_scale * eq.body_size
    moved = comm.allreduce(float(np.max(np.abs(state.u), initial=0.0)), op=max)
    size = max(size, nothing, eq.round_off_force(moved))
    left = contact + support + external
    left[_mirrored_axes(eq)] = 0.0
    imbalance = float(np.linalg.norm(left)) / size
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


def _mirrored_axes(eq: ContactEquations) -> list[int]:
    """Axes across planes of symmetry that have images behind them."""
    return sorted({axis for s in eq.surfaces if s.slides for axis in s.obstacle.opposite.planes})


def support_at_nodes(eq: ContactEquations, state: Evaluation) -> npt.NDArray[np.float64]:
    """Reactions of Dirichlet data on the body at the local nodes (n, dim). Collective.

    They are 0 in the components that none fix.
    """
    reaction = fem.Function(eq.V)
    owned = eq.owned_sizes[0]
    assert state.reactions is not None
    reaction.x.array[:owned] = np.where(eq.fixed[:owned], state.reactions, 0.0)
    reaction.x.scatter_forward()
    return reaction.x.array.reshape(-1, eq.dim).copy()


def forces_at_vertices(
    V: fem.FunctionSpace,
    submesh: FacetSubmesh,
    trace: npt.NDArray[np.int32],
    forces: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """Nodal forces at the local vertices of a surface (n, dim). Collective.

    The force of a node between vertices goes to these by their hat functions, so that the sum is
    that of all nodes of the surface.

    Args:
        V: displacement space.
        submesh: facets of the surface.
        trace: the nodes of V at its local vertices.
        forces: at the local nodes of V (n, dim).
    """
    if V.ufl_element().degree == 1:
        return np.asarray(forces[trace])
    tdim = V.mesh.topology.dim
    topology = V.mesh.topology
    index_map = V.dofmap.index_map
    facets = submesh.parent_facets[: submesh.mesh.topology.index_map(tdim - 1).size_local]
    to_cells = topology.connectivity(tdim - 1, tdim)
    nodes = V.dofmap.list[to_cells.array[to_cells.offsets[facets]]]
    closures = facet_closures(V, facets)
    # A node of several facets is shared among these first, whichever rank has them.
    at_nodes = SharedValues(index_map)
    count = at_nodes.sums(closures, np.ones(closures.shape))
    share = forces / np.maximum(count, 1.0)[:, None]
    on_facet = (nodes[:, :, None] == closures[:, None, :]).any(axis=2)
    hats, corners = _hats(V)
    parts = np.einsum("pv,cp,cpd->cvd", hats, on_facet, share[nodes])
    return at_nodes.sums(nodes[:, corners], parts)[trace]


def _hats(V: fem.FunctionSpace) -> tuple[npt.NDArray[np.float64], list[int]]:
    """Hat functions of a cell at its nodes (nodes, vertices), and the nodes at its vertices."""
    cell = V.mesh.basix_cell()
    corners = basix.geometry(cell)
    linear = basix.create_element(basix.ElementFamily.P, cell, 1)
    layout = V.dofmap.dof_layout
    nodes = [int(layout.entity_dofs(0, i)[0]) for i in range(len(corners))]
    points = V.ufl_element().sub_elements[0].basix_element.points
    return np.round(linear.tabulate(0, points)[0, :, :, 0], 12), nodes
