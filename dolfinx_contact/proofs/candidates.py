# SPDX-License-Identifier: LGPL-3.0-or-later
"""Approximate solutions in a region of the search for a proof in 2D.

A region consists of the allowed statuses of every point. The semismooth Newton method solves the
linear equations for one status per point (`check_proof`), then assigns to every point the allowed
status required by its displacements and forces. If statuses repeat, only one point is changed per
iteration. Nothing is proved here.

At points whose status is decided, approximate solutions need not satisfy the inequalities of the
law: unlike in `laws.coulomb`, the normal force may have any sign at a point that must be closed,
and friction is restricted to the allowed statuses.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from dolfinx_contact._arrays import Array, Codes
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK, WHERE_OPEN
from dolfinx_contact.proofs.check_proof import (
    CLOSED,
    IS_FREE,
    IS_OPEN,
    OPENED,
    SENSE,
    Masks,
    ReducedProblem,
    has_status,
    matrix_of,
)

__all__ = ["candidates", "within"]


_ROUNDS = 40


def candidates(
    problem: ReducedProblem,
    allowed: Masks,
    starts: Iterable[Codes],
    random: np.random.Generator,
    tries: int,
) -> Iterator[Codes]:
    """Yield the statuses of approximate solutions in a region, possibly with repetitions.

    Args:
        problem: reduced problem with m points, scaled by `ReducedProblem.scaled`.
        allowed: allowed statuses of the points as bit masks, shape (m,).
        starts: initial statuses that are tried first, shape (m,) each.
        random: generator of the random starts.
        tries: number of further starts, uniform or random.
    """
    m = problem.points
    may_be = has_status(allowed)
    for k, start in enumerate([*starts, *_starts(m, tries, random)]):
        rho = float(np.diag(problem.S).mean()) * 10 ** (random.uniform(-1.5, 1.5) if k else 0.0)
        codes = np.array(
            [start[i] if may_be[i, start[i]] else np.flatnonzero(may_be[i])[0] for i in range(m)],
            dtype=np.int8,
        )
        found = _newton(problem, allowed, codes, rho)
        if found is not None:
            yield found


def within(regions: Sequence[Masks], number: int, random: np.random.Generator) -> Iterator[Codes]:
    """Yield random statuses of m points, shape (m,), from several regions in turn.

    Args:
        regions: at least one region, each given by its allowed statuses as bit masks, shape (m,).
        number: number of starts.
        random: generator of the starts.
    """
    order = random.permutation(len(regions))
    for k in range(number):
        may_be = has_status(regions[order[k % len(order)]])
        drawn = np.where(may_be, random.random(may_be.shape), -1.0)
        yield drawn.argmax(axis=1).astype(np.int8)


def _starts(m: int, tries: int, random: np.random.Generator) -> Iterator[Codes]:
    """Yield initial statuses: one for all points, then random by points or blocks, shape (m,)."""
    for k in range(tries):
        if k <= MINUS:
            yield np.full(m, k, dtype=np.int8)
        elif k % 3 == 0:
            yield random.integers(OPEN, MINUS + WHERE_OPEN + 1, m).astype(np.int8)
        else:
            ends = np.sort(random.integers(0, m + 1, int(random.integers(0, 4))))
            blocks = random.integers(OPEN, MINUS + 1, len(ends) + 1)
            yield blocks[np.searchsorted(ends, np.arange(m), side="right")].astype(np.int8)


def _newton(problem: ReducedProblem, allowed: Masks, codes: Codes, rho: float) -> Codes | None:
    """Update the statuses of the points until they do not change; None without convergence.

    Args:
        problem: reduced problem with m points, scaled by `ReducedProblem.scaled`.
        allowed: allowed statuses of the points as bit masks, shape (m,).
        codes: initial statuses, shape (m,).
        rho: factor from displacements to forces, see `_required`.
    """
    seen: set[bytes] = set()
    single = 0
    for _ in range(_ROUNDS + 3 * problem.points):
        state = _state(problem, codes)
        if state is None:
            return None
        new = _required(problem, allowed, codes, state, rho)
        differs = np.flatnonzero(new != codes)
        if len(differs) == 0:
            return codes
        single += new.tobytes() in seen
        seen.add(new.tobytes())
        if single > 3 * problem.points or (not single and len(seen) > _ROUNDS):
            return None
        if single:
            last = differs[-1]
            new = np.where(np.arange(len(codes)) == last, new, codes).astype(np.int8)
        codes = new
    return None


def _state(problem: ReducedProblem, codes: Codes) -> tuple[Array, Array, Array, Array] | None:
    """Return (ut, un, rt, rn) for given statuses, shape (m,) each, without error bounds.

    None if the linear equations are singular.
    """
    load = problem.p.copy()
    load[0::2] -= np.where(IS_FREE[codes], SENSE[codes] * problem.g, 0.0)
    try:
        z = np.linalg.solve(matrix_of(problem.S, problem.friction, codes), load).reshape(-1, 2)
    except np.linalg.LinAlgError:
        return None
    if not np.abs(z).max() < 1e12:
        return None
    free = IS_FREE[codes]
    opened = IS_OPEN[codes]
    rn = np.where(opened, 0.0, z[:, 1])
    slip = -SENSE[codes] * (problem.friction * rn + problem.g)
    ut = np.where(free, z[:, 0], 0.0)
    un = np.where(opened, z[:, 1], 0.0)
    return ut, un, np.where(free, slip, z[:, 0]), rn


def _required(
    problem: ReducedProblem,
    allowed: Masks,
    codes: Codes,
    state: tuple[Array, Array, Array, Array],
    rho: float,
) -> Codes:
    """Return the allowed status required by the state (ut, un, rt, rn) of each point, shape (m,).

    For example, a point closes if rn - rho un > 0.
    """
    new = codes.copy()
    F = problem.friction
    g = problem.g
    for i, (ut, un, rt, rn) in enumerate(zip(*state, strict=True)):
        mask = int(allowed[i])
        if mask & (mask - 1) == 0:
            continue
        closes = bool(mask & CLOSED) and (not mask & OPENED or rn - rho * un > 0)
        if F[i] == 0 and g[i] == 0:
            new[i] = PLUS if closes else OPEN
            continue
        if F[i] > 0 and not closes:
            new[i] = OPEN
            continue
        # Remaining tangential statuses, numbered as those of a closed point.
        shift = 0 if closes else WHERE_OPEN
        left = [s for s in (STICK, PLUS, MINUS) if mask >> (s + shift) & 1]
        if len(left) == 1:
            new[i] = left[0] + shift
            continue
        force = rn - rho * un if mask & OPENED else rn
        radius = F[i] * force + g[i]
        pull = rt - rho * ut
        below = PLUS in left and pull < -radius
        above = MINUS in left and pull > radius
        if radius <= 0 and len(left) == 3:
            # The point is certainly closed, so that its normal force may have any sign.
            sticks = codes[i] == STICK
            if sticks and abs(rt) <= F[i] * abs(rn):
                new[i] = STICK
            else:
                new[i] = PLUS if (rt > 0 if sticks else ut > 0) else MINUS
        elif STICK in left and not below and not above:
            new[i] = STICK + shift
        elif MINUS not in left or (PLUS in left and pull < 0):
            new[i] = PLUS + shift
        else:
            new[i] = MINUS + shift
    return new
