# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Directional stability of static equilibria.

At a static equilibrium, contact points at a border between statuses may change their status: a
point with its shear at the bound may stick or slip against its shear, and a grazing point (closed
without force) may take any status. An equilibrium is directionally unstable if there are lambda > 0
and v with

    (K + lambda C + lambda^2 M) v = B^T r

with v and r in the cones of these points. Here K, C and M are stiffness, damping and mass, B v the
jumps, and r changes of contact forces. Then the motion v e^{lambda t} starts arbitrarily close to
the equilibrium and grows (A. P. da Costa, J. A. C. Martins, I. N. Figueiredo and J. J. Judice, The
directional instability problem in systems with frictional contacts, Comput. Methods Appl. Mech.
Engrg. 193, 2004).

If no point is at a border, the motions form a linear space: sticking points are held, and the
remaining points are open or slide without friction. For a symmetric stiffness and dissipative
damping, the negative eigenvalues of K on this space are counted by a factorisation. For each motion
that grows faster than lambda, K + lambda C + lambda^2 M has one negative eigenvalue. Follower loads
(pressure on a part of the surface) make K nonsymmetric. Then all eigenvalues are computed, real or
complex (flutter); they depend on mass and damping, and even small damping may destabilise.

If points are at a border, each choice of their statuses (a piece) defines an eigenproblem, whose
real eigenvectors must lie in the cones. The pieces are enumerated up to a limit. The result is "not
decided" if pieces were omitted, if a motion meets no resistance, or if an oscillation grows in a
piece and K or C supplies energy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import islice, product
from typing import Any, Literal

from petsc4py import PETSc

import numpy as np
from scipy.linalg import eig

import ufl

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._geometry import plane_tangents
from dolfinx_contact._mpi import (
    any_rank,
    collective,
    count_of,
    maximum,
    on_root,
    require,
)
from dolfinx_contact._petsc import destroy, is_symmetric, staged
from dolfinx_contact.analysis.rows import (
    Problem,
    component_rows,
    free_tangents,
    is_free,
    point_normals,
    require_nodes,
    split,
    static_equations,
    unit,
)
from dolfinx_contact.analysis.vibrations import Body, DenseBody, body_of, damped, first_order
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.equations.measures import require_solution
from dolfinx_contact.laws import Coulomb, Frictionless
from dolfinx_contact.laws.status import MINUS, PLUS, closed, senses
from dolfinx_contact.reduced.constrained_body import (
    ConstrainedBody,
    ConstrainedField,
    is_positive_definite,
    with_dirichlet_rows,
)
from dolfinx_contact.results.indicators import small_sliding_violated

__all__ = ["Stability", "stability_at_rest"]

Label = Literal["stable", "unstable", "not decided"]

_LARGEST = 700  # unknowns of dense eigenproblems
_MOST_PIECES = 1024  # eigenproblems for the points at a border
# Distance to a border that counts as zero, relative to the largest force or to the body size.
_BORDER = 1e-8
_REAL = 1e-9  # relative imaginary part that counts as zero
_CONE = 1e-9  # distance outside a cone that counts as zero, relative to the largest component
_ROUND_OFF = 1e-13  # resistance that counts as zero, relative to the largest squared frequency
_HIGHEST = 30.0  # bound of the frequencies, relative to the highest of a single unknown
_SURE = 1e-6  # relative error of an eigenvalue up to which its real part is trusted
_DOUBLE = 1e-8  # relative distance of eigenvalues that count as equal

#: Behaviour of a point: separated, frictionless contact, sticking, slip along or against d.
APART, FREE, HOLDS, ALONG, AGAINST = range(5)


@dataclass(frozen=True)
class Stability:
    """Stability of an equilibrium in the linearised motion.

    Attributes:
        label: "stable", "unstable" (a motion grows with the given mass and damping) or "not
            decided".
        growth: growth rate of the fastest growing motion e^{lambda t}, the real part of lambda; 0
            if no growing motion was found.
        border: number of points at a border.
        pieces: number of eigenproblems that were solved for the points at a border.
        reason: explanation of the label.
        frequency: angular frequency of this motion, the imaginary part of lambda; 0 for growth
            without oscillation.
    """

    label: Label
    growth: float = 0.0
    border: int = 0
    pieces: int = 0
    reason: str = ""
    frequency: float = 0.0


@collective("stability at rest")
@staged("ContactStability")
def stability_at_rest(
    problem: Problem, *, density: Any, damping: float | ufl.Form = 0.0
) -> Stability:
    """Determine the stability of the equilibrium in the Functions. Collective.

    The stiffness of the body is included: a column beyond its buckling load is unstable even if all
    its contact points stick. `Stability.reason` explains the label "not decided": a motion without
    resistance, too many points at a border, too many unknowns with follower loads, or sliding that
    is not small (`Result.warnings`).

    Args:
        problem: solved contact problem, nodal or mixed, with Coulomb friction or without friction;
            slipping points are at the friction bound.
        density: positive mass density: a number, Constant, Function or UFL expression. It affects
            the label only if the stiffness is not symmetric (follower loads).
        damping: damping time, the ratio of damping and stiffness, or a UFL form of the damping with
            a trial and a test function. Default 0.

    Raises:
        ValueError: on every rank, for invalid arguments and for other contact laws.
    """
    eq = static_equations(problem)
    require_nodes(eq)
    for s in eq.surfaces:
        known = type(s.law) in (Coulomb, Frictionless)
        message = f"{s.name}: stability at rest is for Coulomb's friction or none, not {s.law.name}"
        require(eq.comm, known, message)
    evaluation = problem.evaluate()
    require_solution(problem)
    doubt = small_sliding_violated(eq, evaluation)
    if doubt:
        return Stability("not decided", reason=doubt)
    body = body_of(eq, evaluation.u, density, damping)
    try:
        positive = is_positive_definite(eq, body.M)
        require(eq.comm, positive, "the density must be positive everywhere")
        points = _Points(eq, evaluation)
        quiet = _is_symmetric(eq, body.K) and (body.C is None or _is_dissipative(body))
        if points.border == 0:
            return _by_inertia(body, points) if quiet else _by_eigenvalues(body, points)
        if points.rounds or body.unknowns > _LARGEST:
            reason = "slip directions of grazing points with friction are not enumerated in 3D"
            if not points.rounds:
                reason = f"{body.unknowns} unknowns are too many"
            return Stability("not decided", border=points.border, reason=reason)
        gathered = _Gathered(body, points)
        return on_root(eq.comm, lambda: _decided(gathered, quiet=quiet))
    finally:
        body.destroy()


class _Points:
    """Admissible statuses and slip directions of the contact points of this rank. Collective.

    Attributes:
        choices: up to four admissible statuses of each of the n points, padded with -1, shape
            (n, 4).
        directions: slip directions d: opposite to the shear at points at the bound, along the
            tangent at grazing points in 2D, otherwise 0; shape (n, dim).
        friction: friction coefficients, shape (n,).
        border: number of points at a border between two statuses, on all ranks.
        rounds: whether the problem is 3D and a point with friction is grazing.
    """

    def __init__(self, eq: ContactEquations, evaluation: Evaluation):
        n = point_normals(eq)
        codes = np.concatenate(list(evaluation.statuses))
        parts = [
            (s.points, found) for s, found in zip(eq.surfaces, evaluation.surfaces, strict=True)
        ]
        jump = np.concatenate([f.jump for _, f in parts])
        force = np.concatenate([p.areas[:, None] * f.traction for p, f in parts])
        gap = np.concatenate([p.data.gap for p, _ in parts]) - np.sum(jump * n, axis=1)
        slope = np.concatenate([f.answers.unit_bound for _, f in parts])
        tension, rt = split(n, force)
        rn = -tension
        bound = slope * rn
        largest = maximum(eq.comm, rn)
        touches = is_free(eq, n) & (closed(codes) | (gap <= _BORDER * eq.body_size))
        grazes = touches & (rn <= _BORDER * largest)
        slips = (senses(codes) == PLUS) | (senses(codes) == MINUS)
        at_bound = touches & ~grazes & (slope > 0)
        at_bound &= slips | (np.linalg.norm(rt, axis=1) >= bound * (1 - _BORDER))
        self.friction = slope
        self.directions = np.where(at_bound[:, None], -unit(rt), 0.0)
        if eq.dim == 2:
            self.directions[grazes] = plane_tangents(n)[grazes]
        self.choices = np.full((len(n), 4), -1)
        self.choices[:, 0] = np.where(~touches, APART, np.where(slope > 0, HOLDS, FREE))
        self.choices[at_bound, 1] = ALONG
        self.choices[grazes, 1] = APART
        self.choices[grazes & (slope > 0), 2:] = ALONG, AGAINST
        self.border = count_of(eq.comm, self.choices[:, 1] >= 0)
        self.rounds = eq.dim == 3 and any_rank(eq.comm, grazes & (slope > 0))


class _Gathered(DenseBody):
    """Dense matrices and contact points, gathered on rank 0. Collective.

    Attributes:
        C: damping matrix.
        N: rows of the normal jumps of all points, shape (m, unknowns); 0 if held by Dirichlet data.
        T: rows of the free tangents, shape (k, unknowns).
        owner: index of the point of each free tangent, shape (k,).
        along: component d.t of the slip direction d along each free tangent t, shape (k,).
        D: rows of the slips in the direction d, restricted to free tangents, shape (m, unknowns).
        choices, friction: attributes of `_Points`, for the points of all ranks.
        held: mask of the points whose normal motion is held by Dirichlet data, shape (m,).
    """

    def __init__(self, body: Body, points: _Points):
        eq = body.eq
        comm = eq.comm
        n = point_normals(eq)
        owner, tangents = free_tangents(eq)
        rows = [
            component_rows(eq, np.arange(len(n)), n),
            component_rows(eq, owner, tangents),
        ]
        super().__init__(body, rows)
        for A in rows:
            A.destroy()
        along = np.sum(points.directions[owner] * tangents, axis=1)
        first = comm.exscan(len(n)) or 0
        parts = comm.gather((owner + first, along, points.choices, points.friction))
        if parts is None:
            return
        self.owner, self.along, self.choices, self.friction = (
            np.concatenate(p) for p in zip(*parts, strict=True)
        )
        self.C: Array = body.eta * self.K if self.C is None else self.C
        self.N, self.T = self.rows
        self.D = np.zeros_like(self.N)
        np.add.at(self.D, self.owner, self.along[:, None] * self.T)
        self.held = np.abs(self.N).max(axis=1, initial=0.0) == 0


def _is_symmetric(eq: ContactEquations, A: PETSc.Mat) -> bool:
    """Return whether a matrix is symmetric on the free displacements. Collective."""
    free = with_dirichlet_rows(A, eq, 0.0)
    symmetric = is_symmetric(free)
    free.destroy()
    return symmetric


def _is_dissipative(body: Body) -> bool:
    """Return whether the damping is symmetric and positive semidefinite. Collective."""
    if not _is_symmetric(body.eq, body.C):
        return False
    scale = body.scale(body.C)
    return scale == 0 or _signs(body, [], (0.0, 1.0, _ROUND_OFF * scale)) == (0, 0)


def _signs(body: Body, rows: list[PETSc.Mat], parts: tuple[float, float, float]) -> tuple[int, int]:
    """Count negative and zero eigenvalues of a sum of stiffness, damping, mass. Collective.

    Args:
        body: stiffness, mass and damping.
        rows: rows of the held motions.
        parts: factors of stiffness, damping and mass in the sum.
    """
    eq = body.eq
    k, c, m = parts
    A = body.M.copy()
    A.scale(m)
    for part, B in ((k, body.K), (c, body.C)):
        if B is not None and part != 0:
            A.axpy(part, B, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    inside = with_dirichlet_rows(A, eq, eq.scaling.stiffness)
    held = ConstrainedBody(
        eq.comm, [ConstrainedField(inside, rows)], eq.scaling.stiffness, counted=True
    )
    signs = held.signs
    held.destroy()
    destroy(inside, A)
    return signs


def _by_inertia(body: Body, points: _Points) -> Stability:
    """Decide stability by counting negative eigenvalues, if no point is at a border. Collective."""
    eq = body.eq
    doing = points.choices[:, 0]
    n = point_normals(eq)
    pressed = np.flatnonzero((doing != APART) & is_free(eq, n))
    owner, tangents = free_tangents(eq)
    stuck = (doing == HOLDS)[owner]
    rows = [
        component_rows(eq, pressed, n[pressed]),
        component_rows(eq, owner[stuck], tangents[stuck]),
    ]

    def grow(growth: float) -> bool:
        """Return whether a motion has a growth rate larger than ``growth``."""
        parts = (1.0 + growth * body.eta, growth, growth**2)
        return _signs(body, rows, parts)[0] > 0

    highest = body.scale(body.K)
    nothing = _ROUND_OFF * highest
    try:
        if _signs(body, rows, (1.0, 0.0, -nothing)) == (0, 0):
            reason = "no point is at a border, and the stiffness is positive definite"
            return Stability("stable", reason=reason)
        number, _ = _signs(body, rows, (1.0, 0.0, nothing))
        if number == 0:
            return Stability("not decided", reason="a motion meets no resistance")
        slow = 0.0
        fast = _HIGHEST * math.sqrt(highest)
        while grow(fast):
            slow = fast
            fast = 2 * fast
        while fast - slow > _SURE * fast:
            middle = 0.5 * (slow + fast) if slow > 0 else 0.1 * fast
            slow, fast = (middle, fast) if grow(middle) else (slow, middle)
    finally:
        for A in rows:
            A.destroy()
    reason = f"no point is at a border, and the stiffness has {_many(number)}"
    return Stability("unstable", 0.5 * (slow + fast), reason=reason)


def _many(number: int) -> str:
    return "a negative eigenvalue" if number == 1 else f"{number} negative eigenvalues"


def _by_eigenvalues(body: Body, points: _Points) -> Stability:
    """Decide stability from all eigenvalues, if no point is at a border. Collective."""
    # With C = eta K, the eigenproblem is half as large.
    if body.unknowns > _LARGEST * (2 if body.C is None else 1):
        which = "stiffness" if body.C is None else "stiffness or the damping"
        reason = f"the {which} is not symmetric, and {body.unknowns} unknowns are too many"
        return Stability("not decided", reason=reason)
    gathered = _Gathered(body, points)
    return on_root(body.eq.comm, lambda: _of_spectrum(gathered, body.C is None, body.eta))


def _of_spectrum(g: _Gathered, proportional: bool, eta: float) -> Stability:
    K, M, C, _ = _piece(g, g.choices[:, 0])
    if len(K) == 0:
        return Stability("stable", reason="all motions are held")
    inertia = np.linalg.inv(np.linalg.cholesky((M + M.T) / 2))
    K, C = (inertia @ A @ inertia.T for A in (K, C))
    A = K if proportional else first_order(K, C)
    values, left, right = eig(A, left=True, right=True)
    # First-order errors of eigenvalues, by their condition.
    share = np.abs(np.sum(left.conj() * right, axis=0))
    off = len(A) * np.finfo(float).eps * np.linalg.norm(A, 2) / np.maximum(share, 1e-300)
    if proportional:
        # A real mu > 0 makes a motion that keeps its size, or is damped.
        real = (np.abs(values.imag) <= off) & (off <= _SURE * np.abs(values))
        values = np.where(real, values.real + 0j, values)
        around = [damped(values + off * turn, eta) for turn in (1, -1, 1j, -1j)]
        most = np.max([w.real.reshape(2, -1).max(axis=0) for w in around], axis=0)
        least = np.min([w.real.reshape(2, -1).max(axis=0) for w in around], axis=0)
        most = np.where(real & (values.real > 0), 0.0, most)
        least = np.where((eta == 0) & (np.abs(values.imag) <= off) & (values.real > -off), 0, least)
        roots = damped(values, eta).reshape(2, -1)
        values = np.take_along_axis(roots, roots.real.argmax(axis=0)[None], axis=0)[0]
    else:
        most = values.real + off
        least = values.real - off
    if (least > 0).any():
        fastest = values[np.where(least > 0, values.real, -np.inf).argmax()]
        how = "an oscillation grows (flutter)" if fastest.imag != 0 else "a motion grows"
        reason = f"no point is at a border, and {how} with this mass and damping"
        turn = abs(float(fastest.imag))
        return Stability("unstable", float(fastest.real), reason=reason, frequency=turn)
    if (most > 0).any():
        reason = "an eigenvalue is at the limit of stability, or a motion meets no resistance"
        return Stability("not decided", reason=reason)
    reason = "no point is at a border, and no motion grows with this mass and damping"
    return Stability("stable", reason=reason)


def _decided(g: _Gathered, *, quiet: bool) -> Stability:
    """Decide stability from the pieces, starting with slip at all points at a border.

    Args:
        g: matrices and contact points.
        quiet: whether neither the stiffness nor the damping supplies energy.
    """
    border = np.flatnonzero(g.choices[:, 1] >= 0)
    options = [g.choices[p][g.choices[p] >= 0][::-1] for p in border]
    number = math.prod(len(w) for w in options)
    looked = min(number, _MOST_PIECES)
    growth = 0.0
    doubt = ""
    for chosen in islice(product(*options), looked):
        doing = g.choices[:, 0].copy()
        doing[border] = chosen
        fastest, reason = _look(g, doing, quiet=quiet)
        growth = max(growth, fastest)
        doubt = reason or doubt
    if growth > 0:
        label: Label = "unstable"
        reason = "a growing motion lies in the cones of the points at a border"
    elif looked < number:
        label, reason = "not decided", f"{looked} of {number} pieces were examined"
    elif doubt:
        label, reason = "not decided", doubt
    else:
        label, reason = "stable", f"no motion grows in any of {number} pieces"
    return Stability(label, growth, len(border), looked, reason)


def _piece(g: _Gathered, doing: Ints) -> tuple[Array, Array, Array, Array]:
    """Return stiffness, mass and damping on the motions of given statuses, and these motions.

    Args:
        g: matrices and contact points.
        doing: status of each point, shape (m,).
    """
    slips = (doing == ALONG) | (doing == AGAINST)
    stuck = doing == HOLDS
    sign = np.where(doing == AGAINST, -1.0, 1.0)
    pressed = (slips | stuck | (doing == FREE)) & ~g.held
    # Held tangents: all tangents of sticking points, and those across the slip of other points.
    moves = slips[g.owner] & (np.abs(g.along) > 0.5)
    tangents = (stuck | slips)[g.owner] & ~moves
    G = g.N + (np.where(slips, sign * g.friction, 0.0))[:, None] * g.D
    held = np.concatenate([g.N[pressed], g.T[tangents]])
    forces = np.concatenate([G[pressed], g.T[tangents]]) if slips.any() else None
    K, M, C, Z = g.projected(held, forces)
    assert C is not None
    return K, M, C, Z


def _look(g: _Gathered, doing: Ints, *, quiet: bool) -> tuple[float, str]:
    """Search for growing motions within the cones of given statuses ``doing``.

    Returns:
        Largest growth rate of such a motion, 0 if none was found; and the reason why other motions
        may grow, "" if there is none.
    """
    K, M, C, Z = _piece(g, doing)
    n = len(K)
    if n == 0:
        return 0.0, ""
    growth = 0.0
    doubt = ""
    inertia = np.linalg.inv(M)
    values, vectors = np.linalg.eig(first_order(inertia @ K, inertia @ C))
    size = np.sqrt(np.abs(inertia @ K).max(initial=0.0))
    outside = []
    for value, x in zip(values, vectors[:n].T, strict=True):
        if value.real <= _REAL * size:
            continue
        if abs(value.imag) > _REAL * size:
            if not quiet:
                doubt = "an oscillation grows in a piece of the points at a border"
            continue
        turned = x / x[np.argmax(np.abs(x))]
        if _leaves(g, doing, Z @ turned.real, value.real):
            growth = max(growth, float(value.real))
        else:
            outside.append(float(value.real))
    if (np.diff(np.sort(outside)) <= _DOUBLE * size).any():
        doubt = "a combination of motions with equal growth may lie in the cones"
    resistance, motions = np.linalg.svd(K)[1:]
    free = motions[resistance <= _ROUND_OFF * resistance[0]]
    if any(_leaves(g, doing, Z @ v, 0.0) for v in free):
        doubt = "a motion in the cones of the points at a border meets no resistance"
    return growth, doubt


def _leaves(g: _Gathered, doing: Ints, v: Array, growth: float) -> bool:
    """Return whether a motion v or -v, with its forces, lies in the cones of the statuses."""
    components = np.concatenate([g.N[~g.held], g.T])
    load = g.K @ v + growth * (g.C @ v) + growth**2 * (g.M @ v)
    forces = np.linalg.lstsq(components.T, load, rcond=None)[0]
    normal, tangential = np.split(forces, [int((~g.held).sum())])
    rn = np.zeros(len(g.N))
    rn[~g.held] = -normal
    shear = np.bincount(g.owner, g.along * tangential, len(g.N))
    force = _CONE * np.abs(forces).max(initial=0.0)
    length = _CONE * np.abs(components @ v).max(initial=0.0)
    grazing = g.choices[:, 1] == APART
    slips = (doing == ALONG) | (doing == AGAINST)
    sign = np.where(doing == AGAINST, -1.0, 1.0)

    def admissible(way: float) -> bool:
        bound = way * g.friction * rn + force
        wrong = grazing & (doing == APART) & (way * (g.N @ v) > length)
        wrong |= grazing & (doing != APART) & (way * rn < -force)
        wrong |= slips & (way * sign * (g.D @ v) < -length)
        # A shear at its bound, -F rn d, may only decrease relative to the bound.
        wrong |= (doing == HOLDS) & (-way * shear > bound)
        wrong |= (doing == HOLDS) & grazing & (way * shear > bound)
        return not wrong[g.choices[:, 1] >= 0].any()

    return admissible(1.0) or admissible(-1.0)
