# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bonds that break one after the other, held in turn and released.

Where many bonds weaken in one step, and slip as they do, Newton's method goes to and fro between
statuses: a bond that softens pushes its neighbours, and these it. Here the strengths of all bonds
are held, contact and friction are solved with them, then each bond is as weak as the law has it at
that state, and so on (the alternate minimisation of Bourdin, Francfort and Marigo, J. Mech. Phys.
Solids 48, 2000). In this order no bond ever grows stronger, so that strengths converge whatever
the step: where the state jumps, bonds go one by one until the next state is reached. It is handed
to Newton's method when it is near.
"""

from __future__ import annotations

from collections.abc import Callable

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.substitute import HeldBonds
from dolfinx_contact.laws import Law
from dolfinx_contact.solvers.history import Attempt
from dolfinx_contact.solvers.linear import LinearSolver
from dolfinx_contact.solvers.newton import Newton
from dolfinx_contact.solvers.pivoting import pivot

__all__ = ["have_bonds", "release_bonds"]

Array = npt.NDArray[np.float64]

_NEAR = 1e-2, 1e-3, 1e-4, 1e-6, 1e-8  # changes of the strengths after which Newton's method may end
_HELD_RESIDUAL = 1e-9  # residual with bonds that are held, which is none of the law's
_ROUNDS = 2000  # at most


def have_bonds(eq: ContactEquations) -> bool:
    """Whether bonds of a surface weaken, and none of them can grow again."""
    return any(_strength(s.law) is not None for s in eq.surfaces)


def release_bonds(
    eq: ContactEquations, linear: Callable[[], LinearSolver], x: PETSc.Vec, attempt: Attempt
) -> bool:
    """Solve from ``x``, which is overwritten, by strengths that only fall. Collective."""
    names = [_strength(s.law) for s in eq.surfaces]
    strengths = [
        None if name is None else c.data.fields[name].copy()
        for name, c in zip(names, eq.contact(x).surfaces, strict=True)
    ]
    near = list(_NEAR)
    for rounds in range(1, _ROUNDS + 1):
        held = HeldBonds(eq, strengths)
        if not _solve(held, linear, x, attempt):
            attempt.reason = f"bonds that are held, round {rounds}: {attempt.reason}"
            return False
        change = _weaken(eq, x, strengths)
        if change <= near[0]:
            y = x.copy()
            solved = _end(eq, linear, y, attempt)
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


def _strength(law: Law) -> str | None:
    """The field by which bonds weaken; None where there is none, or more is remembered."""
    if law.weakening is None or not all(x.is_field for x in law.internal):
        return None
    return law.weakening.name


def _solve(
    held: HeldBonds, linear: Callable[[], LinearSolver], x: PETSc.Vec, attempt: Attempt
) -> bool:
    """Contact and friction with the bonds as they are held. Collective."""
    start = x.copy()
    try:
        for run in (Newton.run, pivot):
            with Newton(held, linear(), "none", None) as solver:
                tolerance = solver.snes.getTolerances()[0]
                solver.snes.setTolerances(rtol=max(tolerance, _HELD_RESIDUAL))
                if run(solver, x, attempt):
                    return True
            start.copy(x)
        return False
    finally:
        start.destroy()


def _weaken(eq: ContactEquations, x: PETSc.Vec, strengths: list[Array | None]) -> float:
    """Take the strengths that the law has at a state, where they are less; the largest change.

    Collective.
    """
    change = 0.0
    for i, (s, found) in enumerate(zip(eq.surfaces, eq.contact(x).surfaces, strict=True)):
        before = strengths[i]
        if before is None:
            continue
        bond = s.law.weakening
        assert bond is not None
        now = found.answers.bond(f"after.{bond.name}")
        after = np.maximum(before, now) if bond.sense > 0 else np.minimum(before, now)
        change = max(change, float(np.max(np.abs(after - before), initial=0.0)))
        strengths[i] = after
    return float(eq.comm.allreduce(change, op=np.maximum))


def _end(
    eq: ContactEquations, linear: Callable[[], LinearSolver], x: PETSc.Vec, attempt: Attempt
) -> bool:
    """Newton's method with the law itself, its statuses at the state held in the first step."""
    with Newton(eq, linear(), "none", None) as solver:
        solver.held = eq.contact(x).statuses
        solver.most = 1
        start = x.copy()
        if not solver.run(x, attempt):
            start.copy(x)
        start.destroy()
        solver.held = solver.most = None
        return solver.run(x, attempt)
