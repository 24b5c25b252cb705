# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Energy balance of a time step of a body in motion, impacts included.

Over a step of length h from state 0 to state 1, with the mean velocity v = (v_0 + v_1)/2, loads f,
mean forces S of supports, mean contact tractions t over areas W, tractions t' = t without adhesion,
and velocity v_o of the obstacle, the energies grow by

    kinetic     v_1^T M v_1 / 2 - v_0^T M v_0 / 2
    external    ((f_0 + f_1)/2 + S) . (u_1 - u_0) + h sum W t . v_o
    stored      energy of the body without the load potential, energy of bonds, and energy of
                compliant surfaces, sum W (p_0 + p_1)/2 . (increment of the penetration)
    damping     h v^T C (theta v_1 + (1 - theta) v_0)
    contact     - h sum W t'_n . (B v - v_o)_n      impulse times mean velocity (Moreau 1988), for
                                                    surfaces that are not compliant
    dissipated  - h sum W t'_t . (B v - v_o)_t      friction
    damage      energy spent by breaking bonds

The residue is the external work minus all other terms, since the start. With theta = 1/2 it is zero
for a linear body without adhesion and compliance, and of second order in h otherwise. With other
schemes it is the energy dissipated or produced by the scheme.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace

import numpy as np
import numpy.typing as npt

from dolfinx_contact.body.moving import MovingBody
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.evolution.energy import Energies

__all__ = ["Deviation", "Motion", "MotionEnergies", "account", "motion_at"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class MotionEnergies(Energies):
    """Energies of a body in motion; all but the kinetic energy are summed since the start.

    Attributes:
        kinetic: kinetic energy.
        at_start: kinetic energy at the start.
        damping: dissipation by the damping of the body.
        contact: energy lost in impacts; negative if they add energy.
    """

    kinetic: float = 0.0
    at_start: float = 0.0
    damping: float = 0.0
    contact: float = 0.0

    @property
    def residue(self) -> float:
        """External work minus all other energies."""
        growth = self.kinetic - self.at_start
        return super().residue - growth - self.damping - self.contact


@dataclass(frozen=True, eq=False)
class SurfaceMotion:
    """Values at the contact points of a surface at one time, each of shape (n,).

    Attributes:
        obstacle: gap between the undeformed body and the obstacle, a length.
        un: gap, a length.
        push: compressive force without adhesion.
        bonds: energy stored in bonds.
    """

    obstacle: Array
    un: Array
    push: Array
    bonds: Array


@dataclass(frozen=True, eq=False)
class Deviation:
    """Deviation of the velocities of held nodes from their mean velocity in a step.

    Attributes:
        values: deviations at the end of the step, zero where nothing is held (owned).
        reversals: number of successive steps, up to this one, in which it changed its sign.
    """

    values: Array
    reversals: int = 0


@dataclass(frozen=True, eq=False)
class Motion:
    """State of motion with the forces and energies that a step needs.

    Attributes:
        u: displacement, all local values.
        v: velocity, all local values.
        rows: internal forces and loads R(u) + C v (owned).
        load: loads -R(0) (owned).
        inner: energy of the body without the load potential; None for a body given by a residual.
        kinetic: kinetic energy.
        surfaces: values at the contact points of each surface.
        deviation: deviation of the velocities of held nodes in the step that ended here; None at a
            start.
    """

    u: Array
    v: Array
    rows: Array
    load: Array
    inner: float | None
    kinetic: float
    surfaces: tuple[SurfaceMotion, ...]
    deviation: Deviation | None = None


def motion_at(eq: ContactEquations, state: Evaluation, u: Array, v: Array) -> Motion:
    """Return the state of motion at the start or the end of a step. Collective.

    Args:
        eq: equations with the data of that time.
        state: evaluation of the contact at that time.
        u: displacement, all local values.
        v: velocity, all local values.
    """
    body = eq.bulk
    assert isinstance(body, MovingBody)
    n = eq.owned_sizes[0]
    load = body.load()
    inner = body.body.energy_at(u)
    products = np.array([load @ u[:n], 0.5 * v[:n] @ body.times(body.mass, v)])
    potential, kinetic = eq.comm.allreduce(products).tolist()
    surfaces = []
    for s, contact in zip(eq.surfaces, state.surfaces, strict=True):
        areas = contact.kinematics.operator.areas
        traction = contact.traction
        bonds = np.zeros_like(areas)
        if s.law_at_points.compiled.bonded:
            traction = traction - contact.answers.bond("traction")
            bonds = areas * contact.answers.bond("stored")
        push = -areas * np.sum(traction * contact.data.n, axis=1)
        gap = s.points.data.gap.copy()
        surfaces.append(SurfaceMotion(gap, contact.kinematics.gap, push, bonds))
    inner = None if inner is None else inner + potential
    return Motion(u, v, body.forces(u, v), load, inner, kinetic, tuple(surfaces))


def account(
    energies: MotionEnergies,
    eq: ContactEquations,
    end: Evaluation,
    a: Motion,
    b: Motion,
    dq: Array,
) -> MotionEnergies:
    """Return the energies after a step. Collective.

    Args:
        energies: energies before the step.
        eq: equations of the step.
        end: solution of the step, with reactions.
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
        damping = step.length * float(v[:n] @ body.times(body.damping, mean))
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
    """Increments of the energies at a surface on this rank.

    Args:
        eq: equations of the step.
        i: number of the surface.
        end: solution of the step.
        a: motion before the step.
        b: motion after the step.
        moved: length of the step times the mean velocity, all local values.
        dq: increment of the unknowns of the rigid bodies.
    """
    s = eq.surfaces[i]
    contact = end.surfaces[i]
    before, after = a.surfaces[i], b.surfaces[i]
    operator = contact.kinematics.operator
    normal = contact.data.n
    force = operator.areas[:, None] * contact.traction
    # relative displacements h (B v - v_o), and h v_o of a rigid body
    place = s, end.u, end.q
    relative = operator.apply(eq.relative_rate(*place, moved, dq))
    dragged = -operator.apply(eq.relative_rate(*place, np.zeros_like(moved), dq))
    # an obstacle that is moved by its data
    risen = after.obstacle - before.obstacle
    external = float(np.sum(force * dragged) + np.sum(force * normal, axis=1) @ risen)
    # bonds
    spent = stored = impact = 0.0
    if s.law_at_points.compiled.bonded:
        force = force - operator.areas[:, None] * contact.answers.bond("traction")
        spent = float(np.sum(operator.areas * contact.answers.bond("spent")))
        stored = float(np.sum(after.bonds - before.bonds))
    # pressure and friction
    pull = np.sum(force * normal, axis=1)
    opening = np.sum(relative * normal, axis=1)
    friction = float(pull @ opening - np.sum(force * relative))
    if s.law.compliant:
        stored -= float((before.push + after.push) / 2 @ (after.un - before.un))
    else:
        impact = -float(pull @ (opening - risen))
    return MotionEnergies(external, stored, friction, spent, contact=impact)
