# SPDX-License-Identifier: LGPL-3.0-or-later
"""All solutions of the rate problem at the start of a quasi-static step.

Where a step begins every point that slips is at the border of stick, with the memory of the state.
The directions in which the state can continue, while the load continues to that of the end of the
step, solve a problem of cones (`continuation.rays`), memory frozen. There may be several: with
friction beyond a bound a point at the border can stick or slip under one and the same rate of the
load (Klarbring, Ing.-Arch. 60, 1990); or none, if all pieces were tried, and then the state jumps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dolfinx_contact.continuation.rays import outgoing
from dolfinx_contact.equations.evaluation import Statuses
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.reduced.reduction import Reduction
from dolfinx_contact.reduced.scope import can_condense
from dolfinx_contact.solvers.following import Loaded

__all__ = ["StepRays", "number_of_points", "rays_of_step"]

_AT_BORDER = 1e-8  # of the largest number of a state: a border


@dataclass(frozen=True)
class StepRays:
    """Solutions of the rate problem.

    Attributes:
        statuses: of each, surface by surface on this rank.
        complete: whether it is proved that there are no others.
        method: how they were found, in words.
    """

    statuses: tuple[Statuses, ...]
    complete: bool
    method: str


def number_of_points(problem: ContactProblem) -> int:
    """Contact points of all surfaces and ranks. Collective."""
    return int(problem.comm.allreduce(sum(s.points.number for s in problem.surfaces)))


def rays_of_step(problem: ContactProblem) -> StepRays | None:
    """The directions that lead out of the state in a problem. Collective.

    Args:
        problem: problem of a step (`ContactProblem.step_from`), with the start of the step in its
            Functions and the data of its end.

    Returns:
        None where statuses are no polyhedral cones (`reduced.scope`), data of the surfaces
        change in the step, or the body is singular although its contact points are held.
    """
    eq = problem.equations
    x = problem.create_vector()
    problem.write(x)
    try:
        with eq.ramped(x):
            eq.prescribed.part = 0.0
            system = Loaded(eq, lambda: problem.linear_solver, x)
            try:
                if not can_condense(system) or not system.leaves_surfaces_alone():
                    return None
                try:
                    condensed = Reduction(system, x, 0.0, exact=False)
                except RuntimeError:
                    return None
                try:
                    w = condensed.contract(x)
                    cone = condensed.system.tangent_cone(w, _AT_BORDER * float(np.abs(w).max()))
                    found = outgoing(cone)
                    pieces = [condensed.piece(r.codes) for r in found.rays if r.rate > 0]
                finally:
                    condensed.destroy()
                statuses = [system.statuses_of(piece) for piece in pieces]
                kept = tuple(s for s in statuses if s is not None)
                return StepRays(kept, found.complete, found.method)
            finally:
                system.destroy()
    finally:
        x.destroy()
