# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Linear programs that exclude statuses in the search for a proof in 2D.

The programs contain the equilibrium equations. The six nonnegative quantities of each point
(`check_proof.bounded`) are limited by their bounds. Two quantities x <= X and y <= Y that are never
both nonzero in an allowed status satisfy x / X + y / Y <= 1. The five quantities of a point with
Coulomb friction exclude each other in a cycle: the sum of their ratios to their bounds is at most
2. These inequalities describe the convex hull of the statuses and are added when violated.

Forces are affine functions of displacements, so that the first tableau is known without solving
equations. The dual simplex method (`tableau`) proceeds from one program to the next. If a program
is infeasible, the multipliers of the proving row are returned, and `check_proof.Dual` determines
which statuses they exclude.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact.proofs.check_proof import Masks, ReducedProblem, has_status, used
from dolfinx_contact.proofs.tableau import Tableau

__all__ = ["Relaxation"]


_VIOLATED = 1e-6  # smallest violation for which a row of the hull is added
_CYCLE = (0, 1, 2, 3, 4)


class Relaxation(Tableau):
    """Linear relaxation of a region, whose tableau is reused from one linear program to the next.

    At point i of m points, the variable with the index k m + i is the quantity k of
    `check_proof.bounded`. The variable 6 m + i is the tangential force, fixed at 0, if the point
    has no friction. The slack variables of the inequalities of the convex hull follow.

    Args:
        problem: reduced problem, scaled by `ReducedProblem.scaled`.
        allowed: allowed statuses of the points as bit masks, shape (m,).
        ub: upper bounds of the quantities of `check_proof.bounded`, shape (6, m).
    """

    def __init__(self, problem: ReducedProblem, allowed: Masks, ub: Array):
        self.problem = problem
        self.m = problem.points
        m = self.m
        S = problem.S
        p = problem.p
        F = problem.friction
        g = problem.g
        self._uses = used(problem)
        self._ub = ub
        self._hull_terms: list[tuple[Ints, Array]] = []
        # Express rt and rn by ut+, ut- and un.
        forces = np.concatenate([S[:, 0::2], -S[:, 0::2], S[:, 1::2]], axis=1)
        rt = forces[0::2]
        rn = forces[1::2]
        rows = []
        start = []
        numbers = []
        for slot, sign in ((3, 1.0), (4, -1.0)):
            i = np.flatnonzero((F > 0) | (g > 0))
            rows.append(F[i, None] * rn[i] + sign * rt[i])
            start.append(-F[i] * p[1::2][i] - sign * p[0::2][i] + g[i])
            numbers.append(slot * m + i)
        lifts = np.flatnonzero(F == 0)
        glides = np.flatnonzero((F == 0) & (g == 0))
        rows += [rn[lifts], rt[glides]]
        start += [-p[1::2][lifts], -p[0::2][glides]]
        numbers += [5 * m + lifts, 6 * m + glides]
        up = np.zeros(7 * m)
        up[: 6 * m] = ub.reshape(-1)
        super().__init__(
            np.concatenate(rows), np.concatenate(start), np.concatenate(numbers), 3 * m, up
        )
        self._conflicts(allowed)
        for point in range(m):
            self.hold(point, int(allowed[point]))

    def _conflicts(self, allowed: Masks) -> None:
        """Store the pairs of quantities that exclude each other, and the points with cycles."""
        has = has_status(allowed)
        live = self._ub > 1e-9 * max(1.0, float(self._ub.max()))
        self._pairs: list[tuple[int, int, Ints]] = []
        full = self.problem.friction > 0
        for a, b in combinations(range(6), 2):
            together = (has & self._uses[:, :, a] & self._uses[:, :, b]).any(axis=1)
            apart = (~together if (a, b) != (0, 1) else np.ones(self.m, bool)) & live[a] & live[b]
            if b == 5:
                apart &= ~full
            elif a in (3, 4) or b in (3, 4):
                apart &= full | (self.problem.g > 0)
            self._pairs.append((a, b, np.flatnonzero(apart)))
        cycle = full & (allowed == 0b1111) & live[:5].all(axis=0)
        self._cycles = np.flatnonzero(cycle)

    def hold(self, point: int, mask: int) -> None:
        """Restrict a point to the statuses in the bit mask ``mask``."""
        has = np.array([mask >> s & 1 > 0 for s in range(7)])
        uses = self._uses[point][has].any(axis=0)
        for slot in range(6):
            k = slot * self.m + point
            self._up[k] = self._ub[slot, point] if uses[slot] else 0.0
        mine = np.flatnonzero((self._nonbasic < 6 * self.m) & (self._nonbasic % self.m == point))
        self._set(mine, np.where(self._costs[mine] < 0, self._up[self._nonbasic[mine]], 0.0))

    def infeasible(self) -> Array | None:
        """Return multipliers (`check_proof.Dual`) that prove infeasibility, shape (2 m,).

        None if the program is feasible or this is undecided. m is the number of points.
        """
        for _ in range(60):
            identity = self._repair()
            if identity is not None:
                return self._multipliers(identity)
            if self.lost or not self._separate():
                return None
        return None

    def _multipliers(self, v: Array) -> Array:
        """Return multipliers of a linear identity of all variables, scaled to 1, shape (2 m,)."""
        m = self.m
        F = self.problem.friction
        for k, (members, parts) in enumerate(self._hull_terms):
            v[members] -= v[7 * m + k] * parts
        s_plus, s_minus, rn, rt = (v[k * m : (k + 1) * m] for k in (3, 4, 5, 6))
        y = np.empty(2 * m)
        y[0::2] = s_minus - s_plus - rt
        y[1::2] = -F * (s_plus + s_minus) - rn
        return y / (np.abs(y).max(initial=0.0) or 1.0)

    # -- the hull ---------------------------------------------------------------------------------

    @property
    def point(self) -> Array:
        """Quantities of `check_proof.bounded` at the present vertex, shape (6, m).

        The normal force is valid only at points without Coulomb friction.
        """
        return self._all_values[: 6 * self.m].reshape(6, self.m)

    def _separate(self) -> bool:
        """Add violated inequalities of the convex hull; return whether any were added."""
        part = self.point / np.where(self._ub > 0, self._ub, np.inf)
        terms: list[tuple[Ints, float]] = []
        for a, b, points in self._pairs:
            violated = points[part[a, points] + part[b, points] > 1 + _VIOLATED]
            terms += [(np.array([a * self.m + i, b * self.m + i]), 1.0) for i in violated]
        sums = part[:5, self._cycles].sum(axis=0)
        for i in self._cycles[sums > 2 + _VIOLATED]:
            terms.append((np.array([k * self.m + i for k in _CYCLE]), 2.0))
        if not terms:
            return False
        where = np.zeros(len(self._up), dtype=np.int64)
        where[self._nonbasic] = np.arange(len(self._nonbasic))
        where[self._basic] = -1 - np.arange(len(self._basic))
        rows = np.zeros((len(terms), self._T.shape[1]))
        values = np.empty(len(terms))
        for k, (members, most) in enumerate(terms):
            parts: Array = np.asarray(1.0 / self._ub.reshape(-1)[members])
            values[k] = most
            for place, part_of in zip(where[members], parts, strict=True):
                if place >= 0:
                    rows[k, place] -= part_of
                    values[k] -= part_of * self._at[place]
                else:
                    rows[k] -= part_of * self._T[-1 - place]
                    values[k] -= part_of * self._values[-1 - place]
            self._hull_terms.append((members, parts))
        first = len(self._up)
        self._T = np.ascontiguousarray(np.concatenate([self._T, rows]))
        self._values = np.concatenate([self._values, values])
        self._basic = np.concatenate([self._basic, np.arange(first, first + len(terms))])
        self._up = np.concatenate([self._up, np.full(len(terms), np.inf)])
        return True
