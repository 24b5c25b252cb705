# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The term of one contact surface or pair in H.

Contact points have areas W, jumps j(u, q) and tractions t = E l of the multipliers l; the law
answers tau. B takes displacements to jumps (`points.operators`). A surface adds

    H_u += -B^T W t,    H_l = E^T W (t - tau(j, t; statuses)),    H_q += Phi^T B^T W t,

where q are the unknowns of the rigid body that it touches, and Phi its motions at the nodes by
unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from dolfinx_contact.equations.evaluation import ContactState, Evaluation
from dolfinx_contact.equations.rigid_bodies import RigidBodies
from dolfinx_contact.laws import Answers
from dolfinx_contact.laws.symbols import SLID
from dolfinx_contact.points.kinematics import Kinematics
from dolfinx_contact.points.memory import Memory, slid_after
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["Rows", "SurfaceTerm"]

Array = npt.NDArray[np.float64]


@dataclass
class Rows:
    """Sums of the terms of H on this rank.

    Attributes:
        body: owned rows of the displacement.
        laws: residuals of the tractions at the points, shape (n, dim), surface by surface.
        pushed: contributions of this rank to the rows of the rigid bodies.
    """

    body: Array
    laws: list[Array]
    pushed: Array


@dataclass(frozen=True, eq=False)
class SurfaceTerm:
    """Term of one contact surface. Methods are collective unless they say otherwise.

    Attributes:
        surface: contact surface.
        number: number of the surface.
        rigid: rigid bodies of the problem.
        removed: mask of the owned multipliers that Dirichlet data remove (`constraints`), (k,).
        memory: memory of the points at the beginning of the step; None under the static law.
    """

    surface: DiscreteSurface
    number: int
    rigid: RigidBodies
    removed: npt.NDArray[np.bool_]
    memory: Memory | None = None

    # -- evaluation ------------------------------------------------------------------------------

    def evaluate(
        self, u: Array, q: Array, multipliers: Array, statuses: npt.NDArray[np.int8] | None
    ) -> ContactState:
        """Evaluate kinematics and law.

        Args:
            u: displacement at all local dofs.
            q: unknowns of the rigid bodies.
            multipliers: owned multipliers, a stress.
            statuses: statuses for the law, shape (n,); None: those determined by the unknowns.
        """
        s = self.surface
        at = self.kinematics(u, q)
        traction = s.points.traction(np.where(self.removed, 0.0, multipliers))
        answers = self._answers(at, traction, statuses)
        codes = answers.required if statuses is None else statuses
        absent = at.operator.absent
        if absent is not None:
            codes = np.where(absent, s.law_at_points.codes[0], codes)
        return ContactState(at, traction, codes, answers)

    def _answers(
        self, at: Kinematics, traction: Array, statuses: npt.NDArray[np.int8] | None
    ) -> Answers:
        """Return the answers of the law to jumps and tractions."""
        return self.surface.law_at_points(at.jump, traction, at.data, statuses)

    def kinematics(self, u: Array, q: Array) -> Kinematics:
        """Return gap, slip and B at a displacement and unknowns of the rigid bodies."""
        s = self.surface
        return s.kinematics(u.reshape(-1, s.dim), self._motion(q), self.memory)

    def gaps(self, at: Evaluation) -> Array:
        """Return gaps at the points as in the law, but pointwise also in the mixed method."""
        s = self.surface
        if s.method != "mixed" or s.slides:
            return at.surfaces[self.number].kinematics.gap
        nodes = self.relative(at.u, at.q)
        jumps = (nodes - s.opposite(nodes))[s.points.trace_dofs[: s.points.number]]
        return np.asarray(s.points.gaps - np.sum(jumps * s.points.data.n, axis=1))

    def memory_after(self, at: Evaluation) -> Memory:
        """Return the memory after a step ending in a state. Not collective."""
        s = self.surface
        found = at.surfaces[self.number]
        nodes = at.u.reshape(-1, s.dim)[: s.owned_nodes] if s.slides else None
        return Memory(
            found.kinematics.whole,
            _remembered(s, found),
            place=found.kinematics.place,
            motion=found.kinematics.motion,
            displacement=nodes,
        )

    # -- motion relative to a rigid body ---------------------------------------------------------

    @cached_property
    def motion_slice(self) -> slice:
        """Places of the motion of the rigid body among the unknowns q; empty without one."""
        return self.rigid.slice_of(self.surface.rigid_body)

    def _motion(self, q: Array) -> Array:
        """Return the motion of the rigid body of the surface; empty without one."""
        return q[self.motion_slice] / self.rigid.units[self.motion_slice]

    def relative(self, u: Array, q: Array) -> Array:
        """Return displacements of nodes relative to the obstacle, shape (n, dim). Not collective.

        Args:
            u: displacement at the first local dofs, shape (dim n,).
            q: unknowns of the rigid bodies.
        """
        s = self.surface
        return s.partner.relative(u.reshape(-1, s.dim), self._motion(q))

    def relative_rate(self, u: Array, q: Array, du: Array, dq: Array) -> Array:
        """Return the derivative of `relative` at the owned nodes, shape (n, dim). Not collective.

        Args:
            u: displacement at the first local dofs, at least at all owned ones.
            q: unknowns of the rigid bodies.
            du: increment of ``u``.
            dq: increment of ``q``.
        """
        s = self.surface
        at, step = (v.reshape(-1, s.dim)[: s.owned_nodes] for v in (u, du))
        return s.partner.relative_rate(at, self._motion(q), step, self._motion(dq))

    def pushes(self, forces: Array, u: Array, q: Array) -> Array:
        """Return the part of this rank of Phi^T f, forces on rigid bodies. Not collective.

        On a curved obstacle in large sliding, moments are taken in the displaced position.

        Args:
            forces: contact forces f on the owned nodes, shape (dim n,).
            u: displacement at the first local dofs, at least at all owned ones.
            q: unknowns of the rigid bodies.
        """
        s = self.surface
        rows = np.zeros(self.rigid.size)
        body = s.rigid_body
        if body is None:
            return rows
        x = s.node_positions[: s.owned_nodes]
        moved = None
        if s.displaced is not None:
            x = x + u.reshape(-1, s.dim)[: s.owned_nodes]
            moved = self._motion(q)[: s.dim]
        found = body.kinematics.resultant(x, forces.reshape(-1, s.dim), moved)
        rows[self.motion_slice] = found / self.rigid.units[self.motion_slice]
        if s.axisymmetric:  # other components cancel around the axis
            rows[self.motion_slice][[0, 2]] = 0.0
        return rows

    def motions_at_points(self) -> Array:
        """Return Phi, motions of the points by unknown of the body, shape (n, dim, k)."""
        s = self.surface
        body = s.rigid_body
        units = self.rigid.units[self.motion_slice]
        moved = np.zeros((s.points.number, s.dim, len(units)))
        if body is None:
            return moved
        operator = s.constant_operator("a rigid body that moves")
        x = s.node_positions[: s.owned_nodes]
        for k, unit in enumerate(np.diag(1.0 / units)):
            moved[:, :, k] = operator.apply(body.kinematics.field(x, unit))
        return moved

    # -- rows ------------------------------------------------------------------------------------

    def add(self, at: Evaluation, rows: Rows) -> None:
        """Add the term at a state to rows."""
        found = at.surfaces[self.number]
        forces = found.kinematics.operator.transpose(found.traction)
        rows.body -= forces
        rows.laws[self.number] = rows.laws[self.number] + found.off
        rows.pushed += self.pushes(forces, at.u, at.q)

    def add_rate(self, at: Evaluation, du: Array, dq: Array, rows: Rows) -> None:
        """Add the derivative of the term along a motion at fixed tractions and statuses to rows.

        Jump and normal turn with the frame of a rigid body. Laws are objective, so a rotation w
        adds w x tau - dtau/dt (w x t). Rows of rigid bodies are not changed.

        Args:
            at: state.
            du: increment of the displacement at all local dofs.
            dq: increment of the unknowns of the rigid bodies.
            rows: rows that are changed.
        """
        s = self.surface
        found = at.surfaces[self.number]
        step = self.relative_rate(at.u, at.q, du, dq)
        rows.body -= found.kinematics.operator.transpose_rate(found.traction, step)
        change = found.change(step)
        body = s.rigid_body
        if body is not None and s.partner.turns:
            turning = body.kinematics.spin(self._motion(at.q)) @ self._motion(dq)[s.dim :]
            back = np.einsum(
                "nij,nj->ni", found.by_traction, body.kinematics.crossed(turning, found.traction)
            )
            change = change + body.kinematics.crossed(turning, found.answer) - back
        rows.laws[self.number] = rows.laws[self.number] - change

    def law_rows(self, off: Array, identity: Array | float) -> Array:
        """Return the owned rows of the multipliers, shape (k,).

        Args:
            off: residuals of the tractions at the points, shape (n, dim).
            identity: rows of removed multipliers, shape (k,).
        """
        return np.where(self.removed, identity, self.surface.points.rows(off))


def _remembered(s: DiscreteSurface, at: ContactState) -> dict[str, Array]:
    """Return the fields of the memory after a step of ``s`` that ends in a state."""
    fields = {name: at.answers.bond(f"after.{name}") for name in s.law.memory(s.dim)}
    if s.law_at_points.compiled.knows_slip:
        fields[SLID] = slid_after(at.data, at.jump, at.statuses)
    return fields
