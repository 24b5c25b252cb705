# SPDX-License-Identifier: LGPL-3.0-or-later
"""When a correction keeps the matrix of the one before: a chord.

Chords take the place of the last step of Newton's method: where that would reach the tolerance, and
a few chords do as well (C. T. Kelley, Iterative Methods for Linear and Nonlinear Equations, SIAM
1995, section 5.4). So a point is where it would have led, and steps are as long.
"""

from __future__ import annotations

__all__ = ["Chords"]

_MOST = 5  # in a row


class Chords:
    """Counts the corrections of a run.

    Attributes:
        number: chords since the last matrix.
    """

    def __init__(self) -> None:
        self.begin(kept=False)

    def begin(self, *, kept: bool) -> None:
        """A run begins; ``kept`` says that it has a matrix already."""
        self._kept = self._serves = kept
        self._matrices = 0
        self.number = 0

    def new_matrix(self, *, serves: bool) -> None:
        """A correction has a matrix of its own, which ``serves`` others if that is cheap."""
        self._kept = False
        self._serves = serves
        self._matrices += 1
        self.number = 0

    @property
    def iterations(self) -> int:
        """Steps of Newton's method that the run is worth: chords in a row are one."""
        return self._matrices + int(self.number > 0)

    def lead_on(self, error: float, before: float, tolerance: float) -> bool:
        """Whether the next correction keeps the matrix.

        Args:
            error: the relative residual.
            before: that of the correction before; 0 at the first.
            tolerance: to be reached.
        """
        if not self._serves or self.number >= _MOST:
            return False
        if before == 0:
            return True
        rate = error / before
        # The error of the next step of Newton's method, by a rate that falls with the error.
        steps = _MOST - self.number if self._kept or self.number else 2
        return bool(error * rate**steps <= tolerance)
