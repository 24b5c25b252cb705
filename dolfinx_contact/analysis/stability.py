# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Stability of equilibria at rest: directions in which a body begins to move by itself.

At rest a point may stay as it is, or, if it is at a border, leave: a point whose shear is at the
bound may stick or slip against its shear, a point that just touches may do anything. An
equilibrium is directionally unstable if there are lambda > 0 and v with

    (K + lambda C + lambda^2 M) v = B^T r

with v and r in the cones of these points: then v e^{lambda t} is a motion from arbitrarily near
(A. P. da Costa, J. A. C. Martins, I. N. Figueiredo and J. J. Judice, The directional instability
problem in systems with frictional contacts, Comput. Methods Appl. Mech. Engrg. 193, 2004). Where no
point is at a border the matrices are symmetric, and nothing grows. Else every choice of what these
points do is an eigenproblem, whose vectors must lie in the cones. They are enumerated if they are
few, and what was not looked at is not decided.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

import ufl

from dolfinx_contact._errors import on_root, require
from dolfinx_contact._petsc import staged
from dolfinx_contact.analysis.rows import (
    Problem,
    component_rows,
    free_components,
    free_tangents,
    point_normals,
    require_nodes,
)
from dolfinx_contact.analysis.vibrations import Body, body_of, null_space, on_root_dense
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.state import State
from dolfinx_contact.laws.status import MINUS, PLUS, closed, senses
from dolfinx_contact.points.law_checks import check_times

__all__ = ["Stability", "stability_at_rest"]

Array = npt.NDArray[np.float64]
Label = Literal["stable", "unstable", "not decided"]

_LARGEST = 700  # unknowns of dense eigenproblems
_BORDER = 1e-8  # of forces over the largest, of gaps over the body's size
_REAL = 1e-9  # relative imaginary part that is none
_CONE = 1e-9  # of the largest component, by which a cone may be left

#: What a point does: it is open, free along the surface, sticks, or slips with or against its d.
OPEN, FREE, STICK, SLIP, BACK = range(5)


@dataclass(frozen=True)
class Stability:
    """What is known of an equilibrium.

    Attributes:
        label: whether there is a direction in which it leaves by itself.
        growth: lambda of the fastest such motion; 0 if none was found.
        border: number of points at a border.
        pieces: eigenproblems that were solved.
        reason: in words.
    """

    label: Label
    growth: float
    border: int
    pieces: int
    reason: str


@staged("ContactStability")
def stability_at_rest(
    problem: Problem, *, density: Any, damping: float | ufl.Form = 0.0, most: int = 1024
) -> Stability:
    """Whether the equilibrium in the Functions is one that stays. Collective.

    Args:
        problem: a contact problem that has been solved, nodal or mixed; points whose status is slip
            are at the bound of friction.
        density: of mass, a number, Constant, Function or UFL expression.
        damping: eta of the damping C = eta K, a time, or a UFL form C(trial, test).
        most: eigenproblems that are solved; with more the answer is "unstable" or "not decided".

    Raises:
        ValueError: on every rank, for arguments that do not fit, or a law without a coefficient of
            friction.
    """
    eq = problem.equations
    require_nodes(eq)
    require(eq.comm, most > 0, f"the number of eigenproblems must be 1 or more, got {most}")
    check_times(eq.surfaces)
    state = problem.state()
    body = body_of(eq, state.u, density, damping)
    unknowns = int(eq.comm.allreduce(int((~eq.fixed[: eq.owned_sizes[0]]).sum())))
    try:
        points = _Points(eq, state)
        if points.border == 0:
            return Stability("stable", 0.0, 0, 0, "no point is at a border")
        if points.rounds:
            reason = "points with friction just touch, and may go anywhere on a surface"
            return Stability("not decided", 0.0, points.border, 0, reason)
        if unknowns > _LARGEST:
            reason = f"{unknowns} unknowns are too many"
            return Stability("not decided", 0.0, points.border, 0, reason)
        gathered = _Gathered(eq, body, points)
        return on_root(eq.comm, lambda: _decided(gathered, most))
    finally:
        body.destroy()


class _Points:
    """Contact points of this rank: what each may do, and its direction of slip. Collective.

    Attributes:
        choices: codes (n, 4), filled with -1.
        directions: d, against the shear where it is at its bound (n, dim).
        friction: coefficients (n,).
        border: number of points at a border on all ranks.
        rounds: whether points with friction just touch in 3D.
    """

    def __init__(self, eq: ContactEquations, state: State):
        n, codes = point_normals(eq), np.concatenate(list(state.statuses))
        parts = [(s.points, found) for s, found in zip(eq.surfaces, state.surfaces, strict=True)]
        jump = np.concatenate([f.jump for _, f in parts])
        force = np.concatenate([p.areas[:, None] * f.traction for p, f in parts])
        gap = np.concatenate([p.data.gap for p, _ in parts]) - np.sum(jump * n, axis=1)
        slope = np.concatenate([f.answers.unit_bound for _, f in parts])
        known = bool(np.isfinite(slope).all())
        require(eq.comm, known, "stability needs laws with a coefficient of friction")
        rn = -np.sum(force * n, axis=1)
        rt = force + rn[:, None] * n
        size, bound = np.linalg.norm(rt, axis=1), slope * rn
        largest = float(eq.comm.allreduce(rn.max(initial=0.0), op=max))
        movable = np.linalg.norm(n * free_components(eq), axis=1) > 0.5
        touches = movable & (closed(codes) | (gap <= _BORDER * eq.body_size))
        grazes = touches & (rn <= _BORDER * largest)
        slips = (senses(codes) == PLUS) | (senses(codes) == MINUS)
        at_bound = touches & ~grazes & (slope > 0)
        at_bound &= slips | (size >= bound * (1 - _BORDER))
        self.friction = slope
        self.directions = np.where(
            at_bound[:, None], -rt / np.where(size > 0, size, 1.0)[:, None], 0.0
        )
        if eq.dim == 2:
            tangent = np.stack([-n[:, 1], n[:, 0]], axis=1)
            self.directions[grazes] = tangent[grazes]
        self.choices = np.full((len(n), 4), -1)
        self.choices[:, 0] = np.where(~touches, OPEN, np.where(slope > 0, STICK, FREE))
        self.choices[at_bound, 1] = SLIP
        self.choices[grazes, 1] = OPEN
        self.choices[grazes & (slope > 0), 2:] = SLIP, BACK
        self.border = int(eq.comm.allreduce(int((self.choices[:, 1] >= 0).sum())))
        rounds = eq.dim == 3 and bool((grazes & (slope > 0)).any())
        self.rounds = bool(eq.comm.allreduce(int(rounds)))


class _Gathered:
    """Matrices and points on rank 0. Collective.

    Attributes:
        K, M, C: of free displacements.
        N: rows n.j of all points, 0 where Dirichlet data hold them (m, unknowns).
        T: rows of free tangents (k, unknowns), of the points `owner`, along `tangents` in terms of
            the directions: components d.t (k,).
    """

    def __init__(self, eq: ContactEquations, body: Body, points: _Points):
        comm, n = eq.comm, point_normals(eq)
        owner, tangents = free_tangents(eq)
        rows = (
            component_rows(eq, np.arange(len(n)), n),
            component_rows(eq, owner, tangents),
        )
        N, T = (on_root_dense(A) for A in rows)
        K, M = (on_root_dense(A) for A in (body.K, body.M))
        C = on_root_dense(body.C) if body.C is not None else None
        for A in rows:
            A.destroy()
        along = np.sum(points.directions[owner] * tangents, axis=1)
        first = comm.exscan(len(n)) or 0
        free = ~eq.fixed[: eq.owned_sizes[0]]
        parts = comm.gather((owner + first, along, points.choices, points.friction, free))
        if parts is None:
            return
        self.owner, self.along, self.choices, self.friction, free = (
            np.concatenate(p) for p in zip(*parts, strict=True)
        )
        inside = np.ix_(free, free)
        self.K, self.M = K[inside], M[inside]
        self.C = body.eta * self.K if C is None else C[inside]
        self.N, self.T = N[:, free], T[:, free]
        self.held = np.abs(self.N).max(axis=1, initial=0.0) == 0


def _decided(g: _Gathered, most: int) -> Stability:
    """Look at the pieces, those in which all points at a border slip first."""
    border = np.flatnonzero(g.choices[:, 1] >= 0)
    ways = [g.choices[p][g.choices[p] >= 0][::-1] for p in border]
    number = math.prod(len(w) for w in ways)
    growth, looked = 0.0, 0
    for chosen in product(*ways):
        if looked == most:
            break
        looked += 1
        doing = g.choices[:, 0].copy()
        doing[border] = chosen
        growth = max(growth, max(_growths(g, doing), default=0.0))
    if growth > 0:
        reason = "a motion that grows leaves in the cones of the points at a border"
        return Stability("unstable", growth, len(border), looked, reason)
    if looked < number:
        reason = f"{looked} of {number} pieces were looked at"
        return Stability("not decided", 0.0, len(border), looked, reason)
    return Stability("stable", 0.0, len(border), looked, f"nothing grows in any of {number} pieces")


def _growths(g: _Gathered, doing: npt.NDArray[np.int64]) -> Iterator[float]:
    """Lambda > 0 of a piece whose vectors lie in its cones."""
    slips, stuck = (doing == SLIP) | (doing == BACK), doing == STICK
    sign = np.where(doing == BACK, -1.0, 1.0)
    pressed = (slips | stuck | (doing == FREE)) & ~g.held
    # Tangents that are held: all of points that stick, those across the slip of others.
    moves = slips[g.owner] & (np.abs(g.along) > 0.5)
    tangents = (stuck | slips)[g.owner] & ~moves
    D = np.zeros_like(g.N)
    np.add.at(D, g.owner, g.along[:, None] * g.T)
    G = g.N + (np.where(slips, sign * g.friction, 0.0))[:, None] * D
    Z = null_space(np.concatenate([g.N[pressed], g.T[tangents]]))
    Y = null_space(np.concatenate([G[pressed], g.T[tangents]]))
    K, M, C = (Y.T @ A @ Z for A in (g.K, g.M, g.C))
    n = len(K)
    inertia = np.linalg.inv(M)
    first = np.block([[np.zeros((n, n)), np.eye(n)], [-inertia @ K, -inertia @ C]])
    values, vectors = np.linalg.eig(first)
    size = np.sqrt(np.abs(inertia @ K).max(initial=0.0))
    for value, x in zip(values, vectors[:n].T, strict=True):
        if abs(value.imag) <= _REAL * size and value.real > _REAL * size:
            turned = x / x[np.argmax(np.abs(x))]
            v = Z @ turned.real
            if any(_in_cones(g, doing, way * v, value.real) for way in (1.0, -1.0)):
                yield float(value.real)


def _in_cones(g: _Gathered, doing: npt.NDArray[np.int64], v: Array, growth: float) -> bool:
    """Whether a motion and its forces are such as the points at a border may have."""
    components = np.concatenate([g.N[~g.held], g.T])
    load = g.K @ v + growth * (g.C @ v) + growth**2 * (g.M @ v)
    forces = np.linalg.lstsq(components.T, load, rcond=None)[0]
    m = int((~g.held).sum())
    rn, shear, slip = np.zeros(len(g.N)), np.zeros(len(g.N)), np.zeros(len(g.N))
    rn[~g.held] = -forces[:m]
    np.add.at(shear, g.owner, g.along * forces[m:])
    np.add.at(slip, g.owner, g.along * (g.T @ v))
    border, grazing = g.choices[:, 1] >= 0, g.choices[:, 1] == OPEN
    force = _CONE * np.abs(forces).max(initial=0.0)
    length = _CONE * np.abs(components @ v).max(initial=0.0)
    opens = (g.N @ v <= length) | (doing != OPEN) | ~grazing
    presses = (rn >= -force) | (doing == OPEN) | ~grazing
    sign = np.where(doing == BACK, -1.0, 1.0)
    goes = (sign * slip >= -length) | ((doing != SLIP) & (doing != BACK))
    # A shear at its bound, -F rn d, may only become smaller in terms of the bound.
    within = (-shear <= g.friction * rn + force) | (doing != STICK)
    within &= (shear <= g.friction * rn + force) | (doing != STICK) | ~grazing
    return bool((opens & presses & goes & within)[border].all())
