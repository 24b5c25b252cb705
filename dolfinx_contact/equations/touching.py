# SPDX-License-Identifier: LGPL-3.0-or-later
"""Start of a solve without contact: guessed statuses, and rigid bodies moved into contact.

A Newton step from a state without contact would use the laws of open points, so that a body
restrained only by contact would float.
"""

from __future__ import annotations

from collections.abc import Sequence

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._mpi import all_ranks, largest, maximum
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation, RigidTerm, Statuses, SurfaceTerm
from dolfinx_contact.laws.status import PLUS, STICK, closed

__all__ = ["bring_together", "touches_nothing", "touching"]


_TOUCHES = 1e-9  # gap, relative to the size of the body, that counts as zero
_ROUND_OFF = 1e-14  # penetration, relative to the size of the body, that counts as zero
_BESIDE = 1e-3  # penetration, relative to the expected approach, that is insignificant
_ASIDE = 1e-6  # cosine of motion and normal below which a body slides past a point
#: Bands of gaps, relative to the size of the body, in which points may hold a rigid body.
_BANDS = (_TOUCHES, *0.5 ** np.arange(20, -1, -1))


def touches_nothing(eq: ContactEquations, evaluation: Evaluation) -> bool:
    """Return whether the current contact is insignificant compared with the load. Collective.

    The gaps of coincident faces are round-off, and some of them are negative. Without pressure,
    these points do not indicate where the bodies will touch: if only they were closed in the first
    step, the other points would penetrate by the whole prescribed motion.

    Args:
        eq: contact problem.
        evaluation: evaluation of the start, in which a traction divided by the augmentation
            parameter counts as a penetration.
    """
    nothing = True
    for contact, reach in zip(evaluation.surfaces, _reaches(eq, evaluation), strict=True):
        which = closed(contact.statuses)
        gap = np.abs(contact.kinematics.gap[which])
        pressed = np.linalg.norm(contact.traction[which], axis=1)
        comes = _BESIDE * reach
        nothing &= bool(np.all(gap <= max(comes, _TOUCHES * eq.body_size)))
        limit = max(comes, _ROUND_OFF * eq.body_size)
        nothing &= bool(np.all(pressed <= limit * contact.data.r[which]))
    return all_ranks(eq.comm, nothing)


def touching(eq: ContactEquations, evaluation: Evaluation) -> Statuses:
    """Return statuses in which all points that the load may close stick. Collective.

    If a body could then still move rigidly, for example because it touches only a bump of the
    obstacle, its points with the smallest gaps stick as well, as many as are needed to hold the
    body.

    Args:
        eq: contact problem.
        evaluation: evaluation of the start.
    """
    gaps = [term.gaps(evaluation) for term in eq.terms]
    reaches = [max(reach, _TOUCHES * eq.body_size) for reach in _reaches(eq, evaluation)]
    statuses = _within(eq, gaps, reaches)
    if not eq.scaling.unrestrained_motions(statuses):
        return statuses
    nearest = _nearest(eq, gaps, evaluation)
    for band in _BANDS if max(nearest) > -np.inf else ():
        limits = zip(reaches, nearest, strict=True)
        statuses = _within(eq, gaps, [max(r, g + band * eq.body_size) for r, g in limits])
        if not eq.scaling.unrestrained_motions(statuses):
            break
    return statuses


def _nearest(eq: ContactEquations, gaps: Sequence[Array], evaluation: Evaluation) -> list[float]:
    """Return for each surface the smallest gap of its contact points on all ranks. Collective.

    It is minus infinity if no vertex touches (vertices may touch although no Gauss point does), and
    on a free rigid body at least the smallest gap of all surfaces that may touch this body.
    """
    least = []
    for term, gap in zip(eq.terms, gaps, strict=True):
        s = term.surface
        at_vertices = gap
        if s.is_weak:
            nodes = term.relative(evaluation.u, evaluation.q)
            jump = (nodes - s.opposite(nodes))[s.points.vertex_nodes]
            at_vertices = s.at_vertices(jump)[0]
        least += [np.min(g, initial=np.inf) for g in (at_vertices, gap)]
    at_vertices, at_points = (-largest(eq.comm, -np.array(least))).reshape(-1, 2).T
    nearest = np.where(at_vertices <= _TOUCHES * eq.body_size, at_points, -np.inf)
    for body in eq.rigid.bodies:
        if not body.fixed.all():
            on_body = [s.rigid_body is body for s in eq.surfaces]
            nearest[on_body] = np.maximum(nearest[on_body], at_points[on_body].min())
    return [float(gap) for gap in nearest]


def _reaches(eq: ContactEquations, evaluation: Evaluation) -> list[float]:
    """Return for each surface the gap up to which points are expected to close. Collective.

    Half the distance by which a rigid body with a prescribed motion approaches is added.
    """
    reaches = []
    step = np.where(eq.rigid.fixed, eq.constraints.motions() - evaluation.q, 0.0)
    for term in eq.terms:
        reach = eq.constraints.reach(term.surface, evaluation.u)
        if isinstance(term, RigidTerm):
            reach += 0.5 * maximum(eq.comm, _closing(eq, term, evaluation, step))
        reaches.append(eq.constraints.load * reach)
    return reaches


def _within(eq: ContactEquations, gaps: Sequence[Array], limits: Sequence[float]) -> Statuses:
    """Return statuses in which a point sticks if its gap is at most the limit of its surface."""
    statuses = []
    for s, gap, limit in zip(eq.surfaces, gaps, limits, strict=True):
        codes = s.law_at_points.codes
        touches = STICK if STICK in codes else PLUS
        statuses.append(np.where(gap <= limit, touches, codes[0]).astype(np.int8))
    return statuses


def _closing(eq: ContactEquations, term: SurfaceTerm, evaluation: Evaluation, dq: Array) -> Array:
    """Return the decrease of the gaps of a surface due to a motion of rigid bodies, shape (n,).

    Collective.
    """
    still = np.zeros(eq.owned_sizes[0])
    step = term.relative_rate(evaluation.u, evaluation.q, still, dq)
    return -evaluation.surfaces[term.number].kinematics.gap_rate(step)


def bring_together(eq: ContactEquations, x: PETSc.Vec) -> None:
    """Translate rigid bodies without contact along their loads until they touch. Collective.

    Bodies without a load in a free direction, or without contact points ahead of them, do not move.

    Args:
        eq: contact problem.
        x: unknowns, whose rigid motions are updated.
    """
    if not eq.rigid.size:
        return
    evaluation = eq.evaluate_contact(x)
    moved = evaluation.q.copy()
    for body, part in eq.rigid.slices.items():
        load = eq.rigid.loads[part][: body.dim]
        size = float(np.linalg.norm(load))
        if size == 0:
            continue
        along = np.zeros(eq.rigid.size)
        along[part][: body.dim] = load / size
        # distances to the nearest point in any direction, and to the nearest one along the load
        nearest = ahead = np.inf
        for term in eq.terms:
            if term.surface.rigid_body is body:
                gap, closing = term.gaps(evaluation), _closing(eq, term, evaluation, along)
                facing = closing > _ASIDE
                nearest = min(nearest, float(np.min(gap, initial=np.inf)))
                distances = gap[facing] / closing[facing]
                ahead = min(ahead, float(np.min(distances, initial=np.inf)))
        nearest, ahead = (eq.comm.allreduce(v, op=min) for v in (nearest, ahead))
        if nearest > 0 and np.isfinite(ahead):
            moved += ahead * along
    x.array[x.getLocalSize() - eq.rigid.owned :] = eq.rigid.here(moved)
