# SPDX-License-Identifier: LGPL-3.0-or-later
"""How exactly the linear system of a Newton step is worth solving.

Eisenstat and Walker (SIAM J. Sci. Comput. 17, 1996, choice 2): the relative tolerance of step k is
gamma (F_k / F_(k-1))^2, with their safeguard against a fall by accident. Guards for kinks: while
points change their status the reduction of the residual shows nothing about the model of the next
step, so that the tolerance stays at its largest value; where the residual finds no new minimum for
some steps, or statuses cycle, that value shrinks, since it may be the inexactness that makes them
change; and no step is solved beyond what the tolerance of the whole solve can use.

Within a solve the model is put to the test itself: H after the step so far, in the rows of the
contact conditions, is the remainder of the linear model there, which takes it for zero. Below that
the linear residual is not worth reducing (choice 1 of Eisenstat and Walker compares the same two,
but after the solve).
"""

from __future__ import annotations

from dataclasses import dataclass, field

__all__ = ["Forcing"]

_SOON = 1e-3  # factor of the linear residual after which the model is tested again at the latest
_FURTHER = 3.0  # and at the earliest


@dataclass
class Forcing:
    """Relative tolerances of successive linear solves.

    Attributes:
        largest: the tolerance while many statuses change.
        first: that of the first step, which is to carry prescribed motions to the surface.
        warm: the same for a start that is close to a solution, where an inexact step would make
            statuses change that are right already.
        gamma: factor of the squared reduction.
        smallest: the tightest tolerance.
        tightest: the same while statuses change.
        reserve: part of the remaining reduction that the last step is solved to.
        near: times the target; a step that would end nearer to it is solved to the end.
        many: share of the contact points whose change counts as many.
        patience: steps without a new minimum of the residual before the tolerances shrink.
        looks: reduction of the linear residual at which the model is tested first.
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
    _cap: float = field(default=3e-2, init=False)
    _least: float = field(default=float("inf"), init=False)
    _waited: int = field(default=0, init=False)
    _last: float = field(default=0.0, init=False)
    _eta: float = field(default=0.0, init=False)
    _tested: bool = field(default=False, init=False)
    _next: float = field(default=0.0, init=False)

    @classmethod
    def in_motion(cls) -> Forcing:
        """For steps of time, where mass makes systems well conditioned and a step more is cheap."""
        return cls(largest=1e-1, first=3e-2, warm=3e-2, reserve=0.1, near=30.0)

    def restart(self, *, warm: bool) -> None:
        """Begin anew, from a state that is close to a solution or not."""
        self._cap = self.warm if warm else self.largest
        self._last = self._eta = 0.0
        self._least = float("inf")
        self._waited = 0
        self._tested = True
        self._next = 0.0

    def tighten(self) -> bool:
        """Solve more exactly from now on; False if that is done already."""
        if self._cap <= self.tightest:
            return False
        self._cap *= 0.03
        self._waited = 0
        self._tested = False
        return True

    def tolerance(self, residual: float, target: float, changed: float) -> float:
        """The relative tolerance of the step from a state.

        Args:
            residual: relative residual of the state.
            target: at which the solve ends.
            changed: share of the points that changed their status on the way to the state.
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

    def is_due(self, reduction: float) -> bool:
        """Whether the model is to be tested where the linear residual was reduced so far."""
        return reduction <= self._next

    def suffices(self, reduction: float, remainder: float) -> bool:
        """Whether a solve may end, and when it is to be asked next if not.

        Args:
            reduction: linear residual over H at the beginning of the step.
            remainder: of the linear model, over the same.
        """
        if remainder >= reduction:
            return True
        self._next = min(max(remainder, _SOON * reduction), reduction / _FURTHER)
        return False
