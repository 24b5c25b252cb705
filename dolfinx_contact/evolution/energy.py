# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Energy balances of a step at rest and of a step in motion.

**At rest.** In a step from n to n+1, with dead loads f, reactions S of Dirichlet data, forces P on
rigid bodies, contact pressures p and shear tractions t over areas W, gap u_N, jump j and normal n,

    external    (f_n + f_n+1)/2 . du + (S_n + S_n+1)/2 . du - (P_n + P_n+1)/2 . dq
                - sum W (p_n + p_n+1)/2 (d u_N + (n_n + n_n+1)/2 . dj)
    dissipated  - sum W t_n+1 . (increment of the jump along the surface), without adhesion
    damage      energy spent by breaking bonds (`laws.Bond.spent`)
    stored      energy of the body without the potential of its loads, energy of bonds, and of
                compliant surfaces sum W (p_n + p_n+1)/2 . (increment of the penetration)

The sum in the external work is the work of moving obstacles: the change of the gap at fixed points.
It is omitted for obstacles of facets, because at a rim the gap of a leaving point decreases by less
than the displacement of the point.

The residue is external - stored - dissipated - damage, all since the start. In a step it is of
second order, because friction is evaluated at the end of the step, and contact may open or close
within it. Therefore the residue of a run decreases linearly with the step length if friction
changes smoothly. A residue that does not decrease indicates a jump of the state, whose energy goes
into motion.

Loads are defined by the rows of the undeformed body, R(0) = -f. In a body with initial stress, or
with follower loads, the remainder counts as stored energy. If a problem is given by a residual, the
stored energy is integrated from the forces by the trapezoidal rule, which is exact for a linear
body.

**In motion.** Consider a step of length h from state 0 to state 1, with mass M, damping C, and the
weight theta of the forces at the end. Let v = (v_0 + v_1)/2 be the mean velocity, B the operator of
relative velocities at the contact points, f the loads, S the mean forces of supports, t the mean
contact tractions over areas W, t' the tractions without adhesion, and v_o the velocity of the
obstacle. Stored energy and damage are as above, and

    kinetic     v_1^T M v_1 / 2 - v_0^T M v_0 / 2
    external    ((f_0 + f_1)/2 + S) . (u_1 - u_0) + h sum W t . v_o
    damping     h v^T C (theta v_1 + (1 - theta) v_0)
    contact     - h sum W t'_n . (B v - v_o)_n      impulse times mean velocity (Moreau 1988), for
                                                    surfaces that are not compliant
    dissipated  - h sum W t'_t . (B v - v_o)_t      friction

The residue is the external work minus all other terms. With theta = 1/2 it is zero for a linear
body without adhesion and compliance, and of second order in h otherwise. With other schemes it is
the energy dissipated or produced by the scheme.
"""

from __future__ import annotations

from dataclasses import asdict, astuple, dataclass, replace

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._mpi import total
from dolfinx_contact._petsc import product
from dolfinx_contact.body.moving import MovingBody
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation, SurfaceEvaluation
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["Energies", "Forces", "Motion", "MotionEnergies", "account", "forces_at", "motion_at"]


_ROUND_OFF = 1e-9  # smallest scale of the energies of a step, relative to all energies


@dataclass(frozen=True)
class Energies:
    """Energies since the start of an evolution.

    Attributes:
        external: work of loads, supports, rigid bodies and obstacles.
        stored: increase of the energy of the body, of bonds and of compliant surfaces.
        dissipated: frictional dissipation.
        damage: energy dissipated by breaking bonds.
    """

    external: float = 0.0
    stored: float = 0.0
    dissipated: float = 0.0
    damage: float = 0.0

    @property
    def residue(self) -> float:
        """External work minus stored energy, dissipation and damage; 0 in an exact balance."""
        return self.external - self.stored - self.dissipated - self.damage

    def residue_since(self, before: Energies) -> float:
        """Return the residue of the last step relative to the energies of the step.

        The residue is divided by the sum of the magnitudes of external work, stored energy,
        dissipation and damage in the step.

        Args:
            before: energies at the start of the step.
        """
        parts = ("external", "stored", "dissipated", "damage")
        turned = sum(abs(getattr(self, k) - getattr(before, k)) for k in parts)
        scale = max(turned, _ROUND_OFF * sum(abs(getattr(self, k)) for k in parts))
        return (self.residue - before.residue) / scale if scale > 0 else 0.0

    def row(self) -> dict[str, float]:
        """Return the energies and the residue by name, for a row of the table of steps."""
        return asdict(self) | {"residue": self.residue}

    def advanced(self, before: Forces, after: Forces, dissipated: float) -> Energies:
        """Return the energies after a quasi-static step. Collective.

        Args:
            before: forces at the start of the step.
            after: forces at its end.
            dissipated: frictional dissipation in the step.
        """
        du = after.u - before.u
        outer = np.dot(before.outer + after.outer, du) / 2
        inner = np.dot(before.inner + after.inner, du) / 2
        pressed = spent = 0.0
        for p, q in zip(before.surfaces, after.surfaces, strict=True):
            if not p.at_rest:
                moved = np.sum((p.n + q.n) / 2 * (q.jump - p.jump), axis=1)
                outer -= np.dot((p.force + q.force) / 2, q.un - p.un + moved)
            pressed += q.stored_since(p)
            spent += float(np.sum(q.spent))
        sums = total(after.equations.comm, [outer, inner, pressed, spent])
        outer, inner, pressed, spent = map(float, sums)
        outer -= float(np.dot(before.pushes + after.pushes, after.q - before.q)) / 2
        if before.energy is not None and after.energy is not None:
            inner = after.energy - before.energy
        return Energies(
            self.external + outer,
            self.stored + inner + pressed,
            self.dissipated + dissipated,
            self.damage + spent,
        )


@dataclass(frozen=True)
class MotionEnergies(Energies):
    """Energies of a body in motion; all except the kinetic energy accumulate since the start.

    Attributes:
        kinetic: present kinetic energy.
        at_start: kinetic energy at the start of the evolution.
        damping: dissipation by the damping of the body.
        contact: energy lost in impacts; negative if they add energy.
    """

    kinetic: float = 0.0
    at_start: float = 0.0
    damping: float = 0.0
    contact: float = 0.0

    @property
    def residue(self) -> float:
        """External work minus all other energies, including the growth of the kinetic energy."""
        growth = self.kinetic - self.at_start
        return super().residue - growth - self.damping - self.contact


@dataclass(frozen=True, eq=False)
class SurfaceForces:
    """Forces, gaps and energies at the contact points of a surface, for the energy balance.

    On a rotating rigid body, normals and jumps refer to its frame.

    Attributes:
        force: normal forces at the n points, positive in compression, shape (n,).
        un: gaps, shape (n,).
        n: unit normals, shape (n, dim).
        jump: total jumps of the displacement, shape (n, dim).
        springs: normal forces of a compliant surface without adhesion, otherwise 0, shape (n,).
        bonds: energies stored in bonds, shape (n,).
        spent: energies dissipated by bonds in the step, shape (n,).
        at_rest: True if the work of the obstacle is not computed, as for sliding pairs of bodies
            and for obstacles of facets.
        obstacle: gaps between the undeformed body and the obstacle, shape (n,).
    """

    force: Array
    un: Array
    n: Array
    jump: Array
    springs: Array
    bonds: Array
    spent: Array
    at_rest: bool
    obstacle: Array

    def stored_since(self, before: SurfaceForces) -> float:
        """Return the increase of the energy of bonds and compliant surfaces on this rank."""
        bonds = float(np.sum(self.bonds - before.bonds))
        return bonds - float(np.dot((before.springs + self.springs) / 2, self.un - before.un))


@dataclass(frozen=True, eq=False)
class Forces:
    """All forces at a state and the displacements along which they do work.

    Attributes:
        equations: equations of the contact problem.
        u: displacement, owned values.
        q: unknowns of the rigid bodies.
        outer: forces of loads and supports on the body, owned values.
        inner: internal forces of the body, owned values.
        pushes: generalised contact forces on the rigid bodies, conjugate to q.
        energy: energy of the body without the potential of its loads; None if it is unknown.
        surfaces: forces, gaps and energies at the contact points of each surface.
        covered: for each owned displacement dof, the fraction of the area of its contact point that
            lies opposite the master surface; 1 for dofs without a contact point. None without
            sliding surfaces.
    """

    equations: ContactEquations
    u: Array
    q: Array
    outer: Array
    inner: Array
    pushes: Array
    energy: float | None
    surfaces: tuple[SurfaceForces, ...]
    covered: Array | None


@dataclass(frozen=True, eq=False)
class Motion:
    """Displacement and velocity at one time, with the forces and energies required by a step.

    Attributes:
        u: displacement, owned and ghost values.
        v: velocity, owned and ghost values.
        rows: residual R(u) and damping forces C v of the body, their sum R(u) + C v, owned values.
        load: loads, the negative residual -R(0) of the undeformed body, owned values.
        inner: energy of the body without the potential of its loads; None if the body is defined by
            a residual form.
        kinetic: kinetic energy.
        surfaces: forces, gaps and energies at the contact points of each surface.
    """

    u: Array
    v: Array
    rows: Array
    load: Array
    inner: float | None
    kinetic: float
    surfaces: tuple[SurfaceForces, ...]


# -- at rest --------------------------------------------------------------------------------------


def forces_at(eq: ContactEquations, evaluation: Evaluation) -> Forces:
    """Return the forces of the energy balance at a state with known reactions. Collective."""
    assert evaluation.reactions is not None
    assert evaluation.pushes is not None
    n = eq.owned_sizes[0]
    u = evaluation.u[:n].copy()
    rows = eq.bulk.rows(evaluation.u)
    load = -eq.bulk.rows(np.zeros_like(evaluation.u))
    energy = eq.bulk.energy_at(evaluation.u)
    if energy is not None:
        energy += float(eq.comm.allreduce(float(np.dot(load, u))))
    surfaces = []
    covered = [np.ones(m) for m in eq.owned_sizes]
    for i, (s, contact) in enumerate(zip(eq.surfaces, evaluation.surfaces, strict=True)):
        surfaces.append(_at_surface(s, contact))
        if s.slides:
            covered[i + 1] = np.repeat(_covered(s, contact), s.dim)
    return Forces(
        eq,
        u,
        evaluation.q.copy(),
        load + np.where(eq.fixed[:n], evaluation.reactions, 0.0),
        rows + load,
        eq.rigid.conjugate(evaluation.q, evaluation.pushes),
        energy,
        tuple(surfaces),
        np.concatenate(covered) if any(s.slides for s in eq.surfaces) else None,
    )


def _at_surface(s: DiscreteSurface, contact: SurfaceEvaluation) -> SurfaceForces:
    """Return the forces, gaps and energies at the points of a surface. Not collective."""
    n = contact.data.n
    areas = contact.kinematics.operator.areas
    force = -areas * np.sum(contact.traction * n, axis=1)
    springs = stored = spent = np.zeros_like(force)
    bonded = s.law_at_points.compiled.bonded
    if bonded:
        stored, spent = (areas * contact.answers.bond(name) for name in ("stored", "spent"))
    if s.law.compliant:
        springs = force
        if bonded:
            springs = force + areas * np.sum(contact.answers.bond("traction") * n, axis=1)
    jump, normal = contact.kinematics.path
    if s.slides:
        # without an opposing point there is no relative motion
        jump = _covered(s, contact)[:, None] * jump
    return SurfaceForces(
        force,
        contact.kinematics.gap,
        normal.copy(),
        jump,
        springs,
        stored,
        spent,
        at_rest=s.slides or s.obstacle.outline is not None,
        obstacle=s.points.data.gap.copy(),
    )


def _covered(s: DiscreteSurface, contact: SurfaceEvaluation) -> Array:
    """Return the fraction of the area of each contact point opposite the master, shape (n,)."""
    return np.minimum(contact.kinematics.operator.areas / s.points.areas, 1.0)


# -- in motion ------------------------------------------------------------------------------------


def motion_at(eq: ContactEquations, evaluation: Evaluation, u: Array, v: Array) -> Motion:
    """Return displacement, velocity, forces and energies at one time of a motion. Collective.

    Args:
        eq: equations with the data at this time.
        evaluation: evaluation of the contact at this time.
        u: displacement, owned and ghost values.
        v: velocity, owned and ghost values.
    """
    body = eq.bulk
    assert isinstance(body, MovingBody)
    n = eq.owned_sizes[0]
    load = body.load()
    inner = body.body.energy_at(u)
    products = np.array([load @ u[:n], 0.5 * v[:n] @ product(body.mass, v)])
    potential, kinetic = eq.comm.allreduce(products).tolist()
    surfaces = tuple(map(_at_surface, eq.surfaces, evaluation.surfaces))
    inner = None if inner is None else inner + potential
    return Motion(u, v, body.forces(u, v), load, inner, kinetic, surfaces)


def account(
    energies: MotionEnergies,
    eq: ContactEquations,
    end: Evaluation,
    a: Motion,
    b: Motion,
    dq: Array,
) -> MotionEnergies:
    """Return the energies of a motion after a step. Collective.

    Args:
        energies: energies before the step.
        eq: equations of the step.
        end: evaluation of the solution of the step, with reactions.
        a: motion before the step.
        b: motion after the step.
        dq: increment of the unknowns of the rigid bodies.
    """
    body = eq.bulk
    assert isinstance(body, MovingBody)
    assert end.reactions is not None
    step = body.step
    n = eq.owned_sizes[0]
    v = (a.v + b.v) / 2
    du = (b.u - a.u)[:n]
    # the body: work of loads and supports, damping, stored energy
    support = np.where(eq.fixed[:n], end.reactions, 0.0)
    external = float(((a.load + b.load) / 2 + support) @ du)
    damping = stored = 0.0
    if body.damping is not None:
        mean = step.theta * b.v + (1 - step.theta) * a.v
        damping = step.length * float(v[:n] @ product(body.damping, mean))
    if a.inner is None or b.inner is None:
        # the trapezoidal rule of the internal forces, exact for a linear body
        stored = float((a.rows + a.load + b.rows + b.load) / 2 @ du) - damping
    parts = [MotionEnergies(external=external, stored=stored, damping=damping)]
    # the surfaces
    parts += [_of_surface(eq, i, end, a, b, step.length * v, dq) for i in range(len(eq.surfaces))]
    increments = eq.comm.allreduce(np.sum([astuple(part) for part in parts], axis=0))
    after = MotionEnergies(*(np.array(astuple(energies)) + increments).tolist())
    if a.inner is not None and b.inner is not None:
        after = replace(after, stored=after.stored + b.inner - a.inner)
    return replace(after, kinetic=b.kinetic)


def _of_surface(
    eq: ContactEquations, i: int, end: Evaluation, a: Motion, b: Motion, moved: Array, dq: Array
) -> MotionEnergies:
    """Return the increments of the energies of a motion due to one surface, on this rank.

    Args:
        eq: equations of the step.
        i: index of the surface.
        end: evaluation of the solution of the step.
        a: motion before the step.
        b: motion after the step.
        moved: displacement in the step, its length times the mean velocity, owned and ghost values.
        dq: increment of the unknowns of the rigid bodies.
    """
    s = eq.surfaces[i]
    contact = end.surfaces[i]
    before, after = a.surfaces[i], b.surfaces[i]
    operator = contact.kinematics.operator
    normal = contact.data.n
    force = operator.areas[:, None] * contact.traction
    # relative displacements h (B v - v_o), and h v_o of a rigid body
    rate = eq.terms[i].relative_rate
    relative = operator.apply(rate(end.u, end.q, moved, dq))
    dragged = -operator.apply(rate(end.u, end.q, np.zeros_like(moved), dq))
    # an obstacle that is moved by its data
    risen = after.obstacle - before.obstacle
    external = float(np.sum(force * dragged) + np.sum(force * normal, axis=1) @ risen)
    # bonds
    spent = impact = 0.0
    if s.law_at_points.compiled.bonded:
        force = force - operator.areas[:, None] * contact.answers.bond("traction")
        spent = float(np.sum(operator.areas * contact.answers.bond("spent")))
    # pressure and friction
    pull = np.sum(force * normal, axis=1)
    opening = np.sum(relative * normal, axis=1)
    friction = float(pull @ opening - np.sum(force * relative))
    if not s.law.compliant:
        impact = -float(pull @ (opening - risen))
    stored = after.stored_since(before)
    return MotionEnergies(external, stored, friction, spent, contact=impact)
