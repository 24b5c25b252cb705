# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The contact problem H(x) = 0 in PETSc: equilibrium of the body, and the laws at contact points.

With contact points of areas W, jumps j = B u, multipliers l and tractions t = E l,

    H_u = R(u) - B^T W E l,    H_l = E^T W (t - tau(j, t; statuses)).

H is a sum of terms: the body, every surface or pair, and the rigid bodies (`rigid_bodies`). Springs
and loads belong to the residual R of the body. Axisymmetry is a weight of the integrals in R and of
the areas W; the kinematics of a surface contain its sliding (`points.kinematics`).

Dirichlet data enter every row linearly: rows are evaluated at the unknowns, and their derivatives
along the step to the prescribed values are added. Newton's method thus needs no unknowns that
satisfy the data, and the columns of Dirichlet dofs are empty.

Every row has the unit of a force; Dirichlet rows are multiplied by a typical stiffness. Every
unknown in the PETSc vectors is a length; multipliers are divided by a typical stiffness per area.
Thus the relative sizes of rows and of unknowns do not depend on the user's units.

Evaluations are stateless: statuses are arguments, results are returned, and the memory of earlier
states is fixed (`with_memory`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._geometry import mesh_mark, node_positions
from dolfinx_contact._mpi import anywhere, require, total
from dolfinx_contact._petsc import ProblemOptions, logged
from dolfinx_contact.body.bulk import Bulk
from dolfinx_contact.body.rigid import bounding_box
from dolfinx_contact.equations.constraints import Constraints, PrescribedDisplacement, check_overlap
from dolfinx_contact.equations.evaluation import ContactState, Evaluation, Statuses
from dolfinx_contact.equations.rigid_bodies import RigidBodies
from dolfinx_contact.equations.scaling import Scaling
from dolfinx_contact.laws.symbols import SLID
from dolfinx_contact.points.kinematics import Kinematics
from dolfinx_contact.points.memory import Memory, slid_after
from dolfinx_contact.points.surface import DiscreteSurface

if TYPE_CHECKING:
    from dolfinx_contact.body.moving import MovingBody

__all__ = ["ContactEquations", "remembered"]

Array = npt.NDArray[np.float64]


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
        owned_sizes: numbers of owned unknowns: displacement, surface by surface, rigid bodies.
        units: factors from the unknowns of the PETSc vectors to the user's units, one per field.
        body_size: diagonal of the bounding box of the body, a length.
        rigid: rigid bodies that surfaces touch.
        scaling: typical stiffness, augmentation parameters and loose motions.
        axisymmetric: whether the body is a body of revolution.
        memory: memory of the points of each surface at the beginning of the step; None under the
            static law. See `with_memory`.
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
        self.memory: tuple[Memory | None, ...] = (None,) * len(self.surfaces)
        #: Surfaces with a warning about an obstacle that moves along itself.
        self.dragging: set[str] = set()
        #: Messages about obstacles on the wrong side of the undeformed body, by surface.
        self.wrong_sides: dict[str, str] = {}
        self.bcs = list(bcs)
        self.options = options
        check_overlap(self.surfaces)
        self.axisymmetric = self.surfaces[0].axisymmetric
        for s in self.surfaces:
            s.slide(linear=bulk.linear)
        #: Whether H is linear in the displacement as long as no status changes.
        self.linear = bulk.linear and all(s.linear for s in self.surfaces)
        self.constraints = Constraints(V, self.surfaces, bcs)
        self.prescribed = PrescribedDisplacement(V, self.constraints)
        spaces = [V, *(s.points.Q for s in self.surfaces)]
        sizes = [(W.dofmap.index_map, W.dofmap.index_map_bs) for W in spaces]
        self.fixed = self.constraints.fixed.reshape(-1)
        low, high = bounding_box(self.comm, V.mesh.geometry.x)
        self.body_size = float(np.linalg.norm(high - low))
        self.rigid = RigidBodies(V, self.surfaces, self.body_size)
        self.owned_sizes = [*(m.size_local * bs for m, bs in sizes), self.rigid.owned]
        ends = np.cumsum(self.owned_sizes).tolist()
        self._slices = [slice(b - n, b) for b, n in zip(ends, self.owned_sizes, strict=True)]
        self.global_sizes = [*(int(m.size_global) * bs for m, bs in sizes), self.rigid.size]
        self._mesh_mark = mesh_mark(V.mesh)
        #: Positions of the local nodes of the displacement (n, dim).
        self.nodes = node_positions(V)[:, : self.dim]
        self.forced_r = r
        self.scaling = Scaling(bulk, V, self.surfaces, self.constraints.fixed, self.rigid, r)
        per_area = [self.stiffness_scale / s.points.mean_vertex_area for s in self.surfaces]
        self.units = [1.0, *per_area, 1.0]
        if not bulk.linear:
            bulk.destroy()

    @property
    def stiffness_scale(self) -> float:
        """Typical stiffness, factor of the Dirichlet rows; updated with the data (`scaling`)."""
        return self.scaling.stiffness

    # -- unknowns --------------------------------------------------------------------------------

    def create_vector(self) -> PETSc.Vec:
        """Create a vector of all unknowns: displacement, multipliers, rigid bodies per rank."""
        return PETSc.Vec().createMPI((sum(self.owned_sizes), None), comm=self.comm)

    def blocks(self, x: PETSc.Vec) -> list[Array]:
        """Return copies of the owned parts of ``x``, one array per field."""
        values = x.array_r.copy()
        return [values[part] for part in self._slices]

    def fields(self, x: PETSc.Vec) -> list[Array]:
        """Owned values of displacement and multipliers, in the user's units."""
        return [unit * part for unit, part in zip(self.units, self.blocks(x), strict=True)][:-1]

    def put(self, fields: Sequence[Array], q: Array, x: PETSc.Vec) -> None:
        """Copy owned values of displacement, multipliers and rigid bodies into ``x``."""
        sizes = zip([*fields, self.rigid.here(q)], self.units, self.owned_sizes, strict=True)
        x.array[:] = np.concatenate([values[:n] / unit for values, unit, n in sizes])

    def motions(self, x: PETSc.Vec) -> Array:
        """Return the unknowns of the rigid bodies, on every rank."""
        if not self.rigid.size:
            return np.zeros(0)
        return self.rigid.everywhere(x.array_r[x.getLocalSize() - self.rigid.owned :])

    def displacement(self, x: PETSc.Vec) -> Array:
        """Return the displacement at all local dofs, including ghosts."""
        f = self.bulk.displacement
        n = self.owned_sizes[0]
        f.x.array[:n] = x.array_r[:n]
        f.x.scatter_forward()
        return f.x.array.copy()

    # -- H ---------------------------------------------------------------------------------------

    def contact(self, x: PETSc.Vec, statuses: Statuses | None = None) -> Evaluation:
        """Evaluate the contact points at ``x``, without the rows of H.

        Args:
            x: unknowns.
            statuses: statuses for the laws; default: those determined by the unknowns.
        """
        self.refresh()
        u = self.displacement(x)
        q = self.motions(x)
        with logged("ContactStatus"):
            return Evaluation(u, q, self._contact(x, u, q, statuses))

    def taken_by(self, x: PETSc.Vec, state: Evaluation, statuses: Statuses | None) -> Evaluation:
        """Return an evaluation at ``x`` with other statuses; the same as `contact`, but cheaper.

        Laws are evaluated for every status at once. They are evaluated again only if they are
        nonlocal or some points have no opposing point.

        Args:
            x: unknowns.
            state: evaluation at these unknowns.
            statuses: statuses for the laws; None: those determined by the unknowns.
        """
        self.refresh()
        if any(
            s.answers.spreading is not None or s.kinematics.operator.absent is not None
            for s in state.surfaces
        ):
            return self.contact(x, statuses)
        codes = [s.answers.required for s in state.surfaces] if statuses is None else statuses
        pairs = zip(state.surfaces, codes, strict=True)
        return Evaluation(state.u, state.q, [replace(s, statuses=held) for s, held in pairs])

    def refresh(self) -> bool:
        """Update surfaces with changed data, and the ghosts of Functions. Collective.

        Returns:
            Whether a surface has changed.
        """
        parts = [self.bulk, *self.surfaces]
        outdated, *moved = anywhere(self.comm, *[part.has_changed for part in parts])
        if outdated:
            self.bulk.update_ghosts()
        for s, changed in zip(self.surfaces, moved, strict=True):
            if changed:
                s.update_geometry()
        return any(moved)

    def _contact(
        self, x: PETSc.Vec, u: Array, q: Array, statuses: Statuses | None
    ) -> list[ContactState]:
        """Evaluate kinematics and law of every surface."""
        states = []
        parts = self.blocks(x)
        for i, s in enumerate(self.surfaces):
            removed = self.constraints.removed[i].reshape(-1)[: self.owned_sizes[i + 1]]
            multipliers = np.where(removed, 0.0, self.units[i + 1] * parts[i + 1])
            at = self.kinematics(s, u, q)
            traction = s.points.traction(multipliers)
            held = None if statuses is None else statuses[i]
            answers = s.law_at_points(at.jump, traction, at.data, held)
            codes = answers.required if held is None else held
            absent = at.operator.absent
            if absent is not None:
                codes = np.where(absent, s.law_at_points.codes[0], codes)
            states.append(ContactState(at, traction, codes, answers))
        return states

    def kinematics(self, s: DiscreteSurface, u: Array, q: Array) -> Kinematics:
        """Return gap, slip and B of ``s`` at a displacement and unknowns of the rigid bodies."""
        memory = self.memory[self.surfaces.index(s)]
        motion = None if s.rigid_body is None else self.rigid.of_body(q, s.rigid_body)
        return s.kinematics(u.reshape(-1, self.dim), motion, memory)

    def relative(self, s: DiscreteSurface, u: Array, q: Array) -> Array:
        """Displacements of the owned nodes relative to the obstacle of ``s``, shape (n, dim).

        Args:
            s: contact surface.
            u: displacement at the first local dofs, at least at all owned ones.
            q: unknowns of the rigid bodies.
        """
        return self.rigid.relative(s, u[: self.owned_sizes[0]].reshape(-1, self.dim), q)

    def as_possible(self, statuses: Statuses) -> Statuses:
        """Replace guessed statuses that the laws of these equations do not have."""
        return statuses

    def residual(self, x: PETSc.Vec, b: PETSc.Vec, statuses: Statuses | None = None) -> Evaluation:
        """Write H(x) into ``b`` and return the evaluation.

        Args:
            x: unknowns.
            b: vector that receives H(x).
            statuses: statuses for the laws; default: those determined by the unknowns.
        """
        self.refresh()
        u = self.displacement(x)
        q = self.motions(x)
        with logged("ContactStatus"):
            contact = self._contact(x, u, q, statuses)
        # step from the unknowns to the Dirichlet data
        prescribed = self.prescribed.values().reshape(-1)
        motion = self.prescribed_motions()
        du = np.where(self.fixed, prescribed - u, 0.0)
        dq = np.where(self.rigid.fixed, motion - q, 0.0)
        (steps,) = anywhere(self.comm, bool(du.any() or dq.any()))
        # body, and contact forces on it; for a linear body K (u + du) + f needs no assembly
        affine = self.bulk.affine_residual(u + du)
        body = self.bulk.residual_at(u) if affine is None else affine
        pushed: Array = np.zeros(self.rigid.size)
        for s, state in zip(self.surfaces, contact, strict=True):
            forces = state.kinematics.operator.transpose(state.traction)
            body = body - forces
            if s.rigid_body is not None:
                pushed += self.rigid.reactions(s, forces, u, q)
        reactions = body.copy()
        if steps and affine is None:
            body += self.bulk.lifting(u, self.prescribed.conditions, u)
        if steps:
            body -= self._turned_forces(contact, u, q, du, dq)
        fixed = self.fixed[: len(body)]
        body[fixed] = self.scaling.stiffness * (u - prescribed)[: len(body)][fixed]
        # contact conditions
        rows = [body]
        for i, (s, state) in enumerate(zip(self.surfaces, contact, strict=True)):
            off = state.off
            if steps:
                off = off - self._change(s, state, u, q, du, dq)
            rows.append(self._with_removed(i, s.points.rows(off), x))
        # rigid bodies
        if self.rigid.size:
            pushed = total(self.comm, pushed)
        rows.append(self._rigid_rows(q, motion, pushed))
        b.array[:] = np.concatenate(rows)
        return Evaluation(u, q, contact, rows, reactions, -pushed)

    def _rigid_rows(self, q: Array, motion: Array, pushed: Array) -> Array:
        """Owned rows of the rigid bodies: balance of forces, or distance to the given motion."""
        if not self.rigid.size:
            return np.zeros(0)
        held = self.scaling.stiffness * (q - motion)
        return self.rigid.here(np.where(self.rigid.fixed, held, pushed - self.rigid.loads()))

    def contact_rows(self, x: PETSc.Vec, statuses: Statuses | None = None) -> Array:
        """Owned contact rows of H, without evaluating the body. Collective.

        Args:
            x: unknowns that satisfy the Dirichlet conditions.
            statuses: statuses for the laws; default: those determined by the unknowns.
        """
        found = self.contact(x, statuses).surfaces
        rows = [
            self._with_removed(i, s.points.rows(state.off), x)
            for i, (s, state) in enumerate(zip(self.surfaces, found, strict=True))
        ]
        return np.concatenate(rows)

    def relative_rate(self, s: DiscreteSurface, u: Array, q: Array, du: Array, dq: Array) -> Array:
        """Derivative of `relative` along (du, dq), shape (n, dim).

        Args:
            s: contact surface.
            u: displacement at the first local dofs, at least at all owned ones.
            q: unknowns of the rigid bodies.
            du: increment of ``u``.
            dq: increment of ``q``.
        """
        n = self.owned_sizes[0]
        step = du[:n].reshape(-1, self.dim)
        if s.rigid_body is None:
            return step
        at = u[:n].reshape(-1, self.dim)
        return self.rigid.relative_rate(s, at, q, step, dq)

    def _change(
        self, s: DiscreteSurface, found: ContactState, u: Array, q: Array, du: Array, dq: Array
    ) -> Array:
        """Derivative of the answer at a state along (du, dq). Collective.

        Jump and normal turn with the frame of a rigid body. Laws are objective, so a rotation w
        adds w x tau - dtau/dt (w x t).
        """
        change = found.change(self.relative_rate(s, u, q, du, dq))
        turning = None if s.rigid_body is None else self.rigid.spin(s, q, dq)
        if turning is not None:
            assert s.rigid_body is not None
            crossed = s.rigid_body.crossed
            back = np.einsum("nij,nj->ni", found.by_traction, crossed(turning, found.traction))
            change = change + crossed(turning, found.answer) - back
        return np.asarray(change)

    def _turned_forces(
        self, contact: Sequence[ContactState], u: Array, q: Array, du: Array, dq: Array
    ) -> Array:
        """Derivative of the contact forces along (du, dq) at fixed tractions. Collective.

        Args:
            contact: evaluations of the contact surfaces.
            u: displacement at all local dofs.
            q: unknowns of the rigid bodies.
            du: increment of ``u``.
            dq: increment of ``q``.
        """
        forces = np.zeros(self.owned_sizes[0])
        for s, found in zip(self.surfaces, contact, strict=True):
            step = self.relative_rate(s, u, q, du, dq)
            forces += found.kinematics.operator.transpose_rate(found.traction, step)
        return forces

    def prescribed_motions(self) -> Array:
        """Return the prescribed motions of the rigid bodies, zero where they are free."""
        return np.zeros(0) if not self.rigid.size else self.rigid.prescribed(self.prescribed.part)

    def _with_removed(self, i: int, rows: Array, x: PETSc.Vec | None) -> Array:
        """Insert the rows of removed multipliers into the contact rows of surface ``i``."""
        removed = self.constraints.removed[i].reshape(-1)[: self.owned_sizes[i + 1]]
        held = 0.0 if x is None else self.scaling.stiffness * x.array_r[self._slices[i + 1]]
        return np.where(removed, held, rows)

    def rates(
        self,
        state: Evaluation,
        body: Array,
        answers: Sequence[Array | None],
        dirichlet: Array,
        loads: Array,
        motions: Array,
    ) -> Array:
        """Owned rows of the derivative of H by a parameter, at fixed statuses.

        Args:
            state: evaluation with these statuses.
            body: rates of the rows of the body at fixed unknowns, owned.
            answers: rates of the answers at fixed unknowns, shape (n, dim), surface by surface;
                None for surfaces whose law does not depend on the parameter.
            dirichlet: rates of the Dirichlet values at all local dofs, 0 at free ones.
            loads: rates of the loads on the rigid bodies, 0 where their motion is prescribed.
            motions: rates of the prescribed motions, 0 where they are free.
        """
        n = self.owned_sizes[0]
        u = state.u
        (moving,) = anywhere(self.comm, bool(dirichlet.any() or motions.any()))
        rows = body.copy()
        if moving:
            product = self.bulk.product(dirichlet)
            if product is None:
                conditions = self.prescribed.conditions
                at = np.where(self.fixed, self.prescribed.values().reshape(-1) - dirichlet, u)
                product = self.bulk.lifting(u, conditions, at)
            rows += product
            rows -= self._turned_forces(state.surfaces, u, state.q, dirichlet, motions)
        fixed = self.fixed[:n]
        rows[fixed] = -self.stiffness_scale * dirichlet[:n][fixed]
        parts = [rows]
        for i, (s, found, rate) in enumerate(
            zip(self.surfaces, state.surfaces, answers, strict=True)
        ):
            change = np.zeros_like(found.jump) if rate is None else -rate
            if moving:
                change -= self._change(s, found, u, state.q, dirichlet, motions)
            parts.append(self._with_removed(i, s.points.rows(change), None))
        parts.append(self.rigid.here(-loads - self.stiffness_scale * motions))
        return np.concatenate(parts)

    # -- statuses --------------------------------------------------------------------------------

    def gaps(self, s: DiscreteSurface, state: Evaluation) -> Array:
        """Gaps at the points of ``s`` as in the law, but pointwise also in the mixed method."""
        points = s.points
        if s.method != "mixed" or s.slides:
            return state.surfaces[self.surfaces.index(s)].kinematics.gap
        nodes = self.rigid.relative(s, state.u.reshape(-1, self.dim), state.q)
        at = (nodes - s.opposite(nodes))[points.trace_dofs[: points.number]]
        return np.asarray(points.gaps - np.sum(at * points.data.n, axis=1))

    def reach(self, s: DiscreteSurface, u: Array) -> float:
        """Gap up to which open points of ``s`` are expected to close.

        It is half the approach prescribed by Dirichlet data, as at the edge of a Hertzian contact.
        """
        return 0.5 * self.constraints.approach(s, u.reshape(-1, self.dim))

    @contextmanager
    def ramped(self, x: PETSc.Vec) -> Iterator[None]:
        """Prescribe the part `prescribed.part` of the way from ``x`` to the data. Collective."""
        self.rigid.start = self.motions(x)
        try:
            with self.prescribed.ramped(self.displacement(x).reshape(self.constraints.fixed.shape)):
                yield
        finally:
            self.rigid.start = None

    # -- data ------------------------------------------------------------------------------------

    def with_memory(self, memory: Sequence[Memory | None]) -> ContactEquations:
        """Return the same equations with another memory of the contact points. Collective.

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
        equations = copy(self)
        equations.memory = tuple(memory)
        return equations

    def advanced(self, state: Evaluation) -> tuple[Memory, ...]:
        """Return the memory after a step that ends in this state. Not collective."""
        n = self.owned_sizes[0]
        found = zip(self.surfaces, state.surfaces, strict=True)
        return tuple(
            Memory(
                at.kinematics.whole,
                remembered(s, at),
                place=at.kinematics.place,
                motion=at.kinematics.motion,
                displacement=state.u[:n].reshape(-1, self.dim) if s.slides else None,
            )
            for s, at in found
        )

    def resultant(self, forces: Array) -> Array:
        """Sum of forces (n, dim) over all ranks; only the axial part in bodies of revolution."""
        whole = total(self.comm, forces.sum(axis=0))
        return np.where(np.arange(self.dim) < self.axisymmetric, 0.0, whole)

    def require_same_mesh(self) -> None:
        """Raise ``ValueError`` if the mesh has moved since the problem was made."""
        same = mesh_mark(self.V.mesh) == self._mesh_mark
        words = "the mesh has moved since the problem was made; make surfaces and problem anew"
        require(self.comm, same, words)

    def round_off_force(self, displacement: float) -> float:
        """Nodal force that counts as round-off at a displacement of this size.

        If a body moves without resistance, all forces are the round-off of stiffness times motion,
        and no other scale is available. Stresses of a nonlinear body are differences of moduli, so
        their round-off is 1e-15 of the moduli even without load.
        """
        strain = 0.0 if self.bulk.linear else 1e-5 * self.body_size
        return self.scaling.stiffness * max(1e-4 * displacement, strain)


def _fits(memory: Memory, s: DiscreteSurface) -> bool:
    """Whether a memory belongs to a surface of this size and sliding."""
    alike = memory.slides == s.slides and memory.follows == (s.displaced is not None)
    known = set(s.law.memory(s.dim)) <= set(memory.fields)
    return alike and known and memory.fits(s.points.number, s.dim)


def remembered(s: DiscreteSurface, at: ContactState) -> dict[str, Array]:
    """Return the fields of the memory after a step of ``s`` that ends in a state."""
    fields = {name: at.answers.bond(f"after.{name}") for name in s.law.memory(s.dim)}
    if s.law_at_points.compiled.knows_slip:
        fields[SLID] = slid_after(at.data, at.jump, at.statuses)
    return fields
