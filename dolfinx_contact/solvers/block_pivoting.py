# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pivoting: solve H = 0 with fixed statuses, then change the statuses that the solution violates.

Block principal pivoting with a safeguard (Judice and Pires, Computers & Operations Research 21,
1994). A contact point *objects* if the solution requires a status other than the prescribed one.

1. Solve H = 0 with prescribed statuses.
2. As long as the number of objecting points reaches new minima, all of them change their status.
3. After some rounds without a new minimum, only the last objecting point in the order of
    coordinates changes its status (Murty's rule). To reverse its slip, it first sticks for one
    round.

For a linear body in 2D and small friction each round is a step of a method for linear
complementarity problems that is known to terminate.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Codes, Mask
from dolfinx_contact._mpi import count_of
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import differs
from dolfinx_contact.laws.status import MINUS, PLUS, STICK, senses
from dolfinx_contact.solvers.attempts import Attempt
from dolfinx_contact.solvers.newton import Newton

__all__ = ["pivot"]


_PATIENCE = 4  # rounds without a new minimum of objections before single changes


def pivot(solver: Newton, x: PETSc.Vec, attempt: Attempt) -> bool:
    """Solve by pivoting from ``x``, which is overwritten; return success. Collective."""
    eq = solver.equations
    points = sum(s.points.number_everywhere for s in eq.surfaces)
    fewest = points + 1
    patience = _PATIENCE
    prescribed = eq.evaluate_contact(x).statuses
    for _ in range(20 + 4 * min(points, 100)):
        solved = solver.run(x, attempt, prescribed=prescribed)
        if attempt.gives_up():
            return False
        if not solved and not np.isfinite(attempt.steps[-1].measures.worst):
            return False
        required = eq.evaluate_contact(x).statuses
        objecting = differs(required, prescribed)
        count = count_of(eq.comm, np.concatenate(objecting))
        if count < fewest:
            fewest = count
            patience = _PATIENCE
        else:
            patience -= 1
        if count > 0 and patience < 0:
            objecting = _last(eq, objecting)
            required = [_by_stick(a, b) for a, b in zip(required, prescribed, strict=True)]
        prescribed = [
            np.where(o, a, b) for o, a, b in zip(objecting, required, prescribed, strict=True)
        ]
        if count == 0:
            # Every status is the required one: the solution of the piece solves H.
            return solver.run(x, attempt)
    attempt.reason = f"{fewest} points keep objecting to their status"
    return False


def _by_stick(required: Codes, prescribed: Codes) -> Codes:
    """Return the required statuses, but stick at points whose slip would be reversed."""
    before = senses(prescribed)
    after = senses(required)
    turns = (before != after) & np.isin(before, (PLUS, MINUS)) & np.isin(after, (PLUS, MINUS))
    return np.where(turns, prescribed + STICK - before, required).astype(np.int8)


def _last(eq: ContactEquations, objecting: list[Mask]) -> list[Mask]:
    """Return the mask of the last objecting point, in the order of coordinates. Collective."""
    keys = []
    for i, (s, o) in enumerate(zip(eq.surfaces, objecting, strict=True)):
        places = np.asarray(np.round(s.positions / eq.body_size, 9))
        ids = s.points.ids
        keys.append([(i, *places[j], *ids[j]) if o[j] else (-1,) for j in range(len(o))])
    mine = max((k for surface in keys for k in surface), default=(-1,))
    last = max(eq.comm.allgather(mine))
    return [np.array([k == last for k in surface], dtype=bool) for surface in keys]
