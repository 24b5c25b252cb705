# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constraints by Dirichlet data: prescribed displacements and removed multipliers.

If Dirichlet data fix the displacement of a contact node, its multiplier is not determined, because
the reaction acts at the support. Such multiplier components are removed: their rows of the Jacobian
are scaled rows of the identity. The module also checks nodes that belong to several surfaces.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from dolfinx import fem

from dolfinx_contact._arrays import Array, Ints, Mask
from dolfinx_contact._compat import is_value_of
from dolfinx_contact._mpi import (
    SharedValues,
    count_of,
    largest,
    maximum,
    require,
    total,
)
from dolfinx_contact.equations.unknowns import RigidBodies
from dolfinx_contact.laws.status import STICK
from dolfinx_contact.points.shared_functions import crossings
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import facet_closures, nodes_on

__all__ = ["Constraints", "Ramp", "SurfaceConstraints", "require_no_common_facets"]

logger = logging.getLogger(__name__)


_TOLERANCE = 1e-6  # direction cosine that counts as zero
_SAME = 1e-9  # gap, relative to the size of the body, that counts as zero


@dataclass(eq=False)
class Ramp:
    """Load of which a fraction s, growing from 0 to 1, is applied (`ContactEquations.ramped`).

    Attributes:
        u: displacement at all local dofs at the start.
        q: unknowns of the rigid bodies at the start.
        unknowns: all owned unknowns at the start, in the units of the PETSc vectors.
        rows: residual H at the start with s = 0, as arrays of rows by field; empty before its first
            evaluation.
        fraction: applied fraction s of the load.
    """

    u: Array
    q: Array
    unknowns: Array
    rows: Sequence[Array] = ()
    fraction: float = 0.0


@dataclass(frozen=True, eq=False)
class SurfaceConstraints:
    """Components of the jump and of the multipliers of one surface that Dirichlet data fix.

    Attributes:
        fixed_nodes: mask of the fixed components of the jump at nodes, shape (local nodes, dim). A
            component is fixed if neither the node nor its opposing point can move along it, or if
            both are one node.
        fixed_jumps: mask of the components of the weighted jump that Dirichlet data fix, shape
            (local multiplier nodes, dim). The weighted jump of a multiplier is its work-conjugate;
            with quadratic displacement and linear multipliers, it is a mean of the jump over the
            facets around a vertex.
        removed: mask of the removed multiplier components, shape (local multiplier nodes, dim).
        clamped_points: mask of the contact points at nodes whose multiplier components are all
            removed, shape (n,); False at Gauss points.
        owned: number of owned multiplier nodes.
        normals: normals at the local vertices, from which the removed components were determined,
            shape (vertices, dim).
    """

    fixed_nodes: Mask
    fixed_jumps: Mask
    removed: Mask
    clamped_points: Mask
    owned: int
    normals: Array

    @cached_property
    def clamped(self) -> Mask:
        """Mask of the local multiplier nodes whose components are all removed."""
        return np.asarray(self.removed.all(axis=1))

    @cached_property
    def removed_multipliers(self) -> Mask:
        """Mask of the removed components among the owned multipliers, shape (k,)."""
        return self.removed[: self.owned].reshape(-1)


class Constraints:
    """Displacement and multiplier components that Dirichlet data fix, and prescribed values.

    Args:
        V: space of the displacement.
        surfaces: discretisations of the contact surfaces.
        bcs: Dirichlet conditions.
        rigid: rigid bodies.

    Attributes:
        fixed: mask of the fixed components of the displacement, shape (local nodes, dim).
        surfaces: for each surface, the fixed components of jumps and multipliers.
        ramp: load with its applied fraction; None if the full load is applied.
        to_unknowns: function mapping prescribed displacements to the unknowns of a time step; None
            if the unknowns are the displacements.

    Raises:
        ValueError: on every rank, if every node of a surface is clamped, or a component that is
            neither normal nor tangential is fixed under friction.
    """

    def __init__(
        self,
        V: fem.FunctionSpace,
        surfaces: Sequence[DiscreteSurface],
        bcs: Sequence[fem.DirichletBC],
        rigid: RigidBodies,
    ):
        self._V = V
        self._bcs = list(bcs)
        self._rigid = rigid
        self._read = fem.Function(V)  # receives the values
        self.ramp: Ramp | None = None
        self.to_unknowns: Callable[[Array], Array] | None = None
        # A value may itself be NaN, so a component is fixed if either filling is overwritten.
        self.fixed = np.isfinite(self.values()) | np.isnan(self.values(fill=0.0))
        # nodes of several surfaces
        crossing: list[Mask] = [np.zeros_like(s.points.vertex_gaps, dtype=bool) for s in surfaces]
        crossed: Mask = np.zeros(len(self.fixed), dtype=bool)
        if any(s.between_bodies for s in surfaces):
            faces = [(s.points.facets, s.obstacle.opposite) for s in surfaces]
            crossing, crossed = crossings(V, faces, self.fixed)
        for s, vertices in zip(surfaces, crossing, strict=True):
            s.hold(self.fixed, vertices)
        _warn_of_common_nodes(surfaces, crossed)
        pairs = zip(surfaces, crossing, strict=True)
        self.surfaces = [_of_surface(s, self.fixed, vertices) for s, vertices in pairs]
        self.read_data()

    # -- values ----------------------------------------------------------------------------------

    def values(self, fill: float = np.nan) -> Array:
        """Return Dirichlet values at the local nodes, shape (n, dim).

        Args:
            fill: value at free dofs; default: NaN.
        """
        f = self._read
        f.x.array[:] = fill
        for bc in self._bcs:
            bc.set(f.x.array)
        f.x.scatter_forward()
        return f.x.array.reshape(-1, self._V.dofmap.index_map_bs).copy()

    def values_of(self, functions: Sequence[fem.Function]) -> Array:
        """Return the values prescribed by Functions at the local dofs, 0 elsewhere. Collective.

        At a dof of several conditions, the last condition counts.

        Args:
            functions: Functions of Dirichlet conditions.
        """
        f = self._read
        f.x.array[:] = 0.0
        for bc in self._bcs:
            if any(is_value_of(g, bc) for g in functions):
                bc.set(f.x.array)
            else:
                f.x.array[bc.dof_indices()[0]] = 0.0
        f.x.scatter_forward()
        return f.x.array.copy()

    @property
    def load(self) -> float:
        """Applied fraction of the load; 1 if the load is not being ramped."""
        return 1.0 if self.ramp is None else self.ramp.fraction

    def read_data(self) -> None:
        """Read the current Dirichlet values, and loads and motions of rigid bodies. Collective."""
        self._data = self.values(fill=0.0).reshape(-1)
        self._rigid.read_data()

    def displacement(self) -> Array:
        """Return the prescribed displacements at the local dofs, 0 at free dofs."""
        values = self._data if self.to_unknowns is None else self.to_unknowns(self._data)
        if self.ramp is not None:
            values = self.ramp.u + self.ramp.fraction * (values - self.ramp.u)
        return np.where(self.fixed.reshape(-1), values, 0.0)

    def motions(self) -> Array:
        """Return the prescribed unknowns of the rigid bodies, 0 for free unknowns."""
        values = self._rigid.numbers * self._rigid.units
        if self.ramp is not None:
            values = self.ramp.q + self.ramp.fraction * (values - self.ramp.q)
        return np.where(self._rigid.fixed, values, 0.0)

    def reach(self, s: DiscreteSurface, u: Array) -> float:
        """Return the gap up to which open points of a surface are expected to close. Collective.

        It is half the largest distance by which Dirichlet data will move a node along the mean
        contact normal, the initial gap at the edge of a Hertzian contact zone.

        Args:
            s: contact surface; in a pair, either body may approach the other.
            u: displacement at all local dofs.
        """
        n = s.points.vertices.dofmap.index_map.size_local
        normal = total(s.comm, s.points.vertex_normals[:n].sum(axis=0))
        normal /= max(float(np.linalg.norm(normal)), 1e-300)
        motion = np.where(self.fixed, self.values(fill=0.0) - u.reshape(-1, s.dim), 0.0)
        along = motion @ normal
        along = np.abs(along) if s.between_bodies else along
        return 0.5 * maximum(s.comm, along)

    def check_values(self, surfaces: Sequence[DiscreteSurface], size: float) -> None:
        """Raise ``ValueError`` for Dirichlet values that are incompatible with contact. Collective.

        These are values that are not finite, clamp a node inside an obstacle, or move a node off
        its plane of symmetry.

        Args:
            surfaces: contact surfaces.
            size: extent of the body, a length.
        """
        values = self.values()
        finite = bool(np.isfinite(values[self.fixed]).all())
        require(self._V.mesh.comm, finite, "a Dirichlet value is not finite")
        prescribed = np.where(self.fixed, values, 0.0)
        for s, constraints in zip(surfaces, self.surfaces, strict=True):
            s.require_in_place(prescribed, size)
            objection = _objection_to_values(s, constraints, prescribed, size)
            require(s.comm, not objection, f"{s.name}: {objection}")


# -- surfaces --------------------------------------------------------------------------------------


def _of_surface(s: DiscreteSurface, fixed: Mask, crossing: Mask) -> SurfaceConstraints:
    """Return the components of a surface that Dirichlet data fix. Collective.

    Raises:
        ValueError: on every rank, if no multiplier node keeps a free component.
    """
    at_nodes = s.fixed_jumps(fixed)
    jumps = at_nodes[s.points.trace_nodes]
    displacement_degree, multiplier_degree = s.degrees
    if displacement_degree != multiplier_degree:
        jumps = jumps & _fixed_on_support(s, at_nodes)
    if s.points.mirrored is not None:
        jumps = jumps | s.points.mirrored
    removed = _removed(s, jumps)
    if multiplier_degree == 1:  # other degrees have no crossings
        removed[crossing] = True
    owned = s.points.Q.dofmap.index_map.size_local
    left = count_of(s.comm, ~removed[:owned].all(axis=1))
    require(s.comm, left > 0, _why_none_is_left(s))
    if displacement_degree > multiplier_degree:
        _require_free_nodes(s, at_nodes, left)
    clamped: Mask = np.zeros(s.points.number, dtype=bool)
    if not s.is_weak:
        clamped = np.all(removed[: s.points.number], axis=1)
    normals = s.points.vertex_normals.copy()
    return SurfaceConstraints(at_nodes, jumps, removed, clamped, owned, normals)


def _objection_to_values(
    s: DiscreteSurface, constraints: SurfaceConstraints, prescribed: Array, size: float
) -> str:
    """Return an error message if Dirichlet values at a surface are not admissible, else "".

    Collective. ``size`` is the extent of the body, a length.
    """
    trace = s.points.vertex_nodes
    fixed = constraints.fixed_nodes[trace]
    # gaps of the fixed nodes
    moved = prescribed - s.opposite(prescribed)
    if s.rigid_body is not None:
        motion = np.where(s.rigid_body.fixed, s.rigid_body.numbers(), 0.0)
        moved = s.partner.relative(moved, motion)
    gap, normal = s.at_vertices(moved[trace])
    closing = np.linalg.norm(np.where(fixed, 0.0, normal), axis=1) < _TOLERANCE
    if s.displaced is not None:
        closing = fixed.all(axis=1)
    front = np.zeros_like(closing)
    opposite = s.obstacle.opposite
    if opposite is not None:
        closing &= ~opposite.none[trace]
        front = opposite.none[trace] & opposite.matching
    least = [np.min(gap[nodes], initial=np.inf) for nodes in (front, closing)]
    at_front, at_fixed = -largest(s.comm, -np.array(least))
    # normals, which decided on the removed multipliers
    change = np.abs(s.points.vertex_normals - constraints.normals).max(axis=1, initial=0.0)
    if s.displaced is None and (fixed.any(axis=1) & (change > _TOLERANCE)).any():
        return (
            "the obstacle has turned at a contact node with Dirichlet data since the problem "
            "was made; create a new problem"
        )
    if not at_front > -_SAME * size:
        return (
            f"the gap is {at_front:.3g} at the front of the crack, where both sides have a "
            "node in common and no gap; make the interference vanish there, for example as a UFL "
            "expression of the position"
        )
    if not at_fixed > -_SAME * size:
        return f"Dirichlet data push a contact node {-at_fixed:.3g} into the obstacle"
    return ""


def _why_none_is_left(s: DiscreteSurface) -> str:
    """Return an error message for a surface on which no node can carry contact. Not collective."""
    opposite = s.obstacle.opposite
    if opposite is None or not opposite.none.any():
        return f"{s.name}: Dirichlet data clamp every contact node"
    return (
        f"{s.name}: every contact node is clamped by Dirichlet data, has nothing opposite, or is "
        "at the front of a crack, where both sides have it in common"
    )


def _require_free_nodes(s: DiscreteSurface, fixed: Mask, multipliers: int) -> None:
    """Raise ``ValueError`` if a surface has more multiplier nodes than free nodes. Collective.

    On such a face, for example one facet wide between clamped edges, pressures are not unique.
    """
    V = s.u.function_space
    on_face = nodes_on(V, s.submesh.parent_facets)
    n = V.dofmap.index_map.size_local
    free = count_of(s.comm, on_face[:n] & ~fixed[:n].all(axis=1))
    require(
        s.comm,
        multipliers <= free,
        f"{s.name}: the face has {free} nodes that can move, but {multipliers} vertices with "
        "multipliers; refine the face, or use method='integral'",
    )


def _removed(s: DiscreteSurface, fixed: Mask) -> Mask:
    """Return the mask of removed multiplier components, shape (local multiplier nodes, dim).

    ``fixed`` marks the fixed components of the weighted jump. Collective.
    """
    if s.displaced is not None and not s.displaced.friction:
        # The normal turns: a partly fixed node may carry a force in any direction.
        return np.repeat(np.all(fixed, axis=1)[:, None], s.dim, axis=1)
    normal = _node_normals(s)
    along_fixed = np.linalg.norm(np.where(fixed, normal, 0.0), axis=1)
    along_free = np.linalg.norm(np.where(fixed, 0.0, normal), axis=1)
    clamped = fixed.any(axis=1) & (along_free < _TOLERANCE)
    oblique = (along_fixed > _TOLERANCE) & (along_free > _TOLERANCE)
    objection = ""
    if s.displaced is not None and not fixed[clamped].all():
        objection = (
            "fix only the normal displacement at a contact node of a curved obstacle, whose "
            "normal turns in large sliding"
        )
    elif STICK in s.law_at_points.codes and oblique.any():
        objection = (
            "fix a displacement component that is neither normal nor tangential to the obstacle at "
            "a contact node, where friction and the support cannot be distinguished"
        )
    remedy = "fix all components there or leave the node free"
    require(s.comm, not objection, f"{s.name}: Dirichlet data {objection}; {remedy}")
    return np.where(oblique[:, None], False, fixed) | clamped[:, None]


def require_no_common_facets(surfaces: Sequence[DiscreteSurface]) -> None:
    """Raise ``ValueError`` if two surfaces have facets in common. Collective."""
    for a, b in combinations(surfaces, 2):
        facets = np.intersect1d(a.submesh.parent_facets, b.submesh.parent_facets)
        require(a.comm, len(facets) == 0, f"surfaces {a.name} and {b.name} have common facets")
        if a.between_bodies and b.between_bodies:
            twice = [
                len(np.intersect1d(x.submesh.parent_facets, y.obstacle.opposite.master_facets))
                for x, y in ((a, b), (b, a))
            ]
            exchanged = bool(all(total(a.comm, np.array(twice))))
            words = f"{a.name} and {b.name} are one pair with slave and master exchanged"
            require(a.comm, not exchanged, words)


def _warn_of_common_nodes(surfaces: Sequence[DiscreteSurface], crossed: Mask) -> None:
    """Warn if two surfaces share nodes that are not crossings of pairs. Collective."""
    for a, b in combinations(surfaces, 2):
        shared = ~crossed[np.intersect1d(_nodes(a), _nodes(b))]
        if count_of(a.comm, shared) > 0 and a.comm.rank == 0:
            logger.warning(
                "surfaces %s and %s share nodes: where both hold one, their reactions cannot be "
                "distinguished and the solve may fail; leave a facet out between them",
                a.name,
                b.name,
            )


def _nodes(s: DiscreteSurface) -> Ints:
    """Return the local nodes of a surface and of its master."""
    if not s.between_bodies:
        return s.points.vertex_nodes.astype(np.int64)
    return np.flatnonzero(np.logical_or(*s.obstacle.opposite.sides))


def _node_normals(s: DiscreteSurface) -> Array:
    """Return the normals at the local multiplier nodes, interpolated from the vertices."""
    if s.degrees[1] == 1:
        return s.points.vertex_normals.copy()
    normals = fem.Function(s.points.Q)
    component = fem.Function(s.points.vertices)
    for i in range(s.dim):
        component.x.array[:] = s.points.vertex_normals[:, i]
        normals.sub(i).interpolate(component)
    normals.x.scatter_forward()
    return normals.x.array.reshape(-1, s.dim).copy()


def _fixed_on_support(s: DiscreteSurface, fixed: Mask) -> Mask:
    """Return the mask of multiplier components whose jump is fixed on all facets around their node.

    ``fixed`` marks the fixed components of the jump, shape (local nodes, dim).
    """
    cells = s.points.cells
    closures = facet_closures(s.u.function_space, s.submesh.parent_facets[cells])
    any_free = (~fixed)[closures].any(axis=1).astype(float)
    nodes = s.points.Q.dofmap.list[cells]
    at_nodes = np.repeat(any_free[:, None], nodes.shape[1], axis=1)
    return np.asarray(SharedValues(s.points.Q.dofmap.index_map).sums(nodes, at_nodes) == 0)
