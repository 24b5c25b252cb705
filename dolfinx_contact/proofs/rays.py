# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Proof that all rays leaving a state with contact points at the apex are known.

A *ray* is an outgoing direction (da, dr, dgamma) of displacements a, forces r and parameter gamma.
A point with zero tangential and normal displacement and no force is at the *apex*: its tangent cone
is the contact law itself. All other points must be strictly open (dr = 0), stuck (da = 0) or
pressed without friction (drt = dun = 0 for the tangential force and the normal displacement). They
then satisfy dr.da = 0 and can be eliminated from S da - dr = dgamma q, with the stiffness matrix S
and the derivative q of the load:

    S' = S_kk - S_ke S_ee^{-1} S_ek,    q' = q_k - S_ke S_ee^{-1} q_e

for the components k of points at the apex and the free components e. S' is positive definite
because S is. The rays, normalised to dgamma = 1 or -1, are the solutions of the reduced problems
with the loads q' and -q', and `solutions.py` proves completeness. Rays with dgamma = 0 do not
exist, since da.S' da = da.dr <= 0 at the apex.

For slipping points and points at a border between two statuses, dr.da may have either sign, and
nothing is proved.

With an approximation Z of S_ee^{-1} S_ek and its residual R = S_ek - S_ee Z,

    S_ke S_ee^{-1} S_ek = S_ke Z + Z^T R + R^T S_ee^{-1} R.

With the columns R_i of R and the least eigenvalue lambda of S_ee, the error of the entry (i, j) of
S_kk - S_ke Z is at most that of |Z^T R| plus |R_i| |R_j| / lambda, and the error of the entry i of
q_k - Z^T q_e is at most |R_i| |q_e| / lambda.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array, Codes, Ints
from dolfinx_contact.continuation.affine import AffineSystem
from dolfinx_contact.laws.status import OPEN, STICK
from dolfinx_contact.proofs.check_proof import Ball, ReducedProblem, least_eigenvalue, up
from dolfinx_contact.proofs.solutions import prove_solutions

__all__ = ["Apex", "ProvedRays", "apex_problem", "prove_rays"]


@dataclass(frozen=True, eq=False)
class ProvedRays:
    """Outgoing directions (rays) of a state, and the result of the proof of completeness.

    Attributes:
        verdict: ``"complete"``, ``"degenerate"`` or ``"open"``, as in `ProvedSolutions`.
        rays: proved rays: statuses of the m points, shape (m,), and the sign dgamma of the change
            of gamma, 1 or -1.
        method: description of the proof, human-readable.
    """

    verdict: str
    rays: tuple[tuple[Codes, float], ...]
    method: str


@dataclass(frozen=True, eq=False)
class Apex:
    """Reduced problem whose solutions are the outgoing rays of a state.

    Only points with zero displacement and force (at the *apex*) remain; others are eliminated.

    Attributes:
        problem: reduced problem; its load is the derivative of the load with respect to gamma.
        points: indices of the k points at the apex among all m points, shape (k,).
        codes: statuses of all points, shape (m,); only the statuses of eliminated points are used.
    """

    problem: ReducedProblem
    points: Ints
    codes: Codes


def apex_problem(whole: ReducedProblem, system: AffineSystem, cone: AffineSystem) -> Apex | str:
    """Return the reduced problem of the outgoing rays, or the reason why it does not exist.

    Args:
        whole: reduced problem of all points; its load is the derivative with respect to gamma.
        system: affine system of the contact points at the state.
        cone: tangent cone of the system at the state.

    Raises:
        ValueError: if the problem is not proved to be positive definite.
    """
    m = whole.points
    friction = whole.friction
    same = (cone.inequalities == system.inequalities).all(axis=(1, 2, 3))
    apex = same & (cone.allowed == system.allowed).all(axis=1)
    codes = cone.allowed.argmax(axis=1).astype(np.int8)
    held = cone.inequalities[np.arange(m), codes].any(axis=(1, 2))
    slips = (codes != OPEN) & (codes != STICK) & (friction > 0)
    other = ~apex & ((cone.allowed.sum(axis=1) != 1) | held | slips)
    if other.any():
        return f"{int(other.sum())} points slip, or are at a border between two statuses"
    if not apex.any():
        return "no point is at its apex"
    moves = np.zeros((m, 2), dtype=bool)
    moves[~apex & (codes != STICK), 0] = True
    moves[~apex & (codes == OPEN), 1] = True
    points = np.flatnonzero(apex)
    k = np.flatnonzero(np.repeat(apex, 2))
    e = np.flatnonzero(moves.reshape(-1))
    return Apex(_eliminated(whole, k, e, friction[points]), points, codes)


def _eliminated(
    whole: ReducedProblem, k: npt.NDArray[np.intp], e: npt.NDArray[np.intp], friction: Array
) -> ReducedProblem:
    """Return the reduced problem after elimination of the free components, with error bounds.

    Args:
        whole: reduced problem of all points; its load is the derivative with respect to gamma.
        k: indices of the remaining components, at the apex.
        e: indices of the free components, which are eliminated.
        friction: friction coefficients of the points at the apex.
    """
    S, q = whole.stiffness, whole.load
    reduced, load = S[np.ix_(k, k)], q[k]
    if len(e) == 0:
        return _reduced(reduced, load, friction)
    ee, ek = S[np.ix_(e, e)], S[np.ix_(e, k)]
    least = least_eigenvalue(ee.value, ee.radius)
    if not least > 0:
        raise ValueError("the stiffness of the free components is not positive definite")
    Z = np.linalg.solve(ee.value, ek.value)
    R = (ek - ee @ Z).size
    norms = np.sqrt(up((R**2).sum(axis=0)))
    far = float(np.sqrt(up((q[e].size ** 2).sum())))
    off = np.abs(Z).T @ R + np.outer(norms, norms) / least
    reduced = reduced - ek.T @ Z + Ball(np.zeros_like(off), up(off))
    shift: Array = np.asarray(norms * far / least, dtype=np.float64)
    load = load - Z.T @ q[e] + Ball(np.zeros_like(shift), up(shift))
    return _reduced(reduced, load, friction)


def _reduced(S: Ball, q: Ball, friction: Array) -> ReducedProblem:
    return ReducedProblem(S.value, q.value, friction, None, S.radius, q.radius)


def prove_rays(
    apex: Apex, known: Sequence[tuple[Codes, float]], *, proof_seconds: float
) -> ProvedRays:
    """Find all outgoing rays of a state and prove completeness.

    Args:
        apex: reduced problem of the rays.
        known: known rays, each given by the statuses of all m points, shape (m,), and dgamma, 1 or
            -1; they shorten the search.
        proof_seconds: time limit for each sign of dgamma.
    """
    given = apex.problem
    rays = list[tuple[Codes, float]]()
    verdicts = set()
    methods = list[str]()
    for sense in (1.0, -1.0):
        problem = ReducedProblem(given.S, sense * given.p, given.friction, None, given.dS, given.dp)
        starts = [codes[apex.points] for codes, rate in known if rate == sense]
        found = prove_solutions(problem, known=starts, proof_seconds=proof_seconds, progress=False)
        verdicts.add(found.verdict)
        methods.append(f"{found.method} at dgamma = {sense:+g}")
        for solution in found.solutions:
            codes = apex.codes.copy()
            codes[apex.points] = solution.codes
            rays.append((codes, sense))
    worst = next(v for v in ("open", "degenerate", "complete") if v in verdicts)
    return ProvedRays(worst, tuple(rays), " and ".join(methods))
