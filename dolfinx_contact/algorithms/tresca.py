# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Fixed-point iteration of Tresca's problems on the friction bounds.

S(g) = F rn(g) maps friction bounds g to the bounds following from the normal forces rn(g) of
Tresca's problem. Coulomb friction is a fixed point of S (Haslinger, Math. Methods Appl. Sci. 5,
1983; Raous, CISM 570, 2017, section 3c). For each g, Tresca's problem is convex and has a unique
solution. The bounds are relaxed, g <- g + omega (S(g) - g), with a fixed relaxation factor omega or
with Aitken's factor, computed from the last two differences (Irons and Tuck, Int. J. Numer. Methods
Eng. 1, 1969). The convex problems are solved by the semismooth Newton method. The iteration stops
when the relative residual of Coulomb's law is below the tolerance. It contracts for small friction
only. For larger friction it converges slowly, or it fails because the bounds repeat in a cycle or a
convex problem is not solved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._validate import flag
from dolfinx_contact.algorithms.iteration import Algorithm, Iteration, check_between
from dolfinx_contact.algorithms.semismooth import solve_semismooth
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["TrescaFixedPoint"]

_SHARE = 0.01  # tolerance of the convex problems, relative to the tolerance


@dataclass(frozen=True)
class TrescaFixedPoint(Algorithm):
    """Fixed-point iteration of Tresca's problems; one iteration solves one Tresca problem.

    Attributes:
        relaxation: relaxation factor omega, between 0 and 2; with ``aitken``, only the first one.
        aitken: whether Aitken's method determines all factors after the first.
    """

    name: ClassVar[str] = "tresca"
    max_iterations: int = 200
    relaxation: float = 1.0
    aitken: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check_between(self.relaxation, "relaxation", 2.0)
        flag(self.aitken, "aitken")

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        g = contact.radius(r[:, -1])
        a = contact.displacements(r)
        omega = self.relaxation
        before: Array | None = None
        steps = 0
        tolerance = _SHARE * iteration.tolerance
        while not iteration.stops(a, r, g, inner=steps):
            a, steps, solved = solve_semismooth(contact.given(g), a, tolerance=tolerance)
            r = contact.forces(a)
            if not solved:
                iteration.stops(a, r, g, inner=steps)
                iteration.fails(f"Tresca's problem was not solved in {steps} steps")
                return
            off = contact.radius(r[:, -1]) - g
            if self.aitken and before is not None:
                change = off - before
                square = float(change @ change)
                if square > 0:
                    omega = float(np.clip(-omega * float(before @ change) / square, 0.05, 2.0))
            before = off
            g = np.maximum(g + omega * off, 0.0)
