# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The terms of contact surfaces and rigid bodies in H, and the values found by one evaluation.

Contact points have areas W, jumps j(u, q) and tractions t = E l of the multipliers l; the law
answers tau. B maps displacements to jumps (`points.jump_operators`). A surface adds

    H_u += -B^T W t,    H_l = E^T W (t - tau(j, t; statuses)),

Unknowns q of rigid bodies are displacements, and rotations times a length, the largest distance of
a contact point from the reference point. All unknowns are thus lengths and all rows forces. Rank 0
owns them, after its other unknowns. With the forces f = B^T W t of the surfaces touching a body,

    H_q = Phi^T f - F    where q is free,    H_q = k (q - q_prescribed)    elsewhere,

where column k of Phi is the motion of the nodes for a unit of the unknown k.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate, pairwise
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._arrays import Array, Codes, Mask
from dolfinx_contact._mpi import maximum, require
from dolfinx_contact.laws import Answers, HeldAnswers, PointData
from dolfinx_contact.laws.symbols import SLID
from dolfinx_contact.points.kinematics import Kinematics
from dolfinx_contact.points.memory import Memory, slid_after
from dolfinx_contact.points.rigid_body import RigidBody
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = [
    "ContactState",
    "Evaluation",
    "RigidBodies",
    "RigidTerm",
    "Rows",
    "Statuses",
    "SurfaceTerm",
    "differs",
]

#: Status codes of the contact points of this rank, surface by surface.
Statuses = Sequence[Codes]
T = TypeVar("T", bound=np.generic)


@dataclass(frozen=True, eq=False)
class ContactState:
    """Evaluation of one contact surface: its n contact points on this rank.

    The *answer* tau of the law is the traction that it requires for jump j and traction t.

    Attributes:
        kinematics: gap, slip and operator B.
        traction: contact traction t on the body, a stress, shape (n, dim).
        statuses: status codes with which the law was evaluated, shape (n,).
        answers: answers of the law for every status.
    """

    kinematics: Kinematics
    traction: Array
    statuses: Codes
    answers: Answers

    @property
    def jump(self) -> Array:
        """Jump j in the law, after subtracting the memory of the slip, shape (n, dim)."""
        return self.kinematics.jump

    @property
    def data(self) -> PointData:
        """Data of the law at the points, including normals and gaps."""
        return self.kinematics.data

    @cached_property
    def answer(self) -> Array:
        """Traction tau required by the law, shape (n, dim)."""
        return self._present(self.answers.traction(self.statuses))

    @cached_property
    def off(self) -> Array:
        """Residual of the tractions, shape (n, dim). Collective.

        It is t - tau. At a barely covered slave node, where the law has the weight c
        (`Operator.share`), it is c (t - tau) + (1 - c) (t - mean of t around the node).
        """
        operator = self.kinematics.operator
        off = self.traction - self.answer
        if operator.share is None:
            return off
        share = operator.share[:, None]
        rest = self.traction - operator.mean_around(self.traction)
        return self._present(share * off + (1.0 - share) * rest, self.traction)

    @cached_property
    def by_jump(self) -> Array:
        """Derivatives of the answer with respect to the jump, shape (n, dim, dim)."""
        return self._present(self.answers.by_jump(self.statuses))

    @cached_property
    def by_traction(self) -> Array:
        """Derivatives of the answer with respect to the traction, shape (n, dim, dim)."""
        return self._present(self.answers.by_traction(self.statuses))

    @cached_property
    def by_normal(self) -> Array:
        """Derivatives of the answer with respect to the normal, if the jump turns with it.

        Shape (n, dim, dim). Laws are objective, tau(R j, R t; R n) = R tau. Hence for the rotation
        vector w = n x dn of a change dn of the normal

            dtau = w x tau - dtau/dt (w x t).
        """
        n = self.data.n
        turned = _turning(n, self.answer) - self.by_traction @ _turning(n, self.traction)
        return np.asarray(turned)

    def _present(self, values: Array, other: Array | float = 0.0) -> Array:
        """Values, replaced by ``other`` at points without an opposing point."""
        absent = self.kinematics.operator.absent
        if absent is None:
            return values
        return np.where(absent.reshape(-1, *np.ones(values.ndim - 1, dtype=int)), other, values)

    @cached_property
    def by_around(self) -> Array:
        """Derivatives of the answer of a nonlocal law with respect to its averaged quantity.

        Shape (n, dim).
        """
        return self.answers.by_around(self.statuses)

    @property
    def spread_by(self) -> tuple[Array, Array]:
        """Derivatives of the averaged quantity with respect to jump and traction, (n, dim) each."""
        assert self.answers.spreading is not None
        return self.answers.spreading.by_jump, self.answers.spreading.by_traction

    def along(self, step: Array) -> Array:
        """Derivative of the answer along a step of the jumps, shape (n, dim). Collective."""
        rate = np.einsum("nij,nj->ni", self.by_jump, step)
        if self.answers.spreading is not None:
            around = self.answers.spreading.average(np.sum(self.spread_by[0] * step, axis=1))
            rate += self.by_around * around[:, None]
        return rate

    def change(self, v: Array) -> Array:
        """Derivative of -`off` along a displacement v, shape (nodes, dim). Collective."""
        operator = self.kinematics.operator
        rate = self.along(operator.rate(v))
        turned = operator.normal_rate(v)
        if turned is not None:
            rate += np.einsum("nij,nj->ni", self.by_normal, turned)
        return rate if operator.share is None else operator.share[:, None] * rate


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Body, contact points and rows of H at one set of unknowns.

    Attributes:
        unknowns: owned unknowns, in the units of the PETSc vectors.
        u: displacement at all local dofs, including ghosts, a length.
        q: unknowns of the rigid bodies, on every rank (`RigidBodies`).
        surfaces: evaluations of the contact surfaces.
        rows: owned rows of H: displacement, surface by surface, rigid bodies; including Dirichlet
            rows and rows of removed multipliers.
        reactions: owned rows of the displacement before Dirichlet rows are inserted, i.e. support
            forces on Dirichlet dofs.
        pushes: contact forces on the rigid bodies, in the units of their rows, on every rank.
    """

    unknowns: Array
    u: Array
    q: Array
    surfaces: Sequence[ContactState]
    rows: Sequence[Array] = ()
    reactions: Array | None = None
    pushes: Array | None = None

    @property
    def statuses(self) -> Statuses:
        """Status codes with which the laws were evaluated."""
        return [s.statuses for s in self.surfaces]


def differs(a: Statuses, b: Statuses) -> list[Mask]:
    """Return masks of the points whose statuses differ, surface by surface."""
    return [np.asarray(x != y) for x, y in zip(a, b, strict=True)]


def _turning(n: Array, v: Array) -> Array:
    """Return the matrices of dn -> (n x dn) x v = dn (n.v) - n (dn.v), shape (n, dim, dim)."""
    along = np.sum(n * v, axis=1)[:, None, None]
    return np.asarray(along * np.eye(n.shape[1]) - n[:, :, None] * v[:, None])


# -- rigid bodies ----------------------------------------------------------------------------------


class RigidBodies:
    """Rigid bodies that surfaces touch. Their values are the same on every rank.

    Args:
        V: space of the displacement.
        surfaces: discretisations of the contact surfaces.
        body_size: size of the deformable bodies, a length for bodies without another one.

    Attributes:
        bodies: rigid bodies, in the order of the surfaces.
        slices: places of the unknowns of each body.
        size: number of unknowns.
        owned: number of unknowns on this rank.
        fixed: mask of the prescribed unknowns, shape (size,).
        units: ratios of unknowns to displacements and rotations, shape (size,).
        numbers: loads and motions prescribed by the user, as read by `read_data`, shape (size,).
        loads: loads F among them, in the units of their rows, 0 where the motion is prescribed.

    Raises:
        ValueError: on every rank, if two bodies have one name.
    """

    def __init__(self, V: fem.FunctionSpace, surfaces: Sequence[DiscreteSurface], body_size: float):
        self.comm = V.mesh.comm
        self.surfaces = list(surfaces)
        touched = [s.rigid_body for s in surfaces if s.rigid_body is not None]
        self.bodies = list(dict.fromkeys(touched))
        names = [b.name for b in self.bodies]
        unique = len(set(names)) == len(names)
        require(self.comm, unique, f"rigid bodies need different names, got {names}")
        ends = list(accumulate((len(b.components) for b in self.bodies), initial=0))
        self.slices = {b: slice(*c) for b, c in zip(self.bodies, pairwise(ends), strict=True)}
        self.size = ends[-1]
        self.owned = self.size if self.comm.rank == 0 else 0
        none = np.zeros(0, dtype=bool)
        self.fixed = np.concatenate([none, *(b.fixed for b in self.bodies)])
        self.units = np.ones(self.size)
        for b, part in self.slices.items():
            self.units[part][b.dim :] = self._reach(b) or body_size
        self.read_data()

    def _reach(self, body: RigidBody) -> float:
        """Return the largest distance of a contact point from the reference point. Collective."""
        touching = [s.positions for s in self.surfaces if s.rigid_body is body]
        return maximum(self.comm, np.linalg.norm(np.concatenate(touching) - body.about, axis=1))

    # -- values ----------------------------------------------------------------------------------

    @property
    def given(self) -> Array:
        """Unknowns of the present motions of the bodies."""
        return self.units * np.concatenate([np.zeros(0), *(b.values for b in self.bodies)])

    def show(self, q: Array) -> None:
        """Copy unknowns into the motions of the bodies."""
        for b, part in self.slices.items():
            b.values = (q / self.units)[part].copy()

    def everywhere(self, mine: Array) -> Array:
        """Return the unknowns on every rank from the owned ones. Collective."""
        if not self.size:
            return np.zeros(0)
        return np.asarray(self.comm.bcast(np.array(mine) if self.owned else None))

    def here(self, values: npt.NDArray[T]) -> npt.NDArray[T]:
        """Return the entries of this rank."""
        return values[: self.owned]

    def of_body(self, q: Array, body: RigidBody) -> Array:
        """Return displacement and rotation of a body."""
        return np.asarray((q / self.units)[self.slices[body]])

    def forces_of_body(self, rows: Array, body: RigidBody) -> Array:
        """Return force and moment on a body from rows."""
        return np.asarray((rows * self.units)[self.slices[body]])

    def conjugate(self, q: Array, pushes: Array) -> Array:
        """Return forces conjugate to the unknowns from forces and moments in their rows."""
        found = pushes.copy()
        for b, part in self.slices.items():
            if any(s.partner.turns and s.rigid_body is b for s in self.surfaces):
                found[part][b.dim :] = (
                    b.kinematics.spin(self.of_body(q, b)).T @ pushes[part][b.dim :]
                )
        return found

    # -- data ------------------------------------------------------------------------------------

    def read_data(self) -> None:
        """Read the present loads and motions of the user."""
        self.numbers = np.concatenate([np.zeros(0), *(b.numbers() for b in self.bodies)])
        self.loads = np.where(self.fixed, 0.0, self.numbers / self.units)

    def names(self, motions: Array) -> str:
        """Return the names of the components that take part in motions (k, size)."""
        size = np.abs(motions).max(axis=0, initial=0.0)
        words = [
            f"{'translation' if len(c) == 1 else 'rotation about'} {c[-1]} of {b.name}"
            for b in self.bodies
            for c in b.components
        ]
        return ", ".join(w for w, v in zip(words, size, strict=True) if v > 1e-6)


# -- terms -----------------------------------------------------------------------------------------


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
    """Term of one contact surface. Methods are collective unless noted otherwise.

    Attributes:
        surface: contact surface.
        number: number of the surface.
        removed: mask of the owned multipliers that Dirichlet data remove (`constraints`), (k,).
        memory: memory of the points at the beginning of the step; None under the static law.
        strength: prescribed strength of the bonds (`Law.weakening`), shape (n,); None: the law
            determines it.
    """

    surface: DiscreteSurface
    number: int
    removed: Mask
    memory: Memory | None = None
    strength: Array | None = None

    # -- evaluation ------------------------------------------------------------------------------

    def evaluate(
        self, u: Array, q: Array, multipliers: Array, statuses: Codes | None
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
        if self.strength is None:
            answers = s.law_at_points(at.jump, traction, at.data, statuses)
        else:
            assert s.law.weakening is not None
            fields = {**at.data.fields, s.law.weakening.name: self.strength}
            data = replace(at.data, fields=fields)
            answers = HeldAnswers(s.law_at_points(at.jump, traction, data))
        codes = answers.required if statuses is None else statuses
        absent = at.operator.absent
        if absent is not None:
            codes = np.where(absent, s.law_at_points.codes[0], codes)
        return ContactState(at, traction, codes, answers)

    def kinematics(self, u: Array, q: Array) -> Kinematics:
        """Return gap, slip and B at a displacement and unknowns of the rigid bodies."""
        s = self.surface
        return s.kinematics(u.reshape(-1, s.dim), self.motion(q), self.memory)

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
        fields = {name: found.answers.bond(f"after.{name}") for name in s.law.memory(s.dim)}
        if s.law_at_points.compiled.knows_slip:
            fields[SLID] = slid_after(found.data, found.jump, found.statuses)
        return Memory(
            found.kinematics.whole,
            fields,
            place=found.kinematics.place,
            motion=found.kinematics.motion,
            displacement=at.u.reshape(-1, s.dim)[: s.owned_nodes] if s.slides else None,
        )

    # -- motion relative to the obstacle, overridden by `RigidTerm` ----------------------------

    def motion(self, q: Array) -> Array | None:
        """Return the motion of the rigid body of the surface; None without one."""
        return None

    def relative(self, u: Array, q: Array) -> Array:
        """Return displacements of nodes relative to the obstacle, shape (n, dim). Not collective.

        Args:
            u: displacement at the first local dofs, shape (dim n,).
            q: unknowns of the rigid bodies.
        """
        return u.reshape(-1, self.surface.dim)

    def relative_rate(self, u: Array, q: Array, du: Array, dq: Array) -> Array:
        """Return the derivative of `relative` at the owned nodes, shape (n, dim). Not collective.

        Args:
            u: displacement at the first local dofs, at least at all owned ones.
            q: unknowns of the rigid bodies.
            du: increment of ``u``.
            dq: increment of ``q``.
        """
        return du.reshape(-1, self.surface.dim)[: self.surface.owned_nodes]

    # -- rows ------------------------------------------------------------------------------------

    def add_forces(self, at: Evaluation, rows: Rows) -> Array:
        """Subtract the contact forces at a state from rows, and return them."""
        found = at.surfaces[self.number]
        forces = found.kinematics.operator.transpose(found.traction)
        rows.body -= forces
        return forces

    def add_rate(self, at: Evaluation, du: Array, dq: Array, rows: Rows) -> None:
        """Add to rows the derivative of the term along a motion, at fixed tractions and statuses.

        Rows of rigid bodies are not changed.

        Args:
            at: state.
            du: increment of the displacement at all local dofs.
            dq: increment of the unknowns of the rigid bodies.
            rows: rows that are changed.
        """
        found = at.surfaces[self.number]
        step = self.relative_rate(at.u, at.q, du, dq)
        rows.body -= found.kinematics.operator.transpose_rate(found.traction, step)
        rows.laws[self.number] = rows.laws[self.number] - found.change(step)


@dataclass(frozen=True, eq=False)
class RigidTerm(SurfaceTerm):
    """Term of a surface that touches a rigid body. Methods are collective unless noted otherwise.

    It also adds the forces on the rigid body, H_q += Phi^T B^T W t.

    Attributes:
        bodies: rigid bodies of the problem.
    """

    bodies: RigidBodies = field(kw_only=True)

    @cached_property
    def body(self) -> RigidBody:
        """Rigid body that the surface touches."""
        assert self.surface.rigid_body is not None
        return self.surface.rigid_body

    @cached_property
    def motion_slice(self) -> slice:
        """Places of the motion of the rigid body among the unknowns q."""
        return self.bodies.slices[self.body]

    def motion(self, q: Array) -> Array:
        return self.bodies.of_body(q, self.body)

    def relative(self, u: Array, q: Array) -> Array:
        return self.surface.partner.relative(super().relative(u, q), self.motion(q))

    def relative_rate(self, u: Array, q: Array, du: Array, dq: Array) -> Array:
        s = self.surface
        at, step = (v.reshape(-1, s.dim)[: s.owned_nodes] for v in (u, du))
        return s.partner.relative_rate(at, self.motion(q), step, self.motion(dq))

    def motions_at_points(self) -> Array:
        """Return B Phi, motions of the points by unknown of the body, shape (n, dim, k)."""
        s = self.surface
        operator = s.constant_operator("a rigid body that moves")
        x = s.node_positions[: s.owned_nodes]
        units = np.diag(1.0 / self.bodies.units[self.motion_slice])
        fields = [operator.apply(self.body.kinematics.field(x, unit)) for unit in units]
        return np.stack(fields, axis=2)

    def pushes(self, forces: Array, u: Array, q: Array) -> Array:
        """Return this rank's part of Phi^T f, the forces on rigid bodies. Not collective.

        On a curved obstacle in large sliding, moments are taken in the displaced position.

        Args:
            forces: contact forces f on the owned nodes, shape (dim n,).
            u: displacement at the first local dofs, at least at all owned ones.
            q: unknowns of the rigid bodies.
        """
        s = self.surface
        x = s.node_positions[: s.owned_nodes]
        moved = None
        if s.displaced is not None:
            x = x + u.reshape(-1, s.dim)[: s.owned_nodes]
            moved = self.motion(q)[: s.dim]
        found = self.body.kinematics.resultant(x, forces.reshape(-1, s.dim), moved)
        rows = np.zeros(self.bodies.size)
        rows[self.motion_slice] = found / self.bodies.units[self.motion_slice]
        if s.axisymmetric:  # other components cancel around the axis
            rows[self.motion_slice][[0, 2]] = 0.0
        return rows

    def add_forces(self, at: Evaluation, rows: Rows) -> Array:
        forces = super().add_forces(at, rows)
        rows.pushed += self.pushes(forces, at.u, at.q)
        return forces

    def add_rate(self, at: Evaluation, du: Array, dq: Array, rows: Rows) -> None:
        """See `SurfaceTerm.add_rate`.

        Jump and normal turn with the frame of the body. Laws are objective, so a rotation w adds
        w x tau - dtau/dt (w x t).
        """
        super().add_rate(at, du, dq, rows)
        if not self.surface.partner.turns:
            return
        found, rigid = at.surfaces[self.number], self.body.kinematics
        turning = rigid.spin(self.motion(at.q)) @ self.motion(dq)[self.surface.dim :]
        turned = rigid.crossed(turning, found.traction)
        back = np.einsum("nij,nj->ni", found.by_traction, turned)
        rows.laws[self.number] = (
            rows.laws[self.number] - rigid.crossed(turning, found.answer) + back
        )
