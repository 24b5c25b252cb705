# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Uzawa's method: projected gradient iteration on the contact forces as multipliers.

Each iteration solves equilibrium for the displacements a under the forces r = (rt, rn) and updates
r <- Pi(r - rho a) with the projection Pi onto rn >= 0 and the friction disc (Arrow, Hurwicz and
Uzawa, Studies in Linear and Non-linear Programming, 1958). It is a gradient method for the dual
problem. With steps rho < 2/|A|, where A is the compliance, it converges for small friction. The
augmented Lagrangian method solves equilibrium with the compliant laws r = Pi(l - rho a) about the
last forces l by Newton's method (`semismooth`). It converges for any rho > 0, in few iterations if
rho is large (Simo and Laursen, Comput. Struct. 42, 1992). Both stop when the relative residual of
the exact laws is below the tolerance. For large friction the forces may cycle or diverge; the
augmented method also fails if Newton's method does not solve the compliant laws.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._validate import flag, positive
from dolfinx_contact.algorithms.iteration import Algorithm, Iteration
from dolfinx_contact.algorithms.semismooth import solve_yielding
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["Uzawa"]

# Step relative to 2/|A|, the limit of convergence of the gradient method without friction.
_SHARE = 0.8
# Stiffness of the augmented method, relative to the augmentation of Newton's method.
_STIFF = 100.0


@dataclass(frozen=True)
class Uzawa(Algorithm):
    """Uzawa's method; one iteration solves equilibrium once.

    Attributes:
        step: factor on the automatic step length, 1.6 k / |k^(1/2) A k^(1/2)| with the augmentation
            k of Newton's method and the compliance A, or 100 k if ``augmented``.
        augmented: whether to use the augmented Lagrangian method.
    """

    name: ClassVar[str] = "uzawa"
    max_iterations: int = 20000
    step: float = 1.0
    augmented: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        positive(self.step, "step")
        flag(self.augmented, "augmented")

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        k = contact.augmentation
        if self.augmented:
            rho = self.step * _STIFF * k
        else:
            root = np.repeat(np.sqrt(k), contact.dim)
            largest = float(np.linalg.eigvalsh(root[:, None] * contact.A * root)[-1])
            rho = self.step * _SHARE * 2.0 / largest * k
        a = contact.displacements(r)
        while not iteration.stops(a, r):
            if self.augmented:
                cold = iteration.outcome.iterations == 0
                a, steps, solved = solve_yielding(contact, a, r, rho, cold=cold)
                if not solved:
                    iteration.fails(
                        f"the compliant contact problem was not solved in {steps} steps"
                    )
                    return
                r = contact.answer(a, r, rho)
            else:
                r = contact.answer(a, r, rho)
                a = contact.displacements(r)
