# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact between two bodies, or between the sides of a crack."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dolfinx import mesh

from dolfinx_contact._mpi import SharedValues, keep, require
from dolfinx_contact.meshing import GmshMesh
from dolfinx_contact.obstacles import Obstacle
from dolfinx_contact.points.descriptions import ContactPair, ContactSurface, Overlap
from dolfinx_contact.points.held_ends import held_in_place, in_place, resting
from dolfinx_contact.points.opposite import Opposite, OppositeFacets
from dolfinx_contact.points.revolution import check_section
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import exterior_facets, tagged_facets

__all__ = ["DiscretePair"]


class DiscretePair(DiscreteSurface):
    """Discretisation of a `ContactPair`. Collective.

    Args:
        pair: description of the pair.

    Raises:
        ValueError: on every rank, as `DiscreteSurface`; and if the faces have facets in common, do
            not match where they must, have equal normals, touch at a node without matching, or
            overlap more than allowed. The overlap may exceed round-off only for faces that do not
            match, by at most 5 % of a facet, since facets of curved faces are chords. With large
            sliding also if the slave has an edge, the faces share a node, or the master lies behind
            the slave.
    """

    def __init__(self, pair: ContactPair):
        V = pair.u.function_space
        name = pair.name
        keep(V.mesh)
        facets = pair.facets if pair.master_facets is None else pair.master_facets
        sides = [
            _facets_of_side(V.mesh, pair.facets, pair.slave, f"{name}, slave"),
            _facets_of_side(V.mesh, facets, pair.master, f"{name}, master"),
        ]
        self.master_facets = sides[1]
        if pair.axisymmetric:
            check_section(V.mesh, sides[1], f"{name}, master")
        large = pair.sliding == "large"
        overlap = Overlap.of(name, pair.interference, pair.remove_overlap)
        master: Obstacle
        if large:
            from dolfinx_contact.points.sliding.points import SlidingFacets, check_slave

            planes = pair.symmetry or {}
            master = SlidingFacets(V, sides[0], sides[1], pair.search_distance, name, planes=planes)
        else:
            master = OppositeFacets(
                V,
                sides[0],
                sides[1],
                gap=pair.gap,
                surface=pair.surface,
                normal=None if pair.normal is None else np.asarray(pair.normal),
                overlap=overlap,
                axisymmetric=pair.axisymmetric,
                name=name,
            )
        super().__init__(
            ContactSurface(
                pair.u,
                sides[0],
                obstacle=master,
                law=pair.law,
                method="mixed" if large else pair.method,
                multiplier_degree=pair.multiplier_degree,
                quadrature_degree=pair.quadrature_degree,
                axisymmetric=pair.axisymmetric,
                name=name,
            )
        )
        self.description = pair
        self._given_gap = ""
        if large:
            check_slave(
                self.points,
                self.law_at_points,
                name,
                overlap,
                axisymmetric=pair.axisymmetric,
            )
            return
        #: Opposing points while no basis function of a node is given away.
        self._apart: Opposite = self.obstacle.opposite
        self._overlap = overlap
        if np.isfinite(overlap.most) and (pair.gap is not None or pair.surface is not None):
            self._given_gap = "given gap" if pair.surface is None else "gap to the given surface"
        self.check_gaps()

    def check_gaps(self) -> None:
        if not self._given_gap:
            return
        gaps = self.points.vertex_gaps
        worst = self.comm.allreduce(float(np.min(gaps, initial=np.inf)), op=min)
        words = "interference=True for a press fit"
        if self._overlap.presses:
            words = f"interference allows {self._overlap.most:.3g}"
        require(
            self.comm,
            not self._overlap.exceeded_by(worst),
            f"{self.name}: the {self._given_gap} is {worst:.3g}; {words}",
        )

    def hold(self, fixed: npt.NDArray[np.bool_], crossing: npt.NDArray[np.bool_]) -> None:
        """Give away the functions of nodes without a multiplier; see `held_ends`. Collective.

        Of faces that do not match these are the nodes whose jump is fixed.

        Args:
            fixed: local nodes x dim, by Dirichlet data.
            crossing: local vertices at which pairs cross.

        Raises:
            ValueError: if there is no node beside a crossing that could take its part.
        """
        if self.slides:
            self.points.require_held(fixed, self.name)
            return
        V = self.u.function_space
        trace = self.points.vertex_trace_dofs
        matching = self._apart.matching
        self._check_crossing(crossing)
        given = crossing
        if self.method != "integral" and self.degrees[0] == 1 and not matching:
            given = crossing | held_in_place(V, self._apart, fixed)[trace]
        idle = np.all(resting(V, self._apart, fixed)[trace], axis=1)
        given = self.points.give(given, idle & ~given)
        left = np.flatnonzero(
            (crossing & ~given)[: self.points.vertices.dofmap.index_map.size_local]
        )
        x = self.node_positions[trace[left]]
        first = next((row.tolist() for rows in self.comm.allgather(x) for row in rows), None)
        require(
            self.comm,
            first is None,
            f"{self.name}: crosses other pairs at ({_shown(first)}), where it has no node beside "
            "the crossing that could take its part: between a crossing and its end, or the next "
            "crossing, it needs two facets; refine the mesh, or end one of the cracks before",
        )
        if matching:
            return
        marks = SharedValues(V.dofmap.index_map).sums(trace, given.astype(float))
        object.__setattr__(self.obstacle, "opposite", in_place(self._apart, marks > 0))

    def _check_crossing(self, crossing: npt.NDArray[np.bool_]) -> None:
        """Raise ``ValueError`` if multipliers cannot leave out a crossing. Collective."""
        degree = self.degrees[1]
        crosses = self.comm.allreduce(int(crossing.any()))
        require(
            self.comm,
            degree == 1 or not crosses,
            f"{self.name}: crosses other pairs, where a multiplier of degree {degree} is not "
            "unique; take multiplier_degree=1",
        )


def _shown(x: list[float] | None) -> str:
    """A position, without the round-off of zeros."""
    return ", ".join(f"{round(c, 12) + 0.0:.6g}" for c in x or [])


def _facets_of_side(
    domain: mesh.Mesh,
    facets: GmshMesh | mesh.MeshTags | npt.NDArray[np.int32],
    tag: int | str | None,
    side: str,
) -> npt.NDArray[np.int32]:
    """Exterior facets of the slave or the master on this rank. Collective."""
    return exterior_facets(domain, *tagged_facets(domain.comm, facets, tag, side), side)
