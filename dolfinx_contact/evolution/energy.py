# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The energy account of an evolution: what loads and supports put in, and where it is.

Over a step from n to n+1, with dead loads f, reactions S of Dirichlet data, forces P on rigid
bodies and contact pressures p over areas W,

    external work  (f_n + f_n+1)/2 . du + (S_n + S_n+1)/2 . du - (P_n + P_n+1)/2 . dq
                   - sum W (p_n + p_n+1)/2 (d u_N + (n_n + n_n+1)/2 . dj)
                   (obstacles that move: by how much the gap u_N changes where points j stay; none
                   of those of facets, whose gap falls less than points do where they leave a rim)
    dissipated     - sum W t_n+1 . (increment of the jump along the surface), without adhesion
    damage         what breaking bonds has cost (`laws.Bond.spent`)
    stored         the energy of the body without the potential of its loads, that of bonds, and
                   what compliant surfaces hold, sum W (p_n + p_n+1)/2 . (increment of the
                   penetration)

The residue is external less stored less dissipated less damage, all since the start. What is left
in a step is of second order in it: friction is taken at the end of the step, and contact may open
or close within. So the residue of a run falls with the first power of its steps where friction
changes smoothly, and a residue that does not fall is a jump of the state, whose energy goes into
motion.

Loads are what the rows of the undeformed body have, R(0) = -f: of a body that is stressed where it
is undeformed, or has loads that follow it, the rest counts as stored. Of a problem that is given by
a residual the stored energy is summed up from the forces, with the trapezoidal rule, which is exact
where the body is linear.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import ContactState, Evaluation
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["Energies", "Forces", "forces_at"]

Array = npt.NDArray[np.float64]

_ROUND_OFF = 1e-9  # of all energies, the least that counts in a step


@dataclass(frozen=True)
class Energies:
    """Energies since the start of an evolution.

    Attributes:
        external: work of loads, supports, rigid bodies and obstacles.
        stored: growth of the energy of the body and of compliant surfaces.
        dissipated: by friction.
        damage: dissipated by bonds that break.
    """

    external: float = 0.0
    stored: float = 0.0
    dissipated: float = 0.0
    damage: float = 0.0

    @property
    def residue(self) -> float:
        """What of the external work is neither stored nor dissipated."""
        return self.external - self.stored - self.dissipated - self.damage

    def residue_since(self, before: Energies) -> float:
        """Return the residue of a step over the energies that are turned over in it.

        Args:
            before: energies at the start of the step.
        """
        parts = ("external", "stored", "dissipated", "damage")
        turned = sum(abs(getattr(self, k) - getattr(before, k)) for k in parts)
        least = _ROUND_OFF * sum(abs(getattr(self, k)) for k in parts)
        size = max(turned, least)
        return (self.residue - before.residue) / size if size > 0 else 0.0

    def row(self) -> dict[str, float]:
        """By name, with the residue, for a table of steps."""
        return asdict(self) | {"residue": self.residue}

    def advanced(self, before: Forces, after: Forces, dissipated: float) -> Energies:
        """The account after a step. Collective.

        Args:
            before: at its start.
            after: at its end.
            dissipated: in it.
        """
        du = after.u - before.u
        dq = after.q - before.q
        outer = np.dot(before.outer + after.outer, du) / 2
        inner = np.dot(before.inner + after.inner, du) / 2
        pressed = spent = 0.0
        for p, q in zip(before.surfaces, after.surfaces, strict=True):
            force = (p.force + q.force) / 2
            moved = np.sum((p.n + q.n) / 2 * (q.jump - p.jump), axis=1)
            if not p.at_rest:  # else nothing but the bodies moves
                outer -= np.dot(force, q.un - p.un + moved)
            pressed += float(np.sum(q.bonds - p.bonds))
            spent += float(np.sum(q.spent))
            pressed -= np.dot((p.springs + q.springs) / 2, q.un - p.un)
        comm = after.equations.comm
        sums = (comm.allreduce(float(v)) for v in (outer, inner, pressed, spent))
        outer, inner, pressed, spent = sums
        outer -= float(np.dot(before.pushes + after.pushes, dq)) / 2
        if before.energy is not None and after.energy is not None:
            inner = after.energy - before.energy
        return Energies(
            self.external + outer,
            self.stored + inner + pressed,
            self.dissipated + dissipated,
            self.damage + spent,
        )


@dataclass(frozen=True, eq=False)
class SurfaceForces:
    """A contact surface at a state: forces of pressure, gaps (n,), normals, total jumps (n, dim).

    Normals and jumps are those in the frame of a rigid body that turns.

    Attributes:
        springs: forces of a compliant surface, without adhesion; 0 of others (n,).
        bonds: energies that bonds hold (n,).
        spent: energies that bonds have lost since the state before (n,).
        at_rest: whether what may be touched has no motion of its own: another face, or a surface of
            facets.
    """

    force: Array
    un: Array
    n: Array
    jump: Array
    springs: Array
    bonds: Array
    spent: Array
    at_rest: bool = False


@dataclass(frozen=True, eq=False)
class Forces:
    """All forces at a state, and what they work on.

    Attributes:
        equations: of the contact problem.
        u, q: displacement (owned) and unknowns of the rigid bodies.
        outer: on the body, of loads and supports (owned).
        inner: of the body itself (owned).
        pushes: contact forces on the rigid bodies, that do work on changes of q.
        energy: of the body without its loads; None if it is not known.
        surfaces: contact, surface by surface.
        covered: of the unknowns (owned), the part of the area of a point that has something
            opposite, 1 of all else; None where no faces slide over each other.
    """

    equations: ContactEquations
    u: Array
    q: Array
    outer: Array
    inner: Array
    pushes: Array
    energy: float | None
    surfaces: tuple[SurfaceForces, ...]
    covered: Array | None = None


def forces_at(eq: ContactEquations, state: Evaluation) -> Forces:
    """The forces at a state that has its reactions. Collective."""
    assert state.reactions is not None
    assert state.pushes is not None
    n = eq.owned_sizes[0]
    u = state.u[:n].copy()
    rows = _rows(eq, state.u)
    load = -_rows(eq, np.zeros_like(state.u))
    energy = eq.bulk.energy_at(state.u)
    if energy is not None:
        energy += float(eq.comm.allreduce(float(np.dot(load, u))))
    surfaces = []
    for s, found in zip(eq.surfaces, state.surfaces, strict=True):
        pressure = -np.sum(found.traction * found.data.n, axis=1)
        un = found.kinematics.gap
        areas = found.kinematics.operator.areas
        force = areas * pressure
        none = np.zeros_like(force), np.zeros_like(force)
        springs = force if s.law.compliant else none[0]
        if s.law.compliant and s.law_at_points.compiled.bonded:
            springs = force + areas * np.sum(found.answers.bond("traction") * found.data.n, axis=1)
        names = ("stored", "spent") if s.law_at_points.compiled.bonded else ()
        stored, spent = [areas * found.answers.bond(name) for name in names] or none
        jump, normal = found.kinematics.path
        if s.slides:  # what has nothing opposite does not move against anything
            jump = _covered(s, found)[:, None] * jump
        known = force, un, normal.copy(), jump, springs, stored, spent
        at_rest = s.slides or s.obstacle.outline is not None
        surfaces.append(SurfaceForces(*known, at_rest=at_rest))
    return Forces(
        eq,
        u,
        state.q.copy(),
        load + np.where(eq.fixed[:n], state.reactions, 0.0),
        rows + load,
        eq.rigid.conjugate(state.q, state.pushes),
        energy,
        tuple(surfaces),
        _all_covered(eq, state),
    )


def _covered(s: DiscreteSurface, found: ContactState) -> Array:
    """The part of the areas of points that has something opposite (n,)."""
    return np.minimum(found.kinematics.operator.areas / s.points.areas, 1.0)


def _all_covered(eq: ContactEquations, state: Evaluation) -> Array | None:
    """`Forces.covered` at a state."""
    if not any(s.slides for s in eq.surfaces):
        return None
    parts = [np.ones(n) for n in eq.owned_sizes]
    for i, (s, found) in enumerate(zip(eq.surfaces, state.surfaces, strict=True)):
        if s.slides:
            parts[i + 1] = np.repeat(_covered(s, found), s.dim)
    return np.concatenate(parts)


def _rows(eq: ContactEquations, u: Array) -> Array:
    """Owned rows of the body alone. Collective."""
    rows = eq.bulk.affine_residual(u)
    return np.array(eq.bulk.residual_at(u) if rows is None else rows)
