# SPDX-License-Identifier: LGPL-3.0-or-later
"""Outer surface, contact faces and obstacles of a problem, for pictures and records.

All data are on rank 0, at vertices in the order of their numbers in the input of the mesh, which is
the same on any number of ranks. Displacements of higher degree are taken at the vertices, so that
facets are linear.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, la, mesh

from dolfinx_contact._geometry import node_positions
from dolfinx_contact.points.trace import facet_closures, vertex_numbers
from dolfinx_contact.results.outer_surface import Arrays, Cells, OuterSurface, SurfaceState

if TYPE_CHECKING:
    from dolfinx_contact.points.surface import DiscreteSurface
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.results.tables import ContactTable

__all__ = [
    "Outside",
    "gather_cells",
    "patch",
]

#: Stored columns of a `ContactTable`.
_COLUMNS = (
    *("x", "area", "un", "ut", "n", "force", "pressure", "shear", "letters", "bound", "support"),
)
#: Stored columns of laws that have them.
_OF_LAWS = ("adhesion", "bond", "slid")


class Outside:
    """The outer surface of the bodies of a problem and its states. Collective.

    The equivalent strain is sqrt(2/3 e : e) with the deviator e of the Green-Lagrange strain (plane
    in 2D, with the circumferential strain for bodies of revolution). Its value at a vertex is the
    mean over the adjacent cells, weighted by the hat function of the vertex.

    Args:
        problem: contact problem with the displacement.

    Attributes:
        V: scalar P1 space of the bodies.
        numbers: numbers of its local nodes in the input of the mesh.
        cells: local vertices of all cells in 2D, of the boundary facets in 3D.
    """

    def __init__(self, problem: ContactProblem):
        domain = problem.V.mesh
        self.problem = problem
        self.V = fem.functionspace(domain, ("Lagrange", 1))
        self.numbers = vertex_numbers(self.V)
        self.cells = _outer_cells(self.V)
        vectors = fem.functionspace(domain, ("Lagrange", 1, (domain.topology.dim,)))
        self._moved = fem.Function(vectors)
        self._strain: tuple[fem.Form, npt.NDArray[np.float64]] | None = None

    def strain(self) -> npt.NDArray[np.float64]:
        """Return the equivalent strain at the local vertices. Collective."""
        if self._strain is None:
            w = ufl.TestFunction(self.V)
            dx = ufl.dx(domain=self.V.mesh, metadata={"quadrature_degree": 2})
            weights = _assembled(fem.form(w * dx))
            revolves = any(s.axisymmetric for s in self.problem.surfaces)
            equivalent = _equivalent_strain(self.problem.u, revolves)
            self._strain = fem.form(equivalent * w * dx), weights
        form, weights = self._strain
        return _assembled(form) / weights

    def gather(self, values: Mapping[str, npt.NDArray[Any]]) -> Arrays:
        """Gather values at the local vertices on rank 0, see `gather_cells`. Collective."""
        return gather_cells(self.problem.comm, self.V, self.cells, values, self.numbers)

    def inside(self, values: Mapping[str, npt.NDArray[Any]]) -> Arrays:
        """Gather values and the displacement ``u`` at the vertices of all cells. Collective."""
        domain = self.V.mesh
        self._moved.interpolate(self.problem.u)
        u = self._moved.x.array.reshape(-1, domain.topology.dim)
        cells = self.V.dofmap.list[: domain.topology.index_map(domain.topology.dim).size_local]
        every = {"u": u, **values}
        return gather_cells(self.problem.comm, self.V, cells, every, self.numbers)

    def surface(self) -> OuterSurface | None:
        """Return the outer surface on rank 0, None on other ranks. Collective."""
        problem = self.problem
        body = self.gather({})
        contact: dict[str, Arrays] = {}
        opposite: dict[str, Arrays] = {}
        obstacles: dict[str, Arrays] = {}
        for s in problem.surfaces:
            contact[s.name] = self._face(s.submesh.parent_facets)
            if s.between_bodies:
                opposite[s.name] = self._face(s.obstacle.opposite.master_facets)
            else:
                obstacles[s.name] = _obstacle(s)
        if not body:
            return None
        nodes = body["nodes"]

        def on_surface(faces: Mapping[str, Arrays]) -> dict[str, Cells]:
            places = {k: np.searchsorted(nodes, face["nodes"]) for k, face in faces.items()}
            return {k: places[k][face["cells"]] for k, face in faces.items()}

        return OuterSurface(
            body["x"],
            nodes,
            body["cells"],
            on_surface(contact),
            on_surface(opposite),
            {k: face["cells"] for k, face in obstacles.items()},
        )

    def state(self, law: ContactProblem | None = None) -> SurfaceState | None:
        """Return the state in the Functions on rank 0, None on other ranks. Collective.

        Args:
            law: problem with the law of the contact tables; default: problem passed to the
                constructor.
        """
        problem = self.problem if law is None else law
        self._moved.interpolate(problem.u)
        dim = problem.V.mesh.topology.dim
        seen = self.gather({"u": self._moved.x.array.reshape(-1, dim), "strain": self.strain()})
        patches = {s.name: _obstacle(s) for s in problem.surfaces if not s.between_bodies}
        tables = {s.name: _columns(problem.table(s)) for s in problem.surfaces}
        if not seen:
            return None
        obstacles = {k: np.array([p["floor"], p["moved"], p["n"]]) for k, p in patches.items()}
        return SurfaceState(seen["u"], seen["strain"], obstacles, tables)

    def _face(self, facets: npt.NDArray[np.int32]) -> Arrays:
        """Gather owned facets of the body on rank 0. Collective."""
        topology = self.V.mesh.topology
        owned = facets[facets < topology.index_map(topology.dim - 1).size_local]
        closures = facet_closures(self.V, owned)
        return gather_cells(self.problem.comm, self.V, closures, {}, self.numbers)


def _columns(table: ContactTable) -> Arrays:
    """Return the stored columns of a contact table."""
    found: Arrays = {name: getattr(table, name) for name in _COLUMNS}
    of_law = {name: getattr(table, name) for name in _OF_LAWS}
    found |= {name: values for name, values in of_law.items() if values is not None}
    return found | {f"internal.{name}": values for name, values in table.internal.items()}


def _obstacle(s: DiscreteSurface) -> Arrays:
    """Gather the facets of an obstacle, or the opposing points of the surface (see `patch`)."""
    outline = s.obstacle.outline
    if outline is None:
        return patch(s)
    x, cells, n = outline
    return {"cells": cells, "floor": x, "moved": s.partner.dragged(x), "n": n}


def patch(s: DiscreteSurface) -> Arrays:
    """Gather a contact surface and its obstacle on rank 0. Collective."""
    points = s.points
    u, x = (v[points.vertex_trace_dofs] for v in (s.u.x.array.reshape(-1, s.dim), s.node_positions))
    body = s.rigid_body
    gap = points.vertex_gaps
    n = points.vertex_normals
    floor = x + gap[:, None] * n
    if s.displaced is not None:
        motion = None if body is None else body.values
        seen = s.partner.relative(s.u.x.array.reshape(-1, s.dim), motion)[points.vertex_trace_dofs]
        gap, normal = s.displaced.at_vertices(seen)
        floor = x + seen + gap[:, None] * normal
        _, n = s.at_vertices(seen)
    moved = s.partner.dragged(floor)
    values = {"u": u, "n": n, "floor": floor, "moved": moved, "ids": points.vertex_ids}
    V = points.vertices
    cells = V.dofmap.list[: s.submesh.mesh.topology.index_map(s.dim - 1).size_local]
    return gather_cells(s.comm, V, cells, values, vertex_numbers(V))


def _assembled(form: fem.Form) -> npt.NDArray[np.float64]:
    """Assemble a linear form; return its values at all local nodes. Collective."""
    b = fem.assemble_vector(form)
    b.scatter_reverse(la.InsertMode.add)
    b.scatter_forward()
    return np.array(b.array)


def _equivalent_strain(u: fem.Function, revolves: bool) -> ufl.core.expr.Expr:
    """Return sqrt(2/3 e : e) with the deviator e of the Green-Lagrange strain."""
    dim = len(u)
    gradient = ufl.grad(u)
    F = ufl.as_matrix(
        [
            [gradient[i, j] + (i == j) if max(i, j) < dim else float(i == j) for j in range(3)]
            for i in range(3)
        ]
    )
    E = (F.T * F - ufl.Identity(3)) / 2
    if revolves:
        around = 1 + u[0] / ufl.SpatialCoordinate(u.function_space.mesh)[0]
        E += ufl.as_matrix([[0, 0, 0], [0, 0, 0], [0, 0, (around**2 - 1) / 2]])
    e = ufl.dev(E)
    return ufl.sqrt(2 / 3 * ufl.inner(e, e))


def _outer_cells(V: fem.FunctionSpace) -> npt.NDArray[np.int32]:
    """Return local nodes of the owned cells in 2D, of the boundary facets in 3D. Collective."""
    topology = V.mesh.topology
    if topology.dim == 2:
        return np.asarray(V.dofmap.list[: topology.index_map(2).size_local])
    topology.create_connectivity(2, 3)
    return facet_closures(V, mesh.exterior_facet_indices(topology))


def gather_cells(
    comm: MPI.Comm,
    V: fem.FunctionSpace,
    cells: npt.NDArray[np.int32],
    values: Mapping[str, Any],
    numbers: npt.NDArray[np.int64],
) -> Arrays:
    """Gather owned cells with coordinates and values at their nodes on rank 0. Collective.

    Args:
        comm: communicator.
        V: scalar space of the nodes.
        cells: local nodes of the cells of this rank, one row each.
        values: values at the local nodes, by name.
        numbers: numbers of the local nodes that determine their order, equal on all ranks with the
            node.

    Returns:
        ``cells``, ``nodes`` (their numbers), ``x`` and the values on rank 0; an empty dictionary on
        other ranks.
    """
    nodes, local = np.unique(cells, return_inverse=True)
    mine = {
        "cells": numbers[nodes][local].reshape(cells.shape),
        "nodes": numbers[nodes],
        "x": node_positions(V)[nodes],
        **{k: v[nodes] for k, v in values.items()},
    }
    parts = comm.gather(mine)
    if parts is None:
        return {}
    parts = [p for p in parts if len(p["nodes"])]
    joined = {k: np.concatenate([p[k] for p in parts]) for k in mine}
    number, first = np.unique(joined.pop("nodes"), return_index=True)
    places = np.searchsorted(number, joined.pop("cells"))
    at_nodes = {k: v[first] for k, v in joined.items()}
    return {"cells": places, "nodes": number, **at_nodes}
