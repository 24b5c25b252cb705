# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Friction as a linear complementarity problem, 0 <= w = q + M z against z >= 0, in two forms.

Both have a = A r + c with the compliance A = S^-1, rn >= 0 against un >= 0, and friction in
directions d_1..d_k of the tangent plane: +-t in 2D, where they are exact, and k of equal angles in
3D, where the friction disc is replaced by an inscribed regular polygon with k corners. The polygon
reduces the friction bound by up to O(1/k^2). Slip directions have an error of up to pi/k, and so do
the forces: the approximation is of first order in 1/k.

**Copositive form** (`lemke`): z = (rn, b_1..b_k, l), rt = sum_j b_j d_j, with the slip magnitude l,

    un = A_nn rn + A_nt D b + c_n,   l + d_j.ut against b_j,   F rn + g - sum_j b_j against l.

Lemke's method finds a solution for every F; the proof in 3D is the same as in 2D.

**Klarbring's form** (after Klarbring, CMAME 58, 1986), in 2D: z = (rn, u+, f-) with the slip
ut = u+ - u- and the distances f+- = F rn + g +- rt of the friction force from its two bounds,

    un = (A_nn + A_nt F) rn - A_nt f- + c_n + A_nt g               against rn,
    u- = u+ - (A_tn + A_tt F) rn + A_tt f- - c_t - A_tt g          against f-,
    f+ = 2 F rn - f- + 2 g                                         against u+:

with three unknowns per point instead of four. Its matrix is copositive for small F only. For larger
F, Lemke's method may end in a ray although a solution exists.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from dolfinx_contact.algorithms.iteration import Algorithm, Iteration, check
from dolfinx_contact.algorithms.lemke import (
    RayTermination,
    copositive_forces,
    copositive_form,
    lemke,
    parts_of,
    tangents,
)
from dolfinx_contact.algorithms.point_problem import PointProblem
from dolfinx_contact.algorithms.semismooth import newton_step
from dolfinx_contact.laws.coulomb import violation

__all__ = ["Lemke", "copositive_form", "coulomb_by_lemke", "klarbring_form"]

Array = npt.NDArray[np.float64]
_POLISH = 6  # largest number of Newton steps after Lemke's method
_POLISHED = 1e-3  # target measure of these steps, relative to the tolerance
_ROUND_OFF = 1e-12  # relative violation of the law that needs no Newton step
_LARGEST_VIOLATION = 1e-7  # relative violation above which an answer is rejected


@dataclass(frozen=True)
class Lemke(Algorithm):
    """Lemke's method. It counts as one iteration; the number of pivots is reported.

    Attributes:
        max_iterations: largest number of pivots per unknown of the complementarity problem.
        form: complementarity form, ``copositive`` or (in 2D) ``klarbring``.
        facets: number of corners of the polygon that replaces the friction disc in 3D.
    """

    name: ClassVar[str] = "lemke"
    max_iterations: int = 50
    form: Literal["copositive", "klarbring"] = "copositive"
    facets: int = 8

    def __post_init__(self) -> None:
        super().__post_init__()
        check(self, form=self.form in ("copositive", "klarbring"), facets=self.facets >= 3)

    def _iterate(self, contact: PointProblem, r: Array, iteration: Iteration) -> None:
        problem, stiffness, length = contact.scaled()
        iteration.stops(contact.displacements(r), r, pivots=0)
        if self.form == "klarbring" and contact.dim == 3:
            iteration.fails("Klarbring's form is for the plane")
            return
        if self.form == "klarbring":
            M, q = klarbring_form(problem)
        else:
            directions = tangents(problem.dim, self.facets)
            M, q = copositive_form(problem, directions)
        path: list[tuple[float, Array]] = []
        try:
            most = self.max_iterations * len(q)
            z, pivots = lemke(M, q, max_pivots=most, path=path)
        except RayTermination as error:
            iteration.fails(str(error))
            return
        finally:
            iteration.outcome.series["covering"] = [cover for cover, _ in path]
        if self.form == "klarbring":
            rn, _, lacks = z.reshape(3, problem.number)
            r = np.column_stack([problem.radius(rn) - lacks, rn])
        else:
            r = copositive_forces(z, directions)
        r = r * stiffness * length
        a = contact.displacements(r)
        if contact.dim == 2:
            enough = _POLISHED * iteration.trend.tolerance
            a, r = _polished(contact, r, lambda a, r: iteration.measure(a, r).worst, enough)
        iteration.stops(a, r, pivots=pivots)
        found = iteration.outcome
        if contact.dim == 2 and not found.converged:
            iteration.fails(f"round-off: the law is violated by {found.measures[-1].worst:.1e}")
        elif not found.converged and pivots:
            iteration.fails(
                f"the solution of a polygon of {self.facets} facets: off the disc by "
                f"{found.measures[-1].worst:.1e}"
            )


def coulomb_by_lemke(
    S: Array, p: Array, friction: Array, *, bound: Array | None = None
) -> tuple[Array, int]:
    """Return a solution of S a = r + p with Coulomb friction in 2D.

    A solution exists for every friction coefficient (proof in `algorithms.lemke`).

    Args:
        S: reduced stiffness, shape (2 m, 2 m), ordered (ut, un) point by point, positive definite.
        p: reduced load, shape (2 m,).
        friction: friction coefficients F >= 0, shape (m,).
        bound: prescribed friction bounds g >= 0, added to F rn; forces, shape (m,); default zero.

    Returns:
        State (ut, un, rt, rn) of every point, shape (m, 4), and the number of pivots.

    Raises:
        ValueError: as for `PointProblem`, and for a problem in 3D.
        RayTermination: if round-off spoils the result, which occurs for badly conditioned S (1e8).
    """
    given = PointProblem(S, p, friction, np.zeros(0) if bound is None else bound)
    if given.dim != 2:
        raise ValueError("friction in space is no complementarity problem but for a polygon")
    contact, stiffness, length = given.scaled()
    directions = tangents(2, 2)
    z, pivots = lemke(*copositive_form(contact, directions))

    def measure(a: Array, r: Array) -> float:
        ut, un = a.T
        rt, rn = r.T
        return violation(ut, un, rt, rn, contact.friction, contact.bound)

    a, r = _polished(contact, copositive_forces(z, directions), measure, _ROUND_OFF)
    worst = measure(a, r)
    if not worst < _LARGEST_VIOLATION:
        raise RayTermination(f"round-off: the law is violated by {worst:.1e} of the load")
    return np.column_stack([a * length, r * stiffness * length]), pivots


def _polished(
    contact: PointProblem, r: Array, measure: Callable[[Array, Array], float], enough: float
) -> tuple[Array, Array]:
    """Remove the round-off of Lemke's pivots from forces by Newton steps.

    The compliance and the tableau determine displacements and forces up to their condition number
    times round-off, but the statuses are correct. Newton's method solves equilibrium again with
    these statuses, using the stiffness itself.

    Args:
        contact: reduced problem in 2D.
        r: contact forces from Lemke's method, shape (m, 2).
        measure: function of displacements and forces that returns the violation of the laws.
        enough: violation at which no further step is taken.

    Returns:
        Displacements and forces with the smallest violation, shape (m, 2) each.
    """
    a = contact.displacements(r)
    best = (a, r)
    least = measure(a, r)
    for _ in range(_POLISH):
        if least <= enough:
            break
        try:
            a, r = newton_step(contact, a, r)
        except np.linalg.LinAlgError:  # the statuses do not determine the state
            break
        worst = measure(a, r)
        if worst < least:
            best = (a, r)
            least = worst
    return best


def klarbring_form(contact: PointProblem) -> tuple[Array, Array]:
    """Return M and q of Klarbring's form in 2D, with z = (rn, u+, f-); see the module."""
    A, cn, ct, F = parts_of(contact)
    ann = A[:, 1, :, 1]
    ant = A[:, 1, :, 0]
    att = A[:, 0, :, 0]
    atn = ant.T
    g = contact.bound
    one = np.eye(contact.number)
    M = np.block(
        [
            [ann + ant @ F, 0 * one, -ant],
            [2 * F, 0 * one, -one],
            [-(atn + att @ F), one, att],
        ]
    )
    return M, np.concatenate([cn + ant @ g, 2 * g, -ct[:, 0] - att @ g])
