# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Energy balance of an evolution: work of loads and supports, stored and dissipated energy.

In a step from n to n+1, with dead loads f, reactions S of Dirichlet data, forces P on rigid bodies,
contact pressures p and shear tractions t over areas W, gap u_N, jump j and normal n,

    external    (f_n + f_n+1)/2 . du + (S_n + S_n+1)/2 . du - (P_n + P_n+1)/2 . dq
                - sum W (p_n + p_n+1)/2 (d u_N + (n_n + n_n+1)/2 . dj)
    dissipated  - sum W t_n+1 . (increment of the jump along the surface), without adhesion
    damage      energy spent by breaking bonds (`laws.Bond.spent`)
    stored      energy of the body without the potential of its loads, energy of bonds, and of
                compliant surfaces sum W (p_n + p_n+1)/2 . (increment of the penetration)

The sum in the external work is that of moving obstacles: the change of the gap at points that
stay. Obstacles of facets have none, because at a rim the gap of a leaving point decreases by less
than the point moves.

The residue is external - stored - dissipated - damage, all since the start. In a step it is of
second order: friction is taken at the end of the step, and contact may open or close within.
Therefore the residue of a run falls with the first power of its step length where friction changes
smoothly. A residue that does not fall is a jump of the state, whose energy goes into motion.

Loads are defined by the rows of the undeformed body, R(0) = -f. In a body with initial stress, or
with loads that follow the body, the remainder counts as stored. If a problem is given by a
residual, the stored energy is integrated from the forces by the trapezoidal rule, which is exact
for a linear body.
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

_ROUND_OFF = 1e-9  # smallest scale of the energies of a step, relative to all energies


@dataclass(frozen=True)
class Energies:
    """Energies since the start of an evolution.

    Attributes:
        external: work of loads, supports, rigid bodies and obstacles.
        stored: growth of the energy of the body, of bonds and of compliant surfaces.
        dissipated: frictional dissipation.
        damage: dissipation by breaking bonds.
    """

    external: float = 0.0
    stored: float = 0.0
    dissipated: float = 0.0
    damage: float = 0.0

    @property
    def residue(self) -> float:
        """External work that is neither stored nor dissipated."""
        return self.external - self.stored - self.dissipated - self.damage

    def residue_since(self, before: Energies) -> float:
        """Return the residue of a step relative to the energies of the step.

        The scale is the sum of the magnitudes of external work, stored energy, dissipation and
        damage in the step.

        Args:
            before: energies at the start of the step.
        """
        parts = ("external", "stored", "dissipated", "damage")
        turned = sum(abs(getattr(self, k) - getattr(before, k)) for k in parts)
        scale = max(turned, _ROUND_OFF * sum(abs(getattr(self, k)) for k in parts))
        return (self.residue - before.residue) / scale if scale > 0 else 0.0

    def row(self) -> dict[str, float]:
        """Return the energies and the residue by name, for a table of steps."""
        return asdict(self) | {"residue": self.residue}

    def advanced(self, before: Forces, after: Forces, dissipated: float) -> Energies:
        """Return the energies after a step. Collective.

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
            pressed += float(np.sum(q.bonds - p.bonds))
            pressed -= np.dot((p.springs + q.springs) / 2, q.un - p.un)
            spent += float(np.sum(q.spent))
        comm = after.equations.comm
        outer, inner, pressed, spent = (
            comm.allreduce(float(v)) for v in (outer, inner, pressed, spent)
        )
        outer -= float(np.dot(before.pushes + after.pushes, after.q - before.q)) / 2
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
    """Values at the contact points of a surface at a state.

    Normals and jumps are in the frame of a rigid body that turns.

    Attributes:
        force: normal forces, positive in compression, shape (n,).
        un: gaps, lengths, shape (n,).
        n: normals, shape (n, dim).
        jump: total jumps, lengths, shape (n, dim).
        springs: normal forces of a compliant surface without adhesion, otherwise 0, shape (n,).
        bonds: energies stored in bonds, shape (n,).
        spent: energies spent by bonds in the step, shape (n,).
        at_rest: whether the obstacle has no work of its own: another face, or facets.
    """

    force: Array
    un: Array
    n: Array
    jump: Array
    springs: Array
    bonds: Array
    spent: Array
    at_rest: bool


@dataclass(frozen=True, eq=False)
class Forces:
    """All forces at a state and the displacements on which they work.

    Attributes:
        equations: equations of the contact problem.
        u: displacement (owned).
        q: unknowns of the rigid bodies.
        outer: forces of loads and supports on the body (owned).
        inner: internal forces of the body (owned).
        pushes: contact forces on the rigid bodies, conjugate to q.
        energy: energy of the body without the potential of its loads; None if it is unknown.
        surfaces: values at the contact points, by surface.
        covered: fraction of the area of a point with an opposing point, by unknown (owned); 1 for
            other unknowns. None without sliding surfaces.
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


def forces_at(eq: ContactEquations, state: Evaluation) -> Forces:
    """Return the forces at a state whose reactions are known. Collective."""
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
    covered = [np.ones(m) for m in eq.owned_sizes]
    for i, (s, contact) in enumerate(zip(eq.surfaces, state.surfaces, strict=True)):
        surfaces.append(_at_surface(s, contact))
        if s.slides:
            covered[i + 1] = np.repeat(_covered(s, contact), s.dim)
    return Forces(
        eq,
        u,
        state.q.copy(),
        load + np.where(eq.fixed[:n], state.reactions, 0.0),
        rows + load,
        eq.rigid.conjugate(state.q, state.pushes),
        energy,
        tuple(surfaces),
        np.concatenate(covered) if any(s.slides for s in eq.surfaces) else None,
    )


def _at_surface(s: DiscreteSurface, contact: ContactState) -> SurfaceForces:
    """Return the values at the contact points of a surface. Not collective."""
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
        # a point without an opposing point does not move relative to anything
        jump = _covered(s, contact)[:, None] * jump
    at_rest = s.slides or s.obstacle.outline is not None
    gap = contact.kinematics.gap
    return SurfaceForces(force, gap, normal.copy(), jump, springs, stored, spent, at_rest)


def _covered(s: DiscreteSurface, contact: ContactState) -> Array:
    """Return the fraction of the area of each point with an opposing point, shape (n,)."""
    return np.minimum(contact.kinematics.operator.areas / s.points.areas, 1.0)


def _rows(eq: ContactEquations, u: Array) -> Array:
    """Return the owned rows of the body alone. Collective."""
    rows = eq.bulk.affine_residual(u)
    return np.array(eq.bulk.residual_at(u) if rows is None else rows)
