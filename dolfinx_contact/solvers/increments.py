# SPDX-License-Identifier: LGPL-3.0-or-later
"""The load in increments, as one would apply it by hand.

With s from 0 to 1 Dirichlet data go from the displacement at the start to what is prescribed, and
what is left of H at the start fades, H(x, s) = (1 - s) H(x_0, 0): forces that nothing balances (the
loads, from an unloaded body) and the depth of points that begin inside the obstacle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from petsc4py import PETSc

from dolfinx_contact.solvers.states import inverted

if TYPE_CHECKING:
    from dolfinx_contact.solvers.history import Attempt
    from dolfinx_contact.solvers.newton import Newton

__all__ = ["raise_load"]

_SMALLEST = 1e-4  # increment, relative to the first


def raise_load(solver: Newton, x: PETSc.Vec, attempt: Attempt, increments: int) -> bool:
    """Raise the load from 0 to 1 by increments, starting at ``x``. Collective.

    One that fails, or turns the body inside out, is quartered; one that works is doubled.
    """
    eq = solver.equations
    first = 1.0 / increments
    done = 0.0
    step = first
    good = x.duplicate()
    with eq.ramped(x):
        eq.prescribed.part = 0.0
        eq.residual(x, solver.offset)
        try:
            while done < 1.0:
                x.copy(good)
                solver.load = eq.prescribed.part = min(1.0, done + step)
                solved = solver.run(x, attempt)
                if solved and (objection := inverted(eq, x)):
                    solved = False
                    attempt.reason = objection
                if solved:
                    done = solver.load
                    step = 2 * step
                    continue
                good.copy(x)
                step /= 4
                if step < _SMALLEST * first or attempt.gives_up():
                    attempt.reason = f"stuck at {done:.4g} of the load: {attempt.reason}"
                    return False
            return True
        finally:
            good.destroy()
