# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points of a surface: three discretisations of one and the same law.

- ``"nodal"``: the points are the mesh nodes of the surface (vertex rule, P1 displacement). The
  conditions hold node by node.
- ``"integral"``: the points are Gauss points, of facets or of what two faces that do not match have
  in common; P1 or P2 displacement. The conditions hold weakly.
- ``"mixed"``: a P1 multiplier in the cone at the nodes with consistent integrals, so that the gap
  and the slip are nodal averages of the displacement (Hild, Int. J. Appl. Math. Comput. Sci. 12,
  2002, section 2; P1 displacement): B is the inverse of the lumped times the consistent mass.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Literal

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import dolfinx.fem.petsc
import ufl
from dolfinx import fem, la

from dolfinx_contact._compat import FacetSubmesh, merge_entity_maps
from dolfinx_contact._forms import compiled_form
from dolfinx_contact.laws import PointData
from dolfinx_contact.materials import circumference
from dolfinx_contact.points.evaluation import (
    PointEvaluator,
    blocked_space,
    measure_of,
    point_space,
)
from dolfinx_contact.points.gauss import CommonPoints, GaussPoints
from dolfinx_contact.points.given import Given, fields_of
from dolfinx_contact.points.held_ends import shared, takers
from dolfinx_contact.points.ids import point_ids
from dolfinx_contact.points.opposite import Opposite
from dolfinx_contact.points.scattered import ScatteredEvaluator
from dolfinx_contact.points.stencils import Stencils, multiplied, multiplied_transposed, rows_of
from dolfinx_contact.points.trace import trace_dofs

__all__ = ["ContactPoints", "Evaluator", "Given", "Method"]

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]
#: Global nodes and their weights (..., k) of local nodes of the displacement.
Trace = Callable[[npt.NDArray[np.int32]], tuple[Nodes, Array]]
Evaluator = PointEvaluator | ScatteredEvaluator
Method = Literal["nodal", "integral", "mixed"]


class ContactPoints:
    """The contact points of a surface, what is given there, and the operators B and E.

    Points are those of this rank; where they are vertices, in the order of these.

    Args:
        V: displacement space.
        submesh: of the facets.
        method: ``"nodal"``, ``"integral"`` or ``"mixed"``.
        degrees: of displacement and multiplier.
        rule_degree: of the Gauss points of the integral method.
        given: what is given on the surface.
        opposite: what moves opposite to the nodes; None where nothing does.
        axisymmetric: whether areas are those of a body of revolution.

    Attributes:
        number: of points; `number_everywhere` of those of all ranks.
        areas: W, area (length in 2D) of each point (n,).
        positions: (n, dim).
        ids: what tells points at one place apart, on any number of ranks (n, k): the input node of
            a vertex, those of the facet at Gauss points.
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
        B, E: from displacements and multipliers to points; E is None where it is the identity.
    """

    data: PointData
    positions: Array
    gaps: Array
    aside: Array
    vertex_gaps: Array
    vertex_normals: Array

    def __init__(
        self,
        V: fem.FunctionSpace,
        submesh: FacetSubmesh,
        method: Method,
        degrees: tuple[int, int],
        rule_degree: int,
        given: Given,
        opposite: Opposite | None = None,
        *,
        axisymmetric: bool = False,
    ):
        self._V = V
        self.submesh = submesh
        self.method = method
        self.given = given
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
        self._common: CommonPoints | None = None
        self.space = self.vertices
        if method == "integral":
            if opposite is not None and opposite.common is not None:
                self._common = CommonPoints(
                    V, submesh, opposite.common, rule_degree, axisymmetric=axisymmetric
                )
                self._gauss = self._common.gauss
            else:
                self.space = point_space(sub, rule_degree)
                self._gauss = GaussPoints.of_facets(self.space, self._owned_cells)
            self._hats = self._gauss.table(self.vertices)
            self.number = int(self._gauss.numbers.size)
        else:
            self.number = int(self.vertices.dofmap.index_map.size_local)
        self.number_everywhere: int = self.comm.allreduce(self.number)
        self.trace_dofs = trace_dofs(V, self.Q, facets)
        self.vertex_trace_dofs = (
            self.trace_dofs if degrees[1] == 1 else trace_dofs(V, self.vertices, facets)
        )
        gauss = self._gauss if method == "integral" else None
        self.ids, self.vertex_ids = point_ids(self.vertices, gauss)
        at_vertices = measure_of(domain, facets, 1, "vertex")
        at_gauss = measure_of(domain, facets, rule_degree)
        exact = measure_of(domain, facets, 2 * max(degrees) + axisymmetric)
        self._measure = at_gauss if method == "integral" else at_vertices
        self._exact = exact if method == "mixed" else None
        self._evaluate, self._average = self.evaluators(given, given.gap * given.normal)
        self._at_vertices = (
            PointEvaluator(self.vertices, at_vertices, given.at_points, self._maps)
            if method == "integral"
            else self._evaluate
        )
        areas = self._evaluate if self._average is None else self._average
        self.areas = areas.areas[: self.number].copy()
        self.vertex_areas = self._at_vertices.areas if method == "integral" else areas.areas
        self.circumferences: Array = np.ones(len(self.vertex_areas))
        if axisymmetric:
            sections = self._at_vertices.areas
            around = PointEvaluator(self.vertices, exact, {}, self._maps, self._weight)
            self.vertex_areas = around.areas
            self.circumferences = around.areas / sections
            if method == "nodal":
                self.areas = self.vertex_areas[: self.number].copy()
        if opposite is not None and opposite.areas is not None:
            self.vertex_areas = opposite.areas[self.vertex_trace_dofs]
            if method == "nodal":
                self.areas = self.vertex_areas[: self.number].copy()
        stencils = {"nodal": self._nodal, "integral": self._integral, "mixed": self._mixed}[method]
        self.stencils: Stencils = stencils(self._here)
        if self._common is not None:
            self.stencils = self.stencils.minus(self._common.opposite(self.stencils))
        elif opposite is not None:
            self.stencils = self.stencils.minus(stencils(opposite.at))
        self._apart = self.stencils, self.vertex_areas
        self._shared: PETSc.Mat | None = None
        self.B = self.stencils.jump_matrix(self.comm, V.dofmap.index_map.size_local, self.dim)
        nodes = self.Q.dofmap.index_map.size_local
        self.E: PETSc.Mat | None = None
        if not self.stencils.identity:
            self.E = self.stencils.traction_matrix(self.comm, nodes, self.dim)
        self.r: Array = np.ones(len(self.vertex_areas))
        self.update()

    @property
    def _maps(self) -> Any:
        return merge_entity_maps([self.submesh])

    def evaluators(self, given: Given, offset: Any) -> tuple[Evaluator, PointEvaluator | None]:
        """What evaluates ``given`` at the points, and averages ``offset`` in the mixed method."""
        here = self.evaluator({"x": ufl.SpatialCoordinate(self._V.mesh), **given.at_points})
        if self._exact is None:
            return here, None
        average = {"offset": offset}
        return here, PointEvaluator(self.space, self._exact, average, self._maps, self._weight)

    def evaluator(self, expressions: Mapping[str, Any]) -> Evaluator:
        """What evaluates UFL on the body at the points."""
        if self._common is None:
            # At nodes values are those of the vertex rule, on the axis too.
            weight = self._weight if self.method == "integral" else None
            return PointEvaluator(self.space, self._measure, expressions, self._maps, weight)
        at = self._common
        return ScatteredEvaluator(self._V.mesh, at.cells, at.positions, at.areas, expressions)

    # -- what is given ---------------------------------------------------------------------------

    def update(self) -> None:
        """Evaluate what is given anew. Collective."""
        values = self._evaluate()
        if self._at_vertices is self._evaluate:
            self.vertex_gaps = values["gap"]
            self.vertex_normals = values["normal"]
        else:
            at_vertices = self._at_vertices()
            self.vertex_gaps = at_vertices["gap"]
            self.vertex_normals = at_vertices["normal"]
        n = self.number
        mine = {name: v[:n] for name, v in values.items()}
        normal = mine["normal"]
        gap = mine["gap"]
        self.positions = mine["x"]
        self.gaps = gap
        self.aside = np.zeros_like(normal)
        offset = self._averaged(self._average, gap[:, None] * normal)
        if offset is not None:
            gap = np.sum(offset * normal, axis=1)
            self.aside = offset - gap[:, None] * normal
        self.data = PointData(normal, gap, self.from_vertices(self.r), fields_of(mine))

    def rates(self, evaluators: tuple[Evaluator, PointEvaluator | None]) -> tuple[PointData, Array]:
        """Rates of data and of `aside` from the evaluators of rates. Collective."""
        values = {name: v[: self.number] for name, v in evaluators[0]().items()}
        n = self.data.n
        gap = values["gap"]
        normal = values["normal"]
        aside = np.zeros_like(n)
        product = gap[:, None] * n + self.gaps[:, None] * normal
        offset = self._averaged(evaluators[1], product)
        if offset is not None:
            now = self.data.gap[:, None] * n + self.aside
            gap = np.sum(offset * n + now * normal, axis=1)
            aside = offset - gap[:, None] * n - self.data.gap[:, None] * normal
        return PointData(normal, gap, np.zeros(self.number), fields_of(values)), aside

    def _averaged(self, average: PointEvaluator | None, offset: Array) -> Array | None:
        """Averages of an offset that is known at the points (n, dim), if any are taken."""
        if average is None and self._shared is None:
            return None
        if average is not None:
            offset = average()["offset"][: self.number]
        return offset if self._shared is None else multiplied(self._shared, offset)

    def set_augmentation(self, r: Array) -> None:
        """Set r at the local vertices."""
        self.r = np.asarray(r, dtype=np.float64).copy()
        self.data = replace(self.data, r=self.from_vertices(self.r))

    def from_vertices(self, values: Array) -> Array:
        """Values at the points (n,) from those at the local vertices."""
        if self.method != "integral":
            return values[: self.number]
        found: Array = np.zeros(self.number)
        corners = values[self.vertices.dofmap.list[self._gauss.cells]]
        found[self._gauss.numbers] = np.einsum("gpv,gv->gp", self._hats, corners)
        return found

    @property
    def cells(self) -> npt.NDArray[np.int32]:
        """Cells of the submesh that this rank owns and that have Gauss points."""
        return np.unique(self._gauss.cells)

    @property
    def _owned_cells(self) -> int:
        topology = self.submesh.mesh.topology
        return int(topology.index_map(topology.dim).size_local)

    # -- operators -------------------------------------------------------------------------------

    def jump(self, u: PETSc.Vec) -> Array:
        """Jumps j at the points (n, dim): B u, less `aside`. Collective."""
        return self.product(u) - self.aside

    def product(self, u: PETSc.Vec) -> Array:
        """B u at the points (n, dim). Collective."""
        out = self.B.createVecLeft()
        self.B.mult(u, out)
        values = out.array_r.reshape(-1, self.dim).copy()
        out.destroy()
        return np.asarray(values)

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

    def forces(self, tractions: Array) -> Array:
        """B^T W t, owned entries, of tractions at the points (n, dim). Collective."""
        return multiplied_transposed(self.B, self.areas[:, None] * tractions)

    def rows(self, values: Array) -> Array:
        """E^T W of values at the points (n, dim): owned contact rows. Collective."""
        weighted = self.areas[:, None] * values
        return weighted.reshape(-1) if self.E is None else multiplied_transposed(self.E, weighted)

    def with_ghosts(self, values: Array) -> Array:
        """Values at the points of this rank, then at its ghosts. Collective."""
        width = int(np.prod(values.shape[1:], dtype=int))
        v = la.vector(self.space.dofmap.index_map, width)
        v.array.reshape(-1, width)[: self.number] = values.reshape(-1, width)
        v.scatter_forward()
        return v.array.reshape(-1, *values.shape[1:]).copy()

    def at_vertices(self, values: Array) -> Array:
        """Means of point values (n, ...) around the local vertices, ghosts included. Collective.

        Where the vertices are the points they are the values.
        """
        if self.method != "integral":
            return self.with_ghosts(values)
        width = int(np.prod(values.shape[1:], dtype=int)) + 1
        columns = [np.ones(self.number), values.reshape(self.number, width - 1)]
        weighted = np.column_stack(columns)
        weighted *= self.areas[:, None]
        v = la.vector(self.vertices.dofmap.index_map, width)
        v.array[:] = 0.0
        corners = self.vertices.dofmap.list[self._gauss.cells]
        parts = np.einsum("gpv,gpw->gvw", self._hats, weighted[self._gauss.numbers])
        np.add.at(v.array.reshape(-1, width), corners, parts)
        v.scatter_reverse(la.InsertMode.add)
        v.scatter_forward()
        sums = v.array.reshape(-1, width)
        # Of faces in part opposite to nothing some vertices have no point.
        means = np.divide(
            sums[:, 1:], sums[:, :1], out=np.zeros_like(sums[:, 1:]), where=sums[:, :1] > 0
        )
        return means.reshape(-1, *values.shape[1:])

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
        alone, areas = self._apart
        if self.stencils is alone and not self.comm.allreduce(int(given.any())):
            return given
        if self.method == "integral":
            return self._give_hats(given, idle)
        D, self.areas, given = shared(self.vertices, given, idle, areas[: self.number])
        self.vertex_areas = self.with_ghosts(self.areas)
        owned = self._V.dofmap.index_map.size_local
        plain = alone.scalar_matrix(self.comm, owned)
        self.stencils = self._each_alone(*rows_of(D.matMult(plain), np.ones(self.number)))
        plain.destroy()
        self.destroy()
        self._shared = D
        self.B = self.stencils.jump_matrix(self.comm, owned, self.dim)
        self.update()
        return given

    def _give_hats(
        self, given: npt.NDArray[np.bool_], idle: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.bool_]:
        """As `give`, of the functions of degree 1 whose sum the tractions at Gauss points are."""
        alone, _ = self._apart
        nodes, shares, given = takers(self.vertices, given, idle)
        corners = self.Q.dofmap.list[self._gauss.cells]
        groups, p, k = alone.multiplier_weights.shape
        width = k * shares.shape[1]
        weights = alone.multiplier_weights[..., None] * shares[corners][:, None]
        self.stencils = replace(
            alone,
            multiplier_nodes=nodes[corners].reshape(groups, width),
            multiplier_weights=weights.reshape(groups, p, width),
        )
        assert self.E is not None
        self.E.destroy()
        owned = self.Q.dofmap.index_map.size_local
        self.E = self.stencils.traction_matrix(self.comm, owned, self.dim)
        return given

    # -- stencils --------------------------------------------------------------------------------

    def _here(self, nodes: npt.NDArray[np.int32]) -> tuple[Nodes, Array]:
        """The trace of the body."""
        flat = self._V.dofmap.index_map.local_to_global(nodes.reshape(-1))
        known = np.asarray(flat, dtype=np.int64).reshape(*nodes.shape, 1)
        return known, np.ones(known.shape)

    def _each_alone(self, nodes: Nodes, weights: Array) -> Stencils:
        """Points that are multiplier nodes."""
        n = self.number
        mine = np.arange(n, dtype=np.int64)[:, None]
        first = self.Q.dofmap.index_map.local_range[0]
        return Stencils(mine, nodes, weights[:, None, :], first + mine, np.ones((n, 1, 1)), True)

    def _nodal(self, trace: Trace) -> Stencils:
        return self._each_alone(*trace(self.trace_dofs[: self.number]))

    def _mixed(self, trace: Trace) -> Stencils:
        W = self.vertices
        owned = self._V.dofmap.index_map.size_local
        p = ufl.TrialFunction(W)
        q = ufl.TestFunction(W)
        dx = ufl.dx(domain=self.submesh.mesh, metadata={"quadrature_degree": 2})
        product = p * q * dx
        if self._weight is not None:
            exact = {"quadrature_degree": 3}
            product = circumference(self.submesh.mesh) * p * q * dx(metadata=exact)
        consistent = dolfinx.fem.petsc.assemble_matrix(compiled_form(product))
        consistent.assemble()
        at_nodes = self._nodal(trace).scalar_matrix(self.comm, owned)
        means = consistent.matMult(at_nodes)
        consistent.destroy(), at_nodes.destroy()
        return self._each_alone(*rows_of(means, self.areas))

    def _integral(self, trace: Trace) -> Stencils:
        sub = self.submesh.mesh
        cells = self._gauss.cells
        u_element = self._V.ufl_element()
        U = point_space(sub, None)
        if u_element.degree > 1:
            U = fem.functionspace(sub, ("Lagrange", u_element.degree))
        at = trace_dofs(self._V, U, self.submesh.parent_facets)[U.dofmap.list[cells]]
        nodes, shares = trace(at)  # (groups, basis functions, nodes of each)
        mine = self.Q.dofmap.list[cells]
        known = self.Q.dofmap.index_map.local_to_global(mine.reshape(-1)).reshape(mine.shape)
        b = self._gauss.table(U)
        groups, p, k = b.shape
        weights = b[..., None] * shares[:, None]
        return Stencils(
            self._gauss.numbers,
            nodes.reshape(groups, k * shares.shape[2]),
            weights.reshape(groups, p, k * shares.shape[2]),
            known.astype(np.int64),
            self._gauss.table(self.Q),
            False,
        )

    def destroy(self) -> None:
        """Free the matrices."""
        for A in (self.B, self.E, self._shared):
            if A is not None:
                A.destroy()
