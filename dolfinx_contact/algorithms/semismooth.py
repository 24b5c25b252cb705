# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Semismooth Newton on a reduced problem: with its laws, or with laws that yield.

With Pi the projection of `PointProblem.allowed`, the laws are r = Pi(r - k a), and with a force
l that is held (zero: a penalty k; an estimate of the contact force: Uzawa's augmented method) they
become r = Pi(l - k a), a contact that yields. Steps are shortened where the norm of the residual is
larger than all of the last ones (Grippo, Lampariello and Lucidi, SIAM J. Numer. Anal. 23, 1986).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact.algorithms.iteration import Algorithm, Iteration
from dolfinx_contact.algorithms.point_problem import PointProblem

__all__ = ["SemismoothNewton", "solve_semismooth", "solve_yielding"]

Array = npt.NDArray[np.float64]
_REMEMBERED = 5
_SHORTEST = 1e-3
_STAGES = 12  # stiffnesses that are tried on the way


@dataclass(frozen=True)
class SemismoothNewton(Algorithm):
    """Semismooth Newton on the points, with the full steps of the whole problem's; a step each."""

    name: ClassVar[str] = "semismooth-newton"
    max_iterations: int = 40

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        a = contact.displacements(r)
        while not iteration.stops(a, r):
            a, r = newton_step(contact, a, r)


def newton_step(contact: PointProblem, a: Array, r: Array) -> tuple[Array, Array]:
    """A full step of Newton's method from displacements and forces (m, dim).

    In 2D it ends in the state that has the statuses of the one before, where a and r balance to the
    last digits of their products.

    Raises:
        numpy.linalg.LinAlgError: if these statuses have no state, or many.
    """
    # H of Newton's method: its forces are unknowns of their own.
    k = contact.augmentation
    s = r - k[:, None] * a
    D = contact.derivative(s)
    m = contact.number
    d = contact.dim
    off = (r - contact.allowed(s)).reshape(-1)
    spread = np.zeros((m, d, m, d))
    spread[np.arange(m), :, np.arange(m)] = D
    D = spread.reshape(m * d, m * d)
    J = (np.eye(m * d) - D) @ contact.S + D * np.repeat(k, d)
    rest = contact.forces(a).reshape(-1) - r.reshape(-1)
    step = np.linalg.solve(J, off + (np.eye(m * d) - D) @ rest)
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
    """Displacements at which the laws hold, from ``a`` (m, dim).

    Args:
        contact: the problem.
        a: start.
        held: forces l (m, dim) by which contact yields; None for the laws themselves.
        stiffness: k (m,), by default the augmentation of the problem.
        tolerance: of the residual, a force, over the largest force.
        most: steps.

    Returns:
        Displacements, the number of steps, and whether they converged.
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
    """As `solve_semismooth` with a held force; from a cold start the stiffness rises to its value.

    From a body that is far inside its obstacle stiff contact sends slips to and fro. Where a
    stiffness leads nowhere one between it and the last that did not is tried first.
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
    """What is left, r - Pi(s), and s; r = S a - p."""
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
