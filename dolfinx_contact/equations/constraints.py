# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dirichlet data that meet contact surfaces, and surfaces that meet one another.

Where Dirichlet data fix the displacement of a contact node, its multiplier has nothing to determine
it: the reaction belongs to the support. Such multiplier components are removed (identity rows).
Of what the user's Dirichlet data prescribe a part may be applied (`PrescribedDisplacement`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from itertools import combinations

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._errors import require
from dolfinx_contact._geometry import node_positions
from dolfinx_contact._shared import SharedValues, total
from dolfinx_contact.laws.status import STICK
from dolfinx_contact.points.crossings import crossings
from dolfinx_contact.points.held_ends import resting
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import facet_closures

__all__ = ["Constraints", "PrescribedDisplacement", "check_overlap"]

logger = logging.getLogger(__name__)

_TOLERANCE = 1e-6  # of a direction cosine
_CONTRADICTION = 1e-10  # of the largest Dirichlet value: a difference that is none of round-off


class Constraints:
    """Which displacement and multiplier components Dirichlet data fix.

    Attributes:
        fixed: local nodes x dim of the displacement, True where fixed.
        held: per surface, the same for the jump there: where neither a node nor the point opposite
            to it moves, a rigid body included, or both are one.
        clamped: per surface, local multiplier nodes whose normal multiplier is removed.
        removed: per surface, local multiplier nodes x dim, True where the component is removed.

    Raises:
        ValueError: if every node of a surface is clamped, or a component that is neither normal
            nor tangential is fixed under friction.
    """

    def __init__(
        self,
        V: fem.FunctionSpace,
        surfaces: Sequence[DiscreteSurface],
        bcs: Sequence[fem.DirichletBC],
    ):
        self._V = V
        self._bcs = list(bcs)
        self._warned = False
        self._read: fem.Function | None = None  # that values are put into
        # A value may itself be NaN, so a component is fixed if either filling is overwritten.
        self.fixed = np.isfinite(self.values()) | np.isnan(self.values(fill=0.0))
        crossing, crossed = crossings(V, surfaces, self.fixed)
        for s, vertices in zip(surfaces, crossing, strict=True):
            s.hold(self.fixed, vertices)
        _warn_of_common_nodes(surfaces, crossed)
        self.held = [self._held(s) for s in surfaces]
        self.clamped: list[npt.NDArray[np.bool_]] = []
        self.removed: list[npt.NDArray[np.bool_]] = []
        self._owned = [s.points.Q.dofmap.index_map.size_local for s in surfaces]
        self._normals = [s.points.vertex_normals.copy() for s in surfaces]
        for s, held, vertices in zip(surfaces, self.held, crossing, strict=True):
            self._check_slave(s)
            removed = _removed(s, held)
            if s.degrees[1] == 1:  # elsewhere there is no crossing
                removed[vertices] = True
            self.removed.append(removed | s.points.mirrored)
            self.clamped.append(np.asarray(self.removed[-1].all(axis=1)))
            n = s.points.Q.dofmap.index_map.size_local
            left = s.comm.allreduce(int((~self.clamped[-1][:n]).sum()))
            require(s.comm, left > 0, _why_none_is_left(s))

    def values(self, fill: float = np.nan) -> npt.NDArray[np.float64]:
        """Dirichlet values at the local nodes x dim, ``fill`` where the displacement is free."""
        if self._read is None:
            self._read = fem.Function(self._V)
        f = self._read
        f.x.array[:] = fill
        for bc in self._bcs:
            bc.set(f.x.array)
        f.x.scatter_forward()
        return f.x.array.reshape(-1, self._V.dofmap.index_map_bs).copy()

    def approach(self, s: DiscreteSurface, u: npt.NDArray[np.float64]) -> float:
        """How far Dirichlet data will move the body along the mean contact normal. Collective.

        Args:
            s: surface with that normal; between bodies both may come.
            u: displacement of the local nodes, (n, dim).
        """
        n = s.points.vertices.dofmap.index_map.size_local
        normal = total(s.comm, s.points.vertex_normals[:n].sum(axis=0))
        normal /= max(float(np.linalg.norm(normal)), 1e-300)
        motion = np.where(self.fixed, self.values(fill=0.0) - u, 0.0)
        along = motion @ normal
        along = np.abs(along) if s.between_bodies else along
        return float(s.comm.allreduce(float(along.max(initial=0.0)), op=max))

    def _warn_of_contradictions(self) -> None:
        """Warn, once, of components with two values. Collective."""
        V = self._V
        comm = V.mesh.comm
        if self._warned or len(self._bcs) < 2:
            return
        values: npt.NDArray[np.float64] = np.full((len(self._bcs), self.fixed.size), np.nan)
        for row, bc in zip(values, self._bcs, strict=True):
            bc.set(row)
        low, high = np.fmin.reduce(values), np.fmax.reduce(values)
        size = comm.allreduce(np.nanmax(np.abs(values), initial=0.0), op=max)
        bs = V.dofmap.index_map_bs
        wrong = np.flatnonzero(high - low > _CONTRADICTION * size)
        x = np.round(node_positions(V)[wrong // bs, : V.mesh.geometry.dim], 12) + 0.0
        rows = [([*x[k]], int(i % bs), low[i], high[i]) for k, i in enumerate(wrong)]
        found = sorted(row for part in comm.allgather(rows) for row in part)
        self._warned = bool(found)
        if found and comm.rank == 0:
            place, i, least, most = found[0]
            logger.warning(
                "two Dirichlet conditions contradict each other: component %s at (%s) is %g and "
                "%g; the later one in the list holds",
                "xyz"[i],
                ", ".join(f"{c:.6g}" for c in place),
                least,
                most,
            )

    def check_values(
        self, surfaces: Sequence[DiscreteSurface], size: float, where: str = ""
    ) -> None:
        """Raise ``ValueError`` for values that surfaces cannot have. Collective.

        One is not finite, a clamped node is pushed into its obstacle, or a node off its plane of
        symmetry. Of conditions that contradict each other at a node it warns.

        Args:
            surfaces: of the problem.
            size: of the body, a length.
            where: part of the message, where that is.
        """
        values = self.values()
        finite = bool(np.isfinite(values[self.fixed]).all())
        require(self._V.mesh.comm, finite, f"a Dirichlet value is not finite{where}")
        self._warn_of_contradictions()
        prescribed = np.where(self.fixed, values, 0.0)
        for s in surfaces:
            s.points.require_in_place(prescribed, size, f"{s.name}{where}")
        for s, normals, held in zip(surfaces, self._normals, self.held, strict=True):
            name = f"{s.name}{where}"
            fixed = held[s.points.vertex_trace_dofs]
            touched = fixed.any(axis=1)
            turned = np.abs(s.points.vertex_normals - normals).max(axis=1, initial=0.0) > _TOLERANCE
            require(
                s.comm,
                s.displaced is not None or not bool((touched & turned).any()),
                f"{name}: the obstacle has turned at a contact node with Dirichlet data since "
                "the problem was made; make a new problem",
            )
            moved = prescribed - s.opposite(prescribed)
            if s.rigid_body is not None:
                motion = np.where(s.rigid_body.fixed, s.rigid_body.numbers(), 0.0)
                moved = s.relative(moved, motion)
            gap, normal = s.at_vertices(moved[s.points.vertex_trace_dofs])
            closing = np.linalg.norm(np.where(fixed, 0.0, normal), axis=1) < _TOLERANCE
            if s.displaced is not None:
                closing = fixed.all(axis=1)
            opposite = s.opposite_nodes
            if opposite is not None:
                alone = opposite.none[s.points.vertex_trace_dofs]
                least = s.comm.allreduce(float(np.min(gap[alone], initial=np.inf)), op=min)
                require(
                    s.comm,
                    not opposite.matching or bool(least > -1e-9 * size),
                    f"{name}: the gap is {least:.3g} at the front of the crack, where both sides "
                    "have a node in common and no gap; let the interference fade there, as UFL of "
                    "the position",
                )
                closing &= ~alone
            worst = np.min(gap[closing], initial=np.inf)
            worst = s.comm.allreduce(worst, op=min)
            require(
                s.comm,
                bool(worst > -1e-9 * size),
                f"{name}: Dirichlet data push a contact node {-worst:.3g} into the obstacle",
            )

    def removed_multipliers(self) -> npt.NDArray[np.bool_]:
        """Which of the owned unknowns after the displacement are removed multipliers."""
        parts = zip(self.removed, self._owned, strict=True)
        return np.concatenate([removed[:n].reshape(-1) for removed, n in parts])

    def _check_slave(self, s: DiscreteSurface) -> None:
        """Refuse the slave of a mortar that holds more nodes than the master has. Collective."""
        if not s.between_bodies or s.obstacle.opposite.matching:
            return
        n = self._V.dofmap.index_map.size_local
        on_slave, on_master = s.obstacle.opposite.sides
        held = on_slave[:n] & self.fixed[:n].all(axis=1)
        counts = total(s.comm, np.array([int(held.sum()), int(on_master[:n].sum())]))
        require(
            s.comm,
            bool(counts[0] <= counts[1]),
            f"{s.name}: Dirichlet data hold {counts[0]:.0f} nodes of the slave, more than the "
            f"{counts[1]:.0f} that the master has to meet them; exchange slave and master",
        )

    def _held(self, s: DiscreteSurface) -> npt.NDArray[np.bool_]:
        """Local nodes x dim, True where the jump is fixed. Collective."""
        opposite = s.opposite_nodes
        if s.rigid_body is not None:
            return np.asarray(self.fixed & ~s.rigid_body.moves(s.node_positions))
        if opposite is None:
            return self.fixed
        if s.slides:  # what is opposite changes, and a gap is a mean over several nodes
            return np.zeros_like(self.fixed)
        return resting(self._V, opposite, self.fixed)


def _why_none_is_left(s: DiscreteSurface) -> str:
    """Why no contact node of a surface may carry anything. Not collective."""
    opposite = s.opposite_nodes
    if opposite is None or not opposite.none.any():
        return f"{s.name}: Dirichlet data clamp every contact node"
    return (
        f"{s.name}: every contact node is clamped by Dirichlet data, has nothing opposite, or is "
        "at the front of a crack, where both sides have it in common"
    )


def _removed(s: DiscreteSurface, held: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Local multiplier nodes x dim, True where the component is removed. Collective."""
    fixed = held[s.points.trace_dofs]
    if s.degrees[0] != s.degrees[1]:
        fixed = fixed & _fixed_on_support(s, held)
    follows = s.displaced
    if follows is not None and not follows.friction:
        # The normal turns: what is held in part may carry in any direction.
        return np.repeat(np.all(fixed, axis=1)[:, None], s.dim, axis=1)
    normal = _node_normals(s)
    along_fixed = np.linalg.norm(np.where(fixed, normal, 0.0), axis=1)
    along_free = np.linalg.norm(np.where(fixed, 0.0, normal), axis=1)
    clamped = fixed.any(axis=1) & (along_free < _TOLERANCE)
    oblique = (along_fixed > _TOLERANCE) & (along_free > _TOLERANCE)
    require(
        s.comm,
        follows is None or not clamped.any() or bool(fixed[clamped].all()),
        f"{s.name}: Dirichlet data fix the normal displacement alone at a contact node of a curved "
        "obstacle, whose normal turns in large sliding; fix all components there or leave the node "
        "free",
    )
    frictionless = STICK not in s.law_at_points.codes
    require(
        s.comm,
        frictionless or not oblique.any(),
        f"{s.name}: Dirichlet data fix a displacement component that is neither normal nor "
        "tangential to the obstacle at a contact node, where friction and the support cannot "
        "be distinguished; fix all components there or leave the node free",
    )
    return np.where(oblique[:, None], False, fixed) | clamped[:, None]


def check_overlap(surfaces: Sequence[DiscreteSurface]) -> None:
    """Refuse common facets of two surfaces. Collective."""
    for a, b in combinations(surfaces, 2):
        facets = np.intersect1d(a.submesh.parent_facets, b.submesh.parent_facets)
        require(a.comm, len(facets) == 0, f"surfaces {a.name} and {b.name} have common facets")
        if a.between_bodies and b.between_bodies:
            twice = [
                len(np.intersect1d(x.submesh.parent_facets, y.obstacle.opposite.master_facets))
                for x, y in ((a, b), (b, a))
            ]
            require(
                a.comm,
                not all(total(a.comm, np.array(twice))),
                f"{a.name} and {b.name} are one pair with slave and master exchanged",
            )


def _warn_of_common_nodes(
    surfaces: Sequence[DiscreteSurface], crossed: npt.NDArray[np.bool_]
) -> None:
    """Warn of nodes that two surfaces share, but for those at which pairs cross. Collective."""
    for a, b in combinations(surfaces, 2):
        nodes = int((~crossed[np.intersect1d(_nodes(a), _nodes(b))]).sum())
        if a.comm.allreduce(nodes, op=max) > 0 and a.comm.rank == 0:
            logger.warning(
                "surfaces %s and %s share nodes: where both hold one, their reactions cannot be "
                "distinguished and the solve may fail; leave a facet out between them",
                a.name,
                b.name,
            )


def _nodes(s: DiscreteSurface) -> npt.NDArray[np.int64]:
    """Local nodes at the vertices of a surface, and of the master opposite to it."""
    if not s.between_bodies:
        return s.points.vertex_trace_dofs.astype(np.int64)
    return np.flatnonzero(np.logical_or(*s.obstacle.opposite.sides))


def _node_normals(s: DiscreteSurface) -> npt.NDArray[np.float64]:
    """Normals at the local multiplier nodes, from those at the vertices."""
    if s.degrees[1] == 1:
        return s.points.vertex_normals.copy()
    normals = fem.Function(s.points.Q)
    component = fem.Function(s.points.vertices)
    for i in range(s.dim):
        component.x.array[:] = s.points.vertex_normals[:, i]
        normals.sub(i).interpolate(component)
    normals.x.scatter_forward()
    return normals.x.array.reshape(-1, s.dim).copy()


def _fixed_on_support(s: DiscreteSurface, fixed: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Multiplier nodes x dim whose whole support has displacements marked in ``fixed``."""
    cells = s.points.cells
    closures = facet_closures(s.u.function_space, s.submesh.parent_facets[cells])
    any_free = (~fixed)[closures].any(axis=1).astype(float)
    nodes = s.points.Q.dofmap.list[cells]
    at_nodes = np.repeat(any_free[:, None], nodes.shape[1], axis=1)
    return np.asarray(SharedValues(s.points.Q.dofmap.index_map).sums(nodes, at_nodes) == 0)


class PrescribedDisplacement:
    """Dirichlet data of a body as conditions of the problem's own, which follow the user's.

    Args:
        V: space of the displacement.
        constraints: which components are fixed, and to what.

    Attributes:
        part: of the way from a start to the user's data that is prescribed, 1 but in `ramped`.
    """

    def __init__(self, V: fem.FunctionSpace, constraints: Constraints):
        self._V = V
        self._constraints = constraints
        self.part = 1.0
        self._start: npt.NDArray[np.float64] | None = None
        #: What the unknowns are where the displacement is what is prescribed, if they are not it.
        self.unknowns: Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]] | None = None

    @cached_property
    def _components(
        self,
    ) -> list[tuple[int, fem.Function, npt.NDArray[np.int32], fem.DirichletBC]]:
        """Every component that is fixed somewhere: Function of values, nodes, condition."""
        V = self._V
        found = []
        bs = V.dofmap.index_map_bs
        for i in range(bs):
            fixed = self._constraints.fixed[:, i]
            if not V.mesh.comm.allreduce(int(fixed.any())):
                continue
            W, parents = V.sub(i).collapse()
            # Since DOLFINx 0.11 a list with one array for each kind of cell.
            nodes = np.asarray(parents, dtype=np.int32).reshape(-1) // bs
            here = np.flatnonzero(fixed[nodes]).astype(np.int32)
            f = fem.Function(W)
            dofs = [(bs * nodes[here] + i).astype(np.int32), here]
            found.append((i, f, nodes, fem.dirichletbc(f, dofs, V.sub(i))))
        return found

    @property
    def conditions(self) -> list[fem.DirichletBC]:
        """What is prescribed now, one for every component that is fixed somewhere. Collective."""
        values = self.values()
        for i, f, nodes, _ in self._components:
            f.x.array[:] = values[nodes, i]
        return [bc for *_, bc in self._components]

    def values(self) -> npt.NDArray[np.float64]:
        """What is prescribed at the local nodes x dim, 0 where the displacement is free."""
        values = self._constraints.values(fill=0.0)
        if self.unknowns is not None:
            values = self.unknowns(values.reshape(-1)).reshape(values.shape)
        if self._start is not None:
            values = self._start + self.part * (values - self._start)
        return np.where(self._constraints.fixed, values, 0.0)

    @contextmanager
    def ramped(self, start: npt.NDArray[np.float64]) -> Iterator[None]:
        """Prescribe `part` of the way from ``start`` to the user's data while the context lasts.

        Args:
            start: displacement of the local nodes, (n, dim).
        """
        self._start = start.copy()
        try:
            yield
        finally:
            self._start = None
            self.part = 1.0
