# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Semismooth Newton method for the reduced problem, with exact or regularised contact laws.

With the projection Pi onto admissible forces (`PointProblem.allowed`), the exact laws for forces r
and displacements a are r = Pi(r - k a), k > 0. With a fixed force l they become the compliant laws
r = Pi(l - k a): l = 0 is a penalty method with stiffness k, and an estimate l of the contact force
gives the augmented Lagrangian method (`uzawa`). A nonmonotone line search shortens steps whose
residual norm exceeds the largest of the last five (Grippo, Lampariello and Lucidi, SIAM J. Numer.
Anal. 23, 1986).

`SemismoothNewton` takes the full steps of Alart and Curnier (CMAME 92, 1991) until the relative
residual of the laws is below the tolerance. It fails if the statuses repeat in a cycle or do not
determine a unique state.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact.algorithms.iteration import Algorithm, Iteration
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["SemismoothNewton", "newton_step", "solve_semismooth", "solve_yielding"]

_REMEMBERED = 5  # residual norms of the nonmonotone line search
_SHORTEST = 1e-3  # smallest step length of the line search
_STAGES = 12  # largest number of stiffnesses in a continuation


@dataclass(frozen=True)
class SemismoothNewton(Algorithm):
    """Semismooth Newton method with full steps; one iteration is one Newton step."""

    name: ClassVar[str] = "semismooth-newton"
    max_iterations: int = 40

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        a = contact.displacements(r)
        while not iteration.stops(a, r):
            a, r = newton_step(contact, a, r)


def newton_step(contact: PointProblem, a: Array, r: Array) -> tuple[Array, Array]:
    """Return displacements and forces after a full Newton step, shape (m, dim) each.

    In 2D the result is the equilibrium state for the statuses of the points before the step.

    Raises:
        numpy.linalg.LinAlgError: if these statuses do not determine a unique state.
    """
    # Linearise with displacements and forces as independent unknowns, then eliminate the forces.
    k = contact.augmentation
    s = r - k[:, None] * a
    forces = contact.forces(a)
    turned = np.einsum("ipq,iq->ip", contact.derivative(s), forces - r)
    right = forces - contact.allowed(s) - turned
    step = np.linalg.solve(_jacobian(contact, s, None, k), right.reshape(-1))
    a = a - step.reshape(a.shape)
    return a, contact.forces(a)


def solve_semismooth(
    contact: PointProblem,
    a: Array,
    *,
    held: Array | None = None,
    stiffness: Array | None = None,
    tolerance: float = 1e-12,
    most: int = 100,
) -> tuple[Array, int, bool]:
    """Solve the exact or compliant contact laws by a damped semismooth Newton method.

    With the projection Pi onto admissible forces, the exact laws are r = Pi(r - k a), the compliant
    laws r = Pi(l - k a) with fixed forces l.

    Args:
        contact: reduced problem.
        a: initial displacements, shape (m, dim).
        held: fixed forces l, shape (m, dim); None for the exact laws.
        stiffness: stiffness k, shape (m,); by default the augmentation of the problem.
        tolerance: largest residual force, relative to the largest force.
        most: maximum number of steps.

    Returns:
        Displacements, shape (m, dim); the number of steps; and whether they converged.
    """
    k = contact.augmentation if stiffness is None else stiffness
    recent: deque[float] = deque(maxlen=_REMEMBERED)
    H, s = _residual(contact, a, held, k)
    for steps in range(most + 1):
        size = max(contact.force, float(np.abs(contact.forces(a)).max()))
        if steps > 0 and float(np.abs(H).max()) <= tolerance * size:
            return a, steps, True
        if steps == most:
            break
        recent.append(float(np.linalg.norm(H)))
        step = np.linalg.solve(_jacobian(contact, s, held, k), H.reshape(-1)).reshape(a.shape)
        part = 1.0
        while True:
            tried = a - part * step
            H_tried, s_tried = _residual(contact, tried, held, k)
            if part <= _SHORTEST or float(np.linalg.norm(H_tried)) <= max(recent):
                break
            part *= 0.5
        a = tried
        H = H_tried
        s = s_tried
    return a, most, False


def solve_yielding(
    contact: PointProblem, a: Array, held: Array, stiffness: Array, *, cold: bool
) -> tuple[Array, int, bool]:
    """Solve compliant contact laws; after a cold start, increase their stiffness gradually.

    The laws are r = Pi(l - k a) with the projection Pi onto admissible forces. If the initial state
    penetrates the obstacle deeply, stiff contact makes slips oscillate. If Newton's method fails
    for a stiffness, a value between this one and the last successful one is tried first.

    Args:
        contact: reduced problem.
        a: initial displacements, shape (m, dim).
        held: fixed forces l of the compliant laws, shape (m, dim).
        stiffness: stiffness k, shape (m,).
        cold: whether to start with a thousandth of the stiffness.

    Returns:
        Displacements, shape (m, dim); the total number of steps; and whether they converged.
    """
    parts = [*((1e-3, 1e-2, 1e-1) if cold else ()), 1.0]
    total = 0
    known = 0.0
    for _ in range(_STAGES):
        part = parts[0]
        found, steps, solved = solve_semismooth(contact, a, held=held, stiffness=part * stiffness)
        total += steps
        if not solved:
            parts.insert(0, float(np.sqrt(known * part)) if known > 0 else 0.1 * part)
            continue
        a = found
        known = parts.pop(0)
        if not parts:
            return a, total, True
    return found, total, False


def _residual(contact: PointProblem, a: Array, held: Array | None, k: Array) -> tuple[Array, Array]:
    """Return the residual of the contact laws and the argument of the projection.

    The residual is r - Pi(s) with the forces r = S a - p and the projection Pi onto admissible
    forces; s is r - k a for the exact laws, ``held`` - k a for the compliant laws.
    """
    r = contact.forces(a)
    s = (r if held is None else held) - k[:, None] * a
    return r - contact.allowed(s), s


def _jacobian(contact: PointProblem, s: Array, held: Array | None, k: Array) -> Array:
    m, d = s.shape
    D = contact.derivative(s)
    S = contact.S.reshape(m, d, m * d)
    J = S.copy() if held is not None else S - np.einsum("ipq,iqn->ipn", D, S)
    J = J.reshape(m, d, m, d)
    every = np.arange(m)
    J[every, :, every] += D * k[:, None, None]
    return J.reshape(m * d, m * d)
