# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Projected conjugate gradients: on the forces, between friction bounds that are updated.

With friction bounds g given, the forces minimise q(r) = r.A r/2 + c.r over rn >= 0, |rt| <= g, and
the gradient is the displacement a = A r + c. Conjugate gradients run on the forces that are inside
their bounds; a step that would leave them ends there and continues along the projected gradient;
where what the bounds hold back outweighs the rest, a step of the projected gradient frees it
(Dostal and Schoeberl, Comput. Optim. Appl. 30, 2005; for discs Dostal and Kozubek, Math. Program.
135, 2012). The energy falls at every step.

On the displacements the functional has |ut|, which has no gradient at stick: there conjugate
gradients need a regularisation. With |ut| replaced by ut^2/(2 e) where |ut| <= e the problem of the
forces gains e |rt|^2/(2 g): it stays as it is but for a diagonal, and e = 0, the default, needs no
regularisation at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact.algorithms.iteration import Algorithm, Iteration, check
from dolfinx_contact.algorithms.point_problem import PointProblem
from dolfinx_contact.laws.coulomb import project

__all__ = ["GivenBound", "ProjectedGradient"]

Array = npt.NDArray[np.float64]
_BALANCE = 1.0  # of free and chopped gradients, squared, beyond which bounds are left
_ON = 1e-12  # of the radius, by which a force on its circle may be inside


@dataclass(frozen=True)
class ProjectedGradient(Algorithm):
    """Projected conjugate gradients; an iteration is a product with the compliance.

    Attributes:
        reduction: of the projected gradient, after which friction bounds are updated.
        regularisation: e, a length over the largest displacement; a solution of the regularised
            law differs from Coulomb's by about as much, and is measured by Coulomb's law.
    """

    name: ClassVar[str] = "projected-gradient"
    max_iterations: int = 20000
    reduction: float = 1e-3
    regularisation: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check(self, reduction=0 < self.reduction < 1, regularisation=self.regularisation >= 0)

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        softness = self.regularisation * contact.length
        r = contact.allowed(r)
        energy = 0.0
        a = contact.displacements(r)
        while not iteration.stops(a, r, energy=energy):
            inner = GivenBound(contact, contact.radius(r[:, -1]), r, softness)
            # No further than what the stopping measure can see.
            seen = 0.1 * iteration.trend.tolerance * iteration.length
            least = max(self.reduction * inner.left, seen)
            inner.step()
            while inner.left > least and not iteration.stops(inner.a, inner.r, energy=inner.energy):
                inner.step()
            if iteration.outcome.reason:
                return
            a = inner.a
            r = inner.r
            energy = inner.energy


class GivenBound:
    """Projected conjugate gradients on the forces of Tresca's problem.

    Args:
        contact: the problem, of which the friction is not used.
        bound: friction bounds g (m,).
        r: forces to begin with.
        softness: e, a length.

    Attributes:
        r: forces (m, dim), within their bounds.
        a: displacements there, (m, dim).
        products: with the compliance so far.
    """

    def __init__(self, contact: PointProblem, bound: Array, r: Array, softness: float = 0.0):
        self._contact = contact
        self._bound = bound
        self._longest = contact.longest
        yielding = np.zeros_like(r)
        yielding[:, :-1] = (softness / np.maximum(bound, 1e-300))[:, None]
        yielding[bound <= 0] = 0.0
        self._yielding = yielding
        self._longest += float(yielding.max())
        self.products = 0
        self.r = self._projected(r)
        self._refresh()

    def _projected(self, r: Array) -> Array:
        return np.column_stack([project(r[:, :-1], self._bound), np.maximum(r[:, -1], 0.0)])

    def _times(self, v: Array) -> Array:
        self.products += 1
        A = self._contact.A
        return (A @ v.reshape(-1)).reshape(v.shape) + self._yielding * v

    def _refresh(self) -> None:
        """Take the gradient anew, and begin with it."""
        self._gradient = self._times(self.r) + self._contact.free
        self._split()
        self._direction = self._free.copy()

    def _split(self) -> None:
        """The free and the chopped part of the projected gradient."""
        r = self.r
        g = self._gradient
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
    def a(self) -> Array:
        """Displacements under the forces (m, dim)."""
        return self._gradient - self._yielding * self.r

    @property
    def left(self) -> float:
        """The largest entry of the projected gradient, a length."""
        return float(np.abs(self._free + self._chopped).max())

    @property
    def energy(self) -> float:
        """The value of q at the forces."""
        return float(0.5 * np.sum((self._gradient + self._contact.free) * self.r))

    def step(self) -> None:
        """One step."""
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
        length = float(np.sum(self._gradient * d)) / curvature
        most = self._feasible(d)
        self.r = self.r - min(length, most) * d
        if length <= most:
            self._gradient = self._gradient - length * Ad
            self._split()
            beta = float(np.sum(self._free * Ad)) / curvature
            self._direction = self._free - beta * np.where(self._inside, d, 0.0)
        else:
            self._gradient = self._gradient - most * Ad
            self._split()
            self._expand()

    def _expand(self) -> None:
        """A projected step along the gradient, of a length at which the energy falls."""
        self.r = self._projected(self.r - self._gradient / self._longest)
        self._refresh()

    def _feasible(self, d: Array) -> float:
        """The longest step along -d that stays within the bounds."""
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
