# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact surfaces: where a body may touch an obstacle, and what is known at each contact point.

A contact surface owns the multiplier (the traction on the body, on a submesh of facets) and the
contact points at which the law is checked. Three discretisations share the law of `laws.cone`:

- ``"nodal"``: the points are the mesh nodes of the surface (vertex rule, P1 displacement). The
  conditions hold node by node.
- ``"integral"``: the points are Gauss points; P1 or P2 displacement. The conditions hold weakly.
- ``"mixed"``: a P1 multiplier in the cone at the nodes with consistent integrals, so that the gap
  and the slip are nodal averages of the displacement (Hild, Int. J. Appl. Math. Comput. Sci. 12,
  2002, section 2; P1 displacement in 2D).
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

import basix.ufl
import ufl
from dolfinx import fem, la, mesh

from dolfinx_contact._agreement import described, refuse_displacement, refuse_other_mesh
from dolfinx_contact._compat import (
    create_facet_submesh,
    facet_integration_entities,
    merge_entity_maps,
)
from dolfinx_contact._errors import everywhere, require, same_everywhere
from dolfinx_contact.elements import check_elements, check_quadrature, displacement_degree
from dolfinx_contact.evaluation import Evaluator, require_same_numbering
from dolfinx_contact.laws import FrictionLaw, Status, augment, classify, projection
from dolfinx_contact.meshing import GmshMesh, tagged_facets
from dolfinx_contact.obstacles import Obstacle, gap_at
from dolfinx_contact.trace import exterior_facets, facet_closures, owned_exterior, trace_dofs

__all__ = ["ContactSurface", "Method"]

Method = Literal["nodal", "integral", "mixed"]


class RowMeasures(NamedTuple):
    """Largest contact residuals of one rank, and the largest nodal contact force."""

    length: float
    force: float
    contact_force: float


class ContactSurface:
    """A part of the boundary that may touch an obstacle, with a law.

    Args:
        u: displacement of the body, a vector Lagrange Function of degree 1 or 2.
        facets: the mesh of `meshing.read_mesh`, or MeshTags of facets, with ``tag``; of another
            mesh they are refused. Or local indices of exterior facets, which do not tell their
            mesh.
        obstacle: the rigid foundation.
        law: friction law.
        tag: which tag of the MeshTags; of a mesh from gmsh also the name of a physical group.
        method: ``"nodal"``, ``"integral"`` or ``"mixed"`` (see the module); by default nodal for
            degree 1 and integral for degree 2.
        multiplier_degree: 1 or 2; 1 is stable with both displacement degrees.
        quadrature_degree: of the Gauss points of the integral method, by default twice the degree
            of the displacement.
        name: used in messages and tables.

    Attributes:
        multiplier: traction on the body, a vector Function of the facet submesh.
        law: the law with its numbers as Constants, which may be changed between solves.
        r: augmentation parameter (stiffness per area), a Function of the vertices; it changes the
            iterates, not the solution.
        points: scalar space with one dof per contact point.
        trace_dofs: for every local multiplier node the node of the displacement at its place.

    Raises:
        ValueError: on every rank, if the facets or elements do not fit, something is of another
            mesh, or the arguments differ between ranks.
    """

    def __init__(
        self,
        u: fem.Function,
        facets: GmshMesh | mesh.MeshTags | npt.NDArray[np.int32],
        *,
        obstacle: Obstacle,
        law: FrictionLaw,
        tag: int | str | None = None,
        method: Method | None = None,
        multiplier_degree: int = 1,
        quadrature_degree: int | None = None,
        name: str = "contact",
    ):
        if not isinstance(u, fem.Function):
            raise ValueError(f"the displacement must be a Function, got {type(u).__name__}")
        domain = u.function_space.mesh
        self.u, self.domain, self.name, self.dim = u, domain, name, domain.geometry.dim
        self.comm = domain.comm
        with everywhere(self.comm, "a contact surface"):
            if not isinstance(name, str) or not name:
                raise ValueError(f"the name of a contact surface must be a word, got {name!r}")
            degree = displacement_degree(u)
            self.method: Method = method or ("nodal" if degree == 1 else "integral")
            self.degrees = (degree, multiplier_degree)
            if not isinstance(law, FrictionLaw):
                raise ValueError(f"{name}: the law must be Frictionless(), Coulomb(F) or Tresca(g)")
            if not isinstance(obstacle, Obstacle):
                raise ValueError(
                    f"{name}: the obstacle must be a HalfSpace, Sphere, Cylinder, LevelSet"
                )
            check_elements(name, self.method, self.degrees, self.dim)
            rule_degree = check_quadrature(name, self.degrees, quadrature_degree)
            self.law = law.bind(domain)
            self.obstacle = obstacle
            self.gap, self.normal = obstacle.on(domain)
            refuse_displacement(u, f"{name}: the obstacle", self.gap, self.normal)
            bound = self.law.bound(ufl.SpatialCoordinate(domain)[0])  # any pressure will do
            for what, expression in (("law", bound), ("obstacle", self.gap)):
                refuse_other_mesh(expression, domain, f"{name}: the {what}")
            #: Functions of the user in law and obstacle.
            self._data = sorted(
                {
                    f
                    for e in (bound, self.gap, self.normal)
                    for f in ufl.algorithms.extract_coefficients(e)
                    if f is not u
                },
                key=lambda f: f.count(),
            )
        same_everywhere(self.comm, name=name)
        same_everywhere(
            self.comm,
            name,
            displacement=str(u.function_space.ufl_element()),
            kind_of_facets=isinstance(facets, mesh.MeshTags),
            tag=None if tag is None else int(tag) if isinstance(tag, np.integer) else tag,
            method=self.method,
            multiplier_degree=int(multiplier_degree),
            quadrature_degree=int(rule_degree),
            law=f"{type(law).__name__} {described(bound, domain)}",
            obstacle=f"{type(obstacle).__name__} {described(self.gap, domain)}",
            normal=described(self.normal, domain),
        )

        local = exterior_facets(domain, *tagged_facets(self.comm, facets, tag, name), name)
        self.submesh = create_facet_submesh(domain, local)
        self.entity_maps = merge_entity_maps([self.submesh])
        sub = self.submesh.mesh
        self.Q = fem.functionspace(sub, ("Lagrange", multiplier_degree, (self.dim,)))
        self.vertices = fem.functionspace(sub, ("Lagrange", 1))
        self._vertex_vectors = fem.functionspace(sub, ("Lagrange", 1, (self.dim,)))
        if self.method == "integral":
            rule, order = "default", rule_degree
            self.points, self._point_vectors = (
                fem.functionspace(
                    sub,
                    basix.ufl.quadrature_element(
                        sub.basix_cell(), value_shape=shape, scheme=rule, degree=order
                    ),
                )
                for shape in ((), (self.dim,))
            )
        else:
            rule, order = "vertex", 1
            self.points, self._point_vectors = self.vertices, self._vertex_vectors
            require_same_numbering(self.points, self.Q)
        require_same_numbering(self.vertices, self._vertex_vectors)
        require_same_numbering(self.points, self._point_vectors)

        entities = facet_integration_entities(domain, owned_exterior(domain, local))
        ds = ufl.Measure("ds", domain, subdomain_data=[(1, entities)])
        self._ds = ds(1, metadata={"quadrature_rule": rule, "quadrature_degree": order})
        self._ds_exact = ds(1, metadata={"quadrature_degree": 2 * max(self.degrees)})
        self._ds_vertex = ds(1, metadata={"quadrature_rule": "vertex", "quadrature_degree": 1})

        self.multiplier = fem.Function(self.Q, name=f"{name}_traction")
        self.r = fem.Function(self.vertices, name="r")
        self.r.x.array[:] = 1.0
        self._active, self._stick, self._slip = (fem.Function(self.points) for _ in range(3))
        #: Nodal averages of u - g n in the mixed method, else None.
        self.average: fem.Function | None = None
        self._average_stiffness = fem.Constant(domain, 1.0)
        jump, gap = u, self.gap
        if self.method == "mixed":
            self.average = fem.Function(self.Q, name=f"{name}_average")
            jump, gap = self.average, 0.0
        self._augmented = augment(self.multiplier, jump, gap, self.normal, self.r, self.dim)
        self._evaluators()
        self.trace_dofs = trace_dofs(u.function_space, self.Q, self.submesh.parent_facets)
        self.vertex_trace_dofs = trace_dofs(
            u.function_space, self.vertices, self.submesh.parent_facets
        )

    def _evaluators(self) -> None:
        """What is evaluated at points and vertices, compiled once."""

        def at_points(*expressions: Any) -> Evaluator:
            W = self.points, self._point_vectors
            return Evaluator(*W, self._ds, expressions, self.entity_maps)

        def at_vertices(*expressions: Any) -> Evaluator:
            W = self.vertices, self._vertex_vectors
            return Evaluator(*W, self._ds_vertex, expressions, self.entity_maps)

        a = self._augmented
        shear = ufl.dot(a.s, a.t) if a.t is not None else ufl.dot(a.s, a.s)
        self._status_data = at_points(a.p, shear, self.law.bound(a.p))
        self._unit_bound = at_points(self.law.bound(fem.Constant(self.domain, 1.0)))
        self._state = at_points(a.u_n, a.u_t, self.multiplier, a.n)
        #: Positions of the local contact points (n, dim).
        self.positions = at_points(ufl.SpatialCoordinate(self.domain))()[0]
        self._status_at_vertices = at_vertices(self._active, self._stick)
        self._geometry = at_vertices(self.gap, self.normal)
        self.vertex_areas, self.areas = self._geometry.areas, self._state.areas
        self._true_gaps: Evaluator | None = None
        self.update_geometry()

    def update_geometry(self) -> None:
        """Evaluate gap and normal at the vertices anew, after an obstacle has moved. Collective.

        `ContactProblem.solve` does it by itself, so that only what is looked at without a solve
        (tables, pictures, ``vertex_gaps``) needs it. The ghosts of Functions in law and obstacle
        follow their owners.
        """
        for f in self._data:
            f.x.scatter_forward()
        self.vertex_gaps, self.vertex_normals = self._geometry()

    # -- forms -----------------------------------------------------------------------------------

    @property
    def unknowns(self) -> list[fem.Function]:
        """Functions of this surface that are unknowns of the problem, the multiplier first."""
        return [self.multiplier] if self.average is None else [self.multiplier, self.average]

    def displacement_row(self, v: Any) -> Any:
        """UFL term of the displacement equation: minus the work of the traction on ``v``."""
        return -ufl.dot(self.multiplier, v) * (
            self._ds_exact if self.method == "mixed" else self._ds
        )

    def rows(self) -> list[list[tuple[Any, list[fem.Function]]]]:
        """UFL residuals of the rows of `unknowns`, in units of force.

        Every row is a list of terms, each with what it depends on; a term has one quadrature rule,
        since not every FFCx takes the vertex rule beside another. The contact row is the traction
        minus what the law answers to it, unscaled.
        """
        mu = ufl.TestFunction(self.Q)
        answer = projection(self._augmented, self.law, self._active, self._stick, self._slip)
        contact = ufl.dot(self.multiplier - answer, mu) * self._ds
        if self.average is None:
            return [[(contact, [self.u, self.multiplier])]]
        k, jump = self._average_stiffness, self.u - self.gap * self.normal
        lumped = k * ufl.dot(self.average, mu) * self._ds
        consistent = -k * ufl.dot(jump, mu) * self._ds_exact
        return [[(contact, self.unknowns)], [(lumped, [self.average]), (consistent, [self.u])]]

    @property
    def helpers(self) -> list[Any]:
        """Functions and Constants in `rows` that are neither unknowns nor the user's data."""
        return [self._active, self._stick, self._slip, self.r, self._average_stiffness]

    def set_augmentation(self, r: npt.NDArray[np.float64]) -> None:
        """Set r at the local vertices of the surface. Collective."""
        self.r.x.array[:] = r
        self._average_stiffness.value = self._vertex_mean(r)

    def _vertex_mean(self, values: npt.NDArray[np.float64]) -> float:
        index_map = self.vertices.dofmap.index_map
        total = self.comm.allreduce(float(np.sum(values[: index_map.size_local])))
        return total / index_map.size_global

    @property
    def mean_vertex_area(self) -> float:
        """Mean area of a vertex. Collective."""
        return self._vertex_mean(self.vertex_areas)

    # -- status ----------------------------------------------------------------------------------

    @property
    def status(self) -> Status:
        """Status of the local contact points (owned, then ghosts); a copy."""
        return Status(*(f.x.array.copy() for f in (self._active, self._stick, self._slip)))

    @status.setter
    def status(self, status: Status) -> None:
        self._active.x.array[:] = status.active
        self._stick.x.array[:] = status.stick
        self._slip.x.array[:] = status.slip

    def set_owned_status(self, status: Status) -> None:
        """Set the status of the owned points; ghosts follow. Collective."""
        n = self.num_owned_points
        for f, values in (
            (self._active, status.active),
            (self._stick, status.stick),
            (self._slip, status.slip),
        ):
            f.x.array[:n] = values
            f.x.scatter_forward()

    def augmented_values(
        self,
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """p, the shear (along t in 2D, a norm in 3D) and b(p) at the local points. Collective."""
        p, shear, bound = self._status_data()
        return p, np.sqrt(np.maximum(shear, 0.0)) if self.dim == 3 else shear, bound

    def evaluate_status(self) -> Status:
        """Status that the present displacement and multiplier ask for. Collective."""
        return classify(*self.augmented_values(), self.law, self.dim)

    def closed_vertices(self) -> npt.NDArray[np.bool_]:
        """Local vertices around which contact points are mostly closed. Collective."""
        return np.asarray(self._status_at_vertices()[0] > 0.5)

    def touching_status(self, tolerance: float) -> Status:
        """Status in which all points whose gap is at most ``tolerance`` stick. Collective.

        The gap is that of the displacement, also where averages of it are unknowns of their own.
        """
        closed = (self.gaps() <= tolerance).astype(float)
        return Status(closed, closed.copy(), np.zeros_like(closed))

    def gaps(self) -> npt.NDArray[np.float64]:
        """Gap of the displacement at the local contact points, to first order. Collective.

        That is ``un`` of `state`, except where averages are unknowns of their own.
        """
        if self.average is None:
            return self.state()["un"]
        u = self.u.x.array.reshape(-1, self.dim)[self.vertex_trace_dofs]
        return np.asarray(self.vertex_gaps - np.sum(u * self.vertex_normals, axis=1))

    def true_gaps(self) -> npt.NDArray[np.float64] | None:
        """Distance to the obstacle of the local contact points where they are now. Collective.

        Returns:
            One value a point, negative inside; None if the obstacle does not say (`obstacles`).
        """
        if self._true_gaps is None:
            x = ufl.SpatialCoordinate(self.domain) + self.u
            gap = gap_at(self.obstacle, self.domain, x)
            if gap is None:
                return None
            W = self.points, self._point_vectors
            self._true_gaps = Evaluator(*W, self._ds, [gap], self.entity_maps)
        return self._true_gaps()[0]

    def check_law(self, where: str = "") -> None:
        """Raise ``ValueError`` if a friction field is negative or not finite somewhere."""
        bound = self.friction_slope()
        what = f"friction coefficient or threshold{where}"
        require(self.comm, bool(np.isfinite(bound).all()), f"{self.name}: NaN in the {what}")
        require(self.comm, bool((bound > -1e-14).all()), f"{self.name}: negative {what}")

    # -- points and nodes ------------------------------------------------------------------------

    @property
    def num_owned_points(self) -> int:
        """Contact points of this rank."""
        return int(self.points.dofmap.index_map.size_local)

    def state(self) -> dict[str, npt.NDArray[np.float64]]:
        """What is known at the local contact points (owned, then ghosts). Collective.

        Keys: ``x`` position (n, dim), ``area``, ``un`` gap, ``ut`` tangential displacement
        (n, dim), ``n`` normal (n, dim), ``traction`` on the body (n, dim), ``pressure``, ``shear``
        (n, dim). In the nodal and mixed methods tractions are those of the multiplier.
        """
        u_n, u_t, traction, n = self._state()
        pressure = -np.sum(traction * n, axis=1)
        return {
            "x": self.positions,
            "area": self.areas,
            "un": -u_n,
            "ut": u_t,
            "n": n,
            "traction": traction,
            "pressure": pressure,
            "shear": traction + pressure[:, None] * n,
        }

    def vertex_state(self) -> dict[str, npt.NDArray[np.float64]]:
        """What is known at the local vertices (owned, then ghosts), for pictures. Collective.

        Keys as in `state`, ``bound`` radius of the friction disc, and ``open``, ``slip``: how much
        of the area around a vertex has that status (0 or 1 where the vertices are the points).
        """
        a, W, open_ = self._augmented, (self.vertices, self._vertex_vectors), 1 - self._active
        pressure = -ufl.dot(self.multiplier, a.n)
        values = (a.u_n, a.u_t, self.multiplier, pressure, self.law.bound(pressure))
        at_vertices = Evaluator(*W, self._ds_vertex, values, self.entity_maps)
        slipping = self._active * (1 - self._stick) * abs(self._slip)
        around = Evaluator(*W, self._ds, (open_, slipping), self.entity_maps)
        u_n, u_t, traction, p, bound = at_vertices()
        vectors = {
            "ut": u_t,
            "traction": traction,
            "shear": traction + p[:, None] * self.vertex_normals,
        }
        state = {"un": -u_n, "pressure": p, "bound": bound, **vectors}
        return {**state, **dict(zip(("open", "slip"), around(), strict=True))}

    def friction_bound(self) -> npt.NDArray[np.float64]:
        """Radius of the friction disc at the local contact points, in units of traction."""
        p, _, bound = self._status_data()
        return np.maximum(bound, 0.0) if not self.law.needs_pressure else np.where(p > 0, bound, 0)

    def friction_slope(self) -> npt.NDArray[np.float64]:
        """Radius of the friction disc at unit pressure at the local contact points. Collective."""
        return np.asarray(self._unit_bound()[0])

    @property
    def node_normals(self) -> npt.NDArray[np.float64]:
        """Normals at the local multiplier nodes, from those at the vertices."""
        normals, component = fem.Function(self.Q), fem.Function(self.vertices)
        for i in range(self.dim):
            component.x.array[:] = self.vertex_normals[:, i]
            normals.sub(i).interpolate(component)
        normals.x.scatter_forward()
        return normals.x.array.reshape(-1, self.dim).copy()

    def fixed_on_support(self, fixed: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """Multiplier nodes x dim whose whole support has displacements marked in ``fixed``."""
        count = la.vector(self.Q.dofmap.index_map, self.dim)
        count.array[:] = 0.0
        closures = facet_closures(self.u.function_space, self.submesh.parent_facets)
        any_free = (~fixed)[closures].any(axis=1).astype(float)
        rows = count.array.reshape(-1, self.dim)
        for nodes in self.Q.dofmap.list[: len(closures)].T:
            np.add.at(rows, nodes, any_free)
        count.scatter_reverse(la.InsertMode.add)
        count.scatter_forward()
        return np.asarray(count.array.reshape(-1, self.dim) == 0)

    @property
    def mean_augmentation(self) -> float:
        """Mean of r over the vertices, stiffness per area."""
        return float(self._average_stiffness.value)

    def row_measures(self, b: npt.NDArray[np.float64]) -> RowMeasures:
        """Largest entries of the owned contact rows ``b`` on this rank.

        Where each row belongs to one point, the status tells lengths (gap and tangential
        displacement of a closed point, times r and the area) from forces (traction of an open
        point, shear of a slipping one); in the integral method every row counts as both.
        """
        n = self.Q.dofmap.index_map.size_local
        rows, tractions = b.reshape(n, self.dim), self.multiplier.x.array.reshape(-1, self.dim)[:n]
        stiffness, area = self.r.x.array * self.vertex_areas, self.vertex_areas
        if self.method == "integral":
            size, unit = _largest(rows), self.comm.allreduce(_largest(stiffness), op=max)
            return RowMeasures(size / unit, size, _largest(tractions) * _largest(area))
        normals, active, stick = self.vertex_normals[:n], self._active, self._stick
        along = np.sum(rows * normals, axis=1)
        across = np.linalg.norm(rows - along[:, None] * normals, axis=1)
        closed, stuck = active.x.array[:n] > 0, stick.x.array[:n] > 0
        # The direction of a slip is known to the shear residual over r, a length as well.
        lengths = np.where(closed, np.abs(along), 0.0), np.where(closed, across, 0.0)
        forces = np.where(closed, 0.0, np.abs(along)), np.where(stuck, 0.0, across)
        return RowMeasures(
            max(_largest(v / stiffness[:n]) for v in lengths),
            max(_largest(v) for v in forces),
            _largest(tractions * area[:n, None]),
        )

    def held_gram(self, motions: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Gram matrix over owned vertices of the parts of ``motions`` that the status resists."""
        n = self.vertices.dofmap.index_map.size_local
        active, stick = (values[:n] > 0 for values in self._status_at_vertices())
        m = motions[:, self.vertex_trace_dofs[:n]]
        normal = np.einsum("and,nd->an", m, self.vertex_normals[:n])
        tangential = (m - normal[:, :, None] * self.vertex_normals[None, :n]) * stick[None, :, None]
        return (normal * active) @ normal.T + np.einsum("and,bnd->ab", tangential, tangential)


def _largest(values: npt.NDArray[np.float64]) -> float:
    return float(np.max(np.abs(values), initial=0.0))
