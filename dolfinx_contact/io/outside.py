# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is seen of the bodies of a problem: their outer surface, contact faces, and obstacles.

All of it is on rank 0, at vertices in the order of their numbers in the mesh as it was given to
DOLFINx: the same on any number of ranks. A displacement of higher degree is that of the vertices,
so that facets are linear.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, la, mesh

from dolfinx_contact.io.gathering import Arrays, gather_cells
from dolfinx_contact.points.trace import facet_closures, vertex_numbers

if TYPE_CHECKING:
    from dolfinx_contact.points.surface import DiscreteSurface
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.results.tables import ContactTable

__all__ = ["OuterSurface", "Outside", "SurfaceState", "patch"]

Cells = npt.NDArray[np.int64]

#: Of a `ContactTable`, what is kept of every surface.
_COLUMNS = (
    *("x", "area", "un", "ut", "n", "force", "pressure", "shear", "letters", "bound", "support"),
)
#: What is kept where a law has it.
_OF_LAWS = ("adhesion", "bond", "slid")


@dataclass(frozen=True, eq=False)
class OuterSurface:
    """The outer surface of bodies before they move.

    Attributes:
        x: coordinates of its vertices (n, 3).
        nodes: their numbers in the mesh as it was given to DOLFINx (n,), rising.
        cells: vertices of the facets of the boundary, one row each; of bodies in 2D those of their
            cells.
        contact: by the name of a contact surface, vertices of its facets.
        opposite: the same of the masters of pairs.
        obstacles: by the name of a surface without a master, facets of its obstacle, by vertices of
            their own (`SurfaceState.obstacles`).
    """

    x: npt.NDArray[np.float64]
    nodes: npt.NDArray[np.int64]
    cells: Cells
    contact: dict[str, Cells]
    opposite: dict[str, Cells]
    obstacles: dict[str, Cells]

    def arrays(self) -> Arrays:
        """All of it as arrays by name, for a file."""
        found: Arrays = {"x": self.x, "nodes": self.nodes, "cells": self.cells}
        found["surfaces"] = np.array(list(self.contact), dtype=np.str_)
        for i, name in enumerate(self.contact):
            found[f"contact_{i}"] = self.contact[name]
            if name in self.opposite:
                found[f"opposite_{i}"] = self.opposite[name]
            else:
                found[f"obstacle_{i}"] = self.obstacles[name]
        return found

    @staticmethod
    def of_arrays(found: Mapping[str, npt.NDArray[Any]]) -> OuterSurface:
        """What `arrays` made arrays of.

        Raises:
            KeyError: if one is missing.
        """
        names = [str(name) for name in found["surfaces"]]
        pairs = {name for i, name in enumerate(names) if f"opposite_{i}" in found}
        return OuterSurface(
            found["x"],
            found["nodes"],
            found["cells"],
            {name: found[f"contact_{i}"] for i, name in enumerate(names)},
            {name: found[f"opposite_{i}"] for i, name in enumerate(names) if name in pairs},
            {name: found[f"obstacle_{i}"] for i, name in enumerate(names) if name not in pairs},
        )


@dataclass(frozen=True, eq=False)
class SurfaceState:
    """Where an outer surface and obstacles are at a state, and what is known of contact points.

    Attributes:
        u: displacement of the vertices (n, dim).
        obstacles: by the name of a surface without a master, the vertices of its obstacle at the
            contact points, their motion, and the normals there (3, m, dim).
        tables: by the name of a contact surface, columns of its `ContactTable` by their names, in
            double precision; None of a file that an earlier version wrote.
        strain: equivalent strain at the vertices (n,), see `Outside`; None likewise.
    """

    u: npt.NDArray[Any]
    obstacles: dict[str, npt.NDArray[Any]]
    tables: dict[str, Arrays] | None = None
    strain: npt.NDArray[Any] | None = None

    def arrays(self) -> Arrays:
        """All of it as arrays by name, for a file; the motion of the body of single precision."""
        found: Arrays = {"u": self.u.astype(np.float32)}
        found["obstacles"] = np.array(list(self.obstacles), dtype=np.str_)
        for i, values in enumerate(self.obstacles.values()):
            # In double precision: gaps and displacements are small beside its coordinates.
            found[f"obstacle_{i}"] = values
        if self.strain is not None:
            found["strain"] = self.strain.astype(np.float32)
        if self.tables is not None:
            found["tables"] = np.array(list(self.tables), dtype=np.str_)
            for i, columns in enumerate(self.tables.values()):
                found |= {f"table_{i}.{name}": values for name, values in columns.items()}
        return found

    @staticmethod
    def of_arrays(found: Mapping[str, npt.NDArray[Any]]) -> SurfaceState:
        """What `arrays` made arrays of.

        Raises:
            KeyError: if one is missing.
        """
        names = [str(name) for name in found["obstacles"]]
        obstacles = {name: found[f"obstacle_{i}"] for i, name in enumerate(names)}
        tables: dict[str, Arrays] | None = None
        if "tables" in found:
            tables = {}
            for i, name in enumerate(found["tables"]):
                prefix = f"table_{i}."
                columns = {k.removeprefix(prefix): v for k, v in found.items() if prefix in k}
                missing = set(_COLUMNS) - set(columns)
                if missing:
                    raise KeyError(f"{prefix}{min(missing)}")
                tables[str(name)] = columns
        return SurfaceState(found["u"], obstacles, tables, found.get("strain"))


class Outside:
    """Looks at the bodies of a problem from outside. Collective.

    The equivalent strain is sqrt(2/3 e : e), with e the deviator of the Green-Lagrange strain (in
    2D plane, of a body of revolution with that around the axis): at a vertex its mean over the
    cells around it, weighted by the function that is 1 there.

    Args:
        problem: whose displacement is shown.

    Attributes:
        V: linear space of the vertices of the bodies.
        numbers: of its local nodes, in the mesh as it was given to DOLFINx.
        cells: local vertices of what is seen: in 2D cells, in 3D facets of the boundary.
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
        """Equivalent strain at the local vertices at the present displacement. Collective."""
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
        """Values at the local vertices, on rank 0 as `gather_cells` has them. Collective."""
        return gather_cells(self.problem.comm, self.V, self.cells, values, self.numbers)

    def inside(self, values: Mapping[str, npt.NDArray[Any]]) -> Arrays:
        """Values and the displacement ``u`` at the vertices of all cells, likewise. Collective."""
        domain = self.V.mesh
        self._moved.interpolate(self.problem.u)
        u = self._moved.x.array.reshape(-1, domain.topology.dim)
        cells = self.V.dofmap.list[: domain.topology.index_map(domain.topology.dim).size_local]
        every = {"u": u, **values}
        return gather_cells(self.problem.comm, self.V, cells, every, self.numbers)

    def surface(self) -> OuterSurface | None:
        """The outer surface, on rank 0. Collective."""
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
        """Where all is at the displacement of the problem, on rank 0. Collective.

        Args:
            law: problem whose law the tables of contact points have; by default the problem.
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
        return SurfaceState(seen["u"], obstacles, tables, seen["strain"])

    def _face(self, facets: npt.NDArray[np.int32]) -> Arrays:
        """Facets of the body that this rank owns, of all ranks on rank 0. Collective."""
        topology = self.V.mesh.topology
        owned = facets[facets < topology.index_map(topology.dim - 1).size_local]
        closures = facet_closures(self.V, owned)
        return gather_cells(self.problem.comm, self.V, closures, {}, self.numbers)


def _columns(table: ContactTable) -> Arrays:
    """What is kept of a table of contact points, by the names of its columns."""
    found: Arrays = {name: getattr(table, name) for name in _COLUMNS}
    of_law = {name: getattr(table, name) for name in _OF_LAWS}
    found |= {name: values for name, values in of_law.items() if values is not None}
    return found | {f"internal.{name}": values for name, values in table.internal.items()}


def _obstacle(s: DiscreteSurface) -> Arrays:
    """What is drawn of an obstacle: its facets, or the points opposite to the surface.

    As of `patch`, on rank 0. Collective.
    """
    outline = s.obstacle.outline
    if outline is None:
        return patch(s)
    x, cells, n = outline
    return {"cells": cells, "floor": x, "moved": s.dragged(x), "n": n}


def patch(s: DiscreteSurface) -> Arrays:
    """A contact surface and its obstacle, which may move as well, on rank 0. Collective."""
    points = s.points
    u, x = (v[points.vertex_trace_dofs] for v in (s.u.x.array.reshape(-1, s.dim), s.node_positions))
    body = s.rigid_body
    gap = points.vertex_gaps
    n = points.vertex_normals
    floor = x + gap[:, None] * n
    if s.displaced is not None:
        motion = None if body is None else body.values
        seen = s.relative(s.u.x.array.reshape(-1, s.dim), motion)[points.vertex_trace_dofs]
        gap, normal = s.displaced.at_vertices(seen)
        floor = x + seen + gap[:, None] * normal
        _, n = s.at_vertices(seen)
    moved = s.dragged(floor)
    values = {"u": u, "n": n, "floor": floor, "moved": moved, "ids": points.vertex_ids}
    V = points.vertices
    cells = V.dofmap.list[: s.submesh.mesh.topology.index_map(s.dim - 1).size_local]
    return gather_cells(s.comm, V, cells, values, vertex_numbers(V))


def _assembled(form: fem.Form) -> npt.NDArray[np.float64]:
    """A linear form at all local nodes. Collective."""
    b = fem.assemble_vector(form)
    b.scatter_reverse(la.InsertMode.add)
    b.scatter_forward()
    return np.array(b.array)


def _equivalent_strain(u: fem.Function, revolves: bool) -> ufl.core.expr.Expr:
    """sqrt(2/3 e : e) of the deviator e of the Green-Lagrange strain of a displacement."""
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
    """Local nodes of a linear space at what is seen of a body. Collective.

    In 2D its cells, in 3D the facets of its boundary, of this rank.
    """
    topology = V.mesh.topology
    if topology.dim == 2:
        return np.asarray(V.dofmap.list[: topology.index_map(2).size_local])
    topology.create_connectivity(2, 3)
    return facet_closures(V, mesh.exterior_facet_indices(topology))
