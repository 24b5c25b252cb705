# SPDX-License-Identifier: LGPL-3.0-or-later
"""A solution of a plane problem by Lemke's method on its contact points.

The body is condensed onto its contact points (`reduced.Reduction`), where Lemke's method ends in a
solution for every friction if the reduced stiffness is positive definite (`algorithms.lemke`).
"""

from __future__ import annotations

from collections.abc import Callable

from petsc4py import PETSc

from dolfinx import fem

from dolfinx_contact._errors import on_root
from dolfinx_contact.algorithms import RayTermination, coulomb_by_lemke
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.parametric import ParametricEquations
from dolfinx_contact.reduced.reduction import Reduction
from dolfinx_contact.reduced.scope import can_condense
from dolfinx_contact.solvers.history import Attempt
from dolfinx_contact.solvers.linear import LinearSolver

__all__ = ["solve_reduced"]


def solve_reduced(
    equations: ContactEquations,
    linear: Callable[[], LinearSolver],
    x: PETSc.Vec,
    attempt: Attempt,
) -> bool:
    """Put a solution by Lemke's method into ``x``, at which the body is condensed. Collective.

    Where the problem is not one that it solves the attempt has the reason.
    """
    system = ParametricEquations(equations, fem.Constant(equations.V.mesh, 0.0), linear)
    reduction: Reduction | None = None
    known = all(s.law.bound_kind == "proportional" for s in equations.surfaces)
    try:
        if not known or not can_condense(system, partly=True):
            attempt.reason = "needs contact at the nodes with Coulomb's law or without friction"
            return False
        reduction = Reduction(system, x, 0.0, exact=True)
        problem = reduction.problem(unit=reduction.force_unit)
        w, _ = on_root(
            equations.comm, lambda: coulomb_by_lemke(problem.S, problem.p, problem.friction)
        )
        reduction.expand(w, 0.0, x)
    except (RayTermination, ValueError, RuntimeError) as error:
        attempt.reason = str(error)
        return False
    finally:
        if reduction is not None:
            reduction.destroy()
        system.destroy()
    return True
