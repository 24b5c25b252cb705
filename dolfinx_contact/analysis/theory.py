# SPDX-License-Identifier: LGPL-3.0-or-later
"""Existence and uniqueness theorems whose hypotheses can be verified numerically.

The theorems assume a stiffness K that is symmetric and positive definite on the free displacements,
gaps that are linear in the displacement (small sliding), and a contact law that holds node by node:

- Without friction, and for a prescribed friction bound (Tresca), there is exactly one solution, the
  minimiser of a strictly convex energy (Lions and Stampacchia, Comm. Pure Appl. Math. 20, 1967;
  Duvaut and Lions, Les inequations en mecanique et en physique, 1972, chapter 3).
- With Coulomb friction, there is at least one solution for any coefficient: the pressure of
  Tresca's solution depends continuously on its friction bound, which yields a fixed point by
  Brouwer's theorem (Haslinger, Math. Methods Appl. Sci. 5, 1983). The solution is unique below a
  coefficient that depends on the mesh and is not computable; uniqueness therefore requires a
  certificate.

Definiteness is decided by the signs of the pivots of K, up to round-off.
"""

from __future__ import annotations

from dolfinx_contact._mpi import any_rank
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.reduced.constrained_body import is_positive_definite
from dolfinx_contact.results.uniqueness import Theory

__all__ = ["theory_of"]

_NONE = "no computable theorem applies: "


def theory_of(eq: ContactEquations) -> Theory:
    """Return the theorems that apply to a problem with its current data. Collective."""
    rubs = _coefficients(eq)
    for applies, what in (
        (eq.bulk.linear, "the body is not linear"),
        (eq.linear, "gap and normal depend on the displacement"),
        (rubs is not None, "the law is not Coulomb's, Tresca's or without friction"),
        (not eq.is_weak, "the law does not hold node by node"),
        (eq.rigid.size == 0, "a rigid body moves"),
        (len(eq.scaling.loose) == 0, "a body is not held by Dirichlet data"),
    ):
        if not applies:
            return Theory(False, False, _NONE + what)
    stiffness = eq.bulk.stiffness(eq.bulk.displacement.x.array.copy())
    if not is_positive_definite(eq, stiffness):
        what = "the stiffness is not symmetric and positive definite"
        return Theory(False, False, _NONE + what)
    if not rubs:
        return Theory(True, True, "exactly one solution, the state of least energy")
    return Theory(True, False, "at least one solution for every coefficient of friction")


def _coefficients(eq: ContactEquations) -> bool | None:
    """Return whether any friction coefficient is positive. Collective.

    None if the theorems do not cover a contact law of the problem.
    """
    if not all(s.law.bound_kind in ("proportional", "given") for s in eq.surfaces):
        return None
    x = eq.unknowns.create_vector()
    evaluation = eq.evaluate_contact(x)
    x.destroy()
    mine = any(
        s.law.bound_kind == "proportional" and bool((known.answers.unit_bound > 0).any())
        for s, known in zip(eq.surfaces, evaluation.surfaces, strict=True)
    )
    return any_rank(eq.comm, mine)
