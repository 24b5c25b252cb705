# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Fixed-point iteration of Tresca's problems on the friction bounds.

S(g) = F rn(g) maps friction bounds g to the bounds that follow from the normal forces rn(g) of
Tresca's problem. Coulomb friction is a fixed point of S (Haslinger, Math. Methods Appl. Sci. 5,
1983; Raous, CISM 570, 2017, section 3c). For each g, Tresca's problem is convex and has a unique
solution. The bounds are relaxed, g <- g + omega (S(g) - g), with a fixed omega or with Aitken's,
computed from the last two differences (Irons and Tuck, Int. J. Numer. Methods Eng. 1, 1969). The
convex problems are solved

- ``"newton"``: by the semismooth Newton method,
- ``"cg"``: by projected conjugate gradients on the forces (`projected_cg`),
- ``"minimise"``: by minimising a.S a/2 - p.a + sum g |ut| over un >= 0 with accelerated proximal
  gradients, restarted if the energy would increase (Beck and Teboulle, SIAM J. Imaging Sci. 2,
  2009; O'Donoghue and Candes, Found. Comput. Math. 15, 2015), so that it decreases in every step,
- ``"interior-point"``: by a primal-dual interior point method (`interior_point`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from dolfinx_contact.algorithms.interior_point import follow_centre
from dolfinx_contact.algorithms.iteration import Algorithm, Iteration, check
from dolfinx_contact.algorithms.point_problem import PointProblem
from dolfinx_contact.algorithms.projected_cg import GivenBound
from dolfinx_contact.algorithms.semismooth import solve_semismooth

__all__ = ["BoundRelaxation", "TrescaFixedPoint", "minimise"]

Array = npt.NDArray[np.float64]
Inner = Literal["newton", "cg", "minimise", "interior-point"]
_INNER = ("newton", "cg", "minimise", "interior-point")
_SHARE = 0.01  # tolerance of the convex problems, relative to the tolerance
_MOST = 20000  # largest number of steps in a convex problem


@dataclass(frozen=True)
class TrescaFixedPoint(Algorithm):
    """Fixed-point iteration of Tresca's problems; an iteration solves one such problem.

    Attributes:
        relaxation: relaxation factor omega, between 0 and 2; the first factor if ``aitken``.
        aitken: whether Aitken's method determines the following factors.
        inner: solver of the convex problems, ``newton``, ``cg``, ``minimise`` or
            ``interior-point``; on the whole body always Newton's method.
        on: ``body`` for the finite element problem, ``points`` for the reduced problem.
    """

    name: ClassVar[str] = "tresca"
    max_iterations: int = 200
    relaxation: float = 1.0
    aitken: bool = False
    inner: Inner = "newton"
    on: Literal["points", "body"] = "body"

    def __post_init__(self) -> None:
        super().__post_init__()
        check(
            self,
            relaxation=0 < self.relaxation < 2,
            inner=self.inner in _INNER,
            on=self.on in ("points", "body"),
        )

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        relaxed = BoundRelaxation(self.relaxation, aitken=self.aitken)
        g = contact.radius(r[:, -1])
        a = contact.displacements(r)
        steps = 0
        tolerance = _SHARE * iteration.trend.tolerance
        while not iteration.stops(a, r, g, inner=steps):
            given = contact.given(g)
            if self.inner == "newton":
                a, steps, solved = solve_semismooth(given, a, tolerance=tolerance)
            elif self.inner == "cg":
                a, steps, solved = _by_gradients(given, r, tolerance)
            elif self.inner == "minimise":
                energies: list[float] = []
                a, steps, solved = minimise(given, a, tolerance, energies)
                iteration.outcome.series.setdefault("energy", []).extend(energies)
            else:
                a, steps, solved = follow_centre(given, tolerance)
            r = contact.forces(a)
            if not solved:
                iteration.stops(a, r, g, inner=steps)
                iteration.fails(f"Tresca's problem was not solved in {steps} steps")
                return
            g = relaxed(g, contact.radius(r[:, -1]))


class BoundRelaxation:
    """Relaxation of a fixed-point iteration on nonnegative bounds.

    Args:
        omega: relaxation factor of all steps, or of the first step if ``aitken``.
        aitken: whether Aitken's method determines the following factors.
        total: function that sums an array over all ranks.
    """

    def __init__(
        self, omega: float, *, aitken: bool, total: Callable[[Array], Array] = lambda v: v
    ):
        self._omega = omega
        self._aitken = aitken
        self._total = total
        self._before: Array | None = None

    def __call__(self, g: Array, image: Array) -> Array:
        """Return the next bounds from the bounds ``g`` and their image S(g)."""
        off = image - g
        if self._aitken and self._before is not None:
            change = off - self._before
            products = self._total(np.array([self._before @ change, change @ change]))
            if products[1] > 0:
                omega = -self._omega * float(products[0] / products[1])
                self._omega = float(np.clip(omega, 0.05, 2.0))
        self._before = off
        return np.maximum(g + self._omega * off, 0.0)


def _by_gradients(given: PointProblem, r: Array, tolerance: float) -> tuple[Array, int, bool]:
    """Solve Tresca's problem by projected conjugate gradients.

    Returns:
        Displacements (m, dim), the number of steps, and whether they converged.
    """
    inner = GivenBound(given, given.bound, r)
    least = tolerance * given.length
    while inner.left > least and inner.products < _MOST:
        inner.step()
    return given.displacements(inner.r), inner.products, inner.left <= least


def minimise(
    given: PointProblem, a: Array, tolerance: float, energies: list[float]
) -> tuple[Array, int, bool]:
    """Minimise the energy of Tresca's problem by accelerated proximal gradients.

    Args:
        given: Tresca's problem.
        a: initial displacements, shape (m, dim).
        tolerance: length of the last step, relative to the largest displacement.
        energies: list to which the energies of all iterates are appended; they do not increase.

    Returns:
        Displacements (m, dim), the number of steps, and whether they converged.
    """
    step = 1.0 / float(np.linalg.eigvalsh(given.S)[-1])
    shrinkage = step * given.bound

    def near(b: Array) -> Array:
        """Return the proximal point after a gradient step from ``b``."""
        b = b - step * given.forces(b)
        size = np.linalg.norm(b[:, :-1], axis=1)
        kept = np.maximum(1.0 - shrinkage / np.maximum(size, 1e-300), 0.0)
        return np.column_stack([kept[:, None] * b[:, :-1], np.maximum(b[:, -1], 0.0)])

    a = np.column_stack([a[:, :-1], np.maximum(a[:, -1], 0.0)])
    energies.append(given.energy(a))
    y = a
    speed = 1.0
    for steps in range(1, _MOST + 1):
        new = near(y)
        if given.energy(new) > energies[-1]:
            new = near(a)  # without momentum the energy decreases up to round-off
            speed = 1.0
        energies.append(min(given.energy(new), energies[-1]))
        faster = 0.5 * (1 + np.sqrt(1 + 4 * speed**2))
        y = new + (speed - 1) / faster * (new - a)
        moved = float(np.abs(near(new) - new).max())
        a = new
        speed = faster
        if moved <= tolerance * max(given.length, float(np.abs(a).max())):
            return a, steps, True
    return a, _MOST, False
