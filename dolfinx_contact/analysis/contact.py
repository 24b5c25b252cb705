# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is proved of a body: its problem reduced to the contact points, and where that is none."""

from __future__ import annotations

import time

import numpy as np

from dolfinx_contact._progress import Line
from dolfinx_contact.analysis.reduced_problem import ReducedProblem
from dolfinx_contact.analysis.solutions import ProvedSolutions, prove_solutions
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.laws import Coulomb, Frictionless
from dolfinx_contact.reduced.condensed import CondensedContact

__all__ = ["obstacle_to_proof", "proved", "reduced_problem"]

_PATIENCE = 3.0  # seconds before something is said


def obstacle_to_proof(equations: ContactEquations, condensed: CondensedContact | None) -> str:
    """Why nothing can be proved of a problem; "" if something can.

    Args:
        equations: of the problem.
        condensed: the problem condensed onto its contact points; None if that cannot be done.
    """
    if not all(type(s.law) in (Coulomb, Frictionless) for s in equations.surfaces):
        return "proofs are for Coulomb's law and contact without friction"
    if condensed is None or not condensed.exact:
        return "the problem is not linear in 2D, with contact at nodes, but for the law of contact"
    if not condensed.always_solvable:
        return "the stiffness of the body at its contact points is not positive definite"
    return ""


def reduced_problem(condensed: CondensedContact, gamma: float) -> ReducedProblem:
    """S, p and friction at ``gamma``, with what the factorisation may be off. Not collective.

    Args:
        condensed: exact, and without an `obstacle_to_proof`.
        gamma: parameter.

    Raises:
        ValueError: if S is not positive definite beyond its error, or a number is not finite.
    """
    system = condensed.system
    S = system.matrix[:, :, :2].reshape(len(system.load), -1)
    of_S, of_load = condensed.errors(gamma)
    p = np.asarray(system.load + gamma * system.rate)
    return ReducedProblem(S, p, condensed.friction, None, of_S, of_load)


def proved(condensed: CondensedContact, gamma: float, seconds: float) -> ProvedSolutions:
    """All solutions with a proof; where it takes its time there is a line of progress.

    States are in the units of the condensed problem. For one rank alone.
    """
    line, begun = Line(condensed.comm), time.monotonic()

    def tell(text: str) -> None:
        if time.monotonic() - begun > _PATIENCE:
            line.update(f"proof of all solutions: {text}, {time.monotonic() - begun:.0f} s")

    try:
        return prove_solutions(reduced_problem(condensed, gamma), seconds=seconds, progress=tell)
    finally:
        line.clear()
