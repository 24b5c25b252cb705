# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Bounds of all solutions by their energy.

Contact does no work and friction dissipates: r.a <= 0 at a solution, so that a.S a <= p.a, an
ellipsoid. With c = S^-1 p / 2 and rho^2 = p.S^-1 p / 4, a linear functional of a is at most
l.c + rho (l.S^-1 l)^(1/2) on it, and one of the forces, l.r = S l.a - l.p, at most
-l.p / 2 + rho (l.S l)^(1/2).

At every point six nonnegative quantities are bounded, the `SLOTS`: the parts ut+ and ut- of
ut = ut+ - ut-, un, the slacks s+ = F rn + g + rt and s- = F rn + g - rt of the friction bound, and
rn. A status is which of them may differ from zero, where s+ and s- of a point without friction do
not count.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dolfinx_contact.analysis.reduced_problem import Masks, ReducedProblem, has_status
from dolfinx_contact.analysis.rounding import gamma, up

__all__ = ["SLOTS", "bounded", "restricted"]

Array = npt.NDArray[np.float64]

SLOTS = ("ut+", "ut-", "un", "s+", "s-", "rn")
#: Slots that may be positive, by status: with friction, and without.
_USED = np.zeros((7, 6), dtype=bool)
for _status, _slots in enumerate(["012", "345", "045", "135", "234", "024", "123"]):
    _USED[_status, [int(k) for k in _slots]] = True
_USED_FREE = _USED.copy()
_USED_FREE[2] = [True, True, False, False, False, True]


def bounded(problem: ReducedProblem) -> Array:
    """Upper bounds of the slots of all points, at every solution (6, m)."""
    S, p, m = problem.S, problem.p, problem.points
    n, least = 2 * m, problem.least
    G = np.asarray(np.linalg.inv(S), dtype=np.float64)
    # S x = b is off by no more than its residual over the least eigenvalue.
    off = _residuals(problem, G, np.eye(n), np.zeros((n, n)))
    diagonal = np.maximum(np.diag(G), 0) + np.sqrt(up((off**2).sum(axis=0))) / least
    twice = G @ p
    away = _residuals(problem, twice[:, None], p[:, None], problem.dp[:, None])[:, 0]
    shift = float(np.sqrt(up((away**2).sum()))) / least
    work = p @ twice + gamma(n) * np.abs(p) @ np.abs(twice)
    work += float(np.abs(p).sum() * shift + problem.dp @ (np.abs(twice) + shift))
    rho = float(np.sqrt(up(np.maximum(work, 0)))) / 2
    reach = rho * np.sqrt(up(diagonal))
    t, k = np.arange(0, n, 2), np.arange(1, n, 2)
    F, g = problem.friction, problem.g
    ub: Array = np.zeros((6, m))
    size = np.abs(twice) + shift
    ub[0], ub[1], ub[2] = (
        sign * twice[i] / 2 + reach[i] + 2 * gamma(4) * size[i] + shift
        for sign, i in ((1, t), (-1, t), (1, k))
    )
    D = np.diag(S) + np.diag(problem.dS)
    for slot, sign, normal in ((3, 1.0, F), (4, -1.0, F), (5, 0.0, np.ones(m))):
        form = normal**2 * D[k] + abs(sign) * D[t]
        form += 2 * sign * normal * S[t, k] + 2 * abs(sign) * normal * problem.dS[t, k]
        load = np.abs(p) * gamma(8) + problem.dp
        ub[slot] = -(normal * p[k] + sign * p[t]) / 2 + abs(sign) * g
        ub[slot] += normal * load[k] + abs(sign) * (load[t] + g * gamma(8))
        ub[slot] += rho * np.sqrt(up(np.maximum(form, 0) + gamma(16) * (F**2 * D[k] + D[t])))
    ub = up(np.maximum(ub, 0))
    given = g > 0
    ub[3:5, given] = np.minimum(ub[3:5, given], up(2 * g[given]))
    ub[3:5, (F == 0) & ~given] = 0.0
    return ub


def _residuals(problem: ReducedProblem, x: Array, b: Array, b_error: Array) -> Array:
    """Bounds of |b - S x|, column by column."""
    size = np.abs(x)
    rounded = gamma(len(x)) * (np.abs(b) + np.abs(problem.S) @ size)
    return up(np.abs(b - problem.S @ x) + rounded + problem.dS @ size + b_error)


def used(problem: ReducedProblem) -> npt.NDArray[np.bool_]:
    """Which slots may be positive, by point and status (m, 7, 6)."""
    free = (problem.friction == 0) & (problem.g == 0)
    return np.where(free[:, None, None], _USED_FREE, _USED)


def restricted(problem: ReducedProblem, allowed: Masks, ub: Array) -> Array:
    """The bounds, 0 where no allowed status uses a slot (6, m)."""
    has = has_status(allowed)
    return np.where((has[:, :, None] & used(problem)).any(axis=1).T, ub, 0.0)
