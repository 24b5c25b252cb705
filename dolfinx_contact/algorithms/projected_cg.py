# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Projected conjugate gradients on the contact forces, with updates of the friction bounds.

For prescribed friction bounds g, the contact forces r = (rt, rn) minimise q(r) = r.A r/2 + c.r
subject to rn >= 0 and |rt| <= g. The gradient is the displacement a = A r + c with the compliance A
and the displacements c without contact. There are three kinds of steps (Dostal and Schoeberl,
Comput. Optim. Appl. 30, 2005; for discs Dostal and Kozubek, Math. Program. 135, 2012):

1. a conjugate gradient step on the forces inside their bounds (free gradient);
2. if it would leave the feasible set, a step to the boundary and a projected gradient step;
3. if the chopped gradient (of forces on their bounds) outweighs the free gradient, a projected
   gradient step.

The energy decreases in every step. Between two updates of the friction bounds the projected
gradient decreases by a factor of 1000. The iteration stops when the relative residual of Coulomb's
law is below the tolerance. Like the fixed-point iteration of Tresca's problems (`tresca`), it may
cycle for large friction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact.algorithms.iteration import Algorithm, Iteration
from dolfinx_contact.laws.coulomb import project
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["ProjectedGradient"]

_BALANCE = 1.0  # ratio of squared chopped and free gradients above which bounds are released
_REDUCTION = 1e-3  # factor on the projected gradient between two updates of the friction bounds
_ON = 1e-12  # distance to the friction circle, relative to its radius, that counts as zero


@dataclass(frozen=True)
class ProjectedGradient(Algorithm):
    """Projected conjugate gradients; one iteration is one step on the forces."""

    name: ClassVar[str] = "projected-gradient"
    max_iterations: int = 20000

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        r = contact.allowed(r)
        energy = 0.0
        a = contact.displacements(r)
        while not iteration.stops(a, r, energy=energy):
            inner = _GivenBound(contact, contact.radius(r[:, -1]), r)
            # Do not solve more accurately than the stopping measure can resolve.
            seen = 0.1 * iteration.tolerance * iteration.length
            least = max(_REDUCTION * inner.left, seen)
            inner.step()
            while inner.left > least and not iteration.stops(inner.a, inner.r, energy=inner.energy):
                inner.step()
            if iteration.outcome.reason:
                return
            a = inner.a
            r = inner.r
            energy = inner.energy


class _GivenBound:
    """Projected conjugate gradients for the forces with prescribed friction bounds.

    Args:
        contact: reduced problem; its friction is ignored.
        bound: friction bounds, shape (m,).
        r: initial forces, shape (m, dim).

    Attributes:
        r: feasible forces, shape (m, dim).
        a: displacements under these forces, equal to the gradient of the energy, shape (m, dim).
    """

    def __init__(self, contact: PointProblem, bound: Array, r: Array):
        self._contact = contact
        self._bound = bound
        self.r = self._projected(r)
        self._refresh()

    def _projected(self, r: Array) -> Array:
        return np.column_stack([project(r[:, :-1], self._bound), np.maximum(r[:, -1], 0.0)])

    def _times(self, v: Array) -> Array:
        return (self._contact.A @ v.reshape(-1)).reshape(v.shape)

    def _refresh(self) -> None:
        """Recompute the displacements and restart the conjugate directions."""
        self.a = self._contact.displacements(self.r)
        self._split()
        self._direction = self._free.copy()

    def _split(self) -> None:
        """Split the projected gradient into the free part and the chopped part at the bounds."""
        r = self.r
        g = self.a
        size = np.linalg.norm(r[:, :-1], axis=1)
        inside = np.zeros(r.shape, dtype=bool)
        inside[:, -1] = r[:, -1] > 0
        inside[:, :-1] = (size < self._bound * (1 - _ON))[:, None]
        self._free = np.where(inside, g, 0.0)
        self._inside = inside
        chopped = np.where(inside, 0.0, g)
        chopped[:, -1] = np.where(inside[:, -1], 0.0, np.minimum(chopped[:, -1], 0.0))
        outward = r[:, :-1] / np.maximum(size, 1e-300)[:, None]
        along = np.sum(chopped[:, :-1] * outward, axis=1)
        chopped[:, :-1] -= np.minimum(along, 0.0)[:, None] * outward
        chopped[self._bound <= 0, :-1] = 0.0
        self._chopped = chopped

    @property
    def left(self) -> float:
        """Largest magnitude of an entry of the projected gradient, in the unit of length."""
        return float(np.abs(self._free + self._chopped).max())

    @property
    def energy(self) -> float:
        """Energy of the current forces, which the method minimises."""
        return float(0.5 * np.sum((self.a + self._contact.free) * self.r))

    def step(self) -> None:
        """Perform one of the three steps described in the module."""
        free = self._free
        chopped = self._chopped
        if np.sum(chopped**2) > _BALANCE * np.sum(free**2):
            self._expand()
            return
        d = self._direction
        Ad = self._times(d)
        curvature = float(np.sum(d * Ad))
        if not curvature > 0:
            self._expand()
            return
        length = float(np.sum(self.a * d)) / curvature
        most = self._feasible(d)
        self.r = self.r - min(length, most) * d
        if length <= most:
            self.a = self.a - length * Ad
            self._split()
            beta = float(np.sum(self._free * Ad)) / curvature
            self._direction = self._free - beta * np.where(self._inside, d, 0.0)
        else:
            self.a = self.a - most * Ad
            self._split()
            self._expand()

    def _expand(self) -> None:
        """Perform a projected gradient step of length 1/|A|, which decreases the energy."""
        self.r = self._projected(self.r - self.a / self._contact.longest)
        self._refresh()

    def _feasible(self, d: Array) -> float:
        """Return the largest step length along -``d`` for which the forces satisfy their bounds."""
        most = np.inf
        falls = d[:, -1] > 0
        if falls.any():
            most = float(np.min(self.r[falls, -1] / d[falls, -1]))
        moves = np.linalg.norm(d[:, :-1], axis=1) > 0
        if moves.any():
            # |r - s d|^2 = g^2 for s > 0.
            r = self.r[moves, :-1]
            v = d[moves, :-1]
            g = self._bound[moves]
            A = np.sum(v * v, axis=1)
            B = np.sum(r * v, axis=1)
            C = np.sum(r * r, axis=1) - g**2
            root = np.sqrt(np.maximum(B**2 - A * C, 0.0))
            most = min(most, float(np.min((B + root) / A)))
        return max(most, 0.0)
