# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The contact problem H(x) = 0 in PETSc: equilibrium of the body, and the laws at contact points.

With points on the contact surfaces, their areas W, jumps j = B u and tractions t = E l,

    H_u = R(u) - B^T W E l,    H_l = E^T W (t - tau(j, t; statuses)).

Every row is in units of force: the body's by nature, the contact rows unscaled, and the Dirichlet
rows multiplied by a typical stiffness. Every unknown of the PETSc vectors is a length: multipliers
are divided by a typical stiffness per area. So neither norms of H nor the matrix depend on the
user's units.

Nothing is kept between two evaluations: statuses are arguments, what was found is returned, and
the memory of earlier states is fixed (`with_memory`).
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

from dolfinx_contact._errors import require
from dolfinx_contact._mesh_mark import mesh_mark, node_positions
from dolfinx_contact._options import ProblemOptions
from dolfinx_contact._petsc import logged
from dolfinx_contact._shared import anywhere, total
from dolfinx_contact.body.bulk import Bulk
from dolfinx_contact.body.rigid import bounding_box
from dolfinx_contact.equations.constraints import Constraints, PrescribedDisplacement, check_overlap
from dolfinx_contact.equations.evaluation import ContactState, Evaluation, Statuses
from dolfinx_contact.equations.obstacle_sides import warn_of_obstacle
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
    """H of a body with contact surfaces. Collective, as all its methods are.

    Args:
        bulk: the body.
        V: space of its displacement.
        surfaces: where it may touch.
        bcs: Dirichlet conditions.
        r: augmentation parameter, by default from the stiffness of the contact nodes.
        options: of the SNES.

    Attributes:
        owned_sizes: numbers of unknowns of this rank, the displacement first, rigid bodies last.
        units: what the unknowns of each field are multiplied by.
        body_size: diagonal of the bounding box of the body.
        rigid: the rigid bodies that surfaces touch.
        scaling: what follows the stiffness.
        snes: what users see of Newton's method; empty before it is made for the first time.
        axisymmetric: whether the body is one of revolution.
        memory: memory of the points of each surface at the beginning of the step; None: the static
            law. See `with_memory`.
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
        self.bcs = list(bcs)
        self.options = options
        self.snes = PETSc.SNES()
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
        #: Names of the surfaces whose obstacle is known to be on the wrong side.
        self._wrong_sides: set[str] = set()
        if not bulk.linear:
            bulk.destroy()

    @property
    def stiffness_scale(self) -> float:
        """Typical stiffness, of the Dirichlet rows; it may follow the data (`scaling`)."""
        return self.scaling.stiffness

    def check_obstacles(self) -> None:
        """Warn of obstacles on the wrong side. Collective."""
        for s in self.surfaces:
            warn_of_obstacle(s, self.body_size, self._wrong_sides)

    # -- unknowns --------------------------------------------------------------------------------

    def create_vector(self) -> PETSc.Vec:
        """A vector of all unknowns, rank by rank displacement, multipliers, rigid bodies."""
        return PETSc.Vec().createMPI((sum(self.owned_sizes), None), comm=self.comm)

    def blocks(self, x: PETSc.Vec) -> list[Array]:
        """Local parts of ``x``, one array per field; copies."""
        values = x.array_r.copy()
        return [values[part] for part in self._slices]

    def fields(self, x: PETSc.Vec) -> list[Array]:
        """Owned values of displacement and multipliers, in the user's units."""
        return [unit * part for unit, part in zip(self.units, self.blocks(x), strict=True)][:-1]

    def put(self, fields: Sequence[Array], q: Array, x: PETSc.Vec) -> None:
        """Put owned values of displacement and multipliers, and of rigid bodies, into ``x``."""
        sizes = zip([*fields, self.rigid.here(q)], self.units, self.owned_sizes, strict=True)
        x.array[:] = np.concatenate([values[:n] / unit for values, unit, n in sizes])

    def motions(self, x: PETSc.Vec) -> Array:
        """Unknowns of the rigid bodies, on every rank. Collective."""
        return self.rigid.everywhere(x.array_r[x.getLocalSize() - self.rigid.owned :])

    def displacement(self, x: PETSc.Vec) -> Array:
        """The displacement at all local dofs, ghosts included."""
        f = self.bulk.displacement
        n = self.owned_sizes[0]
        f.x.array[:n] = x.array_r[:n]
        f.x.scatter_forward()
        return f.x.array.copy()

    # -- H ---------------------------------------------------------------------------------------

    def contact(self, x: PETSc.Vec, statuses: Statuses | None = None) -> Evaluation:
        """The state ``x`` without the rows of H.

        Args:
            x: unknowns.
            statuses: by which the laws are taken; by default those that the state determines.
        """
        self.refresh()
        u = self.displacement(x)
        q = self.motions(x)
        with logged("ContactStatus"):
            return Evaluation(u, q, self._contact(x, u, q, statuses))

    def taken_by(self, x: PETSc.Vec, state: Evaluation, statuses: Statuses | None) -> Evaluation:
        """A state at ``x``, without the rows of H, as `contact` has it by other statuses.

        Laws answer for every status, so that they are not asked again unless they see the points
        around theirs, or some have nothing opposite.
        """
        self.refresh()
        if any(
            found.answers.spreading is not None or found.kinematics.operator.absent is not None
            for found in state.surfaces
        ):
            return self.contact(x, statuses)
        if statuses is None:
            statuses = [found.answers.required for found in state.surfaces]
        found = zip(state.surfaces, statuses, strict=True)
        return Evaluation(state.u, state.q, [replace(at, statuses=codes) for at, codes in found])

    def refresh(self) -> None:
        """Evaluate anew what is given on surfaces where the user has changed it. Collective.

        The ghosts of Functions that are given follow their owners, in the forms of the body too.
        """
        parts = [self.bulk, *self.surfaces]
        changed = anywhere(self.comm, *(part.has_changed for part in parts))
        if changed[0]:
            self.bulk.update_ghosts()
        for s, memory, other in zip(self.surfaces, self.memory, changed[1:], strict=True):
            if other:
                s.update_geometry()
            if other and (memory is None or s.displaced is None):
                warn_of_obstacle(s, self.body_size, self._wrong_sides)

    def _contact(
        self, x: PETSc.Vec, u: Array, q: Array, statuses: Statuses | None
    ) -> list[ContactState]:
        found = []
        parts = self.blocks(x)
        held = [None] * len(self.surfaces) if statuses is None else statuses
        for i, (s, codes) in enumerate(zip(self.surfaces, held, strict=True)):
            removed = self.constraints.removed[i].reshape(-1)[: self.owned_sizes[i + 1]]
            multipliers = np.where(removed, 0.0, self.units[i + 1] * parts[i + 1])
            at = self.kinematics(s, u, q)
            traction = s.points.traction(multipliers)
            answers = s.law_at_points(at.jump, traction, at.data, codes)
            codes = answers.required if codes is None else codes
            if at.operator.absent is not None:
                codes = np.where(at.operator.absent, s.law_at_points.codes[0], codes)
            found.append(ContactState(at, traction, codes, answers))
        return found

    def kinematics(self, s: DiscreteSurface, u: Array, q: Array) -> Kinematics:
        """Gap, slip and B of ``s`` at a displacement and unknowns of the rigid bodies."""
        memory = self.memory[self.surfaces.index(s)]
        return s.kinematics(u.reshape(-1, self.dim), self.rigid.of_body(q, s.rigid_body), memory)

    def relative(self, s: DiscreteSurface, u: Array, q: Array) -> Array:
        """Displacements of the owned nodes (n, dim), seen from what ``s`` touches.

        Args:
            s: the surface.
            u: values at the first local dofs, at least the owned ones.
            q: unknowns of the rigid bodies.
        """
        return self.rigid.relative(s, u[: self.owned_sizes[0]].reshape(-1, self.dim), q)

    def as_possible(self, statuses: Statuses) -> Statuses:
        """Guessed statuses, by others where what answers here does not have them."""
        return statuses

    def residual(self, x: PETSc.Vec, b: PETSc.Vec, statuses: Statuses | None = None) -> Evaluation:
        """H(x) into ``b``, and the state. Dirichlet data enter all rows linearly.

        Args:
            x: unknowns.
            b: receives H(x).
            statuses: by which the laws are taken; by default those that the state determines.
        """
        self.refresh()
        u = self.displacement(x)
        q = self.motions(x)
        n = self.owned_sizes[0]
        with logged("ContactStatus"):
            contact = self._contact(x, u, q, statuses)
        prescribed = self.prescribed.values().reshape(-1)
        motion = self.prescribed_motions()
        missing = np.where(self.fixed, prescribed - u, 0.0)
        missing_q = np.where(self.rigid.fixed, motion - q, 0.0)
        any_missing = self._any(missing, missing_q)
        # A linear body takes its Dirichlet data in the product, and needs no assembly.
        affine = self.bulk.affine_residual(u + missing)
        body = self.bulk.residual_at(u) if affine is None else affine
        pushed: Array = np.zeros(self.rigid.size)
        for s, state in zip(self.surfaces, contact, strict=True):
            forces = state.kinematics.operator.transpose(state.traction)
            body = body - forces
            pushed += self.rigid.reactions(s, forces, u, q)
        reactions = body.copy()
        if affine is None and any_missing:
            body += self.bulk.lifting(u, self.prescribed.conditions, u)
        if any_missing:
            body -= self._turned_forces(contact, u, q, missing, missing_q)
        fixed = self.fixed[:n]
        body[fixed] = self.stiffness_scale * (u - prescribed)[:n][fixed]
        rows = [body]
        for i, (s, state) in enumerate(zip(self.surfaces, contact, strict=True)):
            off = state.off
            if any_missing:
                off = off - self._change(s, state, u, q, missing, missing_q)
            rows.append(self._with_removed(i, s.points.rows(off), x))
        if self.rigid.size:
            pushed = total(self.comm, pushed)
        held = self.stiffness_scale * (q - motion)
        balance = np.where(self.rigid.fixed, held, pushed - self.rigid.loads())
        rows.append(self.rigid.here(balance))
        b.array[:] = np.concatenate(rows)
        return Evaluation(u, q, contact, rows, reactions, -pushed)

    def contact_rows(self, x: PETSc.Vec, statuses: Statuses | None = None) -> Array:
        """Rows of H at the multipliers, which need nothing of the body, owned. Collective.

        Args:
            x: unknowns, with the Dirichlet data.
            statuses: by which the laws are taken; by default those that the state determines.
        """
        found = self.contact(x, statuses).surfaces
        rows = [
            self._with_removed(i, s.points.rows(state.off), x)
            for i, (s, state) in enumerate(zip(self.surfaces, found, strict=True))
        ]
        return np.concatenate(rows)

    def relative_rate(self, s: DiscreteSurface, u: Array, q: Array, du: Array, dq: Array) -> Array:
        """The derivative of `relative` along displacements of all, at a state (n, dim).

        Args:
            s: the surface.
            u: values at the first local dofs, at least the owned ones.
            q: unknowns of the rigid bodies.
            du: displacement, likewise.
            dq: by which these change.
        """
        n = self.owned_sizes[0]
        at, step = (v[:n].reshape(-1, self.dim) for v in (u, du))
        return self.rigid.relative_rate(s, at, q, step, dq)

    def _change(
        self, s: DiscreteSurface, found: ContactState, u: Array, q: Array, du: Array, dq: Array
    ) -> Array:
        """The derivative of the answer at a state along displacements of all. Collective.

        Where the frame of a rigid body turns, jump and normal do, and a law does not know
        directions in space: of the rotation w it is w x tau - dtau/dt (w x t).
        """
        change = found.change(self.relative_rate(s, u, q, du, dq))
        turning = self.rigid.spin(s, q, dq)
        if turning is not None:
            assert s.rigid_body is not None
            crossed = s.rigid_body.crossed
            back = np.einsum("nij,nj->ni", found.by_traction, crossed(turning, found.traction))
            change = change + crossed(turning, found.answer) - back
        return np.asarray(change)

    def _turned_forces(
        self, contact: Sequence[ContactState], u: Array, q: Array, du: Array, dq: Array
    ) -> Array:
        """The derivative of the contact forces of held tractions along displacements. Collective.

        Args:
            contact: the surfaces at a state.
            u: displacement there, at all local dofs.
            q: unknowns of the rigid bodies there.
            du: displacement at all local dofs.
            dq: unknowns of the rigid bodies.
        """
        forces = np.zeros(self.owned_sizes[0])
        for s, found in zip(self.surfaces, contact, strict=True):
            step = self.relative_rate(s, u, q, du, dq)
            forces += found.kinematics.operator.transpose_rate(found.traction, step)
        return forces

    def prescribed_motions(self) -> Array:
        """What is prescribed to the rigid bodies now, zero where they are free."""
        return self.rigid.prescribed(self.prescribed.part)

    def _any(self, *values: npt.ArrayLike) -> bool:
        """Whether anything is not zero on any rank. Collective."""
        return bool(self.comm.allreduce(int(any(np.any(v) for v in values))))

    def _with_removed(self, i: int, rows: Array, x: PETSc.Vec | None) -> Array:
        """Contact rows of surface ``i`` with those of removed multipliers put in."""
        removed = self.constraints.removed[i].reshape(-1)[: self.owned_sizes[i + 1]]
        held = 0.0 if x is None else self.stiffness_scale * x.array_r[self._slices[i + 1]]
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
        """Rows of the derivative of H by a parameter, at a state.

        Args:
            state: with the statuses that are held.
            body: rates of the body's rows at held unknowns, owned.
            answers: of the laws' answers at held unknowns (n, dim), surface by surface; None where
                they do not change.
            dirichlet: of the Dirichlet values, at all local dofs, 0 elsewhere.
            loads: on the rigid bodies, 0 where their motion is prescribed.
            motions: of what is prescribed to these, 0 elsewhere.
        """
        n = self.owned_sizes[0]
        u = state.u
        moving = self._any(dirichlet, motions)
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
        """Gap of the displacement at the points of ``s`` as the law has it, but no averages."""
        points = s.points
        if s.method != "mixed" or s.slides:
            return state.surfaces[self.surfaces.index(s)].kinematics.gap
        nodes = self.rigid.relative(s, state.u.reshape(-1, self.dim), state.q)
        at = (nodes - s.opposite(nodes))[points.trace_dofs[: points.number]]
        return np.asarray(points.gaps - np.sum(at * points.data.n, axis=1))

    def reach(self, s: DiscreteSurface, u: Array) -> float:
        """Gaps up to which points of ``s`` are expected to close, from an open state.

        Half the motion that Dirichlet data prescribe, where the contact of Hertz ends.
        """
        return 0.5 * self.constraints.approach(s, u.reshape(-1, self.dim))

    def loose_motions(self, statuses: Statuses, state: Evaluation | None = None) -> str:
        """Rigid motions held neither by Dirichlet data nor by these statuses; "" if none.

        Args:
            statuses: of the contact points.
            state: whose shear shows where points that slip hold as well (`loose`).
        """
        return self.scaling.loose.not_held(statuses, state)

    @contextmanager
    def ramped(self, x: PETSc.Vec) -> Iterator[None]:
        """Prescribe `prescribed.part` of the way from ``x`` to the user's data. Collective."""
        self.rigid.start = self.motions(x)
        try:
            with self.prescribed.ramped(self.displacement(x).reshape(self.constraints.fixed.shape)):
                yield
        finally:
            self.rigid.start = None

    # -- data ------------------------------------------------------------------------------------

    def with_memory(self, memory: Sequence[Memory | None]) -> ContactEquations:
        """The same equations with another memory of the contact points. Collective.

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
        words = "the memory is that of other contact surfaces, of another sliding or another mesh"
        require(self.comm, fits, words)
        equations = copy(self)
        equations.memory = tuple(memory)
        return equations

    def advanced(self, state: Evaluation) -> tuple[Memory, ...]:
        """The memory that a step leaves whose end this state is. Not collective."""
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
        """The sum of forces (n, dim) of all ranks; of a body of revolution its axial part."""
        whole = total(self.comm, forces.sum(axis=0))
        return np.where(np.arange(self.dim) < self.axisymmetric, 0.0, whole)

    def require_same_mesh(self) -> None:
        """Raise ``ValueError`` if the mesh has moved since the problem was made."""
        same = mesh_mark(self.V.mesh) == self._mesh_mark
        words = "the mesh has moved since the problem was made; make surfaces and problem anew"
        require(self.comm, same, words)

    def round_off_force(self, displacement: float) -> float:
        """Nodal forces that count as round-off at a displacement of this size.

        Where a body moves without resistance all forces are the round-off of stiffness times
        motion, and nothing else shows how small a force has to be. Stresses of a body that is not
        linear are differences of moduli, also where it has no load: to 1e-15 of these.
        """
        strain = 0.0 if self.bulk.linear else 1e-5 * self.body_size
        return self.stiffness_scale * max(1e-4 * displacement, strain)


def _fits(memory: Memory, s: DiscreteSurface) -> bool:
    """Whether a memory is one of this surface."""
    alike = memory.slides == s.slides and memory.follows == (s.displaced is not None)
    return alike and memory.fits(s.points.number, s.dim)


def remembered(s: DiscreteSurface, at: ContactState) -> dict[str, Array]:
    """The fields of the memory that a state of ``s`` leaves."""
    fields = {name: at.answers.bond(f"after.{name}") for name in s.law.memory(s.dim)}
    if s.law_at_points.compiled.knows_slip:
        fields[SLID] = slid_after(at.data, at.jump, at.statuses)
    return fields
