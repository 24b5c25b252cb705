# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear elimination: corrections of a few unknowns between Newton steps of all unknowns.

The corrections are Newton steps of some rows for their own unknowns, with the others held
(Lanzkron, Rose and Wilkes, SIAM J. Sci. Comput. 17, 1996; truncated nonsmooth Newton multigrid,
Graeser and Kornhuber, J. Comput. Math. 27, 2009). Points at the edge of the contact thus find their
status without a step of the whole body. A nearly incompressible body with held unknowns is too
stiff for this; H then grows considerably, and the correction is discarded.
"""

from __future__ import annotations

from collections.abc import Callable

from petsc4py import PETSc

__all__ = ["ROUNDS", "settle"]

_GROWTH = 10.0  # largest factor by which a correction may enlarge the norm of H
ROUNDS = 2  #: Worthwhile corrections when few points still change their status.


def settle(
    evaluate: Callable[[PETSc.Vec, PETSc.Vec], None],
    correct: Callable[[PETSc.Vec, PETSc.Vec, PETSc.Vec], bool],
    x: PETSc.Vec,
    b: PETSc.Vec,
    d: PETSc.Vec,
    rounds: int,
) -> bool:
    """Correct ``x`` in place and return whether it has changed. Collective.

    Args:
        evaluate: function of (x, b) that writes H(x) into b.
        correct: function of (x, b, d) that writes the vector to subtract from x into d and returns
            whether there is a correction.
        x: unknowns.
        b: vector for residuals.
        d: vector for corrections.
        rounds: largest number of corrections.
    """
    changed = False
    trial = x.duplicate()
    evaluate(x, b)
    for _ in range(rounds):
        if not correct(x, b, d):
            break
        size = b.norm()
        trial.waxpy(-1.0, d, x)
        evaluate(trial, b)
        if not b.norm() < _GROWTH * size:  # also if it is NaN
            break
        trial.copy(x)
        changed = True
    trial.destroy()
    return changed
