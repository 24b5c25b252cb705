# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points of a surface: three discretisations of one and the same law.

- ``"nodal"``: the points are the mesh nodes of the surface (vertex rule, P1 displacement). The
  conditions hold node by node (`node_points`).
- ``"integral"``: the points are Gauss points, of facets or of what two faces that do not match have
  in common; P1 or P2 displacement. The conditions hold weakly (`integral_points`).
- ``"mixed"``: the points are the vertices, and the multiplier is continuous and linear on every
  facet; P1 or P2 displacement. The conditions hold at every vertex for the means of gap and slip
  with the hat function of the vertex as weight (Hild, Int. J. Appl. Math. Comput. Sci. 12, 2002,
  section 2; Hild and Laborde, Appl. Numer. Math. 41, 2002). B is the inverse of the lumped mass
  times the integrals of hat functions and displacements (`node_points`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem

from dolfinx_contact._compat import FacetSubmesh, merge_entity_maps
from dolfinx_contact._forms import compiled_form
from dolfinx_contact._mpi import SharedValues
from dolfinx_contact.body.bulk import circumference
from dolfinx_contact.laws import PointData
from dolfinx_contact.points.descriptions import ContactMethod
from dolfinx_contact.points.evaluation import (
    Given,
    PointEvaluator,
    ScatteredEvaluator,
    blocked_space,
    fields_of,
    measure_of,
    point_space,
)
from dolfinx_contact.points.operators import (
    ConstantOperator,
    Operator,
    Stencils,
    multiplied,
    multiplied_transposed,
)
from dolfinx_contact.points.opposite import Opposite
from dolfinx_contact.points.trace import trace_dofs

__all__ = ["ContactPoints", "Evaluator", "Given", "Trace"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]
#: Global nodes and their weights (..., k) of local nodes of the displacement.
Trace = Callable[[npt.NDArray[np.int32]], tuple[Nodes, Array]]
Evaluator = PointEvaluator | ScatteredEvaluator


class ContactPoints(ABC):
    """The contact points of a surface, what is given there, and the operators B and E.

    Points are those of this rank; where they are vertices, in the order of these.

    Args:
        V: displacement space.
        submesh: of the facets.
        degrees: of displacement and multiplier.
        rule_degree: of the Gauss points of the integral method.
        given: what is given on the surface.
        opposite: what moves opposite to the nodes; None where nothing does.
        axisymmetric: whether areas are those of a body of revolution.

    Attributes:
        method: ``"nodal"``, ``"integral"`` or ``"mixed"``.
        number: of points; `number_everywhere` of those of all ranks.
        areas: W, area (length in 2D) of each point (n,).
        positions: (n, dim).
        ids: what distinguishes points at one place, on any number of ranks (n, k): the input node
            of a vertex, those of the facet at Gauss points.
        data: normals, augmentation and fields of the law at the points.
        gaps: initial gaps at the points, averages in the mixed method (n,).
        aside: part of the average of g n across the normal, in the mixed method (n, dim).
        space: scalar space with one dof per point; that of the vertices where points lie on common
            parts of faces.
        Q: space of the multiplier, on the submesh.
        vertices: scalar P1 space on the submesh.
        trace_dofs: for every local multiplier node the node of the displacement at its place.
        vertex_trace_dofs: the same for the vertices.
        vertex_areas, vertex_gaps, vertex_normals, vertex_ids: at the local vertices, ghosts
            included.
        circumferences: by which areas of vertices are larger than their sections, 1 of a body that
            is none of revolution.
        operator: B, from displacements to jumps at the points.
        E: from multipliers to tractions at the points; None where it is the identity.
    """

    method: ClassVar[ContactMethod]
    #: Whether they slide over another face, wherever both are (`sliding`).
    slides: ClassVar[bool] = False

    number: int
    areas: Array
    positions: Array
    ids: npt.NDArray[np.int64]
    data: PointData
    gaps: Array
    aside: Array
    space: fem.FunctionSpace
    circumferences: Array
    vertex_areas: Array
    vertex_gaps: Array
    vertex_normals: Array
    vertex_ids: npt.NDArray[np.int64]
    operator: Operator
    #: Overlaps with an obstacle that are taken from gaps, at points and vertices; None of none.
    removed_overlap: fem.Function | None = None
    removed_at_vertices: fem.Function | None = None
    #: How often B has been set: another problem on the surface may give other functions away.
    connections = 0
    #: Vertices whose functions are given away, and those that take none, as asked for last.
    _asked: tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]] | None = None
    _gave: npt.NDArray[np.bool_] | None = None
    #: Areas of the local vertices that have something opposite, where that may be a part.
    _covered_areas: Array | None = None

    def __init__(
        self,
        V: fem.FunctionSpace,
        submesh: FacetSubmesh,
        degrees: tuple[int, int],
        rule_degree: int,
        given: Given,
        opposite: Opposite | None = None,
        *,
        axisymmetric: bool = False,
    ):
        self._V = V
        self.submesh = submesh
        self.given = given
        #: Degrees of displacement and multiplier.
        self._degrees = degrees
        self._weight: Any = circumference(V.mesh) if axisymmetric else None
        domain = V.mesh
        sub = submesh.mesh
        facets = submesh.parent_facets
        self.comm = domain.comm
        self.dim = domain.geometry.dim
        self.vertices = point_space(sub, None)
        if degrees[1] == 1:
            self.Q = blocked_space(self.vertices, self.dim)
        else:
            self.Q = fem.functionspace(sub, ("Lagrange", degrees[1], (self.dim,)))
        self.trace_dofs = trace_dofs(V, self.Q, facets)
        self.vertex_trace_dofs = (
            self.trace_dofs if degrees[1] == 1 else trace_dofs(V, self.vertices, facets)
        )
        self._at_nodes = measure_of(domain, facets, 1, "vertex")
        self._exact_degree = 2 * max(degrees) + axisymmetric
        self.E: PETSc.Mat | None = None
        self._shared: PETSc.Mat | None = None
        self._place(rule_degree, opposite)
        self.number_everywhere: int = self.comm.allreduce(self.number)
        self._evaluate, self._average = self.evaluators(given, given.gap * given.normal)
        self._measure(opposite)
        stencils = self._jumps(opposite)
        self._apart = stencils, self.vertex_areas
        self._connect(stencils)
        self.r: Array = np.ones(len(self.vertex_areas))
        self.update()

    # -- what subclasses define ------------------------------------------------------------------

    @abstractmethod
    def _place(self, rule_degree: int, opposite: Opposite | None) -> None:
        """Set `space`, `number`, `ids` and `vertex_ids`. Collective."""

    @abstractmethod
    def _measure(self, opposite: Opposite | None) -> None:
        """Set `areas`, `vertex_areas` and `circumferences`. Collective."""

    @abstractmethod
    def _stencils(self, trace: Trace) -> Stencils:
        """Of the displacement that a trace has. Collective."""

    def _jumps(self, opposite: Opposite | None) -> Stencils:
        """Stencils of the jumps at the points. Collective."""
        stencils = self._stencils(self._here)
        if opposite is None:
            return stencils
        return stencils.minus(self._opposite_to(stencils, opposite))

    @property
    def stencils(self) -> Stencils:
        """Weights of the nodes at the points, of B and E."""
        return self._weights

    def _opposite_to(self, stencils: Stencils, opposite: Opposite) -> Stencils:
        """Positions opposite to the points of these stencils. Collective."""
        return self._stencils(opposite.at)

    @abstractmethod
    def from_vertices(self, values: Array) -> Array:
        """Values at the points (n,) from those at the local vertices."""

    @abstractmethod
    def at_vertices(self, values: Array) -> Array:
        """Means of point values (n, ...) around the local vertices, ghosts included. Collective.

        Where the vertices are the points they are the values.
        """

    @property
    @abstractmethod
    def cells(self) -> npt.NDArray[np.int32]:
        """Cells of the submesh that this rank owns and that have points."""

    @property
    def mirrored(self) -> npt.NDArray[np.bool_]:
        """Local multiplier nodes x dim, True across planes of symmetry, where images cancel."""
        return np.zeros((len(self.trace_dofs), self.dim), dtype=bool)

    @property
    def choices(self) -> list[float]:
        """What else says what they meet, for records. Collective."""
        if self.removed_overlap is None:
            return []
        largest = self.comm.allreduce(
            float(np.max(self.removed_overlap.x.array, initial=0.0)), op=max
        )
        # Without the digits that depend on the number of ranks.
        return [float(f"{largest:.6g}")]

    def require_held(self, fixed: npt.NDArray[np.bool_], name: str) -> None:  # noqa: B027
        """Raise ``ValueError`` if nodes on planes of symmetry can leave these. Collective.

        Args:
            fixed: local nodes x dim, by Dirichlet data.
            name: of the surface.
        """

    def require_in_place(self, prescribed: Array, size: float, name: str) -> None:  # noqa: B027
        """Raise ``ValueError`` if nodes are moved off planes of symmetry. Collective.

        Args:
            prescribed: displacements of the local nodes by Dirichlet data, 0 where free (n, dim).
            size: of the body, a length.
            name: of the surface.
        """

    @abstractmethod
    def _given_at_vertices(self, values: Mapping[str, Array]) -> Mapping[str, Array]:
        """What is given at the local vertices, of that at the local points. Collective."""

    @abstractmethod
    def _give(
        self, alone: Stencils, given: npt.NDArray[np.bool_], idle: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.bool_]:
        """As `give`, of the stencils in which nothing is given away. Collective."""

    # -- what is given ---------------------------------------------------------------------------

    @property
    def _maps(self) -> Any:
        return merge_entity_maps([self.submesh])

    def evaluators(self, given: Given, offset: Any) -> tuple[Evaluator, Evaluator | None]:
        """Evaluators of ``given`` at the points, and of ``offset`` where the mixed method averages.

        The second one is None in the other methods.
        """
        expressions = {"x": ufl.SpatialCoordinate(self._V.mesh), **given.at_points}
        return self.evaluator(expressions), None

    @abstractmethod
    def evaluator(self, expressions: Mapping[str, Any]) -> Evaluator:
        """What evaluates UFL on the body at the points."""

    def remove_overlap(self, gaps: Array, vertex_gaps: Array) -> None:
        """Take overlaps from all gaps to come, beside what was taken before. Collective.

        Args:
            gaps: at the points of this rank, of which what is below zero is taken (n,).
            vertex_gaps: likewise, at the local vertices.
        """
        if self.removed_overlap is None or self.removed_at_vertices is None:
            self.removed_overlap, self.removed_at_vertices = (
                fem.Function(self.space),
                fem.Function(self.vertices),
            )
        self.removed_overlap.x.array[:] += self.with_ghosts(np.maximum(-gaps, 0.0))
        self.removed_at_vertices.x.array[:] += np.maximum(-vertex_gaps, 0.0)
        self.update()

    def update(self) -> None:
        """Evaluate what is given anew. Collective."""
        values = self._evaluate()
        at_vertices = self._given_at_vertices(values)
        self.vertex_gaps = at_vertices["gap"]
        self.vertex_normals = at_vertices["normal"]
        mine = {name: v[: self.number] for name, v in values.items()}
        normal = mine["normal"]
        gap = mine["gap"]
        if self.removed_overlap is not None and self.removed_at_vertices is not None:
            gap = gap + self.removed_overlap.x.array[: self.number]
            self.vertex_gaps = self.vertex_gaps + self.removed_at_vertices.x.array
        self.positions = mine["x"]
        self.gaps = gap
        self.aside = np.zeros_like(normal)
        offset = self._averaged(self._average, gap[:, None] * normal, normal)
        if offset is not None:
            gap = np.sum(offset * normal, axis=1)
            self.aside = offset - gap[:, None] * normal
        self.data = PointData(normal, gap, self.from_vertices(self.r), fields_of(mine))

    def rates(self, evaluators: tuple[Evaluator, Evaluator | None]) -> tuple[PointData, Array]:
        """Rates of data and of `aside` from the evaluators of rates. Collective."""
        values = {name: v[: self.number] for name, v in evaluators[0]().items()}
        n = self.data.n
        gap = values["gap"]
        normal = values["normal"]
        aside = np.zeros_like(n)
        product = gap[:, None] * n + self.gaps[:, None] * normal
        offset = self._averaged(evaluators[1], product, normal)
        if offset is not None:
            now = self.data.gap[:, None] * n + self.aside
            gap = np.sum(offset * n + now * normal, axis=1)
            aside = offset - gap[:, None] * n - self.data.gap[:, None] * normal
        return PointData(normal, gap, np.zeros(self.number), fields_of(values)), aside

    def _averaged(self, average: Evaluator | None, offset: Array, normal: Array) -> Array | None:
        """Averages of an offset that is known at the points (n, dim), if any are taken."""
        if average is None and self._shared is None:
            return None
        if average is not None:
            offset = self._mean_offset(average)
            if self.removed_overlap is not None:
                offset = offset + self.removed_overlap.x.array[: self.number, None] * normal
        return offset if self._shared is None else multiplied(self._shared, offset)

    def _mean_offset(self, evaluate: Evaluator) -> Array:
        """Weighted means of an offset at the points (n, dim), in the mixed method. Collective."""
        raise NotImplementedError

    def set_augmentation(self, r: Array) -> None:
        """Set r at the local vertices."""
        self.r = np.asarray(r, dtype=np.float64).copy()
        self.data = replace(self.data, r=self.from_vertices(self.r))

    @cached_property
    def _exact(self) -> ufl.Measure:
        """The measure that is exact for products of displacements and multipliers. Collective."""
        return measure_of(self._V.mesh, self.submesh.parent_facets, self._exact_degree)

    def _swept(self) -> Array:
        """Areas of the local vertices of a body of revolution. Collective."""
        return PointEvaluator(self.vertices, self._exact, {}, self._maps, self._weight).areas

    @cached_property
    def whole_areas(self) -> Array:
        """Areas of the local vertices, whether something is opposite or not. Collective."""
        return self._apart[1] if self._covered_areas is None else self._swept()

    @property
    def covered(self) -> Array:
        """Parts of the areas of the local vertices that have something opposite. Collective."""
        if self._covered_areas is None:
            return np.ones(len(self.vertex_areas))
        return np.asarray(np.minimum(self._covered_areas / self.whole_areas, 1.0))

    @property
    def _owned_cells(self) -> int:
        topology = self.submesh.mesh.topology
        return int(topology.index_map(topology.dim).size_local)

    # -- operators -------------------------------------------------------------------------------

    @property
    def mean_vertex_area(self) -> float:
        """Mean area of a vertex. Collective."""
        return self._vertex_mean(self.vertex_areas)

    @property
    def mean_width(self) -> float:
        """Size of a facet: the root in space, of the mean area of a vertex. Collective."""
        mean = self._vertex_mean(self.vertex_areas / self.circumferences)
        return float(mean ** (1 / (self.dim - 1)))

    @cached_property
    def facet_widths(self) -> fem.Function:
        """Sizes of the facets, roots of their areas in space; on the submesh. Collective."""
        widths = fem.Function(fem.functionspace(self.submesh.mesh, ("DG", 0)))
        W = widths.function_space
        fem.assemble_vector(widths.x.array, compiled_form(ufl.TestFunction(W) * ufl.dx))
        widths.x.array[:] **= 1 / (self.dim - 1)
        widths.x.scatter_forward()
        return widths

    @property
    def mean_augmentation(self) -> float:
        """Mean of r over the vertices, stiffness per area. Collective."""
        return self._vertex_mean(self.r)

    def _vertex_mean(self, values: Array) -> float:
        index_map = self.vertices.dofmap.index_map
        total = self.comm.allreduce(float(np.sum(values[: index_map.size_local])))
        return total / index_map.size_global

    def traction(self, multipliers: Array) -> Array:
        """T = E l at the points (n, dim) of the owned multipliers. Collective."""
        if self.E is None:
            return multipliers.reshape(-1, self.dim).copy()
        x, y = self.E.createVecs()
        x.array[:] = multipliers
        self.E.mult(x, y)
        values = y.array_r.reshape(-1, self.dim).copy()
        x.destroy(), y.destroy()
        return np.asarray(values)

    def rows(self, values: Array) -> Array:
        """E^T W of values at the points (n, dim): owned contact rows. Collective."""
        weighted = self.areas[:, None] * values
        return weighted.reshape(-1) if self.E is None else multiplied_transposed(self.E, weighted)

    @cached_property
    def _at_places(self) -> SharedValues:
        return SharedValues(self.space.dofmap.index_map)

    def with_ghosts(self, values: Array) -> Array:
        """Values at the points of this rank, then at its ghosts. Collective."""
        return self._at_places.from_owners(values)

    def give(
        self, given: npt.NDArray[np.bool_], idle: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.bool_]:
        """Give the functions of vertices to those around them; see `held_ends`. Collective.

        Args:
            given: local vertices, ghosts included; of none all functions are as they were.
            idle: local vertices that take none, as they have no multiplier either.

        Returns:
            Those that are given away: none whose function nobody takes.
        """
        alone, _ = self._apart
        if self._weights is alone and not self.comm.allreduce(int(given.any())):
            return given
        asked = given.copy(), idle.copy()
        same = self._asked is not None and all(map(np.array_equal, asked, self._asked))
        if self._gave is None or self.comm.allreduce(int(not same)):
            self._gave = self._give(alone, given, idle)
            self._asked = asked
        return self._gave

    def _connect(self, stencils: Stencils) -> None:
        """Set B and E, of which no others are left. Collective."""
        self._weights = stencils
        self.connections += 1
        B = stencils.jump_matrix(self.comm, self._owned_nodes, self.dim)
        self.operator = ConstantOperator(stencils, self.areas, B)
        if not stencils.identity:
            nodes = self.Q.dofmap.index_map.size_local
            self.E = stencils.traction_matrix(self.comm, nodes, self.dim)

    @property
    def _owned_nodes(self) -> int:
        """Nodes of the displacement that this rank owns."""
        return int(self._V.dofmap.index_map.size_local)

    def _here(self, nodes: npt.NDArray[np.int32]) -> tuple[Nodes, Array]:
        """The trace of the body."""
        flat = self._V.dofmap.index_map.local_to_global(nodes.reshape(-1))
        known = np.asarray(flat, dtype=np.int64).reshape(*nodes.shape, 1)
        return known, np.ones(known.shape)

    def destroy(self) -> None:
        """Free the matrices."""
        self._disconnect()

    def _disconnect(self) -> None:
        """Free B and E, and the matrix of shared functions."""
        self.operator.destroy()
        for A in (self.E, self._shared):
            if A is not None:
                A.destroy()
