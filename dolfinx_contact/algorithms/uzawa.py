# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Uzawa's method: the contact force as a multiplier, raised by what the body violates.

The body is brought to rest under forces r; then r <- Pi(r - rho a), with the projection Pi on
rn >= 0 and on the friction disc. It is a gradient method for the dual problem, and with steps
rho < 2/|A| of the compliance A it converges for small friction. The augmented method lets contact
yield by rho about the force (`semismooth`), brings the body to rest by Newton's method with it, and
takes r <- Pi(r - rho a) there: then any rho > 0 will do, and a large one takes few iterations
(Simo and Laursen, Comput. Struct. 42, 1992).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from dolfinx_contact.algorithms.iteration import Algorithm, Iteration, check
from dolfinx_contact.algorithms.point_problem import PointProblem
from dolfinx_contact.algorithms.semismooth import solve_yielding

__all__ = ["Uzawa"]

Array = npt.NDArray[np.float64]
#: Of 2/|A|, the longest step with which the gradient method converges without friction.
SHARE = 0.8
#: Times the augmentation of Newton's method, with which contact yields about its force.
STIFF = 100.0


@dataclass(frozen=True)
class Uzawa(Algorithm):
    """Uzawa's method; an iteration is an equilibrium of the body.

    Attributes:
        step: over the automatic one, which is 0.8 of 2/|A|, in the augmented method 100 times the
            augmentation of Newton's method.
        augmented: whether contact yields about its force.
        on: ``body`` for the whole finite element problem, ``points`` for the reduced one.
            Integral contact is refused but for the augmented method on the body.
    """

    name: ClassVar[str] = "uzawa"
    max_iterations: int = 20000
    step: float = 1.0
    augmented: bool = False
    on: Literal["points", "body"] = "body"

    def __post_init__(self) -> None:
        super().__post_init__()
        check(self, step=self.step > 0, on=self.on in ("points", "body"))

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        k = contact.augmentation
        if self.augmented:
            rho = self.step * STIFF * k
        else:
            root = np.repeat(np.sqrt(k), contact.dim)
            largest = float(np.linalg.eigvalsh(root[:, None] * contact.A * root)[-1])
            rho = self.step * SHARE * 2.0 / largest * k
        a = contact.displacements(r)
        while not iteration.stops(a, r):
            if self.augmented:
                cold = iteration.trend.count == 0
                a, steps, solved = solve_yielding(contact, a, r, rho, cold=cold)
                if not solved:
                    iteration.fails(f"contact that yields was not solved in {steps} steps")
                    return
                r = contact.answer(a, r, rho)
            else:
                r = contact.answer(a, r, rho)
                a = contact.displacements(r)
