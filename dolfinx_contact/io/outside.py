# SPDX-License-Identifier: LGPL-3.0-or-later
"""Outer surface, contact faces and obstacles of a problem, for pictures and records.

All data are gathered on rank 0. Vertices are in the order of their numbers in the input mesh, which
does not depend on the number of ranks. Displacements of higher degree are evaluated at the vertices
only, so that the facets of the outer surface are plane or straight.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, la, mesh

from dolfinx_contact._arrays import Array, Indices, Ints
from dolfinx_contact._geometry import in_space, node_positions
from dolfinx_contact.points.trace import facet_closures, vertex_numbers
from dolfinx_contact.results.outer_surface import Arrays, Cells, OuterSurface, SurfaceState

if TYPE_CHECKING:
    from dolfinx_contact.points.surface import DiscreteSurface
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.results.tables import ContactTable

__all__ = [
    "Outside",
    "VertexMeans",
    "gather_facets",
    "obstacle_facets",
]

#: Stored columns of a `ContactTable`.
_COLUMNS = (
    *("x", "area", "un", "ut", "n", "force", "pressure", "shear", "letters", "bound", "support"),
)
#: Stored columns of laws that have them.
_OF_LAWS = ("adhesion", "bond", "slid")


class VertexMeans:
    """Mean of a field at each vertex, weighted by the hat function of the vertex.

    With the vertex quadrature rule the mean is taken over the one-sided values in the adjacent
    cells, so that it is exact for continuous fields.

    Args:
        V: Lagrange space of degree 1, with one dof per vertex.
        scalars: field as UFL scalars by cell tag; the key None means all cells.
        tags: cell tags; default: none.
        **rule: metadata of the quadrature rule; default: quadrature degree 1.
    """

    def __init__(
        self,
        V: fem.FunctionSpace,
        scalars: Mapping[int | None, Any],
        tags: mesh.MeshTags | None = None,
        **rule: Any,
    ):
        q = ufl.TestFunction(V)
        dx = ufl.Measure(
            "dx", V.mesh, subdomain_data=tags, metadata={"quadrature_degree": 1, **rule}
        )
        terms = [e * q * (dx if tag is None else dx(tag)) for tag, e in scalars.items()]
        self._form = fem.form(sum(terms))
        self._weights = _assembled(fem.form(q * dx))

    def __call__(self) -> Array:
        """Return the means at the n local vertices, shape (n,). Collective."""
        return _assembled(self._form) / self._weights


class Outside:
    """Outer surface of the bodies of a problem, and states on this surface. Collective.

    A state contains the displacement and the equivalent strain sqrt(2/3 e : e) at the vertices
    (`VertexMeans`), with the deviator e of the Green-Lagrange strain. In 2D the strain is plane;
    for bodies of revolution it includes the circumferential strain.

    Args:
        problem: contact problem with the displacement.

    Attributes:
        V: scalar P1 space of the bodies.
        numbers: numbers of the n local nodes of ``V`` in the input mesh, shape (n,).
        cells: local vertices of all cells in 2D, or of the boundary facets in 3D.
    """

    def __init__(self, problem: ContactProblem):
        domain = problem.V.mesh
        self.problem = problem
        self.V = fem.functionspace(domain, ("Lagrange", 1))
        self.numbers = vertex_numbers(self.V)
        self.cells = _outer_cells(self.V)
        self._moved = fem.Function(fem.functionspace(domain, ("Lagrange", 1, problem.u.ufl_shape)))
        self._strain: VertexMeans | None = None

    def gather(self, values: Mapping[str, npt.NDArray[Any]], *, whole: bool = False) -> Arrays:
        """Gather cells, the displacement and other vertex values on rank 0. Collective.

        Args:
            values: values at the local vertices, by name.
            whole: whether all cells are gathered, also in 3D; default: only `cells`.
        """
        self._moved.interpolate(self.problem.u)
        u = self._moved.x.array.reshape(-1, len(self.problem.u))
        topology = self.V.mesh.topology
        cells = self.V.dofmap.list[: topology.index_map(topology.dim).size_local]
        chosen = cells if whole else self.cells
        return _gather_cells(self.problem.comm, self.V, chosen, {"u": u, **values}, self.numbers)

    def surface(self) -> OuterSurface | None:
        """Return the undeformed outer surface on rank 0, None on other ranks. Collective."""
        body = self.gather({})
        contact, opposite = self.faces(body)
        obstacles = {
            s.name: obstacle_facets(s) for s in self.problem.surfaces if not s.between_bodies
        }
        if not body:
            return None
        cells = {name: face["cells"] for name, face in obstacles.items()}
        return OuterSurface(body["x"], body["nodes"], body["cells"], contact, opposite, cells)

    def state(self, law: ContactProblem) -> SurfaceState | None:
        """Return the present state of the outer surface on rank 0, None elsewhere. Collective.

        Args:
            law: problem whose contact law determines the values in the tables, in the same state.
        """
        if self._strain is None:
            revolves = any(s.axisymmetric for s in law.surfaces)
            strain = _equivalent_strain(self.problem.u, revolves)
            self._strain = VertexMeans(self.V, {None: strain}, quadrature_degree=2)
        seen = self.gather({"strain": self._strain()})
        patches = {s.name: obstacle_facets(s) for s in law.surfaces if not s.between_bodies}
        tables = {name: _columns(table) for name, table in law.tables().items()}
        if not seen:
            return None
        obstacles = {k: np.array([p["floor"], p["moved"], p["n"]]) for k, p in patches.items()}
        return SurfaceState(seen["u"], seen["strain"], obstacles, tables)

    def faces(self, body: Arrays) -> tuple[dict[str, Cells], dict[str, Cells]]:
        """Return the vertices of the facets of all contact surfaces on rank 0. Collective.

        Args:
            body: gathered body with these vertices, see `gather`.

        Returns:
            Facets of each contact surface, and of the master of each pair, by name of the surface.
        """
        nodes = body.get("nodes", np.zeros(0, dtype=np.int64))
        surfaces = self.problem.surfaces
        pairs = {s.name: s.obstacle.opposite for s in surfaces if s.between_bodies}
        contact = {s.name: self._face(s.submesh.parent_facets, nodes) for s in surfaces}
        opposite = {name: self._face(pair.master_facets, nodes) for name, pair in pairs.items()}
        return contact, opposite

    def _face(self, facets: Indices, nodes: Ints) -> Cells:
        """Gather facets on rank 0, as positions of their vertices in ``nodes``. Collective.

        Args:
            facets: local facets of this rank; ghosts are left out.
            nodes: numbers of the gathered vertices in the input mesh, in increasing order.
        """
        topology = self.V.mesh.topology
        owned = facets[facets < topology.index_map(topology.dim - 1).size_local]
        corners = self.numbers[facet_closures(self.V, owned)]
        return np.searchsorted(
            nodes, np.concatenate(self.problem.comm.gather(corners) or [corners])
        )


def _columns(table: ContactTable) -> Arrays:
    """Return the columns of a contact table that are stored in records, by name."""
    found: Arrays = {name: getattr(table, name) for name in _COLUMNS}
    of_law = {name: getattr(table, name) for name in _OF_LAWS}
    found |= {name: values for name, values in of_law.items() if values is not None}
    return found | {f"internal.{name}": values for name, values in table.internal.items()}


def obstacle_facets(s: DiscreteSurface) -> Arrays:
    """Gather the facets that represent the obstacle of a contact surface. Collective.

    An obstacle without facets is represented by the points opposite to the surface.

    Returns:
        Facets ``cells``, and at their m vertices the current position ``floor``, the displacement
        ``moved`` and the normal ``n`` into the obstacle, shape (m, dim) each. Points opposite to
        the surface are returned on rank 0; other ranks return an empty dictionary.
    """
    if s.obstacle.outline is not None:
        x, facets, n = s.obstacle.outline
        return {"cells": facets, "floor": x, "moved": s.partner.dragged(x), "n": n}
    points = s.points
    trace = points.vertex_nodes
    u = s.u.x.array.reshape(-1, s.dim)
    n = points.vertex_normals
    floor = s.node_positions[trace] + points.vertex_gaps[:, None] * n
    if s.displaced is not None:
        motion = None if s.rigid_body is None else s.rigid_body.values
        seen = s.partner.relative(u, motion)[trace]
        gap, normal = s.displaced.at_vertices(seen)
        floor = s.node_positions[trace] + seen + gap[:, None] * normal
        _, n = s.at_vertices(seen)
    return gather_facets(s, {"n": n, "floor": floor, "moved": s.partner.dragged(floor)})


def gather_facets(s: DiscreteSurface, values: Mapping[str, Any]) -> Arrays:
    """Gather the facets of a contact surface and values at its vertices on rank 0. Collective.

    Args:
        s: contact surface whose facets are gathered.
        values: values at its local vertices, by name, with one entry of the first axis per vertex.

    Returns:
        On rank 0: the facets ``cells``, shape (n, vertices per facet); the numbers ``nodes`` of the
        m vertices in the input mesh, shape (m,); their coordinates ``x``, shape (m, 3); and
        ``values``, first axis of length m. On other ranks: an empty dictionary.
    """
    V = s.points.vertices
    cells = V.dofmap.list[: s.submesh.mesh.topology.index_map(s.dim - 1).size_local]
    return _gather_cells(s.comm, V, cells, values, vertex_numbers(V))


def _assembled(form: fem.Form) -> Array:
    """Assemble a linear form and return the vector at all local nodes. Collective."""
    b = fem.assemble_vector(form)
    b.scatter_reverse(la.InsertMode.add)
    b.scatter_forward()
    return np.array(b.array)


def _equivalent_strain(u: fem.Function, revolves: bool) -> ufl.core.expr.Expr:
    """Return sqrt(2/3 e : e) with the deviator e of the Green-Lagrange strain.

    For an axisymmetric body (``revolves``) the circumferential strain is included.
    """
    dim = len(u)
    H = ufl.grad(u)
    across = 1.0
    if revolves:
        across = 1.0 + u[0] / ufl.SpatialCoordinate(u.function_space.mesh)[0]
    F = ufl.as_matrix(
        [
            [(H[i, j] if max(i, j) < dim else 0.0) + float(i == j) for j in range(3)]
            for i in range(dim)
        ]
        + [[0.0, 0.0, across]] * (3 - dim)
    )
    e = ufl.dev((F.T * F - ufl.Identity(3)) / 2)
    return ufl.sqrt(2 / 3 * ufl.inner(e, e))


def _outer_cells(V: fem.FunctionSpace) -> Indices:
    """Return the local nodes of all owned cells in 2D, of boundary facets in 3D. Collective."""
    topology = V.mesh.topology
    if topology.dim == 2:
        return np.asarray(V.dofmap.list[: topology.index_map(2).size_local])
    topology.create_connectivity(2, 3)
    return facet_closures(V, mesh.exterior_facet_indices(topology))


def _gather_cells(
    comm: MPI.Comm,
    V: fem.FunctionSpace,
    cells: Indices,
    values: Mapping[str, Any],
    numbers: Ints,
) -> Arrays:
    """Gather owned cells with coordinates and values at their nodes on rank 0. Collective.

    Args:
        comm: communicator.
        V: scalar space of the nodes.
        cells: local nodes of the cells of this rank, one row per cell.
        values: values at the local nodes, by name.
        numbers: numbers of the local nodes, by which the gathered nodes are sorted; the same on all
            ranks that share a node.

    Returns:
        On rank 0: ``cells`` of positions in the list of nodes; their numbers ``nodes``, shape (m,),
        and coordinates ``x``, shape (m, 3); and ``values``. On other ranks: an empty dictionary.
    """
    at_corners = {"x": in_space(node_positions(V)), **values}
    parts = comm.gather(
        {"cells": numbers[cells], **{name: v[cells] for name, v in at_corners.items()}}
    )
    if parts is None:
        return {}
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    corners = joined.pop("cells")
    nodes, first, places = np.unique(corners, return_index=True, return_inverse=True)
    at_nodes = {name: v.reshape(-1, *v.shape[2:])[first] for name, v in joined.items()}
    return {"cells": places.reshape(corners.shape), "nodes": nodes, **at_nodes}
