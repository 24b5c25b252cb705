# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The contact problem H(x) = 0: equilibrium of the body, and the laws at contact points.

H has rows of the displacement u, of the multipliers l and of the rigid bodies q:

    H_u = R(u) - sum B^T W t,           the body (`body.bulk`, with loads and springs), and surfaces
    H_l = E^T W (t - tau(j, t)),        the law of each surface or pair (`evaluation`)
    H_q = sum Phi^T B^T W t - F,        the rigid bodies (`evaluation`).

`evaluation` defines the symbols. In axisymmetry the integrals in R and the areas W are weighted.

Rows are evaluated at the unknowns, which need not satisfy the Dirichlet data g; the derivatives of
the rows along the step to g are added. Columns of Dirichlet dofs in the Jacobian are thus empty off
the diagonal. Rows of Dirichlet dofs, of removed multipliers and of prescribed motions are

    H = k (x - g)

with a typical stiffness k, so that every row has the unit of a force.

Every unknown in a vector is a length (`Unknowns`), so the relative sizes of unknowns do not depend
on the user's units.

Evaluations are stateless: statuses are arguments, results are returned, and the memory of earlier
states is fixed (`with_memory`). They use the values of the user's data that `read_data` read last.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

from petsc4py import PETSc

import numpy as np

from dolfinx import fem, mesh

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._geometry import mesh_mark, node_positions
from dolfinx_contact._mpi import any_rank, anywhere, require, total
from dolfinx_contact._petsc import ProblemOptions, logged
from dolfinx_contact.body.bulk import Bulk
from dolfinx_contact.body.rigid import bounding_box
from dolfinx_contact.equations.constraints import Constraints, Ramp, require_no_common_facets
from dolfinx_contact.equations.evaluation import (
    Evaluation,
    RigidBodies,
    RigidTerm,
    Rows,
    Statuses,
    SurfaceTerm,
)
from dolfinx_contact.equations.scaling import Scaling
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import nodes_on

if TYPE_CHECKING:
    from dolfinx_contact.body.moving import MovingBody

__all__ = ["ContactEquations", "Unknowns"]

logger = logging.getLogger(__name__)


class ContactEquations:
    """H of a body with contact surfaces. All methods are collective unless they say otherwise.

    Args:
        bulk: discrete body.
        V: space of its displacement.
        surfaces: discretisations of the contact surfaces.
        bcs: Dirichlet conditions.
        r: augmentation parameter, a stiffness per area; None: derived from the stiffness of the
            contact nodes.
        options: options of the SNES.

    Attributes:
        unknowns: layout of the unknowns in PETSc vectors.
        owned_sizes: numbers of owned unknowns: displacement, surface by surface, rigid bodies.
        terms: terms of the contact surfaces.
        rigid: rigid bodies that surfaces touch.
        constraints: displacement and multiplier components that Dirichlet data fix, and prescribed
            values.
        fixed: mask of the local displacement dofs that Dirichlet data fix.
        scaling: typical stiffness, augmentation parameters and loose motions.
        body_size: diagonal of the bounding box of the body, a length.
        nodes: positions of the local nodes of the displacement, shape (n, dim).
        axisymmetric: whether the body is a body of revolution.
        linear: whether H is linear in the displacement as long as no status changes.
        warnings: warnings about the data, by name (`warn`).
    """

    def __init__(
        self,
        bulk: Bulk | MovingBody,
        V: fem.FunctionSpace,
        surfaces: Sequence[DiscreteSurface],
        bcs: Sequence[fem.DirichletBC],
        *,
        r: float | None,
        options: ProblemOptions,
    ):
        self.bulk = bulk
        self.V = V
        self.comm = V.mesh.comm
        self.dim = V.mesh.geometry.dim
        self.surfaces = list(surfaces)
        self.warnings: dict[str, str] = {}
        self.bcs = list(bcs)
        self.options = options
        self._mesh_mark = mesh_mark(V.mesh)
        self.nodes = node_positions(V)[:, : self.dim]
        low, high = bounding_box(self.comm, V.mesh.geometry.x)
        self.body_size = float(np.linalg.norm(high - low))
        require_no_common_facets(self.surfaces)
        self.axisymmetric = self.surfaces[0].axisymmetric
        self.linear = bulk.linear and all(s.linear for s in self.surfaces)
        self.rigid = RigidBodies(V, self.surfaces, self.body_size)
        self.constraints = Constraints(V, self.surfaces, bcs, self.rigid)
        self.fixed = self.constraints.fixed.reshape(-1)
        removed = zip(self.surfaces, self.constraints.removed_multipliers, strict=True)
        self.terms = [
            SurfaceTerm(s, i, mask)
            if s.rigid_body is None
            else RigidTerm(s, i, mask, bodies=self.rigid)
            for i, (s, mask) in enumerate(removed)
        ]
        self.forced_r = r
        self.scaling = Scaling(bulk, V, self.terms, self.constraints.fixed, self.rigid, r)
        geometries = [s.points.geometry for s in self.surfaces]
        self.unknowns = Unknowns(
            bulk.displacement,
            [s.points.Q for s in self.surfaces],
            self.rigid,
            [self.scaling.stiffness / g.mean(g.vertex_areas) for g in geometries],
        )
        self.owned_sizes = self.unknowns.sizes
        if not bulk.linear:
            bulk.destroy()

    # -- evaluation ------------------------------------------------------------------------------

    def contact(self, x: PETSc.Vec, statuses: Statuses | None = None) -> Evaluation:
        """Evaluate the contact points at ``x``, without the rows of H.

        Args:
            x: unknowns.
            statuses: statuses for the laws; default: those determined by the unknowns.
        """
        u = self.unknowns.displacement(x)
        q = self.unknowns.motions(x)
        multipliers = self.unknowns.fields(x)[1:]
        held = [None] * len(self.terms) if statuses is None else statuses
        with logged("ContactStatus"):
            parts = zip(self.terms, multipliers, held, strict=True)
            states = [term.evaluate(u, q, owned, codes) for term, owned, codes in parts]
        return Evaluation(x.array_r.copy(), u, q, states)

    def residual(self, x: PETSc.Vec, b: PETSc.Vec, statuses: Statuses | None = None) -> Evaluation:
        """Write H(x) into ``b`` and return the evaluation; see `evaluate`."""
        state = self.evaluate(x, statuses)
        b.array[:] = np.concatenate(state.rows)
        return state

    def evaluate(self, x: PETSc.Vec, statuses: Statuses | None = None) -> Evaluation:
        """Evaluate the contact points and the rows of H at ``x``.

        Args:
            x: unknowns.
            statuses: statuses for the laws; default: those determined by the unknowns.
        """
        at = self.contact(x, statuses)
        # step from the unknowns to the prescribed values
        off = at.u - self.constraints.displacement()
        off_motions = at.q - self.constraints.motions()
        du = np.where(self.fixed, -off, 0.0)
        dq = np.where(self.rigid.fixed, -off_motions, 0.0)
        # body; for a linear one K (u + du) + f needs no assembly
        affine = self.bulk.affine_residual(at.u + du)
        body = self.bulk.residual_at(at.u) if affine is None else affine
        rows = Rows(body, [found.off for found in at.surfaces], np.zeros(self.rigid.size))
        for term in self.terms:
            term.add_forces(at, rows)
        reactions = rows.body.copy()
        if any_rank(self.comm, du.any() or dq.any()):
            if affine is None:
                rows.body += self.bulk.rate_at(at.u, du)
            for term in self.terms:
                term.add_rate(at, du, dq, rows)
        # rows of prescribed values
        k = self.scaling.stiffness
        fixed = self.fixed[: len(rows.body)]
        rows.body[fixed] = k * off[: len(rows.body)][fixed]
        laws = self._law_rows(rows.laws, x)
        pushed = total(self.comm, rows.pushed) if self.rigid.size else rows.pushed
        rigid = np.where(self.rigid.fixed, k * off_motions, pushed - self.rigid.loads)
        parts = self._ramped([rows.body, *laws, self.rigid.here(rigid)], slice(None))
        return replace(at, rows=parts, reactions=reactions, pushes=-pushed)

    def contact_rows(self, x: PETSc.Vec, statuses: Statuses | None = None) -> Array:
        """Return the owned contact rows of H, without evaluating the body.

        Args:
            x: unknowns satisfying the Dirichlet conditions.
            statuses: statuses for the laws; default: those determined by the unknowns.
        """
        at = self.contact(x, statuses)
        rows = self._law_rows([found.off for found in at.surfaces], x)
        return np.concatenate(self._ramped(rows, slice(1, -1)))

    def _ramped(self, rows: list[Array], fields: slice) -> list[Array]:
        """Return rows of H minus the part 1 - s of those at the start of a growing load."""
        ramp = self.constraints.ramp
        if ramp is None or not ramp.rows:
            return rows
        pairs = zip(rows, ramp.rows[fields], strict=True)
        return [row - (1.0 - ramp.fraction) * first for row, first in pairs]

    def rates(
        self,
        at: Evaluation,
        body: Array,
        answers: Sequence[Array | None],
        dirichlet: Array,
        loads: Array,
        motions: Array,
    ) -> Array:
        """Return the owned rows of dH/dgamma for a parameter gamma, at fixed statuses.

        Args:
            at: evaluation with these statuses.
            body: rates of the rows of the body at fixed unknowns, owned.
            answers: rates of the answers at fixed unknowns, shape (n, dim), surface by surface;
                None for surfaces whose law does not depend on the parameter.
            dirichlet: rates of the Dirichlet values at all local dofs, 0 at free ones.
            loads: rates of the loads on the rigid bodies, 0 where their motion is prescribed.
            motions: rates of the prescribed motions, 0 where they are free.
        """
        pairs = zip(at.surfaces, answers, strict=True)
        laws = [np.zeros_like(s.traction) if rate is None else -rate for s, rate in pairs]
        rows = Rows(body.copy(), laws, np.zeros(self.rigid.size))
        if any_rank(self.comm, dirichlet.any() or motions.any()):
            rows.body += self.bulk.rate_at(at.u, dirichlet)
            for term in self.terms:
                term.add_rate(at, dirichlet, motions, rows)
        k = self.scaling.stiffness
        fixed = self.fixed[: len(rows.body)]
        rows.body[fixed] = -k * dirichlet[: len(rows.body)][fixed]
        parts = [rows.body, *self._law_rows(rows.laws)]
        return np.concatenate([*parts, self.rigid.here(-loads - k * motions)])

    def _law_rows(self, laws: Sequence[Array], x: PETSc.Vec | None = None) -> list[Array]:
        """Return the rows of the multipliers from the residuals of the tractions at the points.

        Args:
            laws: residuals, shape (n, dim), surface by surface.
            x: unknowns for the rows of removed multipliers; default: 0 in these rows.
        """
        owned: Sequence[Array | float] = [0.0] * len(laws)
        if x is not None:
            owned = self.unknowns.blocks(x)[1:-1]
        return [
            np.where(term.removed, self.scaling.stiffness * values, term.surface.points.rows(off))
            for term, off, values in zip(self.terms, laws, owned, strict=True)
        ]

    @cached_property
    def bare_nodes(self) -> Ints:
        """Owned boundary nodes on no contact surface that are not held, shape (n,). Collective."""
        V = self.V
        bare = nodes_on(V, mesh.exterior_facet_indices(V.mesh.topology))
        for s in self.surfaces:
            bare &= ~nodes_on(V, s.submesh.parent_facets)
            if s.between_bodies:
                bare &= ~s.obstacle.opposite.sides[1]
        bare &= ~self.constraints.fixed.all(axis=1)
        return np.flatnonzero(bare[: V.dofmap.index_map.size_local])

    # -- data ------------------------------------------------------------------------------------

    def read_data(self) -> bool:
        """Read the present values of the Functions and Constants of the user.

        A solve, a question and an evaluation for the user begin with this step, and so does a run
        or a branch after each change of the load.

        Returns:
            Whether the data of a surface have changed.
        """
        self.bulk.read_data()
        self.constraints.read_data()
        moved = anywhere(self.comm, *[s.has_changed for s in self.surfaces])
        for s, changed in zip(self.surfaces, moved, strict=True):
            if changed:
                s.update_geometry()
        return any(moved)

    def require_same_mesh(self) -> None:
        """Raise ``ValueError`` if the mesh has moved since the problem was made."""
        same = mesh_mark(self.V.mesh) == self._mesh_mark
        words = "the mesh has moved since the problem was made; make surfaces and problem anew"
        require(self.comm, same, words)

    @contextmanager
    def ramped(self, x: PETSc.Vec) -> Iterator[Ramp]:
        """Apply a fraction s of the load within the context, at first 0.

        Prescribed values are between those of ``x`` and those of the user, and the residual at the
        start fades: H(x, s) - (1 - s) H(x_0, 0). This residual contains the loads on an unloaded
        body and the depth of points that begin inside an obstacle.

        Args:
            x: unknowns x_0 at the start.

        Yields:
            Load, whose fraction the caller sets.
        """
        self.read_data()
        start = self.unknowns.displacement(x), self.unknowns.motions(x)
        ramp = self.constraints.ramp = Ramp(*start, x.array_r.copy())
        try:
            ramp.rows = self.evaluate(x).rows
            yield ramp
        finally:
            self.constraints.ramp = None

    # -- memory ----------------------------------------------------------------------------------

    @property
    def memory(self) -> tuple[Memory | None, ...]:
        """Memory of each surface at the beginning of the step; None under the static law."""
        return tuple(term.memory for term in self.terms)

    def warn(self, name: str, text: str) -> None:
        """Keep a warning about the data for the results, and log a new one on rank 0.

        Not collective.

        Args:
            name: name of the warning.
            text: text of the warning, the same on every rank; empty if there is no objection now.
        """
        if not text:
            self.warnings.pop(name, None)
            return
        if name not in self.warnings and self.comm.rank == 0:
            logger.warning("%s: %s", name, text)
        self.warnings[name] = text

    def with_memory(self, memory: Sequence[Memory | None]) -> ContactEquations:
        """Return the same equations with another memory of the contact points.

        The copy is shallow: it shares everything that has been compiled or assembled.

        Args:
            memory: memory of the points of each surface at the beginning of the step; None: the
                static law.

        Raises:
            ValueError: on every rank, if the memory belongs to other surfaces.
        """
        fits = len(memory) == len(self.surfaces) and all(
            m is None or _fits(m, s) for s, m in zip(self.surfaces, memory, strict=True)
        )
        message = "the memory belongs to other contact surfaces, another law, sliding or mesh"
        require(self.comm, fits, message)
        pairs = zip(self.terms, memory, strict=True)
        return self.with_terms([replace(term, memory=m) for term, m in pairs])

    def with_terms(self, terms: Sequence[SurfaceTerm]) -> ContactEquations:
        """Return the same equations with other terms of the surfaces. Not collective."""
        equations = copy(self)
        equations.terms = list(terms)
        return equations

    def memory_after(self, at: Evaluation) -> tuple[Memory, ...]:
        """Return the memory after a step ending in this state. Not collective."""
        return tuple(term.memory_after(at) for term in self.terms)


class Unknowns:
    """Layout of the unknowns in PETSc vectors.

    The unknowns of a rank are its displacements, its multipliers surface by surface, divided by a
    typical stiffness per area, and, on rank 0, the motions of rigid bodies (`evaluation`).

    Args:
        displacement: Function that receives displacements to update their ghosts.
        multipliers: spaces of the multipliers, surface by surface.
        rigid: rigid bodies.
        stiffness_per_area: units of the multipliers, surface by surface.

    Attributes:
        sizes: numbers of owned unknowns: displacement, multipliers by surface, rigid bodies.
        global_sizes: the same over all ranks.
        units: factors from the unknowns of the PETSc vectors to the user's units, one per field; 1
            for the rigid bodies, which have units of their own (`RigidBodies.units`).
    """

    def __init__(
        self,
        displacement: fem.Function,
        multipliers: Sequence[fem.FunctionSpace],
        rigid: RigidBodies,
        stiffness_per_area: Sequence[float],
    ):
        self.comm = displacement.function_space.mesh.comm
        self._displacement = displacement
        self._rigid = rigid
        spaces = [displacement.function_space, *multipliers]
        maps = [(W.dofmap.index_map, W.dofmap.index_map_bs) for W in spaces]
        self.sizes = [*(m.size_local * bs for m, bs in maps), rigid.owned]
        self.global_sizes = [*(int(m.size_global) * bs for m, bs in maps), rigid.size]
        self.units = [1.0, *stiffness_per_area, 1.0]
        ends = np.cumsum(self.sizes).tolist()
        self._slices = [slice(b - n, b) for b, n in zip(ends, self.sizes, strict=True)]

    def create_vector(self) -> PETSc.Vec:
        """Create a vector of all unknowns. Collective."""
        return PETSc.Vec().createMPI((sum(self.sizes), None), comm=self.comm)

    def blocks(self, x: PETSc.Vec) -> list[Array]:
        """Return copies of the owned parts of ``x``, one array per field."""
        values = x.array_r.copy()
        return [values[part] for part in self._slices]

    def fields(self, x: PETSc.Vec) -> list[Array]:
        """Return the owned values of displacement and multipliers, in the user's units."""
        return [unit * part for unit, part in zip(self.units, self.blocks(x), strict=True)][:-1]

    def displacement(self, x: PETSc.Vec) -> Array:
        """Return the displacement at all local dofs, including ghosts. Collective."""
        f = self._displacement
        n = self.sizes[0]
        f.x.array[:n] = x.array_r[:n]
        f.x.scatter_forward()
        return f.x.array.copy()

    def motions(self, x: PETSc.Vec) -> Array:
        """Return the unknowns of the rigid bodies, on every rank. Collective."""
        return self._rigid.everywhere(x.array_r[self._slices[-1]])

    def write(self, fields: Sequence[Array], q: Array, x: PETSc.Vec) -> None:
        """Write values into ``x``.

        Args:
            fields: displacement and multipliers at least at the owned dofs, in the user's units.
            q: unknowns of the rigid bodies.
            x: vector of unknowns.
        """
        parts = zip([*fields, self._rigid.here(q)], self.units, self.sizes, strict=True)
        x.array[:] = np.concatenate([values[:n] / unit for values, unit, n in parts])


def _fits(memory: Memory, s: DiscreteSurface) -> bool:
    """Return whether a memory belongs to a surface with these points, law and sliding."""
    shape = s.points.number, s.dim
    vectors = [memory.jump] if memory.place is None else [memory.jump, memory.place]
    return (
        (memory.displacement is not None) == s.slides
        and (memory.place is not None) == (s.displaced is not None)
        and set(s.law.memory(s.dim)) <= set(memory.fields)
        and all(values.shape == shape for values in vectors)
        and all(len(values) == s.points.number for values in memory.fields.values())
    )
