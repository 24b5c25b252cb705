# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Friction as a linear complementarity problem, 0 <= w = q + M z against z >= 0, in two forms.

Both have a = A r + c with the compliance A = S^-1, rn >= 0 against un >= 0, and friction in
directions d_1..d_k of the tangent plane: +-t in 2D, where they are exact, and k of equal angles in
3D, a polygon inside the disc with corners on the circle. It holds less than the disc by 1/k^2, and
directions of slip are off by up to pi/k, which forces are off by as well: first order in 1/k.

**Copositive** (`lemke`): z = (rn, b_1..b_k, l), rt = sum_j b_j d_j, l the size of a slip,

    un = A_nn rn + A_nt D b + c_n,   l + d_j.ut against b_j,   F rn + g - sum_j b_j against l.

Lemke's method ends in a solution of it for every F, in 3D for the same reason as in 2D.

**Klarbring** (after Klarbring, CMAME 58, 1986), in 2D: z = (rn, u+, f-) with slips ut = u+ - u- and
what friction lacks of its bound on both sides, f+- = F rn + g +- rt,

    un = (A_nn + A_nt F) rn - A_nt f- + c_n + A_nt g               against rn,
    u- = u+ - (A_tn + A_tt F) rn + A_tt f- - c_t - A_tt g          against f-,
    f+ = 2 F rn - f- + 2 g                                         against u+:

three unknowns a point in place of four. Its matrix is copositive for small F only: beyond, Lemke's
method may end in a ray though there is a solution.
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
_POLISH = 6  # Newton steps at most,
_POLISHED = 1e-3  # to this part of the tolerance
_ROUND_OFF = 1e-12  # violations of the law that need no such step, relative,
_LARGEST_VIOLATION = 1e-7  # and those by which an answer counts as none


@dataclass(frozen=True)
class Lemke(Algorithm):
    """Lemke's method; an iteration is the whole of it, and its pivots are reported.

    Attributes:
        max_iterations: pivots, over the unknowns of the complementarity problem.
        form: ``copositive`` or ``klarbring``.
        facets: of the friction polygon in 3D, where the solution is that of the polygon.
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
    """A solution of S a = r + p with Coulomb friction in 2D; see `lemke` why there is one.

    Args:
        S: reduced stiffness, (2 m, 2 m), ordered ut, un point by point, positive definite.
        p: reduced load, (2 m,).
        friction: coefficients F >= 0, (m,).
        bound: friction bounds g >= 0 beside F rn, forces, (m,).

    Returns:
        The state (ut, un, rt, rn) of every point, (m, 4), and the number of pivots.

    Raises:
        ValueError: as `PointProblem`, and if it is not in the plane.
        RayTermination: never but for round-off, which a badly conditioned S (1e8) may bring; an
            answer that is none is not returned.
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
    """The state under forces (m, 2) without the round-off of their way, (m, 2) each.

    The compliance and the table know lengths and forces to their condition times round-off. What
    they have found are statuses: with these equilibrium is solved anew, by the stiffness itself.

    Args:
        contact: the problem.
        r: the forces.
        measure: by how much displacements and forces are off.
        enough: of that, at which nothing is left to do.
    """
    a = contact.displacements(r)
    best = (a, r)
    least = measure(a, r)
    for _ in range(_POLISH):
        if least <= enough:
            break
        try:
            a, r = newton_step(contact, a, r)
        except np.linalg.LinAlgError:  # there are many states of these statuses
            break
        worst = measure(a, r)
        if worst < least:
            best = (a, r)
            least = worst
    return best


def klarbring_form(contact: PointProblem) -> tuple[Array, Array]:
    """M and q with z = (rn, u+, f-), in 2D; see the module."""
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
