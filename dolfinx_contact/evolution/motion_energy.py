# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The energy account of a body in motion, every term by its own formula.

Over a step of length h from 0 to 1, with the mean velocity v = (v_0 + v_1)/2, loads f, mean forces
S of supports and tractions t of contact, t' what of these is not adhesion, and velocities v_o of
what is touched,

    kinetic     v^T M v / 2, at the end
    external    (f_0 + f_1)/2 . (u_1 - u_0) + S . (u_1 - u_0) + h sum W t . v_o
    stored      the energy of the body without the potential of its loads, that of bonds, and what
                compliant surfaces hold, sum W (p_0 + p_1)/2 . (increment of the penetration)
    damping     h v^T (theta C v_1 + (1 - theta) C v_0)
    contact     - h sum W t'_n . (B v - v_o)_n, impulse times mean velocity, of surfaces that are
                not compliant
    dissipated  - h sum W t'_t . (B v - v_o)_t, by friction
    damage      what breaking bonds has cost

The residue is external less all the others, the growth of the kinetic energy among them, since the
start. With theta = 1/2 it vanishes for a linear body, but for adhesion and compliance, and is of
second order in h for others. Otherwise it is the energy that the scheme dissipates or feeds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_contact.body.moving import MovingBody
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.evolution.energy import Energies

__all__ = ["Motion", "MotionEnergies", "account", "motion_at"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class MotionEnergies(Energies):
    """Energies of a body in motion, since the start but for the kinetic one.

    Attributes:
        kinetic: as it is.
        at_start: the kinetic energy at the start.
        damping: dissipated by the damping of the body.
        contact: that impacts have taken; less than nothing where they gave.
    """

    kinetic: float = 0.0
    at_start: float = 0.0
    damping: float = 0.0
    contact: float = 0.0

    @property
    def residue(self) -> float:
        """What of the external work is nowhere."""
        grown = self.kinetic - self.at_start
        return super().residue - grown - self.damping - self.contact


@dataclass(frozen=True, eq=False)
class Motion:
    """A state of motion, and what its energies need.

    Attributes:
        u, v: displacement and velocity, all local values.
        rows: R(u) + C v (owned).
        load: -R(0) (owned).
        inner: energy of the body without its loads; None if it is not known.
        kinetic: energy.
        gaps: of the obstacles at the contact points where the body is undeformed, surface by
            surface (n,).
        un: gaps now, likewise.
        pressed: forces of pressure at the points without adhesion, likewise.
        bonds: energies that bonds hold, likewise.
    """

    u: Array
    v: Array
    rows: Array
    load: Array
    inner: float | None
    kinetic: float
    gaps: tuple[Array, ...]
    un: tuple[Array, ...]
    pressed: tuple[Array, ...]
    bonds: tuple[Array, ...]


def motion_at(eq: ContactEquations, state: Evaluation, u: Array, v: Array) -> Motion:
    """The state of motion at the end of a step, or at a start. Collective.

    Args:
        eq: the contact problem of the step.
        state: whose contact is that of the end.
        u: displacement, all local values.
        v: velocity, likewise.
    """
    body = eq.bulk
    assert isinstance(body, MovingBody)
    comm = eq.comm
    n = eq.owned_sizes[0]
    load = body.load()
    inner = body.body.energy_at(u)
    sums = [float(np.dot(load, u[:n])), 0.5 * float(np.dot(v[:n], body.times(body.mass, v)))]
    potential, kinetic = comm.allreduce(np.array(sums))
    gaps = []
    un = []
    pressed = []
    bonds = []
    for s, found in zip(eq.surfaces, state.surfaces, strict=True):
        normal = found.data.n
        areas = found.kinematics.operator.areas
        gaps.append(s.points.data.gap.copy())
        un.append(found.kinematics.gap)
        force = found.traction
        if s.law_at_points.compiled.bonded:
            force = force - found.answers.bond("traction")
        pressed.append(-areas * np.sum(force * normal, axis=1))
        none = np.zeros_like(areas)
        bonds.append(
            areas * found.answers.bond("stored") if s.law_at_points.compiled.bonded else none
        )
    return Motion(
        u,
        v,
        body.forces(u, v),
        load,
        None if inner is None else inner + float(potential),
        float(kinetic),
        tuple(gaps),
        tuple(un),
        tuple(pressed),
        tuple(bonds),
    )


def account(
    energies: MotionEnergies,
    eq: ContactEquations,
    state: Evaluation,
    a: Motion,
    b: Motion,
    turned: Array,
) -> MotionEnergies:
    """The account after a step. Collective.

    Args:
        energies: before it.
        eq: the contact problem of the step.
        state: its solution, with reactions.
        a: the motion before it.
        b: the motion after it.
        turned: by which the unknowns of the rigid bodies change in it.
    """
    body = eq.bulk
    assert isinstance(body, MovingBody)
    assert state.reactions is not None
    step = body.step
    n = eq.owned_sizes[0]
    h = step.length
    v = (a.v + b.v) / 2
    du = (b.u - a.u)[:n]
    support = np.where(eq.fixed[:n], state.reactions, 0.0)
    external = float(np.dot((a.load + b.load) / 2 + support, du))
    stored = damping = contact = slipped = spent = 0.0
    if body.damping is not None:
        mean = step.theta * b.v + (1 - step.theta) * a.v
        damping = h * float(np.dot(v[:n], body.times(body.damping, mean)))
    inner_of_rows = (a.rows + a.load + b.rows + b.load) / 2
    for i, (s, found) in enumerate(zip(eq.surfaces, state.surfaces, strict=True)):
        operator = found.kinematics.operator
        W = operator.areas
        normal = found.data.n
        force = W[:, None] * found.traction
        at = s, state.u, state.q
        relative = operator.apply(eq.relative_rate(*at, h * v, turned))
        dragged = -operator.apply(eq.relative_rate(*at, np.zeros_like(v), turned))
        external += float(np.sum(force * dragged))
        closing = np.sum(force * normal, axis=1)
        external += float(np.dot(closing, b.gaps[i] - a.gaps[i]))
        if s.law_at_points.compiled.bonded:
            force = force - W[:, None] * found.answers.bond("traction")
            spent += float(np.sum(W * found.answers.bond("spent")))
            stored += float(np.sum(b.bonds[i] - a.bonds[i]))
        pull = np.sum(force * normal, axis=1)
        along = np.sum(relative * normal, axis=1)
        slipped -= float(np.sum(force * relative) - np.dot(pull, along))
        if s.law.compliant:
            stored -= float(np.dot((a.pressed[i] + b.pressed[i]) / 2, b.un[i] - a.un[i]))
        else:
            contact -= float(np.dot(pull, along - (b.gaps[i] - a.gaps[i])))
    inner = float(np.dot(inner_of_rows, du)) - damping
    sums = np.array([external, stored, damping, contact, slipped, spent, inner])
    external, stored, damping, contact, slipped, spent, inner = eq.comm.allreduce(sums).tolist()
    if a.inner is not None and b.inner is not None:
        inner = b.inner - a.inner
    return MotionEnergies(
        energies.external + external,
        energies.stored + inner + stored,
        energies.dissipated + slipped,
        energies.damage + spent,
        b.kinetic,
        energies.at_start,
        energies.damping + damping,
        energies.contact + contact,
    )
