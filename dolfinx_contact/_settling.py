# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear elimination: a few unknowns put right between the Newton steps of all.

Newton steps on some rows for their own unknowns, with the others held (Lanzkron, Rose and Wilkes,
SIAM J. Sci. Comput. 17, 1996; truncated nonsmooth Newton multigrid, Graeser and Kornhuber, J.
Comput. Math. 27, 2009): points at the edge of the contact settle their status without a step of the
whole body for each. A nearly incompressible body that is held is too stiff for that; H then grows
much, and the correction is not taken.
"""

from __future__ import annotations

from collections.abc import Callable

from petsc4py import PETSc

__all__ = ["ROUNDS", "settle"]

_GROWTH = 10.0  # of the norm of H that a correction may cause
ROUNDS = 2  #: Corrections that pay where few points are left to change their status.


def settle(
    evaluate: Callable[[PETSc.Vec, PETSc.Vec], None],
    correct: Callable[[PETSc.Vec, PETSc.Vec, PETSc.Vec], bool],
    x: PETSc.Vec,
    b: PETSc.Vec,
    d: PETSc.Vec,
    rounds: int,
) -> bool:
    """Correct ``x`` in place; whether that changed it. Collective.

    Args:
        evaluate: called as (x, b), puts H(x) into b.
        correct: called as (x, b, d), puts into d what to subtract from x; False if there is nothing
            to correct.
        x: state.
        b: for residuals.
        d: for corrections.
        rounds: corrections at most.
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
        if not b.norm() < _GROWTH * size:  # NaN is no improvement either
            break
        trial.copy(x)
        changed = True
    trial.destroy()
    return changed
