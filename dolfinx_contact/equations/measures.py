# SPDX-License-Identifier: LGPL-3.0-or-later
"""Relative residuals of the contact equations H = 0, and detection of unphysical states.

Residuals that are forces are divided by the largest nodal force (reactions, contact forces, first
residual), gaps and slips by the largest displacement. If all contact points stick, displacements
may be round-off; the length scale is then the displacement that a contact force would cause at its
node if all other nodes were fixed (`local_displacement`). The test is independent of the user's
units, and a small contact row cannot hide behind a large force row.

A maximum is NaN if one of its values is NaN.

Unphysical states that nevertheless satisfy the equations are detected by `diverged`, `inverted`,
`fixed_along_normal` and `without_normal`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array
from dolfinx_contact._geometry import dot, tangential
from dolfinx_contact._mpi import any_rank, largest, maximum, sorted_rows
from dolfinx_contact.body.cells import smallest_jacobian
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation, SurfaceEvaluation
from dolfinx_contact.laws.status import STICK, closed, senses
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = [
    "Measures",
    "Scales",
    "diverged",
    "fixed_along_normal",
    "inverted",
    "least_scales",
    "local_displacement",
    "measure",
    "require_solution",
    "round_off_force",
    "without_normal",
]

_SOLVED = 1e-6  # residual up to which a state counts as a solution
_AT_REST = 1e-3  # the same for a body without displacements and forces: 1e-15 of its stiffness
_NOTHING = 1e-12  # displacement that counts as zero, relative to the size of the body
_FAR = 1e5  # displacement, in body sizes, that is not an equilibrium
_ACROSS = 1e-6  # component of a unit normal along a fixed direction
#: Largest admissible slope of a gap along the normal at a touching point: -1 where a level set has
#: a gradient, -1/m where it vanishes like the m-th power of the distance.
_STEEPEST = -0.75
_NO_NORMAL = (
    "the obstacle has no normal at a contact point that is at ({}) or next to it: the gradient of "
    "a level set vanishes there, or it is the centre of a sphere"
)
_TURNED = (
    "the normal of the obstacle has turned by half a turn in this step at a contact point that is "
    "at ({}), as where a body passes through a thin tool: how far it slipped is not known; take "
    "shorter steps"
)


@dataclass(frozen=True)
class Measures:
    """Relative residuals, each the largest value over all ranks.

    Attributes:
        force: residual of the equilibrium of free nodes and rigid bodies, divided by the force
            scale.
        constraint: largest error of Dirichlet data and prescribed motions, gap of closed points and
            slip of stuck points, divided by the length scale.
        cone: residual of the traction of open points and of the shear of slipping points, divided
            by the force scale.
    """

    force: float
    constraint: float
    cone: float

    @cached_property
    def worst(self) -> float:
        """Largest of the three relative residuals."""
        return float(np.max([self.force, self.constraint, self.cone]))


class Scales(NamedTuple):
    """Force and length by which residuals are divided; they never decrease along a branch.

    Attributes:
        force: largest nodal force so far.
        length: largest displacement so far.
    """

    force: float = 0.0
    length: float = 0.0


def least_scales(equations: ContactEquations, length: float) -> Scales:
    """Return lower bounds of the force and length scales.

    The bounds are 1e-12 of the body size and the nodal forces for such displacements, which count
    as zero. Both are 0 if the displacements are larger.

    Args:
        equations: contact problem.
        length: largest displacement.
    """
    none = _NOTHING * equations.body_size
    return Scales(equations.scaling.stiffness * none, none) if length <= none else Scales()


def round_off_force(equations: ContactEquations, displacement: float) -> float:
    """Return the nodal force below which forces count as round-off.

    If a body moves without resistance, all forces are round-off errors of stiffness times
    displacement, and no other force scale is available. Stresses of a nonlinear body are
    differences of terms as large as its moduli, with a round-off of 1e-15 of the moduli even
    without load.

    Args:
        equations: contact problem.
        displacement: largest displacement.
    """
    strain = 0.0 if equations.bulk.linear else 1e-5 * equations.body_size
    return equations.scaling.stiffness * max(1e-4 * displacement, strain)


def measure(
    eq: ContactEquations,
    evaluation: Evaluation,
    scales: Sequence[float] = (),
    *,
    settled: bool = False,
) -> tuple[Measures, Scales]:
    """Return the relative residuals of a state, and the scales updated by it. Collective.

    Args:
        eq: contact problem.
        evaluation: evaluation of the state with the rows of H.
        scales: force and length scales of earlier states; default: none.
        settled: whether the state is expected to be a solution; the scales are then bounded from
            below by `least_scales`. Default: False.
    """
    assert evaluation.reactions is not None
    stiffness = eq.scaling.stiffness
    body, *laws, rigid = evaluation.rows
    fixed, fixed_rigid = eq.fixed[: len(body)], eq.rigid.fixed[: len(rigid)]
    parts = zip(eq.surfaces, evaluation.surfaces, laws, eq.scaling.at_vertices, strict=True)
    constraint, cone, nodal, moved = np.max([_of_surface(*part) for part in parts], axis=0)
    # equilibrium and Dirichlet data
    force, dirichlet, reaction, length = _largest(
        (body[~fixed], rigid[~fixed_rigid]),
        (body[fixed], rigid[fixed_rigid]),
        (evaluation.reactions[fixed],),
        (evaluation.u, evaluation.q),
    )
    dirichlet /= stiffness
    # scales; a moving body has a length scale even while it passes its undeformed position
    force_scale, length_scale = Scales(*scales)
    first = force if force_scale == 0.0 else 0.0
    forces = np.max([first, reaction, nodal])
    lengths = np.max([length, eq.bulk.reach, dirichlet, moved])
    values = np.array([forces, lengths, force, np.max([dirichlet, constraint]), cone])
    forces, lengths, force, constraint, cone = map(float, largest(eq.comm, values))
    force_scale = max(force_scale, forces)
    length_scale = max(length_scale, lengths, 1e-14 * eq.body_size)
    if settled:
        least = least_scales(eq, length_scale)
        force_scale, length_scale = max(force_scale, least.force), max(length_scale, least.length)
    unit = max(force_scale, round_off_force(eq, length_scale))
    measures = Measures(force / unit, constraint / length_scale, cone / unit)
    return measures, Scales(force_scale, length_scale)


def require_solution(problem: Any, hint: str = "") -> None:
    """Raise ``ValueError`` unless the state in the Functions solves the current problem.

    Statuses are determined from the unknowns; stored statuses could hide a change of the friction
    coefficient. Collective.

    Args:
        problem: contact problem, or problem of a step.
        hint: possible reason, for the message.
    """
    equations = problem.equations
    equations.read_data()
    x = problem.create_vector()
    problem.write(x)
    evaluation = equations.evaluate(x)
    x.destroy()
    tolerance = equations.options.value("snes_rtol")
    allowed = max(_SOLVED, 10.0 * float(tolerance or 0.0))
    measures, scales = measure(equations, evaluation, settled=True)
    if scales == least_scales(equations, scales.length):
        allowed = max(allowed, _AT_REST)
    if not measures.worst <= allowed:
        raise ValueError(
            f"not a solution of the problem as it is now: residual {measures.worst:.1e} "
            f"(allowed {allowed:.0e}){hint and f'; {hint}'}"
        )


def local_displacement(s: DiscreteSurface, contact: SurfaceEvaluation, stiffness: Array) -> float:
    """Return the largest displacement that a contact force would cause at its own node.

    All other nodes are fixed. Only nodes of this rank are considered.

    Args:
        s: contact surface.
        contact: evaluation of the surface.
        stiffness: stiffness per area at the local vertices, shape (n,).
    """
    if len(stiffness) == 0:
        return 0.0
    traction = np.linalg.norm(contact.traction, axis=1)
    # Gauss points belong to several vertices; the largest stiffness gives the strictest test.
    resists = float(stiffness.max()) if s.is_weak else stiffness[: len(traction)]
    moved = np.divide(traction, resists, out=np.zeros_like(traction), where=resists > 0)
    return float(moved.max(initial=0.0))


def _of_surface(
    s: DiscreteSurface, contact: SurfaceEvaluation, rows: Array, stiffness: Array
) -> tuple[float, float, float, float]:
    """Return residuals and scales of one surface on this rank. Collective.

    With ``method="nodal"`` or ``"mixed"``, gap and tangential displacement of a closed point, times
    r and the area, are lengths; the traction of an open point and the shear of a slipping point are
    forces. With ``method="integral"`` every row counts as both.

    Returns:
        Largest length and largest force in the rows; largest nodal contact force; and a length
        scale, the larger of the displacement by a nodal contact force (`held_back`) and the largest
        initial penetration.
    """
    points = s.points
    overlap = np.max(-points.vertex_gaps, initial=0.0)
    moved = float(np.max([local_displacement(s, contact, stiffness), overlap]))
    if s.is_weak:
        area = points.geometry.vertex_areas
        unit, size, traction, width = _largest(
            (points.r * area,), (rows,), (contact.traction,), (area,)
        )
        return size / maximum(s.comm, unit), size, traction * width, moved
    area = points.areas
    n = contact.data.n
    rows = rows.reshape(-1, s.dim)
    along = np.abs(dot(rows, n))
    across = np.linalg.norm(tangential(rows, n), axis=1)
    touching = closed(contact.statuses)
    stuck = senses(contact.statuses) == STICK
    # The shear residual of a slipping point divided by r is a length, too: the error of the slip
    # direction. Friction may hold an open point.
    units = points.data.r * area
    length, size, force = _largest(
        (np.where(touching, along, 0.0) / units, np.where(touching | stuck, across, 0.0) / units),
        (np.where(touching, 0.0, along), np.where(stuck, 0.0, across)),
        (contact.traction * area[:, None],),
    )
    return length, size, force, moved


def _largest(*groups: Sequence[npt.NDArray[Any]]) -> list[float]:
    """Return for each group of arrays the largest absolute entry, 0 if all are empty."""
    return [float(np.max([np.abs(v).max(initial=0.0) for v in group])) for group in groups]


# -- states that are not physical ------------------------------------------------------------------


def diverged(eq: ContactEquations, x: PETSc.Vec) -> str:
    """Return a message if a body slides away without equilibrium, else "". Collective.

    Residuals relative to the nodal forces of such displacements are meaningless.
    """
    parts = eq.unknowns.blocks(x)
    values = np.array([np.max(np.abs(v), initial=0.0) for v in (parts[0], parts[-1])])
    body, rigid = largest(eq.comm, values) / eq.body_size
    if max(body, rigid) <= _FAR:
        return ""
    which = "the body" if body >= rigid else "a rigid body"
    return (
        f"{which} moves away, by {max(body, rigid):.1e} times the size of the body: nothing holds "
        "it against the loads"
    )


def inverted(eq: ContactEquations, x: PETSc.Vec) -> str:
    """Return a message if a hyperelastic body is turned inside out; otherwise "". Collective."""
    if eq.bulk.linear:
        return ""
    smallest, place = smallest_jacobian(
        eq.V, eq.unknowns.displacement(x), vertices=False, axisymmetric=eq.axisymmetric
    )
    if smallest > 0:
        return ""
    where = ", ".join(f"{c:.4g}" for c in place)
    return f"its solution has det F = {smallest:.3g} at ({where})"


def fixed_along_normal(eq: ContactEquations, evaluation: Evaluation) -> str:
    """Return a message about a touching point fixed along its normal; "" if none is. Collective.

    With friction on a curved obstacle, a node fixed in one direction has no multiplier component in
    it, and the direction must remain tangential to the obstacle.
    """
    parts = zip(eq.constraints.surfaces, eq.surfaces, evaluation.surfaces, strict=True)
    for constraints, s, contact in parts:
        if s.displaced is None or not s.displaced.friction:
            continue
        n = s.points.vertices.dofmap.index_map.size_local
        fixed = constraints.fixed_nodes[s.points.vertex_nodes]
        partly = np.where(np.all(fixed, axis=1)[:, None], False, fixed)
        if not any_rank(eq.comm, partly):
            continue
        touches = s.points.at_vertices(closed(contact.statuses).astype(float))[:n]
        normal = s.points.at_vertices(contact.data.n)[:n]
        across = np.linalg.norm(np.where(partly[:n], normal, 0.0), axis=1)
        if any_rank(eq.comm, across[touches > 0] > _ACROSS):
            return (
                f"{s.name}: Dirichlet data fix a displacement component of a touching node that "
                "was tangential to the obstacle and is not where it is now, so that friction and "
                "the support cannot be distinguished; fix all components there or leave it free"
            )
    return ""


def without_normal(eq: ContactEquations, evaluation: Evaluation) -> str:
    """Return a message if a displaced point has no normal; otherwise "". Collective."""
    for s, contact in zip(eq.surfaces, evaluation.surfaces, strict=True):
        data = contact.data
        place = contact.kinematics.place
        if place is None:
            continue
        fall = dot(contact.kinematics.gap_slope, data.n)
        lost = ~np.isfinite(fall + contact.kinematics.gap) | (
            closed(contact.statuses) & (fall > _STEEPEST)
        )
        # If the normal is finite, the undefined quantity is the slip in the step.
        turned = lost & np.isfinite(data.n).all(axis=1) & ~np.isfinite(fall)
        for which, why in ((lost & ~turned, _NO_NORMAL), (turned, _TURNED)):
            relative = np.round((s.positions + place)[which] / eq.body_size, 9)
            if places := sorted_rows(eq.comm, relative):
                where = ", ".join(f"{c * eq.body_size:.6g}" for c in places[0])
                return f"{s.name}: {why.format(where)}"
    return ""
