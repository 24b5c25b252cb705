# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fields on the master of a pair of bodies.

The contact points of a pair belong to the slave, whose face has all fields. The master has its
displacement, its support, and a traction: the contact forces B^T W t at its nodes divided by the
areas of its own vertices. For matching nodes and nodal contact this is minus the traction of the
slave. Otherwise it is the same total force on another mesh; at a vertex that the slave covers
partially, the force is divided by the whole area of the vertex. Gap, slip and status exist at
contact points, hence on the slave only.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, la

from dolfinx_contact._compat import FacetSubmesh, create_facet_submesh
from dolfinx_contact._forms import compiled_form
from dolfinx_contact.body.bulk import circumference
from dolfinx_contact.points.evaluation import point_space, vertex_function
from dolfinx_contact.points.trace import outward_normals, trace_dofs
from dolfinx_contact.results.balance import forces_at_vertices, pair_forces, support_at_nodes

if TYPE_CHECKING:
    from dolfinx_contact.points.surface import DiscreteSurface
    from dolfinx_contact.problem import ContactProblem

__all__ = ["MasterFace"]


class MasterFace:
    """Master face of a pair. Collective.

    Args:
        problem: contact problem with the pair.
        pair: surface between bodies.

    Attributes:
        submesh: mesh of the facets.
        vertices: scalar P1 space on it.
        areas: areas of the local vertices, integrated as on the slave: by the vertex rule for
            matching nodes and nodal contact, otherwise by hat functions.
        trace: nodes of the displacement at the local vertices.
        normals: outward unit normals at the local vertices, shape (n, dim).
    """

    def __init__(self, problem: ContactProblem, pair: DiscreteSurface):
        self._number = problem.surfaces.index(pair)
        opposite = pair.obstacle.opposite
        V = problem.V
        self.submesh: FacetSubmesh = create_facet_submesh(V.mesh, opposite.master_facets)
        self.vertices = point_space(self.submesh.mesh, None)
        facets = self.submesh.parent_facets
        self.trace = trace_dofs(V, self.vertices, facets)
        same = pair.method == "nodal" and opposite.matching
        rule = {"quadrature_rule": "vertex", "quadrature_degree": 1}
        dx = ufl.Measure("dx", self.submesh.mesh, metadata=rule if same else {})
        areas = la.vector(self.vertices.dofmap.index_map, 1)
        areas.array[:] = 0.0
        area = ufl.TestFunction(self.vertices) * dx
        if pair.axisymmetric:
            exact = dx(metadata={"quadrature_degree": 2})
            area = circumference(self.submesh.mesh) * ufl.TestFunction(self.vertices) * exact
        fem.assemble_vector(areas.array, compiled_form(area))
        areas.scatter_reverse(la.InsertMode.add)
        areas.scatter_forward()
        self.areas = areas.array.copy()
        W = fem.functionspace(V.mesh, ("Lagrange", 1))
        normals = outward_normals(W, opposite.master_facets)
        self.normals = normals[trace_dofs(W, self.vertices, facets)]

    def fields(self, problem: ContactProblem) -> dict[str, fem.Function]:
        """Return the continuous, linear fields at the state in the Functions. Collective.

        Args:
            problem: problem with the law of the state.

        Returns:
            Fields by name: ``displacement``, contact ``traction`` on the master, ``pressure`` (its
            component against the outward normal), and ``support`` (reaction of Dirichlet data
            divided by the area of a vertex).
        """
        eq = problem.equations
        state = problem.evaluate()
        dim = eq.dim
        u = problem.u.x.array.reshape(-1, dim)
        forces = fem.Function(problem.V)
        owned = pair_forces(eq, self._number, state).reshape(-1)
        forces.x.array[: len(owned)] = owned
        forces.x.scatter_forward()
        traction = self._per_area(problem.V, forces.x.array.reshape(-1, dim))
        values = {
            "displacement": u[self.trace],
            "traction": traction,
            "pressure": -np.sum(traction * self.normals, axis=1) + 0.0,
            "support": self._per_area(problem.V, support_at_nodes(eq, state)),
        }
        return {name: vertex_function(self.vertices, name, v) for name, v in values.items()}

    def _per_area(
        self, V: fem.FunctionSpace, forces: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.float64]:
        """Divide forces at the local nodes of the displacement by the areas of the vertices."""
        there = forces_at_vertices(V, self.submesh, self.trace, forces)
        return np.asarray(there / self.areas[:, None])
