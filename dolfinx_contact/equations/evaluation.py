# SPDX-License-Identifier: LGPL-3.0-or-later
"""Evaluations of H, and the terms of contact surfaces.

Contact points have areas W, jumps j(u, q) for the displacement u and the unknowns q of a rigid
body, and tractions t = E l of the multipliers l; tau is the traction required by the law. B maps
displacements to jumps (`points.jump_operators`). A surface adds

    H_u += -B^T W t,    H_l = E^T W (t - tau(j, t; statuses)).

If it touches a rigid body (`unknowns`), it also adds

    H_q += Phi^T B^T W t,

where column k of Phi contains the displacements of the nodes for q_k = 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dolfinx_contact._arrays import Array, Codes, Mask
from dolfinx_contact._geometry import dot, tangential, transformed
from dolfinx_contact.equations.unknowns import RigidBodies
from dolfinx_contact.laws import Answers, FrozenBonds, PointData
from dolfinx_contact.laws.status import STICK
from dolfinx_contact.laws.symbols import SLID
from dolfinx_contact.points.kinematics import Kinematics
from dolfinx_contact.points.memory import Memory, slid_after
from dolfinx_contact.points.rigid_body import RigidBody
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = [
    "Evaluation",
    "RigidTerm",
    "Rows",
    "Statuses",
    "SurfaceEvaluation",
    "SurfaceTerm",
    "differs",
]

#: Status codes of the contact points of this rank, surface by surface.
Statuses = Sequence[Codes]

_NO_SLIP = 1e-9  # r times a slip, relative to the friction bound, that counts as round-off
_STEPS = 100  # largest number of steps for the friction along driven directions
_ENLARGEMENTS = 15  # largest number of enlargements of the interval that contains this friction
_SINGULAR = 1e-9  # derivative of T - e . tau below which a point sticks or is at the border
_ACCURACY = 64 * np.finfo(np.float64).eps  # of this friction, relative to the friction bound


@dataclass(frozen=True, eq=False)
class SurfaceEvaluation:
    """Evaluation of one contact surface: its n contact points on this rank.

    The *answer* tau of the law is the traction that it requires for jump j and traction t.

    Attributes:
        kinematics: gap, slip, and operator from displacements to jumps.
        traction: contact traction t on the body, a stress, shape (n, dim).
        statuses: status codes with which the law was evaluated, shape (n,).
        answers: answers tau of the law for every status.
        law_traction: traction passed to the law, shape (n, dim). It differs from ``traction`` at
            points that Dirichlet data move along a tangent (`SurfaceTerm.driven_directions`).
        driven: unit vectors of these tangents, 0 at other points, shape (n, dim); None if there are
            no such points.
    """

    kinematics: Kinematics
    traction: Array
    statuses: Codes
    answers: Answers
    law_traction: Array
    driven: Array | None = None

    @property
    def jump(self) -> Array:
        """Jump j passed to the law, shape (n, dim)."""
        return self.kinematics.jump

    @property
    def data(self) -> PointData:
        """Data with which the law is evaluated at the points, including normals and gaps."""
        return self.kinematics.data

    def complete(self, rate: Array) -> Array:
        """Return the derivative of the required traction tau, including the driven friction.

        Where Dirichlet data drive a point along a tangent e, t contains the friction T = e . tau,
        hence

            dtau = rate + p (e . rate) / (1 - e . p),    p = dtau/dt e.

        Args:
            rate: derivative of tau along the parameter at constant T, shape (n, dim, ...).
        """
        e = self.driven
        if e is None:
            return rate
        slope = transformed(self.answers.by_traction(self.statuses), e)
        rest = 1.0 - dot(e, slope)
        factor = slope / np.where(rest > _SINGULAR, rest, np.inf)[:, None]
        return np.asarray(rate + np.einsum("ni,nj,nj...->ni...", factor, e, rate))

    @cached_property
    def answer(self) -> Array:
        """Traction required by the law, shape (n, dim)."""
        return self._present(self.answers.traction(self.statuses))

    @cached_property
    def off(self) -> Array:
        """Residual of the contact law at the points, shape (n, dim). Collective.

        It is t - tau with the traction t and the required traction tau. At a slave node barely
        covered by the master, where the law has the weight c (`Operator.share`), it is c (t - tau)
        + (1 - c) (t - mean of t around the node).
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
        """Derivatives of the required traction with respect to the jump, shape (n, dim, dim)."""
        return self._present(self.complete(self.answers.by_jump(self.statuses)))

    @cached_property
    def by_traction(self) -> Array:
        """Derivatives of the required traction by the given traction, shape (n, dim, dim)."""
        return self._present(self.complete(self.answers.by_traction(self.statuses)))

    @cached_property
    def by_normal(self) -> Array:
        """Derivatives of the required traction with respect to the normal, shape (n, dim, dim).

        The jump j turns with the normal n. Laws are objective: tau(R j, R t; R n) = R tau for any
        rotation R. Hence, for the rotation vector w = n x dn of a change dn,

            dtau = w x tau - dtau/dt (w x t).
        """
        n = self.data.n
        turned = self.complete(_turning(n, self.answer))
        return np.asarray(turned - self.by_traction @ _turning(n, self.law_traction))

    def _present(self, values: Array, other: Array | float = 0.0) -> Array:
        """Return values, replaced by ``other`` at contact points without an opposing point."""
        absent = self.kinematics.operator.absent
        if absent is None:
            return values
        return np.where(absent.reshape(-1, *np.ones(values.ndim - 1, dtype=int)), other, values)

    @cached_property
    def by_around(self) -> Array:
        """Derivatives of the traction required by a nonlocal law with respect to its average.

        Shape (n, dim).
        """
        return self.answers.by_around(self.statuses)

    @property
    def spread_by(self) -> tuple[Array, Array]:
        """Derivatives of the quantity averaged by a nonlocal law with respect to jump and traction.

        Two arrays of shape (n, dim).
        """
        assert self.answers.spreading is not None
        return self.answers.spreading.by_jump, self.answers.spreading.by_traction

    def along(self, step: Array) -> Array:
        """Return the derivative of the required traction along a change of the jumps. Collective.

        Args:
            step: change of the jumps, shape (n, dim).
        """
        rate = transformed(self.by_jump, step)
        if self.answers.spreading is not None:
            around = self.answers.spreading.average(dot(self.spread_by[0], step))
            rate += self.by_around * around[:, None]
        return rate

    def change(self, v: Array) -> Array:
        """Return minus the derivative of `off` along a displacement at fixed tractions. Collective.

        Args:
            v: displacement of the owned nodes, shape (nodes, dim).

        Returns:
            Derivative at the points, shape (n, dim).
        """
        operator = self.kinematics.operator
        rate = self.along(operator.rate(v))
        turned = operator.normal_rate(v)
        if turned is not None:
            rate += transformed(self.by_normal, turned)
        return rate if operator.share is None else operator.share[:, None] * rate


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Displacements, contact points and rows of H, evaluated at one set of unknowns.

    Attributes:
        unknowns: owned unknowns, in the units of the PETSc vectors.
        u: displacement at all local dofs, including ghosts.
        q: unknowns of the rigid bodies, on every rank (`RigidBodies`).
        surfaces: evaluations of the contact surfaces.
        rows: owned rows of H by field: displacement, multipliers of each surface, rigid bodies;
            including Dirichlet rows and rows of removed multipliers.
        reactions: owned rows of the displacement before Dirichlet rows are inserted. On Dirichlet
            dofs they are the support forces.
        pushes: contact forces and moments on the rigid bodies in the units of their rows, equal on
            every rank.
    """

    unknowns: Array
    u: Array
    q: Array
    surfaces: Sequence[SurfaceEvaluation]
    rows: Sequence[Array] = ()
    reactions: Array | None = None
    pushes: Array | None = None

    @property
    def statuses(self) -> Statuses:
        """Status codes with which the laws were evaluated."""
        return [s.statuses for s in self.surfaces]


def differs(a: Statuses, b: Statuses) -> list[Mask]:
    """Return for each surface the mask of the points whose statuses differ."""
    return [np.asarray(x != y) for x, y in zip(a, b, strict=True)]


def _turning(n: Array, v: Array) -> Array:
    """Return derivatives of vectors v turning with unit normals n, shape (points, dim, dim).

    A change dn of the normal changes v by (n x dn) x v = dn (n.v) - n (dn.v).
    """
    along = dot(n, v)[:, None, None]
    return np.asarray(along * np.eye(n.shape[1]) - n[:, :, None] * v[:, None])


# -- terms -----------------------------------------------------------------------------------------


@dataclass
class Rows:
    """Sums of the terms of H on this rank.

    Attributes:
        body: owned rows of the displacement.
        laws: residuals of the law at the points of each surface (`SurfaceEvaluation.off`), shape
            (n, dim).
        pushed: contributions of this rank to the rows of the rigid bodies.
    """

    body: Array
    laws: list[Array]
    pushed: Array


@dataclass(frozen=True, eq=False)
class SurfaceTerm:
    """Term of H from one contact surface. Methods are collective unless noted otherwise.

    Attributes:
        surface: contact surface.
        number: index of the surface.
        removed: mask of the owned multipliers removed because of Dirichlet data (`constraints`),
            shape (k,).
        memory: memory of the points at the beginning of the step; None under the static law.
        strength: prescribed strength of the bonds (`Law.weakening`), shape (n,); None if the law
            determines the strength.
    """

    surface: DiscreteSurface
    number: int
    removed: Mask
    memory: Memory | None = None
    strength: Array | None = None

    # -- evaluation ------------------------------------------------------------------------------

    def evaluate(
        self, u: Array, q: Array, multipliers: Array, statuses: Codes | None
    ) -> SurfaceEvaluation:
        """Evaluate the kinematics and the law of the contact points of the surface.

        Args:
            u: displacement at all local dofs.
            q: unknowns of the rigid bodies.
            multipliers: owned values of the multipliers, in units of stress.
            statuses: statuses for the law, shape (n,); None: statuses determined by the unknowns.
        """
        at = self.kinematics(u, q)
        traction = self.surface.points.traction(np.where(self.removed, 0.0, multipliers))
        codes, answers = self._law(at, traction, statuses)
        driven = self._driven(at, answers)
        if driven is None:
            return SurfaceEvaluation(at, traction, codes, answers, traction)
        given = self._with_driven_friction(at, traction, statuses, driven, answers)
        codes, answers = self._law(at, given, statuses)
        return SurfaceEvaluation(at, traction, codes, answers, given, driven)

    def _law(
        self, at: Kinematics, traction: Array, statuses: Codes | None
    ) -> tuple[Codes, Answers]:
        """Return the statuses, and the answers of the law to a traction (`evaluate`).

        Collective for nonlocal laws only.
        """
        s = self.surface
        if self.strength is None:
            answers = s.law_at_points(at.jump, traction, at.data, statuses)
        else:
            assert s.law.weakening is not None
            fields = {**at.data.fields, s.law.weakening.name: self.strength}
            data = replace(at.data, fields=fields)
            answers = FrozenBonds(s.law_at_points(at.jump, traction, data))
        codes = answers.required if statuses is None else statuses
        absent = at.operator.absent
        if absent is not None:
            codes = np.where(absent, s.law_at_points.codes[0], codes)
        return codes, answers

    @cached_property
    def driven_directions(self) -> Array | None:
        """Tangents along which Dirichlet data fix the jump, at points that are otherwise free.

        The multiplier along such a tangent e is removed. If the data move the point along e, it
        slips, and the law determines the friction T = e . tau, where tau is the required traction.
        T is part of the traction passed to the law, since otherwise the friction perpendicular to e
        would depend on the augmentation parameter r.

        Unit vectors, 0 at other points, shape (n, dim). None without such points on this rank, for
        nonlocal laws, and if several multipliers act at a point. Not collective.
        """
        s = self.surface
        local = not s.is_weak and s.law.averaging is None
        if s.dim == 2 or not local or STICK not in s.law_at_points.codes:
            return None
        removed = self.removed.reshape(-1, s.dim)[: s.points.number]
        one = removed.sum(axis=1) == 1
        return np.where(one[:, None], removed, False).astype(float) if one.any() else None

    def _driven(self, at: Kinematics, answers: Answers) -> Array | None:
        """Return the `driven_directions` at points where they have friction, 0 at other points.

        A friction disc has friction along e only if the point slips along e. Under another law,
        slip in any direction may cause friction along e. None if there are no such points. Not
        collective.
        """
        e = self.driven_directions
        if e is None:
            return None
        r, bound = at.data.r, answers.bound
        slips = r * np.abs(dot(e, at.jump)) > _NO_SLIP * np.fmax(bound, 0.0)
        if np.isnan(bound).any():
            slip = np.linalg.norm(tangential(at.jump, at.data.n), axis=1)
            size = np.linalg.norm(answers.traction(answers.required), axis=1)
            moves = (r * slip > _NO_SLIP * size) | (answers.required != STICK)
            slips = np.where(np.isnan(bound), moves, slips) & e.any(axis=1)
        return np.where(slips[:, None], e, 0.0) if slips.any() else None

    def _largest_friction(
        self, at: Kinematics, traction: Array, e: Array, answers: Answers
    ) -> Array:
        """Return bounds on the size of the friction T along driven directions e, shape (n,).

        The bound is the radius of the friction disc. A law without a disc has some bounded set of
        tractions, so that T - e . tau changes its sign between T = 0 and a sufficiently large T of
        the sign of e . tau. The bound is then such a T, or 0 if none is found. Not collective.

        Args:
            at: kinematics of the points.
            traction: traction without T, shape (n, dim).
            e: driven directions (`driven_directions`), shape (n, dim).
            answers: answers of the law to ``traction``.
        """
        bound = answers.bound
        unknown = np.isnan(bound) & e.any(axis=1)
        if not unknown.any():
            return np.fmax(bound, 0.0)
        friction = dot(e, answers.traction(answers.required))
        sign, largest = np.sign(friction), np.abs(friction)
        for _ in range(_ENLARGEMENTS):
            codes, answers = self._law(at, traction + (sign * largest)[:, None] * e, None)
            exceeded = unknown & (sign * dot(e, answers.traction(codes)) > largest)
            if not exceeded.any():
                break
            largest = np.where(exceeded, 10.0 * largest, largest)
        else:
            largest = np.where(exceeded, 0.0, largest)
        return np.where(unknown, largest, np.fmax(bound, 0.0))

    def _with_driven_friction(
        self, at: Kinematics, traction: Array, statuses: Codes | None, e: Array, answers: Answers
    ) -> Array:
        """Return the traction with the friction T added along the driven directions e.

        T is the component along e of the required traction, a zero of the function T - e . tau. It
        is computed by Newton's method, which starts at the largest friction and converges
        monotonically for a friction disc. For other laws, a step that leaves the interval in which
        the function changes its sign is replaced by a bisection. T is NaN at points where the
        method does not converge. Not collective.

        Args:
            at: kinematics of the points.
            traction: traction without T, shape (n, dim).
            statuses: statuses for the law; None: those determined by the unknowns.
            e: driven directions (`driven_directions`), shape (n, dim).
            answers: answers of the law to ``traction``.
        """
        bound = self._largest_friction(at, traction, e, answers)
        codes = answers.required if statuses is None else statuses
        friction = dot(e, answers.traction(codes))  # at T = 0
        lower = np.where(friction >= 0, 0.0, -np.inf)
        upper = np.where(friction <= 0, 0.0, np.inf)
        disc = ~np.isnan(answers.bound)
        sign = np.where(disc, -np.sign(dot(e, at.jump)), np.sign(friction))
        T = sign * bound
        for _ in range(_STEPS):
            codes, answers = self._law(at, traction + T[:, None] * e, statuses)
            off = T - dot(e, answers.traction(codes))
            rest = 1.0 - dot(e, transformed(answers.by_traction(codes), e))
            lower, upper = np.where(off < 0, T, lower), np.where(off > 0, T, upper)
            size = _ACCURACY * np.maximum(np.abs(T), bound)
            between = ~disc & np.isfinite(lower) & np.isfinite(upper) & (upper - lower > size)
            left = ((rest > _SINGULAR) | between) & (np.abs(off) > size)
            if not left.any():
                break
            new = T - off / np.maximum(rest, _SINGULAR)
            bisects = between & ((rest <= _SINGULAR) | (new <= lower) | (new >= upper))
            new[bisects] = (lower[bisects] + upper[bisects]) / 2
            T = np.where(left, new, T)
        else:
            T = np.where(left, np.nan, T)
        return traction + T[:, None] * e

    def kinematics(self, u: Array, q: Array) -> Kinematics:
        """Return gap, slip, and operator from displacements to jumps, at the points.

        Args:
            u: displacement at the first local dofs, at least at all owned ones.
            q: unknowns of the rigid bodies.
        """
        s = self.surface
        return s.kinematics(u.reshape(-1, s.dim), self.motion(q), self.memory)

    def gaps(self, evaluation: Evaluation) -> Array:
        """Return the gaps at the points, shape (n,); not averaged if ``method="mixed"``."""
        s = self.surface
        if s.method != "mixed" or s.slides:
            return evaluation.surfaces[self.number].kinematics.gap
        nodes = self.relative(evaluation.u, evaluation.q)
        jumps = (nodes - s.opposite(nodes))[s.points.trace_nodes[: s.points.number]]
        return np.asarray(s.points.gaps - dot(jumps, s.points.data.n))

    def memory_after(self, evaluation: Evaluation) -> Memory:
        """Return the memory after a step ending in an evaluated state. Not collective."""
        s = self.surface
        contact = evaluation.surfaces[self.number]
        fields = {name: contact.answers.bond(f"after.{name}") for name in s.law.memory(s.dim)}
        if s.law_at_points.compiled.knows_slip:
            fields[SLID] = slid_after(contact.data, contact.jump, contact.statuses)
        return Memory(
            contact.kinematics.whole,
            fields,
            place=contact.kinematics.place,
            motion=contact.kinematics.motion,
            displacement=evaluation.u.reshape(-1, s.dim)[: s.owned_nodes] if s.slides else None,
        )

    # -- motion relative to the obstacle -------------------------------------------------------

    def motion(self, q: Array) -> Array | None:
        """Return the motion of the rigid body touched by the surface; None if there is none."""
        return None

    def relative(self, u: Array, q: Array) -> Array:
        """Return displacements of nodes relative to the obstacle, shape (n, dim). Not collective.

        Args:
            u: displacement at the first n local nodes, as a flat array, shape (dim n,).
            q: unknowns of the rigid bodies.
        """
        s = self.surface
        return s.partner.relative(u.reshape(-1, s.dim), self.motion(q))

    def relative_rate(self, u: Array, q: Array, du: Array, dq: Array) -> Array:
        """Return the derivative of `relative` at the owned nodes, shape (n, dim). Not collective.

        Args:
            u: displacement at the first local dofs, at least at all owned ones.
            q: unknowns of the rigid bodies.
            du: direction of the derivative with respect to ``u``.
            dq: direction of the derivative with respect to ``q``.
        """
        s = self.surface
        at, step = (v.reshape(-1, s.dim)[: s.owned_nodes] for v in (u, du))
        return s.partner.relative_rate(at, self.motion(q), step, self.motion(dq))

    # -- rows ------------------------------------------------------------------------------------

    def add_forces(self, evaluation: Evaluation, rows: Rows) -> Array:
        """Subtract the nodal contact forces from the rows of H, and return these forces."""
        contact = evaluation.surfaces[self.number]
        forces = contact.kinematics.operator.transpose(contact.traction)
        rows.body -= forces
        return forces

    def add_rate(self, evaluation: Evaluation, du: Array, dq: Array, rows: Rows) -> None:
        """Add to rows of H the derivative of this term along a motion.

        Tractions and statuses are fixed. Rows of rigid bodies are not changed.

        Args:
            evaluation: evaluation with the tractions and statuses.
            du: increment of the displacement at all local dofs.
            dq: increment of the unknowns of the rigid bodies.
            rows: rows to which the derivative is added.
        """
        contact = evaluation.surfaces[self.number]
        step = self.relative_rate(evaluation.u, evaluation.q, du, dq)
        rows.body -= contact.kinematics.operator.transpose_rate(contact.traction, step)
        rows.laws[self.number] = rows.laws[self.number] - contact.change(step)


@dataclass(frozen=True, eq=False)
class RigidTerm(SurfaceTerm):
    """Term of a surface touching a rigid body. Methods are collective unless noted otherwise.

    It also adds the contact force and moment to the rows of the rigid bodies.

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
        """Index range of the motion of the rigid body among the unknowns of all rigid bodies."""
        return self.bodies.slices[self.body]

    def motion(self, q: Array) -> Array:
        return self.bodies.of_body(q, self.body)

    def motions_at_points(self) -> Array:
        """Return displacements of the points per unknown of the rigid body, shape (n, dim, k)."""
        s = self.surface
        operator = s.constant_operator("a rigid body that moves")
        x = s.node_positions[: s.owned_nodes]
        units = np.diag(1.0 / self.bodies.units[self.motion_slice])
        fields = [operator.apply(self.body.kinematics.field(x, unit)) for unit in units]
        return np.stack(fields, axis=2)

    def pushes(self, forces: Array, u: Array, q: Array) -> Array:
        """Return the contribution of this rank to contact forces and moments on rigid bodies.

        On a curved obstacle in large sliding, moments are taken in the displaced position. Not
        collective.

        Args:
            forces: contact forces on the owned nodes, shape (dim n,).
            u: displacement at the first local dofs, at least at all owned ones.
            q: unknowns of the rigid bodies.
        """
        s = self.surface
        x = s.node_positions[: s.owned_nodes]
        moved = None
        if s.displaced is not None:
            x = x + u.reshape(-1, s.dim)[: s.owned_nodes]
            moved = self.motion(q)[: s.dim]
        resultant = self.body.kinematics.resultant(x, forces.reshape(-1, s.dim), moved)
        rows = np.zeros(self.bodies.size)
        rows[self.motion_slice] = resultant / self.bodies.units[self.motion_slice]
        if s.axisymmetric:  # other components cancel around the axis
            rows[self.motion_slice][[0, 2]] = 0.0
        return rows

    def add_forces(self, evaluation: Evaluation, rows: Rows) -> Array:
        forces = super().add_forces(evaluation, rows)
        rows.pushed += self.pushes(forces, evaluation.u, evaluation.q)
        return forces

    def add_rate(self, evaluation: Evaluation, du: Array, dq: Array, rows: Rows) -> None:
        """See `SurfaceTerm.add_rate`.

        Jump and normal turn with the rigid body. Laws are objective, so a rotation w changes the
        required traction tau by w x tau - dtau/dt (w x t), with the traction t.
        """
        super().add_rate(evaluation, du, dq, rows)
        if not self.surface.partner.turns:
            return
        contact, rigid = evaluation.surfaces[self.number], self.body.kinematics
        turning = rigid.spin(self.motion(evaluation.q)) @ self.motion(dq)[self.surface.dim :]
        turned = rigid.crossed(turning, contact.law_traction)
        back = transformed(contact.by_traction, turned)
        along = contact.complete(rigid.crossed(turning, contact.answer))
        rows.laws[self.number] = rows.laws[self.number] - along + back
