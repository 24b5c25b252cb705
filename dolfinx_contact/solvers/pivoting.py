# SPDX-License-Identifier: LGPL-3.0-or-later
"""Piece by piece: solve H with the status held, then change the status of points that object.

Block principal pivoting with a safeguard (Judice and Pires, Computers & Operations Research 21,
1994): as long as the number of objecting points reaches new minima all of them change at once;
after some rounds without a new minimum only the last of them, in order of coordinates, changes
(Murty's rule). For a linear bulk in 2D and small friction each round is a step of a method for
linear complementarity problems that is known to end.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.solvers.history import Attempt
    from dolfinx_contact.solvers.newton import Newton

__all__ = ["pivot"]

_PATIENCE = 4  # rounds without a new minimum of objections before single changes


def pivot(solver: Newton, x: PETSc.Vec, attempt: Attempt) -> bool:
    """Solve by pivoting from ``x``, which is overwritten. Collective."""
    problem = solver.problem
    points = sum(s.points.dofmap.index_map.size_global for s in problem.surfaces)
    fewest, patience = points + 1, _PATIENCE
    problem.read(x)
    problem.update_status()
    for _ in range(20 + 4 * min(points, 100)):
        with problem.status_held():
            solved = solver.run(x, attempt)
            if attempt.gives_up():
                return False
            if not solved and not np.isfinite(attempt.steps[-1].measures.worst):
                return False
            asked = [s.evaluate_status() for s in problem.surfaces]
            held = problem.statuses
            objecting = [a.differs(b) for a, b in zip(asked, held, strict=True)]
            count = _count(problem, objecting)
            if count < fewest:
                fewest, patience = count, _PATIENCE
            else:
                patience -= 1
            if count > 0 and patience < 0:
                objecting = _last(problem, objecting)
            problem.statuses = [
                a.where(o, b) for a, b, o in zip(asked, held, objecting, strict=True)
            ]
        if count == 0:
            # Every status is the one asked for: the piece's solution solves H.
            return solver.run(x, attempt)
    attempt.reason = f"{fewest} points keep objecting to their status"
    return False


def _count(problem: ContactProblem, objecting: list[npt.NDArray[np.bool_]]) -> int:
    own = zip(objecting, problem.surfaces, strict=True)
    return int(problem.comm.allreduce(sum(int(o[: s.num_owned_points].sum()) for o, s in own)))


def _last(
    problem: ContactProblem, objecting: list[npt.NDArray[np.bool_]]
) -> list[npt.NDArray[np.bool_]]:
    """Only the objecting point that comes last: by surface, then by coordinates. Collective."""
    keys = []
    for i, (s, o) in enumerate(zip(problem.surfaces, objecting, strict=True)):
        places = np.asarray(np.round(s.positions / problem.body_size, 9))
        keys.append([(i, *places[j]) if o[j] else (-1,) for j in range(len(o))])
    mine = max((k for surface in keys for k in surface), default=(-1,))
    last = max(problem.comm.allgather(mine))
    return [np.array([k == last for k in surface], dtype=bool) for surface in keys]
