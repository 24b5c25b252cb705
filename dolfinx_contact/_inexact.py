# SPDX-License-Identifier: LGPL-3.0-or-later
"""Inexact Newton methods: forcing terms, and nonlinear elimination of a few unknowns.

*Forcing terms* are the relative tolerances of the linear systems of Newton steps. The tolerance of
step k is gamma (F_k / F_(k-1))^2 with the norm F_k of the nonlinear residual and a constant gamma,
with the safeguard against accidental decreases (Eisenstat and Walker, SIAM J. Sci. Comput. 17,
1996, choice 2). Additions for kinks:

1. While points change their status, the reduction of the residual does not predict the accuracy of
   the next linear model, so the tolerance keeps its largest value.
2. If the residual finds no new minimum for some steps, or statuses cycle, the largest value
   shrinks, because the inaccuracy of the solves may cause the changes.
3. No step is solved more accurately than the tolerance of the whole solve requires.

Within a linear solve the linear model is tested: its error is the nonlinear residual after the
present step, in the rows of the contact conditions. A linear residual that is smaller than this
error need not be reduced further. (Choice 1 of Eisenstat and Walker compares the two after the
solve.)

*Nonlinear elimination* corrects a few unknowns between Newton steps of all unknowns: Newton steps
for some rows and the corresponding unknowns, while all other unknowns are fixed (Lanzkron, Rose and
Wilkes, SIAM J. Sci. Comput. 17, 1996; truncated nonsmooth Newton multigrid, Graeser and Kornhuber,
J. Comput. Math. 27, 2009). Points at the edge of the contact zone thus find their status without a
step of the whole body. A nearly incompressible body with fixed unknowns is too stiff for this; the
residual then grows considerably, and the correction is discarded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from petsc4py import PETSc

__all__ = ["ROUNDS", "Forcing", "settle"]

_SOON = 1e-3  # smallest reduction of the linear residual between two tests of the model
_FURTHER = 3.0  # smallest factor between two tests of the model


@dataclass
class Forcing:
    """Relative tolerances of successive linear solves.

    Attributes:
        largest: tolerance while many statuses change.
        first: tolerance of the first step, which carries prescribed motions to the surface.
        warm: tolerance of a start close to a solution, where an inaccurate step would change
            statuses that are correct.
        gamma: factor of the squared residual reduction of the last step in the tolerance.
        smallest: lower bound of all tolerances.
        tightest: smallest tolerance while statuses change.
        reserve: tolerance of the last step, relative to the reduction of the residual that is still
            required.
        near: multiple of the target residual; a step expected to end below this multiple is solved
            accurately enough to reach the target.
        many: fraction of the contact points; if the statuses of more points change in a step, the
            tolerance is ``largest``.
        patience: steps without a new minimum of the residual after which tolerances shrink.
        looks: relative linear residual at which the linear model is tested first.
    """

    largest: float = 3e-2
    first: float = 1e-2
    warm: float = 1e-3
    gamma: float = 0.9
    smallest: float = 1e-10
    tightest: float = 1e-6
    reserve: float = 0.3
    near: float = 100.0
    many: float = 0.02
    patience: int = 8
    looks: float = 0.3

    def __post_init__(self) -> None:
        self.restart(warm=False)

    @classmethod
    def in_motion(cls) -> Forcing:
        """Return tolerances for time steps, whose systems the mass matrix conditions well."""
        return cls(largest=1e-1, first=3e-2, warm=3e-2, reserve=0.1, near=30.0)

    def restart(self, *, warm: bool) -> None:
        """Begin a nonlinear solve; ``warm`` indicates a start close to a solution."""
        self._cap = self.warm if warm else self.largest  # largest tolerance at present
        self._last = 0.0  # residual of the last step
        self._eta = 0.0  # tolerance of the last step
        self._least = float("inf")  # smallest residual
        self._waited = 0  # steps since the smallest residual
        self._tested = True  # whether linear models are tested
        self._next = 0.0  # reduction of the linear residual at the next test

    def tighten(self) -> bool:
        """Reduce the largest tolerance; return False if it cannot be reduced further."""
        if self._cap <= self.tightest:
            return False
        self._cap *= 0.03
        self._waited = 0
        self._tested = False
        return True

    def tolerance(self, residual: float, target: float, changed: float) -> float:
        """Return the relative tolerance of the linear solve of the next Newton step.

        Args:
            residual: relative residual of the present iterate.
            target: relative residual at which the solve ends.
            changed: fraction of the points whose status changed in the last step.
        """
        self._waited = 0 if residual < self._least else self._waited + 1
        self._least = min(residual, self._least)
        if self._waited > self.patience:
            self.tighten()
            self._waited = 0
        eta = self._cap if self._last > 0 else min(self._cap, self.first)
        if self._last > 0 and changed <= self.many:
            eta = self.gamma * min(residual / self._last, 1.0) ** 2
            safeguard = self.gamma * self._eta**2
            if safeguard > 0.1:
                eta = max(eta, safeguard)
        least = max(self.reserve * target / max(residual, 1e-300), self.smallest)
        if eta * residual <= self.near * target:
            eta = least
        self._last, self._eta = residual, max(min(eta, self._cap), least)
        self._next = self.looks if self._tested else 0.0
        return self._eta

    def suffices(self, reduction: float, remainder: Callable[[], float]) -> bool:
        """Return whether the linear residual is at most the linear model's error. Collective.

        The error is evaluated only if a test is due.

        Args:
            reduction: ratio of the linear residual to the initial nonlinear residual of the step.
            remainder: function returning the error, divided by the same residual.
        """
        if reduction > self._next:
            return False
        left = remainder()
        if left >= reduction:
            return True
        self._next = min(max(left, _SOON * reduction), reduction / _FURTHER)
        return False


_GROWTH = 10.0  # largest factor by which a correction may enlarge the norm of H
ROUNDS = 2  #: Worthwhile corrections when few points still change their status.


def settle(
    evaluate: Callable[[PETSc.Vec, PETSc.Vec], None],
    correct: Callable[[PETSc.Vec, PETSc.Vec, PETSc.Vec], bool],
    x: PETSc.Vec,
    b: PETSc.Vec,
    d: PETSc.Vec,
    rounds: int,
) -> tuple[bool, bool]:
    """Correct unknowns in place until a correction makes the residual grow. Collective.

    The loop also ends without a correction or after a number of rounds. A correction with a
    considerably larger residual is rejected.

    Args:
        evaluate: function of (x, b) that writes the residual at x into b.
        correct: function of (x, b, d) that stores in d the vector to be subtracted from x and
            returns whether there is a correction.
        x: unknowns, which are corrected.
        b: vector for residuals.
        d: vector for corrections.
        rounds: largest number of corrections.

    Returns:
        Whether ``x`` has changed; and whether the residual was last evaluated at ``x``, not at a
        rejected state.
    """
    changed = False
    at_x = True
    trial = x.duplicate()
    evaluate(x, b)
    for _ in range(rounds):
        if not correct(x, b, d):
            break
        size = b.norm()
        trial.waxpy(-1.0, d, x)
        evaluate(trial, b)
        at_x = bool(b.norm() < _GROWTH * size)  # False for NaN
        if not at_x:
            break
        trial.copy(x)
        changed = True
    trial.destroy()
    return changed, at_x
