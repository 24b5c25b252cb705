# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Shakedown: does friction come to rest under cyclic loads? A static bound, and stepped cycles.

The loads cycle through p_k(f) = p_s + f (p_k - p_s), with the corners p_k, the steady load p_s and
the load factor f. Melan's statement for friction: if constant slips w exist that keep the forces of
all points within the friction bound at all corners of the cycle, the body comes to rest. The
largest load factor with such slips is the *static bound* (`static_bound`).

At rest no point slips, opens or closes; points without friction slide freely, without dissipation.
No such state exists beyond the bound, though points may open and close without slip. The range of
factors need not begin at f = 0: points opened by p_s may stay closed at large factors, but open and
close at small factors. `Shakedown.ranges` contains all factors with a state at rest. Within these
ranges:

- **Without coupling** of slips and normal forces (S_tn = 0 at points with friction) the statement
  is a theorem (Klarbring, Ciavarella and Barber, Shakedown in elastic contact problems with Coulomb
  friction, Int. J. Solids Struct. 44, 2007). Normal forces do not depend on the slips. Let a state
  at rest have the slips w~ and shears rt~ strictly inside the discs. Then (rt - rt~).dut <= 0 for
  every slip increment dut, and the energy (u - u~).S (u - u~) / 2 of the difference decreases by at
  least a fixed multiple of |dut|. Hence the sum of all slips is finite.
- **One point in the plane** with F |k| < k_t, S = [k_t, k; k, k_n]: a slip to the left, against rt
  = F rn > 0, requires (k_t - F k) (ut - w~) >= 0. A slip to the right requires (k_t + F k) (ut -
  w~) <= 0. Hence every slip is directed towards w~.
- **Uncoupled parts**, not connected by entries of S, come to rest independently. The theorem then
  covers parts without coupling, and single points in the plane below their critical friction.
- **Otherwise** the bound is necessary, but whether it is sufficient depends on the initial state;
  the paper contains counterexamples. Subcritical friction is not enough: two points in the plane
  that are coupled only through their shears, with F |k| / k_t = 0.12 and 0.15, slip forever from
  some initial states (`tests/unit/analysis/test_shakedown.py`). Cycles are therefore stepped
  through (`load_cycles`).

If a wedged state with forces inside their cones exists (`wedging_friction`), the bound is infinite:
every load can be borne if the body is wedged firmly enough.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact._mpi import Arguments, collective, everywhere, on_root
from dolfinx_contact._validate import count, instance, listed, nonnegative, positive
from dolfinx_contact.analysis.load_cycles import LoadCycles, one_solution, step_cycles
from dolfinx_contact.analysis.static_bound import Ranges, largest_factor, states_at_rest
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["LoadCycles", "Shakedown", "shakedown"]

#: Function that puts a load into the data of a problem.
Load = Callable[[], object]

_UNCOUPLED = 1e-10  # coupling that counts as zero, relative to the stiffness of the two points
_BELOW = 0.95  # default factor of the cycles, relative to the static bound
_LIMIT = 1e-7  # distance of a point from its bound that counts as zero, relative
_SAME = 1e-9  # relative difference of equal stiffnesses


@dataclass(frozen=True, eq=False)
class Shakedown:
    """Static bound of a load cycle, and stepped cycles from several initial states.

    Attributes:
        factor: largest load factor found with a state at rest, in which no point slips, opens or
            closes; infinite if all sufficiently large factors have a state at rest, -inf if no
            factor has. All smaller factors have a state at rest if `ranges` is one range from 0.
        ranges: intervals of load factors with a state at rest, in increasing order, for all sets of
            open points that were tried. At other factors below `factor`, points open and close in
            every cycle.
        upper: upper bound of the factor for the set `opened` of open points. It equals `factor` in
            the plane; in space, `factor` results from polygons inside the friction discs and
            `upper` from tangents.
        complete: whether all sets of open points were tried; otherwise a larger factor may exist.
        theorem_holds: whether a theorem guarantees that the body comes to rest from every initial
            state, for load factors within `ranges`.
        why: explanation of `theorem_holds`.
        slip: constant slips of the m points in the state at rest with `factor`, ordered by
            coordinates; 0 at open points and at points without friction; shape (m, dim - 1).
        forces: forces in this state at the K corners of the cycle, tangential and normal, shape
            (K, m, dim).
        opened: mask of the open points in this state, shape (m,).
        limits: descriptions of the conditions that a larger factor would violate.
        cycles: stepped cycles from several initial states.
        seconds: computing time.
    """

    factor: float
    ranges: Ranges
    upper: float
    complete: bool
    theorem_holds: bool
    why: str
    slip: Array
    forces: Array
    opened: Mask
    limits: tuple[str, ...]
    cycles: tuple[LoadCycles, ...]
    seconds: float

    @property
    def broken(self) -> tuple[LoadCycles, ...]:
        """Cycles with persistent slip although a state at rest exists."""
        slips = ("alternating slip", "ratcheting")
        ranges = [(a, b) for a, b in self.ranges if a < b]
        within = [c for c in self.cycles if any(a <= c.factor < b for a, b in ranges)]
        return tuple(c for c in within if c.ending in slips)

    def __str__(self) -> str:
        """Return the bound, whether it is sufficient, and the final behaviour of the cycles."""
        bound = _in_words(self.ranges)
        if self.upper > self.factor * (1 + 1e-6):
            bound += f" (no more than {self.upper:.9g})"
        sets = "" if self.complete else ", not all sets of open points were tried"
        lines = [f"{bound}{sets}: {self.why}", *(f"  {limit}" for limit in self.limits)]
        if self.cycles:
            lines.append(f"cycles at the factor {self.cycles[0].factor:.6g}:")
        return "\n".join([*lines, *(f"  {c}" for c in self.cycles)])


def _in_words(ranges: Ranges) -> str:
    """Describe the ranges of load factors with states at rest as text."""
    if not ranges:
        return "no factor has a state at rest"
    if ranges == ((0.0, np.inf),):
        return "every factor has a state at rest"
    words = [
        f"up to the factor {b:.9g}"
        if a == 0
        else f"from the factor {a:.9g} " + ("on" if b == np.inf else f"up to {b:.9g}")
        for a, b in ranges
    ]
    return "at rest " + ", and ".join(words)


def _check(a: Arguments) -> None:
    instance(a.problem, "problem", ContactProblem)
    a.loads = listed(a.loads, "loads")
    if len(a.loads) < 2 or not all(map(callable, a.loads)):
        raise ValueError("loads must be two functions or more, each of which puts a load in place")
    if a.steady is not None and not callable(a.steady):
        raise ValueError(f"steady must be a function that puts a load in place, got {a.steady!r}")
    if a.factor is not None:
        positive(a.factor, "factor")
    a.cycles = count(a.cycles, "cycles")
    a.steps = count(a.steps, "steps")
    a.starts = count(a.starts, "starts", least=0)
    nonnegative(a.seconds, "seconds")


@collective("shakedown", _check, local=("loads", "steady"))
def shakedown(
    problem: ContactProblem,
    loads: Sequence[Load],
    *,
    steady: Load | None = None,
    factor: float | None = None,
    cycles: int = 50,
    steps: int = 4,
    starts: int = 4,
    seconds: float = 60.0,
) -> Shakedown:
    """Determine whether frictional slip ceases under cyclic loads (shakedown). Collective.

    At rest no point slips, opens or closes. After a `QuasiStatic` run, slips are measured from the
    remembered slips, from which the first cycles also start. The bound does not depend on the
    memory, which is left unchanged.

    Args:
        problem: contact problem of a linear body held by Dirichlet data, with contact at its nodes.
        loads: corners of the cycle in order. Each is a function without arguments writing a
            load (or displacements of Dirichlet data) to the Constants and Functions of the problem.
            Between corners, and from the last to the first, the load varies linearly. The first
            load is set afterwards, also after an error.
        steady: function setting the steady load p_s; the factor multiplies the differences from
            it. Default: the first corner.
        factor: load factor of the stepped cycles; by default 0.95 of the bound, within the last of
            `Shakedown.ranges`, or 1 if the bound is infinite or no state at rest exists.
        cycles: largest number of cycles from each initial state. Default 50.
        steps: number of steps between two corners of the cycle. Default 4.
        starts: number of initial states in addition to the state without slip. They are states at
            rest under the first load with large slips in random directions, reproducible between
            calls. Default 4.
        seconds: time limit of the search over sets of open points, in seconds. Default 60.

    Raises:
        ValueError: on every rank, if the problem cannot be reduced to its contact points
            (`ContactProblem.reduced`), if the loads are equal or change the stiffness or the
            friction, or if a number is not valid.
        RuntimeError: if no solution of a step is found (in space).
    """
    comm = problem.comm
    reduced = []
    try:
        for load in (*loads, loads[0] if steady is None else steady):
            with everywhere(comm, "a load"):
                load()
            reduced.append(problem.reduced())
    finally:
        with everywhere(comm, "a load"):
            loads[0]()
    corners = np.array([points.p for points in reduced[:-1]])
    return on_root(
        comm,
        lambda: shakedown_of(
            _same(reduced),
            corners,
            reduced[-1].p,
            factor=factor,
            cycles=cycles,
            steps=steps,
            starts=starts,
            seconds=seconds,
        ),
    )


def _same(reduced: list[PointProblem]) -> PointProblem:
    """Return the reduced problem under the first load.

    Raises:
        ValueError: if the stiffness or the friction differs between loads.
    """
    first = reduced[0]
    size = float(np.abs(first.S).max())
    for points in reduced[1:]:
        same = np.abs(points.S - first.S).max() <= _SAME * size
        laws = [(points.friction, first.friction), (points.bound, first.bound)]
        if not same or not all(np.array_equal(a, b) for a, b in laws):
            raise ValueError("a load changes the stiffness or the friction: only loads may differ")
    return first


def shakedown_of(
    points: PointProblem,
    loads: Array,
    steady: Array | None = None,
    *,
    factor: float | None = None,
    cycles: int = 50,
    steps: int = 4,
    starts: int = 4,
    seconds: float = 60.0,
) -> Shakedown:
    """Return the result of `shakedown` for m contact points. Not collective.

    ``loads`` are the loads of the K corners, shape (K, dim m), ``steady`` is the steady load, shape
    (dim m,), by default the first corner.
    """
    begun = time.monotonic()
    steady = loads[0] if steady is None else steady
    opened = _statically(points, steady)[1][:, -1] <= 0
    state, ranges, complete = largest_factor(points, steady, loads, opened, begun + seconds)
    holds, why = _theorem(points)
    chosen = _factor_of(ranges) if factor is None else factor
    # Step from the state without slip, and from states at rest under the first load.
    corners = steady + chosen * (loads - steady)
    after = np.roll(corners, -1, axis=0)
    shares = np.arange(1, steps + 1)[:, None] / steps
    path = np.concatenate([p + shares * (q - p) for p, q in zip(corners, after, strict=True)])
    first = {"from no slip": _statically(points, corners[0])}
    at_rest = states_at_rest(points, corners[0], state.opened, starts)
    first |= {f"from slips {i}": other for i, other in enumerate(at_rest, 1)}
    found = [
        step_cycles(points, path, begin, start=start, factor=chosen, cycles=cycles)
        for start, begin in first.items()
    ]
    limits = _limits(points, state.forces, state.displacements, state.opened)
    return Shakedown(
        factor=state.lower,
        ranges=ranges,
        upper=state.upper,
        complete=complete,
        theorem_holds=holds,
        why=why,
        slip=state.slip,
        forces=state.forces,
        opened=state.opened,
        limits=limits if np.isfinite(state.lower) else (),
        cycles=tuple(found),
        seconds=time.monotonic() - begun,
    )


def _factor_of(ranges: Ranges) -> float:
    """Return the default load factor, just below the end of the last range with rest."""
    a, b = ranges[-1] if ranges else (0.0, 0.0)
    if b == np.inf:
        return max(1.0, 2.0 * a)
    return max(_BELOW * b, (a + b) / 2) or 1.0


def _theorem(points: PointProblem) -> tuple[bool, str]:
    """Return `Shakedown.theorem_holds` and `Shakedown.why` for contact points."""
    m, d = points.number, points.dim
    rubs = (points.friction > 0) | (points.bound > 0)
    tangents = np.zeros((m, d), dtype=bool)
    tangents[:, :-1] = True
    free = tangents & ~rubs[:, None]
    S = _eliminated(points.S, free.reshape(-1))
    held = (tangents & ~free)[~free]
    point = np.repeat(np.arange(m), d)[~free.reshape(-1)]
    # The stiffness may differ from point to point: an entry is measured by its own two points.
    size = np.sqrt(np.diag(S))
    joined = np.abs(S) > _UNCOUPLED * size[:, None] * size
    coupled = np.unique(point[(joined & (held[:, None] != held)).any(axis=1)])
    if len(coupled) == 0:
        return True, "sufficient, as slips do not change normal forces"
    others = joined & (point[:, None] != point)
    # Both rows of a single point are in S; freely sliding neighbours make it softer.
    if d == 2 and not others[np.isin(point, coupled)].any():
        rows = {i: S[np.ix_(point == i, point == i)][0] for i in coupled}
        if all(points.friction[i] * abs(k) < kt for i, (kt, k) in rows.items()):
            which = "one point, with"
            if m > 1:
                which = "each point whose slip changes its normal force is joined to no other, with"
            return True, f"sufficient, as {which} less than its critical friction k_t/|k|"
    return False, "necessary, not sufficient from every start, as slips change normal forces"


def _eliminated(S: Array, free: Mask) -> Array:
    """Return the stiffness after elimination of the force-free components (Schur complement)."""
    if not free.any():
        return S
    inner = np.linalg.solve(S[np.ix_(free, free)], S[np.ix_(free, ~free)])
    return np.asarray(S[np.ix_(~free, ~free)] - S[np.ix_(~free, free)] @ inner)


def _statically(points: PointProblem, p: Array) -> tuple[Array, Array]:
    """Return a static solution under the load p: displacements and forces, shape (m, dim)."""
    at = replace(points, p=p, S_error=None, p_error=None)
    return one_solution(at, "no solution under the first load")


def _limits(points: PointProblem, forces: Array, a: Array, opened: Mask) -> tuple[str, ...]:
    """Describe the points about to open, close or slip, and at which corners of the cycle.

    Forces and displacements ``a`` at the K corners have shape (K, m, dim).
    """
    size = _LIMIT * float(np.abs(forces).max(initial=0.0))
    length = _LIMIT * float(np.abs(a).max(initial=0.0))
    rubs = (points.friction > 0) | (points.bound > 0)
    rt, rn = np.linalg.norm(forces[:, :, :-1], axis=2), forces[:, :, -1]
    closes = opened & (a[:, :, -1] <= length)
    opens = ~opened & (rn <= size)
    slips = ~opened & rubs & (rt >= points.friction * rn + points.bound - size)
    event = np.select([closes, opens, slips], ["close", "open", "slip"], "")
    return tuple(
        f"point {i} is about to {event[k, i]} at corner {k}" for k, i in np.argwhere(event != "")
    )
