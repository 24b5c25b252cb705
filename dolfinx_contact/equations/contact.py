# SPDX-License-Identifier: LGPL-3.0-or-later
"""The contact problem H(x) = 0: equilibrium of the body, and the laws at contact points.

The unknowns x are the displacement u, the multipliers l and the unknowns q of the rigid bodies,
with the rows

    H_u = R(u) - sum B^T W t,           the body (`body.bulk`, with loads and springs), and surfaces
    H_l = E^T W (t - tau(j, t)),        the law of each surface or pair (`evaluation`)
    H_q = sum Phi^T B^T W t - L,        the rigid bodies with loads L (`unknowns`).

R is the residual of the body without contact. The contact points have areas W, tractions t = E l,
jumps j, and tractions tau required by the law. B maps displacements to jumps, and Phi maps q to
displacements of nodes (`evaluation`). For bodies of revolution, the integrals in R and the areas W
have the weight 2 pi r.

If u does not satisfy the Dirichlet data g, the derivative of the rows along the step from u to g is
added, so that the columns of Dirichlet dofs in the Jacobian are empty off the diagonal. Rows of
Dirichlet dofs, of removed multipliers and of prescribed motions are

    H = k (x - g)

with a typical stiffness k and the prescribed value g (0 for multipliers), so that every row has the
unit of a force.

Every unknown in a vector is a length (`Unknowns`), so the relative magnitudes of the unknowns do
not depend on the user's units.

Evaluations are stateless: statuses are arguments, results are returned, and the memory of earlier
states is fixed (`with_memory`). They use the values of the user's data as last read by `read_data`.
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
from dolfinx_contact._geometry import mesh_mark
from dolfinx_contact._mpi import all_ranks, any_rank, anywhere, require, total
from dolfinx_contact._petsc import ProblemOptions, logged
from dolfinx_contact.body.bulk import Bulk
from dolfinx_contact.body.rigid import diagonal
from dolfinx_contact.equations.constraints import Constraints, Ramp, require_no_common_facets
from dolfinx_contact.equations.evaluation import (
    Evaluation,
    RigidTerm,
    Rows,
    Statuses,
    SurfaceTerm,
)
from dolfinx_contact.equations.scaling import Scaling
from dolfinx_contact.equations.unknowns import RigidBodies, Unknowns
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import nodes_on

if TYPE_CHECKING:
    from dolfinx_contact.body.moving import MovingBody

__all__ = ["ContactEquations"]

logger = logging.getLogger(__name__)


class ContactEquations:
    """Residual H(x) of a body with contact surfaces. Methods are collective unless noted otherwise.

    Args:
        bulk: discrete body.
        V: space of the displacement.
        surfaces: discretisations of the contact surfaces.
        bcs: Dirichlet conditions.
        r: augmentation parameter, a stiffness per area; None: derived from the stiffness of the
            contact nodes.
        options: options of the SNES.

    Attributes:
        unknowns: layout of the unknowns in PETSc vectors.
        owned_sizes: numbers of owned unknowns by field: displacement, multipliers of each surface,
            rigid bodies.
        terms: terms of the contact surfaces.
        rigid: rigid bodies that surfaces touch.
        constraints: displacement and multiplier components that Dirichlet data fix, and prescribed
            values.
        fixed: mask of the local displacement dofs that Dirichlet data fix.
        scaling: typical stiffness, augmentation parameters, and rigid motions that only contact can
            prevent.
        body_size: diagonal of the bounding box of the body, a length.
        axisymmetric: whether the body is a body of revolution.
        linear: whether H is linear in the displacement as long as no status changes.
        is_weak: whether the law of a surface holds weakly (``method="integral"``).
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
        self.body_size = diagonal(self.comm, V.mesh.geometry.x)
        require_no_common_facets(self.surfaces)
        self.axisymmetric = self.surfaces[0].axisymmetric
        self.linear = bulk.linear and all(s.linear for s in self.surfaces)
        self.is_weak = any(s.is_weak for s in self.surfaces)
        self.rigid = RigidBodies(V, self.surfaces, self.body_size)
        self.constraints = Constraints(V, self.surfaces, bcs, self.rigid)
        self.fixed = self.constraints.fixed.reshape(-1)
        removed = [c.removed_multipliers for c in self.constraints.surfaces]
        self.terms = [
            SurfaceTerm(s, i, mask)
            if s.rigid_body is None
            else RigidTerm(s, i, mask, bodies=self.rigid)
            for i, (s, mask) in enumerate(zip(self.surfaces, removed, strict=True))
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

    def evaluate_contact(self, x: PETSc.Vec, statuses: Statuses | None = None) -> Evaluation:
        """Evaluate the contact points at given unknowns, without the rows of H.

        Args:
            x: vector of unknowns.
            statuses: statuses for the laws; default: statuses determined by the unknowns.
        """
        u = self.unknowns.displacement(x)
        q = self.unknowns.motions(x)
        multipliers = self.unknowns.fields(x)[1:]
        codes = [None] * len(self.terms) if statuses is None else statuses
        with logged("ContactStatus"):
            parts = zip(self.terms, multipliers, codes, strict=True)
            surfaces = [term.evaluate(u, q, owned, codes) for term, owned, codes in parts]
        return Evaluation(x.array_r.copy(), u, q, surfaces)

    def residual(self, x: PETSc.Vec, b: PETSc.Vec, statuses: Statuses | None = None) -> Evaluation:
        """Write H(x) into ``b`` and return the evaluation (`evaluate`)."""
        evaluation = self.evaluate(x, statuses)
        b.array[:] = np.concatenate(evaluation.rows)
        return evaluation

    def evaluate(self, x: PETSc.Vec, statuses: Statuses | None = None) -> Evaluation:
        """Evaluate the contact points and the rows of H at given unknowns.

        Args:
            x: vector of unknowns.
            statuses: statuses for the laws; default: statuses determined by the unknowns.
        """
        evaluation = self.evaluate_contact(x, statuses)
        u = evaluation.u
        # step from the unknowns to the prescribed values
        off = u - self.constraints.displacement()
        off_motions = evaluation.q - self.constraints.motions()
        du = np.where(self.fixed, -off, 0.0)
        dq = np.where(self.rigid.fixed, -off_motions, 0.0)
        # body; for a linear one K (u + du) + f needs no assembly
        affine = self.bulk.affine_residual(u + du)
        body = self.bulk.residual_at(u) if affine is None else affine
        rows = Rows(body, [c.off for c in evaluation.surfaces], np.zeros(self.rigid.size))
        for term in self.terms:
            term.add_forces(evaluation, rows)
        reactions = rows.body.copy()
        self._add_rate(evaluation, du, dq, rows, body=affine is None)
        if self.rigid.size:
            rows.pushed = total(self.comm, rows.pushed)
        parts = self._owned_rows(rows, off, off_motions, self.rigid.loads, x)
        parts = self._ramped(parts, slice(None))
        return replace(evaluation, rows=parts, reactions=reactions, pushes=-rows.pushed)

    def contact_rows(self, x: PETSc.Vec, statuses: Statuses | None = None) -> Array:
        """Return the owned rows of H for the multipliers, without evaluating the body.

        Args:
            x: unknowns satisfying the Dirichlet conditions.
            statuses: statuses for the laws; default: statuses determined by the unknowns.
        """
        evaluation = self.evaluate_contact(x, statuses)
        rows = self._law_rows([c.off for c in evaluation.surfaces], x)
        return np.concatenate(self._ramped(rows, slice(1, -1)))

    def rates(
        self,
        evaluation: Evaluation,
        body: Array,
        answers: Sequence[Array | None],
        dirichlet: Array,
        loads: Array,
        motions: Array,
    ) -> Array:
        """Return the owned rows of dH/dgamma for a parameter gamma, at fixed statuses.

        Args:
            evaluation: evaluation of H with the fixed statuses.
            body: rates of the owned rows of the body at fixed unknowns.
            answers: for each surface, rates at fixed unknowns of the tractions required by the law,
                shape (n, dim); None for surfaces whose law does not depend on the parameter.
            dirichlet: rates of the Dirichlet values at all local dofs, 0 at free ones.
            loads: rates of the loads on the rigid bodies, 0 where their motion is prescribed.
            motions: rates of the prescribed motions, 0 where they are free.
        """
        pairs = zip(evaluation.surfaces, answers, strict=True)
        laws = [np.zeros_like(c.traction) if rate is None else -rate for c, rate in pairs]
        rows = Rows(body.copy(), laws, np.zeros(self.rigid.size))
        self._add_rate(evaluation, dirichlet, motions, rows, body=True)
        return np.concatenate(self._owned_rows(rows, -dirichlet, -motions, loads))

    def _add_rate(
        self, evaluation: Evaluation, du: Array, dq: Array, rows: Rows, *, body: bool
    ) -> None:
        """Add to rows the derivative of the surface (and bulk) terms along a motion."""
        if not any_rank(self.comm, du.any() or dq.any()):
            return
        if body:
            rows.body += self.bulk.rate_at(evaluation.u, du)
        for term in self.terms:
            term.add_rate(evaluation, du, dq, rows)

    def _owned_rows(
        self, rows: Rows, off: Array, off_motions: Array, loads: Array, x: PETSc.Vec | None = None
    ) -> list[Array]:
        """Return the owned rows of H by field, with Dirichlet rows, from the sums of the terms.

        ``off`` and ``off_motions`` are the differences of displacement and rigid motions from their
        prescribed values. Rows of removed multipliers are 0 without ``x``.
        """
        k = self.scaling.stiffness
        n = len(rows.body)
        body = np.where(self.fixed[:n], k * off[:n], rows.body)
        rigid = np.where(self.rigid.fixed, k * off_motions, rows.pushed - loads)
        return [body, *self._law_rows(rows.laws, x), self.rigid.here(rigid)]

    def _law_rows(self, laws: Sequence[Array], x: PETSc.Vec | None) -> list[Array]:
        """Return the rows of H for the multipliers from the residuals t - tau of the laws.

        Residuals have shape (n, dim) for each surface. Rows of removed multipliers are 0 without
        ``x``.
        """
        owned: Sequence[Array | float] = [0.0] * len(laws)
        if x is not None:
            owned = self.unknowns.blocks(x)[1:-1]
        return [
            np.where(term.removed, self.scaling.stiffness * values, term.surface.points.rows(off))
            for term, off, values in zip(self.terms, laws, owned, strict=True)
        ]

    def _ramped(self, rows: list[Array], fields: slice) -> list[Array]:
        """Subtract (1 - s) times the rows at the start of a load with fraction s from rows of H."""
        ramp = self.constraints.ramp
        if ramp is None or not ramp.rows:
            return rows
        pairs = zip(rows, ramp.rows[fields], strict=True)
        return [row - (1.0 - ramp.fraction) * first for row, first in pairs]

    @cached_property
    def bare_nodes(self) -> Ints:
        """Owned boundary nodes off all contact surfaces that are not clamped. Collective."""
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
        """Read the current values of the user's Functions and Constants.

        Call it at the beginning of every solve, analysis and evaluation, and in an evolution or
        along a branch after each change of the load.

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
        words = "the mesh has moved since the problem was made"
        require(self.comm, same, f"{words}; create the surfaces and the problem again")

    @contextmanager
    def ramped(self, x: PETSc.Vec) -> Iterator[Ramp]:
        """Context manager that applies a fraction s of the load, initially 0.

        Prescribed values are interpolated between their values at the start x_0 and the full data.
        The residual becomes H(x, s) - (1 - s) H(x_0, 0), which is zero at x = x_0 and s = 0. H(x_0,
        0) contains loads on an unloaded body and initial penetrations.

        Args:
            x: unknowns x_0 at the start.

        Yields:
            Load whose fraction s the caller sets.
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

    @property
    def is_static(self) -> bool:
        """Whether friction opposes the total slip on all surfaces (the static law)."""
        return all(term.memory is None for term in self.terms)

    def warn(self, name: str, text: str) -> None:
        """Store a warning about the data for the results, and log it on rank 0 if it is new.

        Not collective.

        Args:
            name: name of the warning.
            text: text of the warning, the same on every rank; empty if the warning no longer
                applies.
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
        message = "the memory belongs to other contact surfaces, another law, sliding or mesh"
        require(self.comm, self.fits(memory), message)
        pairs = zip(self.terms, memory, strict=True)
        return self.with_terms([replace(term, memory=m) for term, m in pairs])

    def fits(self, memory: Sequence[Memory | None]) -> bool:
        """Return whether a memory matches the surfaces, their laws and their sliding. Collective.

        Args:
            memory: memory of the points of each surface; None for the static law.
        """
        mine = len(memory) == len(self.surfaces) and all(
            m is None or _fits(m, s) for s, m in zip(self.surfaces, memory, strict=True)
        )
        return all_ranks(self.comm, mine)

    def with_terms(self, terms: Sequence[SurfaceTerm]) -> ContactEquations:
        """Return the same equations with other terms of the contact surfaces. Not collective."""
        equations = copy(self)
        equations.terms = list(terms)
        return equations

    def memory_after(self, evaluation: Evaluation) -> tuple[Memory, ...]:
        """Return the memory after a step that ends in an evaluated state. Not collective."""
        return tuple(term.memory_after(evaluation) for term in self.terms)


def _fits(memory: Memory, s: DiscreteSurface) -> bool:
    """Return whether a memory matches the points, the law and the kind of sliding of a surface."""
    shape = s.points.number, s.dim
    vectors = [memory.jump] if memory.place is None else [memory.jump, memory.place]
    return (
        (memory.displacement is not None) == s.slides
        and (memory.place is not None) == (s.displaced is not None)
        and set(s.law.memory(s.dim)) <= set(memory.fields)
        and all(values.shape == shape for values in vectors)
        and all(len(values) == s.points.number for values in memory.fields.values())
    )
