# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact between two bodies, or between the sides of a crack, in small sliding."""

from __future__ import annotations

import numpy as np

from dolfinx_contact._arrays import Indices, Mask
from dolfinx_contact._mpi import SharedValues, keep, minimum, require
from dolfinx_contact.points.descriptions import ContactPair
from dolfinx_contact.points.opposite import Opposite, OppositeFacets
from dolfinx_contact.points.revolution import check_section
from dolfinx_contact.points.shared_functions import clamped_ends, in_place, resting
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import exterior_facets, owned_facets

__all__ = ["DiscretePair", "facets_of_sides"]


class DiscretePair(DiscreteSurface):
    """Discretisation of a `ContactPair` in small sliding. Methods are collective.

    Args:
        pair: description of the pair.

    Raises:
        ValueError: on every rank, for the reasons listed in `DiscreteSurface`; or if the faces have
            common facets, have normals in the same direction, overlap by more than is allowed, do
            not match although their elements require it, or share nodes although they do not match.
            For faces that do not match, an overlap of up to 5 % of a facet is always allowed,
            because facets of curved faces are chords.
    """

    def __init__(self, pair: ContactPair):
        slave, master = facets_of_sides(pair)
        obstacle = OppositeFacets(pair, slave, master)
        super().__init__(pair, slave, obstacle)
        #: Opposing points before basis functions of nodes are distributed.
        self._apart: Opposite = obstacle.opposite
        self._given_gap = ""
        if np.isfinite(self._overlap.most) and (pair.gap is not None or pair.surface is not None):
            self._given_gap = "given gap" if pair.surface is None else "gap to the given surface"
        self.check_gaps()

    def check_gaps(self) -> None:
        """Raise ``ValueError`` if a given gap is negative by more than is allowed. Collective."""
        if not self._given_gap:
            return
        worst = minimum(self.comm, self.points.vertex_gaps, np.inf)
        words = "interference=True for a press fit"
        if self._overlap.presses:
            words = f"interference allows {self._overlap.most:.3g}"
        require(
            self.comm,
            not self._overlap.exceeded_by(worst),
            f"{self.name}: the {self._given_gap} is {worst:.3g}; {words}",
        )

    def fixed_jumps(self, fixed: Mask) -> Mask:
        return resting(self.u.function_space, self.obstacle.opposite, fixed)

    def hold(self, fixed: Mask, crossing: Mask) -> None:
        """Distribute the basis functions of nodes without a multiplier. Collective.

        For faces that do not match, nodes with a fixed jump are included (`shared_functions`).

        Args:
            fixed: mask of the components fixed by Dirichlet data, shape (local nodes, dim).
            crossing: mask of the local vertices at which pairs cross.

        Raises:
            ValueError: if no node next to a crossing can receive its basis function, or a
                multiplier of degree 2 is not unique there.
        """
        V = self.u.function_space
        trace = self.points.vertex_nodes
        require(
            self.comm,
            self.degrees.multiplier == 1 or not crossing.any(),
            f"{self.name}: crosses other pairs, where a multiplier of degree "
            f"{self.degrees.multiplier} is not unique; take multiplier_degree=1",
        )
        matching = self._apart.matching
        given = crossing
        if not self.is_weak and self.degrees.displacement == 1 and not matching:
            given = crossing | clamped_ends(V, self._apart, fixed)[trace]
        idle = np.all(resting(V, self._apart, fixed)[trace], axis=1)
        given = self.points.give(given, idle & ~given)
        owned = self.points.vertices.dofmap.index_map.size_local
        left = np.flatnonzero((crossing & ~given)[:owned])
        x = np.round(self.node_positions[trace[left]], 12) + 0.0
        require(
            self.comm,
            not len(left),
            f"{self.name}: crosses other pairs at ({', '.join(f'{c:.6g}' for c in x[:1].flat)}), "
            "where it has no node beside the crossing that could take its part: between a crossing "
            "and its end, or the next crossing, it needs two facets; refine the mesh, or end one "
            "of the cracks before",
        )
        if not matching:
            marks = SharedValues(V.dofmap.index_map).marked(trace[given])
            self.obstacle.opposite = in_place(self._apart, marks)
        places = self._apart.places
        here = np.where(places.none[:, None], fixed, resting(V, places, fixed))
        self._mirror(here, places)


def facets_of_sides(pair: ContactPair) -> tuple[Indices, Indices]:
    """Return the local facets of the slave and of the master of a pair. Collective.

    Raises:
        ValueError: on every rank, if slave and master have facets in common.
    """
    domain, name = pair.u.function_space.mesh, pair.name
    keep(domain)
    masters = pair.facets if pair.master_facets is None else pair.master_facets
    slave = exterior_facets(domain, pair.facets, pair.slave, f"{name}, slave")
    master = exterior_facets(domain, masters, pair.master, f"{name}, master")
    common = domain.comm.allreduce(len(owned_facets(domain, np.intersect1d(slave, master))))
    require(
        domain.comm,
        common == 0,
        f"{name}: slave and master have {common} facets in common; for a face that may touch "
        "itself there is SelfContact",
    )
    if pair.axisymmetric:
        check_section(domain, master, f"{name}, master")
    return slave, master
