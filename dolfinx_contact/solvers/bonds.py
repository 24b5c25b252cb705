# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strategy that holds and releases weakening bonds in turn.

If many bonds weaken in one step and slip at the same time, Newton's method cycles between statuses:
a softening bond pushes its neighbours, and they push it. This strategy is the alternate
minimisation of Bourdin, Francfort and Marigo (J. Mech. Phys. Solids 48, 2000):

1. the strengths of all bonds are frozen, and contact and friction are solved with them;
2. the strength of each bond is reduced to the value given by the law at that state, if this is
   smaller;
3. when the strengths hardly change any more, Newton's method continues with the law itself.

No bond ever grows stronger, so the strengths converge for any step. Where the state jumps, bonds
break one by one until the next state is reached.
"""

from __future__ import annotations

from dataclasses import replace

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._mpi import maximum
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.solvers.attempts import Attempt
from dolfinx_contact.solvers.block_pivoting import pivot
from dolfinx_contact.solvers.newton import LinearSolver, Newton

__all__ = ["release_bonds"]


#: Successive changes of the strengths below which Newton's method is tried.
_NEAR = 1e-2, 1e-3, 1e-4, 1e-6, 1e-8
_FROZEN_RESIDUAL = 1e-9  # relative residual that suffices while bonds are frozen
_ROUNDS = 2000  # largest number of rounds


def release_bonds(solver: Newton, x: PETSc.Vec, attempt: Attempt) -> bool:
    """Solve from ``x``, which is overwritten, with decreasing bond strengths. Collective.

    Args:
        solver: Newton's method.
        x: start, which is overwritten.
        attempt: attempt recording the iterates.

    Returns:
        Whether a solution was found.
    """
    eq = solver.equations
    strengths = [
        c.data.fields[s.law.weakening.name].copy() if s.law.weakens and s.law.weakening else None
        for s, c in zip(eq.surfaces, eq.evaluate_contact(x).surfaces, strict=True)
    ]
    near = list(_NEAR)
    for rounds in range(1, _ROUNDS + 1):
        pairs = zip(eq.terms, strengths, strict=True)
        frozen = eq.with_terms([replace(term, strength=strength) for term, strength in pairs])
        if not _solve(frozen, solver.linear, x, attempt):
            attempt.reason = f"at fixed bond strengths, round {rounds}: {attempt.reason}"
            return False
        change = _weaken(eq, x, strengths)
        if change <= near[0]:
            y = x.copy()
            with Newton(eq, solver.linear, "none", None) as whole:
                solved = whole.run_from_statuses(y, attempt, eq.evaluate_contact(y).statuses)
            if solved:
                y.copy(x)
            y.destroy()
            if solved:
                return True
            near = [n for n in near[1:] if n < change] or near[-1:]
            if change == 0.0:
                return False
        if attempt.gives_up():
            return False
    attempt.reason = f"bonds still weaken after {_ROUNDS} rounds"
    return False


def _solve(frozen: ContactEquations, linear: LinearSolver, x: PETSc.Vec, attempt: Attempt) -> bool:
    """Solve contact and friction while the strengths of the bonds are frozen. Collective."""
    start = x.copy()
    try:
        for run in (Newton.run, pivot):
            with Newton(frozen, linear, "none", None) as solver:
                solver.tolerance = max(solver.tolerance, _FROZEN_RESIDUAL)
                if run(solver, x, attempt):
                    return True
            start.copy(x)
        return False
    finally:
        start.destroy()


def _weaken(eq: ContactEquations, x: PETSc.Vec, strengths: list[Array | None]) -> float:
    """Reduce bond strengths, in place, to the strengths by the law at a state. Collective.

    Returns:
        Largest change of a strength.
    """
    change = 0.0
    for i, (s, contact) in enumerate(
        zip(eq.surfaces, eq.evaluate_contact(x).surfaces, strict=True)
    ):
        before = strengths[i]
        if before is None:
            continue
        bond = s.law.weakening
        assert bond is not None
        now = contact.answers.bond(f"after.{bond.name}")
        after = np.maximum(before, now) if bond.sense > 0 else np.minimum(before, now)
        change = max(change, float(np.max(np.abs(after - before), initial=0.0)))
        strengths[i] = after
    return maximum(eq.comm, change)
