# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points of a surface: three discretisations of the same law.

- ``"nodal"``: the points are the mesh nodes of the surface (vertex rule, P1 displacement). The
  conditions hold node by node (`NodePoints`).
- ``"integral"``: the points are Gauss points of facets, or of the common parts of two faces that do
  not match; P1 or P2 displacement. The conditions hold weakly (`FacetPoints`).
- ``"mixed"``: the points are the vertices, and the multiplier is continuous and linear on every
  facet; P1 or P2 displacement. The conditions hold at every vertex for means of gap and slip
  weighted with its hat function (Hild, Int. J. Appl. Math. Comput. Sci. 12, 2002, section 2; Hild
  and Laborde, Appl. Numer. Math. 41, 2002). Jumps are the inverse of the lumped mass matrix times
  the integrals of hat functions times displacements (`AveragedPoints`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

from petsc4py import PETSc

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact._arrays import Array, Indices, Ints, Mask
from dolfinx_contact._compat import FacetSubmesh, merge_entity_maps
from dolfinx_contact._geometry import dot, unit
from dolfinx_contact._mpi import SharedValues, any_rank, maximum
from dolfinx_contact._petsc import destroy, product
from dolfinx_contact.body.bulk import circumference
from dolfinx_contact.laws import PointData
from dolfinx_contact.points.descriptions import ContactMethod
from dolfinx_contact.points.evaluators import (
    Evaluator,
    Given,
    PointEvaluator,
    blocked_space,
    fields_of,
    measure_of,
    point_space,
)
from dolfinx_contact.points.gauss_points import CommonGaussPoints, GaussPoints
from dolfinx_contact.points.jump_operators import (
    ConstantOperator,
    NodeWeights,
    Operator,
    Stencils,
    multiplied,
    own_nodes,
    rows_of,
    scaled_rows,
)
from dolfinx_contact.points.opposite import Opposite
from dolfinx_contact.points.shared_functions import receiving_vertices, shared
from dolfinx_contact.points.surface_geometry import SurfaceFacets, SurfaceGeometry
from dolfinx_contact.points.trace import point_ids, trace_nodes

__all__ = ["AveragedPoints", "ContactPoints", "Degrees", "Evaluators", "FacetPoints", "NodePoints"]


class Degrees(NamedTuple):
    """Polynomial degrees of displacement and multiplier."""

    displacement: int
    multiplier: int


class Evaluators(NamedTuple):
    """Evaluators of the data of a surface at its points, or of rates of these data.

    Attributes:
        at_points: evaluator at the points.
        average: evaluator of the product of gap and normal, which the mixed method averages; None
            in the other methods.
    """

    at_points: Evaluator
    average: Evaluator | None = None


class ContactPoints(ABC):
    """Contact points of a surface on this rank, data there, and the operators B and E.

    If the points are vertices, they have the order of the vertices.

    Args:
        V: displacement space.
        submesh: mesh of the facets.
        degrees: degrees of displacement and multiplier.
        rule_degree: quadrature degree with ``method="integral"`` or ``"mixed"``.
        given: gap, normal and fields of the law in UFL.
        opposite: opposing points of the nodes; None without another body.
        axisymmetric: whether the body is a body of revolution.

    Attributes:
        method: ``"nodal"``, ``"integral"`` or ``"mixed"``.
        number: number of points on this rank.
        number_everywhere: number of points on all ranks.
        areas: areas W of the points (lengths in 2D), shape (n,).
        positions: positions, shape (n, dim).
        ids: keys of k integers that distinguish points with equal coordinates, independent of the
            number of ranks, shape (n, k).
        data: normals, gaps, augmentation and fields of the law at the points.
        gaps: initial gaps at the points, shape (n,); in the mixed method, `data` contains averages
            of them.
        aside: tangential part of the average of g n (gap g, normal n) in the mixed method, shape
            (n, dim).
        space: scalar space with one dof per point; P1 space of the vertices if points lie on
            common parts of two faces.
        Q: space of the multiplier, on the submesh.
        vertices: scalar P1 space on the submesh.
        trace_nodes: node of the displacement at each local multiplier node.
        vertex_nodes: node of the displacement at each local vertex.
        facets: facets owned by this rank, with their geometry at any displacement.
        geometry: areas of the local vertices, sizes of the facets.
        exchange: exchange of values at the points and their ghosts between ranks.
        vertex_gaps: gaps at the local vertices.
        vertex_normals: normals at the local vertices, shape (vertices, dim).
        operator: B, from displacements to jumps at the points.
        E: matrix from multipliers to tractions at the points; None for the identity.
    """

    method: ClassVar[ContactMethod]
    #: Whether the face slides over another face by any distance (`sliding_pair`).
    slides: ClassVar[bool] = False

    number: int
    areas: Array
    positions: Array
    ids: Ints
    data: PointData
    gaps: Array
    aside: Array
    space: fem.FunctionSpace
    geometry: SurfaceGeometry
    vertex_gaps: Array
    vertex_normals: Array
    operator: Operator
    #: Gauss points of the integral and the mixed method; None in the nodal method.
    _gauss: GaussPoints | None = None
    #: Components of the local vertices across planes of symmetry, where the traction of the whole
    #: model vanishes; None without such planes.
    mirrored: Mask | None = None
    #: Removed overlaps with an obstacle, at points and at vertices; None if none is removed.
    removed_overlap: fem.Function | None = None
    removed_at_vertices: fem.Function | None = None

    def __init__(
        self,
        V: fem.FunctionSpace,
        submesh: FacetSubmesh,
        degrees: Degrees,
        rule_degree: int,
        given: Given,
        opposite: Opposite | None = None,
        *,
        axisymmetric: bool = False,
    ):
        self._V = V
        self.submesh = submesh
        self.given = given
        domain, facets = V.mesh, submesh.parent_facets
        self.comm = domain.comm
        self.dim = domain.geometry.dim
        self._weight: Any = circumference(domain) if axisymmetric else None
        self._maps: Any = merge_entity_maps([submesh])
        self._owned_nodes = int(V.dofmap.index_map.size_local)
        # spaces on the facets and their nodes in the body
        self.vertices = point_space(submesh.mesh, None)
        self.vertex_nodes = trace_nodes(V, self.vertices, facets)
        self.facets = SurfaceFacets(V, submesh, self.vertices, self.vertex_nodes)
        self.Q = blocked_space(self.vertices, self.dim)
        self.trace_nodes = self.vertex_nodes
        if degrees.multiplier > 1:
            Q = ("Lagrange", degrees.multiplier, (self.dim,))
            self.Q = fem.functionspace(submesh.mesh, Q)
            self.trace_nodes = trace_nodes(V, self.Q, facets)
        self._at_nodes = measure_of(domain, facets, 1, "vertex")
        self._exact_degree = 2 * max(degrees) + axisymmetric
        # points, areas, operators, data
        self.E: PETSc.Mat | None = None
        self._shared: PETSc.Mat | None = None
        self._place(rule_degree, opposite)
        self.exchange = SharedValues(self.space.dofmap.index_map)
        self.number_everywhere: int = self.comm.allreduce(self.number)
        self._evaluators = self.evaluators(given, given.gap * given.normal)
        self.geometry = self._measure(opposite)
        self._set_operators(opposite)
        self.r: Array = np.ones(len(self.geometry.vertex_areas))
        self.update()

    # -- defined by subclasses -------------------------------------------------------------------

    @abstractmethod
    def _place(self, rule_degree: int, opposite: Opposite | None) -> None:
        """Choose the points: set `space`, `number` and `ids`. Collective."""

    @abstractmethod
    def _measure(self, opposite: Opposite | None) -> SurfaceGeometry:
        """Set the areas of the points, and return the areas of the vertices. Collective."""

    @abstractmethod
    def _jumps(self, opposite: Opposite | None) -> Stencils:
        """Return the weights of the nodes in the jumps at the points. Collective."""

    @abstractmethod
    def from_vertices(self, values: Array) -> Array:
        """Return values interpolated from the local vertices to the points, shape (n,)."""

    @abstractmethod
    def at_vertices(self, values: Array) -> Array:
        """Return means of values at the points around each local vertex, ghosts included.

        If the points are the vertices, their own values are returned. Collective.
        """

    @abstractmethod
    def _given_at_vertices(self, values: Mapping[str, Array]) -> Mapping[str, Array]:
        """Return gap, normal and fields at the local vertices from point values. Collective."""

    @abstractmethod
    def _give(self, given: Mask, idle: Mask) -> Mask:
        """Distribute basis functions as described in `give`. Collective."""

    @abstractmethod
    def evaluator(self, expressions: Mapping[str, Any]) -> Evaluator:
        """Return an evaluator of UFL expressions on the body at the points."""

    # -- data ------------------------------------------------------------------------------------

    @property
    def cells(self) -> Indices:
        """Cells of the facet mesh that are owned by this rank and contain points."""
        if self._gauss is None:
            return np.arange(len(self.facets.corners), dtype=np.int32)
        return np.unique(self._gauss.cells)

    def evaluators(self, given: Given, offset: Any) -> Evaluators:
        """Return evaluators of data at the points, and of their averages with ``method="mixed"``.

        Args:
            given: gap, normal and fields of the law in UFL, or their rates.
            offset: product of gap and normal in UFL, or its rate.
        """
        expressions = {"x": ufl.SpatialCoordinate(self._V.mesh), **given.at_points}
        return Evaluators(self.evaluator(expressions))

    def vertex_evaluator(self, expressions: Mapping[str, Any]) -> PointEvaluator:
        """Return an evaluator of UFL expressions on the body at the local vertices.

        It uses the vertex rule, which also gives the values on the axis of a body of revolution.
        """
        return PointEvaluator(self.vertices, self._at_nodes, expressions, self._maps)

    def remove_overlap(self, gaps: Array, vertex_gaps: Array) -> None:
        """Subtract overlaps from all later gaps. Collective.

        Overlaps removed by earlier calls remain removed.

        Args:
            gaps: gaps at the points of this rank, whose negative parts are the overlaps, shape
                (n,).
            vertex_gaps: gaps at the local vertices, whose negative parts are the overlaps.
        """
        if self.removed_overlap is None or self.removed_at_vertices is None:
            self.removed_overlap = fem.Function(self.space)
            self.removed_at_vertices = fem.Function(self.vertices)
        self.removed_overlap.x.array[:] += self.exchange.from_owners(np.maximum(-gaps, 0.0))
        self.removed_at_vertices.x.array[:] += np.maximum(-vertex_gaps, 0.0)
        self.update()

    @property
    def choices(self) -> list[float]:
        """Largest overlap removed by `remove_overlap`, as a list; empty if none was removed.

        Rounded to 6 digits. Records compare it to detect a different discretisation. Collective.
        """
        if self.removed_overlap is None:
            return []
        # without the digits that depend on the number of ranks
        return [float(f"{maximum(self.comm, self.removed_overlap.x.array):.6g}")]

    def update(self) -> None:
        """Evaluate the data at the points again, with their current values. Collective."""
        values = self._evaluators.at_points()
        at_vertices = self._given_at_vertices(values)
        self.vertex_gaps = at_vertices["gap"]
        self.vertex_normals = at_vertices["normal"]
        mine = {name: v[: self.number] for name, v in values.items()}
        normal, gap = mine["normal"], mine["gap"]
        if self.removed_overlap is not None and self.removed_at_vertices is not None:
            gap = gap + self.removed_overlap.x.array[: self.number]
            self.vertex_gaps = self.vertex_gaps + self.removed_at_vertices.x.array
        self.positions = mine["x"]
        self.gaps = gap
        self.aside = np.zeros_like(normal)
        offset = self._averaged(self._evaluators.average, gap[:, None] * normal, normal)
        if offset is not None:
            gap = dot(offset, normal)
            self.aside = self._within_planes(offset - gap[:, None] * normal)
        self.data = PointData(normal, gap, self.from_vertices(self.r), fields_of(mine))

    def own(self, evaluate: Evaluator) -> dict[str, Array]:
        """Return values of an evaluator at the owned points, by name. Collective."""
        return {name: v[: self.number] for name, v in evaluate().items()}

    def rates(self, evaluators: Evaluators) -> tuple[PointData, Array]:
        """Return the rates of the data of the law and of `aside` at the points. Collective.

        Args:
            evaluators: evaluators of the rates of gap, normal and fields of the law.
        """
        values = self.own(evaluators.at_points)
        n = self.data.n
        gap, normal = values["gap"], values["normal"]
        aside = np.zeros_like(n)
        change = gap[:, None] * n + self.gaps[:, None] * normal
        offset = self._averaged(evaluators.average, change, normal)
        if offset is not None:
            now = self.data.gap[:, None] * n + self.aside
            gap = dot(offset, n) + dot(now, normal)
            aside = offset - gap[:, None] * n - self.data.gap[:, None] * normal
            aside = self._within_planes(aside)
        return PointData(normal, gap, np.zeros(self.number), fields_of(values)), aside

    def _averaged(self, average: Evaluator | None, offset: Array, normal: Array) -> Array | None:
        """Return averages of gap times normal around the points; None without averages. Collective.

        Args:
            average: evaluator of the product, or of its rate, in the mixed method; None in the
                other methods.
            offset: product at the points, or its rate, shape (n, dim).
            normal: normals, or their rates, shape (n, dim).
        """
        return None if self._shared is None else multiplied(self._shared, offset)

    def _within_planes(self, vectors: Array) -> Array:
        """Return vectors at the points without components across planes of symmetry (`mirror`)."""
        if self.mirrored is None:
            return vectors
        return np.where(self.mirrored[: self.number], 0.0, vectors)

    def outward(self, u: Array) -> Array:
        """Return outward unit normals of the displaced face at the points, shape (n, dim).

        They are interpolated from the vertices, where they have the direction of the sum of the
        area vectors around. Collective.

        Args:
            u: displacement of the local nodes, shape (nodes, dim).
        """
        facets = self.facets
        vectors = facets.vectors(facets.reference + facets.at_corners(u))
        at_vertices = facets.around_vertices(vectors)
        return unit(np.stack([self.from_vertices(v) for v in at_vertices.T], axis=1))

    def set_augmentation(self, r: Array) -> None:
        """Set the augmentation parameter r of the law.

        Args:
            r: parameter at the local vertices, a stiffness per area, shape (vertices,).
        """
        self.r = np.asarray(r, dtype=np.float64).copy()
        self.data = replace(self.data, r=self.from_vertices(self.r))

    @property
    def mean_augmentation(self) -> float:
        """Mean augmentation parameter of the vertices, as stiffness per area. Collective."""
        return self.geometry.mean(self.r)

    def _gauss_points(self, rule_degree: int, opposite: Opposite | None) -> GaussPoints:
        """Return Gauss points of facets, on common parts if faces do not match. Collective."""
        given = self._V, self.submesh, self.vertices, rule_degree, self._maps, self._weight
        if opposite is None or opposite.common is None:
            return GaussPoints(*given)
        return CommonGaussPoints(opposite.common, *given)

    # -- areas -----------------------------------------------------------------------------------

    def _geometry(
        self, opposite: Opposite | None, sections: Array, averaged: Array | None = None
    ) -> SurfaceGeometry:
        """Return areas of the local vertices and sizes of the facets. Collective.

        Args:
            opposite: opposing points of the nodes.
            sections: areas around the vertices; for a body of revolution, lengths in its section.
            averaged: areas of the points in the mixed method; None in the other methods.
        """
        areas = averaged
        if areas is None:
            areas = sections if self._weight is None else self._swept()
        sections = areas if self._weight is None else sections
        covered = None
        if opposite is not None and opposite.areas is not None:
            covered = opposite.areas[self.vertex_nodes] if averaged is None else averaged
        return SurfaceGeometry(self.vertices, areas, areas / sections, self._swept, covered)

    def _swept(self) -> Array:
        """Return exact areas that the local vertices of a body of revolution sweep. Collective."""
        ds = measure_of(self._V.mesh, self.submesh.parent_facets, self._exact_degree)
        return PointEvaluator(self.vertices, ds, {}, self._maps, self._weight).areas

    # -- operators -------------------------------------------------------------------------------

    def traction(self, multipliers: Array) -> Array:
        """Return the tractions at the points, shape (n, dim). Collective.

        Args:
            multipliers: owned values of the multiplier, in units of stress.
        """
        if self.E is None:
            return multipliers.reshape(-1, self.dim).copy()
        return product(self.E, multipliers.reshape(-1)).reshape(-1, self.dim)

    def rows(self, values: Array) -> Array:
        """Return integrals of the multiplier basis times values, one per owned dof. Collective.

        Args:
            values: values at the points, shape (n, dim).
        """
        weighted = (self.areas[:, None] * values).reshape(-1)
        return weighted if self.E is None else product(self.E, weighted, transposed=True)

    def give(self, given: Mask, idle: Mask) -> Mask:
        """Add basis functions of given vertices to surrounding vertices. Collective.

        Call it only once; see `shared_functions`.

        Args:
            given: mask of the local vertices whose basis function is distributed, ghosts included.
            idle: mask of the local vertices that receive no basis function, because they have no
                multiplier.

        Returns:
            Mask of the vertices whose basis function could be distributed.
        """
        return self._give(given, idle) if any_rank(self.comm, given) else given

    def mirror(self, across: Mask, opposite: Opposite | None) -> None:
        """Mark vertices on planes of symmetry. Collective.

        Call it only once, after `give`. Where jumps are means around a vertex, the mean over one
        half of the model has a component across the plane, which the other half cancels. This
        component is replaced by the jump of the vertex itself, or by 0 if the master has no point
        opposite to the vertex.

        Args:
            across: mask of the components across the planes, shape (local vertices, dim).
            opposite: opposing points of the positions of the nodes; None without another body.
        """
        self.mirrored = across if any_rank(self.comm, across) else None

    def _set_operators(self, opposite: Opposite | None) -> None:
        """Set the operators from displacements to jumps and multipliers to tractions.

        Collective.
        """
        self._connect(self._jumps(opposite))

    def _connect(self, stencils: Stencils) -> None:
        """Set `operator` and `E` from weights of the nodes at the points. Collective."""
        self._weights = stencils
        B = stencils.jump_matrix(self.comm, self._owned_nodes, self.dim)
        self.operator = ConstantOperator(stencils, self.areas, B)
        if not stencils.identity:
            nodes = self.Q.dofmap.index_map.size_local
            self.E = stencils.traction_matrix(self.comm, nodes, self.dim)

    def _reconnect(self, stencils: Stencils) -> None:
        """Replace `operator` and `E` by operators with other weights. Collective."""
        assert isinstance(self.operator, ConstantOperator)
        destroy(self.operator.B, self.E)
        self._connect(stencils)


class NodePoints(ContactPoints):
    """Contact points with ``method="nodal"``: mesh nodes of a surface, with the vertex rule."""

    method: ClassVar[ContactMethod] = "nodal"

    def _place(self, rule_degree: int, opposite: Opposite | None) -> None:
        self.space = self.vertices
        self.number = int(self.vertices.dofmap.index_map.size_local)
        self.ids = point_ids(self.vertices)

    def _measure(self, opposite: Opposite | None) -> SurfaceGeometry:
        geometry = self._geometry(opposite, self._evaluators.at_points.areas)
        self.areas = geometry.vertex_areas[: self.number].copy()
        return geometry

    evaluator = ContactPoints.vertex_evaluator

    def _given_at_vertices(self, values: Mapping[str, Array]) -> Mapping[str, Array]:
        return values

    def from_vertices(self, values: Array) -> Array:
        return values[: self.number]

    def at_vertices(self, values: Array) -> Array:
        return self.exchange.from_owners(values)

    def _jumps(self, opposite: Opposite | None) -> Stencils:
        nodes = self.trace_nodes[: self.number]
        here = self._each_alone(own_nodes(self._V, nodes))
        return here if opposite is None else here.minus(self._each_alone(opposite.at(nodes)))

    def _each_alone(self, rows: NodeWeights) -> Stencils:
        """Return stencils with one group per point; each point is a multiplier node."""
        n = self.number
        mine = np.arange(n, dtype=np.int64)[:, None]
        return Stencils(
            points=mine,
            nodes=rows.nodes,
            weights=rows.weights[:, None, :],
            multiplier_nodes=self.Q.dofmap.index_map.local_range[0] + mine,
            multiplier_weights=np.ones((n, 1, 1)),
            identity=True,
        )

    def mirror(self, across: Mask, opposite: Opposite | None) -> None:
        super().mirror(across, opposite)
        if self.mirrored is None:
            return
        assert isinstance(self.operator, ConstantOperator)
        across = across[: self.number]
        itself = across
        if opposite is not None:
            itself = across & ~opposite.none[self.vertex_nodes[: self.number], None]
        own = NodePoints._jumps(self, opposite)
        at_vertices = own.jump_matrix(self.comm, self._owned_nodes, self.dim)
        B = self.operator.B
        for matrix, kept in ((B, ~across), (at_vertices, itself)):
            rows = matrix.createVecs(side="left")
            rows.array[:] = kept.reshape(-1)
            matrix.diagonalScale(rows)
            rows.destroy()
        B.axpy(1.0, at_vertices)
        at_vertices.destroy()
        self.operator = replace(self.operator, fixed=across)
        self.update()

    def _give(self, given: Mask, idle: Mask) -> Mask:
        D, self.areas, given = shared(self.vertices, given, idle, self.areas)
        self.geometry.vertex_areas = self.exchange.from_owners(self.areas)
        plain = self._weights.jump_matrix(self.comm, self._owned_nodes, 1)
        means = self._each_alone(rows_of(D.matMult(plain)))
        plain.destroy()
        self._reconnect(means)
        self._shared = D
        self.update()
        return given


class AveragedPoints(NodePoints):
    """Contact points with ``method="mixed"``: vertices with weighted means of jumps and gaps.

    The weights are the hat functions of the multiplier, integrated over the surface with Gauss
    points.
    """

    method: ClassVar[ContactMethod] = "mixed"
    _gauss: GaussPoints

    def _place(self, rule_degree: int, opposite: Opposite | None) -> None:
        super()._place(rule_degree, opposite)
        self._gauss = self._gauss_points(rule_degree, opposite)

    def evaluators(self, given: Given, offset: Any) -> Evaluators:
        average = self._gauss.evaluator({"offset": offset})
        return super().evaluators(given, offset)._replace(average=average)

    def _measure(self, opposite: Opposite | None) -> SurfaceGeometry:
        assert self._evaluators.average is not None
        areas = self._evaluators.average.areas[: self._gauss.number]
        self._at_gauss = self._gauss.jumps(self.Q, opposite)
        hats = self._at_gauss.traction_matrix(self.comm, self.number, 1)
        #: Matrix of the weighted means, from Gauss points to the owned vertices.
        self._means = hats.transpose(PETSc.Mat())
        hats.destroy()
        points = self._means.createVecs(side="right")
        points.array[:] = areas
        self._means.diagonalScale(None, points)
        points.destroy()
        self.areas = scaled_rows(self._means)
        if opposite is not None and opposite.areas is not None:
            # vertices of uncovered facets have no traction, so that any area serves
            whole = opposite.areas[self.vertex_nodes[: self.number]]
            self.areas = np.where(self.areas > 0.0, self.areas, whole)
        averaged = self.exchange.from_owners(self.areas)
        return self._geometry(opposite, self._evaluators.at_points.areas, averaged)

    def _jumps(self, opposite: Opposite | None) -> Stencils:
        at_gauss = self._at_gauss.jump_matrix(self.comm, self._owned_nodes, 1)
        rows = rows_of(self._means.matMult(at_gauss))
        at_gauss.destroy()
        return self._each_alone(rows)

    def _averaged(self, average: Evaluator | None, offset: Array, normal: Array) -> Array | None:
        assert average is not None
        means = multiplied(self._means, average()["offset"][: self._gauss.number])
        if self.removed_overlap is not None:
            means = means + self.removed_overlap.x.array[: self.number, None] * normal
        return means if self._shared is None else super()._averaged(None, means, normal)


class FacetPoints(ContactPoints):
    """Contact points with ``method="integral"``: Gauss points of facets.

    If two faces do not match, they lie on the common parts of their facets.
    """

    method: ClassVar[ContactMethod] = "integral"
    _gauss: GaussPoints

    def _place(self, rule_degree: int, opposite: Opposite | None) -> None:
        self._gauss = self._gauss_points(rule_degree, opposite)
        self.space = self._gauss.space
        self.number = self._gauss.number
        self.ids = point_ids(self.vertices, self._gauss.cells, self._gauss.numbers)

    def _measure(self, opposite: Opposite | None) -> SurfaceGeometry:
        self.areas = self._evaluators.at_points.areas[: self.number].copy()
        self._of_vertices = self.vertex_evaluator(self.given.at_points)
        return self._geometry(opposite, self._of_vertices.areas)

    def evaluator(self, expressions: Mapping[str, Any]) -> Evaluator:
        return self._gauss.evaluator(expressions)

    def _given_at_vertices(self, values: Mapping[str, Array]) -> Mapping[str, Array]:
        return self._of_vertices()

    def from_vertices(self, values: Array) -> Array:
        return self._gauss.from_vertices(values)

    def at_vertices(self, values: Array) -> Array:
        return self._gauss.at_vertices(values, self.areas)

    def _jumps(self, opposite: Opposite | None) -> Stencils:
        return self._gauss.jumps(self.Q, opposite)

    def _give(self, given: Mask, idle: Mask) -> Mask:
        # tractions are sums of functions of degree 1, which are given away
        receivers, given = receiving_vertices(self.vertices, given, idle)
        corners = self.Q.dofmap.list[self._gauss.cells]
        of_corners = self._weights.multiplier_weights
        weights = of_corners[..., None] * receivers.weights[corners][:, None]
        groups, p, k, n = weights.shape
        self._reconnect(
            replace(
                self._weights,
                multiplier_nodes=receivers.nodes[corners].reshape(groups, k * n),
                multiplier_weights=weights.reshape(groups, p, k * n),
            )
        )
        return given
