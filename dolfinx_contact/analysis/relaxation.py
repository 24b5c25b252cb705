# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Linear programs that tell which statuses may be possible.

S a = r + p with the slots (`check_proof.py`) between 0 and their bounds X; of slots that no allowed
status uses together x / X + y / Y <= 1 holds, and for all five of a point with Coulomb friction,
which exclude each other in a cycle, sum x / X <= 2: that is the convex hull of its statuses. Such
rows are added when they are violated.

Slots of forces are affine in those of displacements, so that no equation has to be solved to begin
with. The dual simplex method goes from one program to the next, in which a few
bounds differ. Its objective is drawn at random, so that it does not cycle. Where it ends without a
point it has a row that proves so, whose multipliers y are returned; `check_proof.Dual` decides what
they prove.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import numpy.typing as npt
from scipy.linalg.blas import dger

from dolfinx_contact.analysis.check_proof import Masks, ReducedProblem, has_status, used

__all__ = ["Relaxation"]

Array = npt.NDArray[np.float64]

_FEASIBLE = 1e-9
_VIOLATED = 1e-6  # of a row of the hull that is worth adding
_PIVOT = 1e-9
_CYCLE = (0, 1, 2, 3, 4)


class Relaxation:
    """The relaxation of a region, a tableau that lasts from program to program.

    Numbers of variables are slot * m + point; 6 m + point is rt of a point without friction, which
    is held at 0; rows of the hull follow.

    Args:
        problem: scaled.
        allowed: sets of statuses, masks (m,).
        ub: bounds of the slots (6, m).
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
        self._hull_terms: list[tuple[npt.NDArray[np.int64], Array]] = []
        # Rows of rt, rn over ut+, ut-, un.
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
        self._T = np.ascontiguousarray(np.concatenate(rows))
        self._basic = np.concatenate(numbers)
        self._nonbasic = np.arange(3 * m)
        self._values = np.concatenate(start)
        self._at = np.zeros(3 * m)
        self._costs = np.random.default_rng(0).uniform(0.5, 1.0, 3 * m)  # reduced, of the nonbasic
        self._up = np.zeros(7 * m)
        self._up[: 6 * m] = ub.reshape(-1)
        self._conflicts(allowed)
        for point in range(m):
            self.hold(point, int(allowed[point]))

    def _conflicts(self, allowed: Masks) -> None:
        """Pairs of slots that no allowed status uses together, and whole cycles."""
        has = has_status(allowed)
        live = self._ub > 1e-9 * max(1.0, float(self._ub.max()))
        self._pairs: list[tuple[int, int, npt.NDArray[np.int64]]] = []
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
        """Allow the statuses ``mask`` at a point."""
        has = np.array([mask >> s & 1 > 0 for s in range(7)])
        uses = self._uses[point][has].any(axis=0)
        for slot in range(6):
            k = slot * self.m + point
            self._up[k] = self._ub[slot, point] if uses[slot] else 0.0
        mine = np.flatnonzero((self._nonbasic < 6 * self.m) & (self._nonbasic % self.m == point))
        self._set(mine, np.where(self._costs[mine] < 0, self._up[self._nonbasic[mine]], 0.0))

    def _set(self, columns: npt.NDArray[np.int64], to: Array) -> None:
        """Give nonbasic variables values."""
        moved = to != self._at[columns]
        if moved.any():
            columns = columns[moved]
            to = to[moved]
            self._values += self._T[:, columns] @ (to - self._at[columns])
            self._at[columns] = to

    # -- the dual simplex method ------------------------------------------------------------------

    def infeasible(self) -> Array | None:
        """Multipliers that tell why there is no point, or None if there is one, or no answer."""
        for _ in range(60):
            y = self._repair()
            if y is not None or self._lost or not self._separate():
                return y
        return None

    def _repair(self) -> Array | None:
        """Pivot until every variable is between its bounds."""
        self._lost = False
        for _ in range(40 + 4 * self._T.shape[1]):
            below = -self._values
            above = self._values - self._up[self._basic]
            worst = np.maximum(below, above)
            wrong = np.flatnonzero(worst > _FEASIBLE)
            if len(wrong) == 0:
                return None
            # The row that is farthest off, in the space of the nonbasic variables.
            norms = np.sqrt(np.einsum("ij,ij->i", self._T[wrong], self._T[wrong]))
            r = int(wrong[np.argmax(worst[wrong] / (1e-12 + norms))])
            off = float(worst[r])
            sign = 1.0 if below[r] >= above[r] else -1.0
            row = sign * self._T[r]
            most = self._up[self._nonbasic]
            room = np.where(row > 0, most - self._at, self._at)
            room[np.abs(row) <= _PIVOT] = 0.0
            gain = np.abs(row) * np.where(np.isfinite(room), room, 1e100)
            if gain.sum() < off:
                return self._multipliers(r, sign)
            j = self._entering(row, gain, off)
            self._pivot(r, j, 0.0 if sign > 0 else float(self._up[self._basic[r]]))
        self._lost = True
        return None

    def _entering(self, row: Array, gain: Array, off: float) -> int:
        """The variable that enters; those before it that cannot reach go to their other bound."""
        free = np.flatnonzero(gain > 0)
        order = free[np.argsort(np.abs(self._costs[free]) / np.abs(row[free]))]
        last = min(int(np.searchsorted(np.cumsum(gain[order]), off)), len(order) - 1)
        flips = order[:last]
        self._set(flips, np.where(row[flips] > 0, self._up[self._nonbasic[flips]], 0.0))
        return int(order[last])

    def _pivot(self, r: int, j: int, to: float) -> None:
        T = self._T
        element = float(self._T[r, j])
        across = T[r] / element
        down = T[:, j].copy()
        step = (to - float(self._values[r])) / element
        dger(-1.0, across, down, a=T.T, overwrite_a=True)
        T[r] = -across
        T[:, j] = down / element
        T[r, j] = 1.0 / element
        cost = float(self._costs[j])
        self._costs -= cost * across
        self._costs[j] = cost / element
        self._values += down * step
        self._values[r] = self._at[j] + step
        self._at[j] = to
        self._basic[r], self._nonbasic[j] = self._nonbasic[j], self._basic[r]

    def _multipliers(self, r: int, sign: float) -> Array:
        """The y of the identity that the row represents."""
        m = self.m
        F = self.problem.friction
        v = np.zeros(len(self._up))
        v[self._nonbasic] = -sign * self._T[r]
        v[self._basic[r]] += sign
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
        """Values of the slots (6, m); rn is that of points without Coulomb friction."""
        x = np.zeros(len(self._up))
        x[self._nonbasic] = self._at
        x[self._basic] = self._values
        return x[: 6 * self.m].reshape(6, self.m)

    def _separate(self) -> bool:
        """Add violated rows of the hull; whether there were any."""
        part = self.point / np.where(self._ub > 0, self._ub, np.inf)
        terms: list[tuple[npt.NDArray[np.int64], float]] = []
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
