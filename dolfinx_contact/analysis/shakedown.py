# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Shakedown: whether friction comes to rest under cycles of loads, by a bound and by steps.

Loads go round p_k(f) = p_s + f (p_k - p_s), f their factor. Melan's statement for friction: if some
slips w that do not change in time keep the forces of all points within friction's bound at all
corners of the cycle, the body comes to rest. The largest such factor is the *static bound*
(`static_bound`).

Rest is meant so that no point slips, opens or closes; points without friction slide freely, which
costs nothing. Beyond the bound there is no rest of this kind, though points may open and close
without a slip. Neither need it reach down to f = 0: points that p_s opens may be closed for ever at
large factors, and open and close between. `Shakedown.ranges` has all factors. Within these:

- **Without coupling** of slips and normal forces (S_tn = 0, of points with friction) the statement
  is a theorem (Klarbring, Ciavarella and Barber, Shakedown in elastic contact problems with Coulomb
  friction, Int. J. Solids Struct. 44, 2007). Normal forces do not depend on the slips, so that with
  the slips w~ of a state at rest, strictly inside the discs, (rt - rt~).dut <= 0 in every slip dut,
  and the energy of the difference, (u - u~).S (u - u~) / 2, falls by at least a share of |dut|:
  slips have a finite sum.
- **One point in the plane** with F |k| < k_t, S = [k_t, k; k, k_n]: a slip against rt = F rn > 0,
  which is to the left, needs (k_t - F k) (ut - w~) >= 0, and one to the right (k_t + F k) (ut - w~)
  <= 0: every slip is towards w~.
- **Parts** that are joined by no entry of S come to rest each for itself: points without coupling,
  and single points in the plane below their critical friction.
- **Else** the bound is necessary, and whether it is sufficient depends on where the body starts:
  the paper has counterexamples. Friction below the critical one is not enough: two points in the
  plane of which only shears are joined slip for ever from some starts, with F |k| / k_t = 0.12 and
  0.15 (`tests/unit/analysis/test_shakedown.py`). So cycles are stepped through (`load_cycles`).

With a wedged state whose forces are inside their cones (`wedging_friction`) every load can be
borne, if only the body is wedged enough: the bound is infinite.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from dolfinx_contact._mpi import Arguments, collective, everywhere, on_root
from dolfinx_contact._validate import count, instance, listed, nonnegative, positive
from dolfinx_contact.algorithms.gauss_seidel import GaussSeidel
from dolfinx_contact.algorithms.lemke import coulomb_by_lemke
from dolfinx_contact.algorithms.point_problem import PointProblem
from dolfinx_contact.analysis.load_cycles import LoadCycles, step_cycles
from dolfinx_contact.analysis.static_bound import largest_factor, states_at_rest
from dolfinx_contact.problem import ContactProblem

__all__ = ["LoadCycles", "Shakedown", "shakedown"]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
#: Puts a load into the data of a problem.
Load = Callable[[], object]

_UNCOUPLED = 1e-10  # of the stiffness of the two points, coupling that is none
_BELOW = 0.95  # of the static bound, at which cycles are stepped through
_LIMIT = 1e-7  # of the largest force, by which a point is from its bound
_SAME = 1e-9  # of the stiffness, by which it may differ from load to load


@dataclass(frozen=True, eq=False)
class Shakedown:
    """The static bound of a cycle of loads, and what became of cycles.

    Attributes:
        factor: the largest factor of the loads with a state at rest that was found, in which no
            point slips, opens or closes; infinite if all from one on have one, -inf if none has.
            Smaller ones have one as well where `ranges` begin with 0 and are one.
        ranges: factors that have a state at rest, from and to, by size; of all sets of open points
            that were tried. Between two of them, and from 0 to the first, there is none: points
            open and close in every cycle.
        upper: no state with open points as `opened` has a larger one. In the plane it is `factor`;
            in space they bound what is between tangents and polygons.
        complete: whether all sets of open points were tried; else there may be a larger factor.
        theorem_holds: whether within `ranges` the body comes to rest from every start.
        why: that, in words.
        slip: that the points have at rest (m, dim - 1), in the order of coordinates; 0 of open
            points, and of those without friction.
        forces: at the corners at rest (K, m, dim), tangential and normal, at `factor`.
        opened: points that are open at rest (m,).
        limits: what a larger factor would violate, in words.
        cycles: from several starts.
        seconds: that it took.
    """

    factor: float
    ranges: tuple[tuple[float, float], ...]
    upper: float
    complete: bool
    theorem_holds: bool
    why: str
    slip: Array
    forces: Array
    opened: Flags
    limits: tuple[str, ...]
    cycles: tuple[LoadCycles, ...]
    seconds: float

    @property
    def broken(self) -> tuple[LoadCycles, ...]:
        """Cycles of which there is a state at rest and that do not find one: they slip for ever."""
        slips = ("alternating slip", "ratcheting")
        ranges = [(a, b) for a, b in self.ranges if a < b]
        within = [c for c in self.cycles if any(a <= c.factor < b for a, b in ranges)]
        return tuple(c for c in within if c.ending in slips)

    def __str__(self) -> str:
        """The bound, whether it is sufficient, and what became of cycles."""
        bound = _in_words(self.ranges)
        if self.upper > self.factor * (1 + 1e-6):
            bound += f" (no more than {self.upper:.9g})"
        sets = "" if self.complete else ", not all sets of open points were tried"
        lines = [f"{bound}{sets}: {self.why}", *(f"  {limit}" for limit in self.limits)]
        if self.cycles:
            lines.append(f"cycles at the factor {self.cycles[0].factor:.6g}:")
        return "\n".join([*lines, *(f"  {c}" for c in self.cycles)])


def _in_words(ranges: tuple[tuple[float, float], ...]) -> str:
    """Factors with states at rest."""
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
    for name, least in (("cycles", 1), ("steps", 1), ("starts", 0)):
        count(getattr(a, name), name, least)
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
    """Whether friction comes to rest under cycles of loads. Collective.

    At rest no point slips, opens or closes. Where surfaces remember slips, as after a `QuasiStatic`
    run, all slips are counted from these, and the first cycles begin with them; the memory is left
    as it is, and the bound does not depend on it.

    Args:
        problem: of a linear body that Dirichlet data hold, with contact at its nodes.
        loads: the corners of the cycle in their order. Each is called without arguments and puts a
            load (or displacements of Dirichlet data) into the Constants and Functions of the
            problem; between corners the load is linear, and from the last it returns to the first.
            The first is in place when this returns, or raises an error.
        steady: the same for the load from which the factor multiplies departures; by default the
            first corner.
        factor: at which cycles are stepped through; by default 0.95 of the bound if that is in the
            last of `Shakedown.ranges`, or 1 where the bound is infinite or there is none.
        cycles: that are stepped through at most.
        steps: from corner to corner.
        starts: beside the one whose points have not slipped before, states at rest under the
            first load with large slips in random directions (the same in every call).
        seconds: after which no more sets of open points are tried.

    Raises:
        ValueError: on every rank, for a problem that has no contact points of its own
            (`ContactProblem.reduced`), loads that do not differ, or change stiffness or friction,
            or numbers that do not fit.
        RuntimeError: if a step finds no solution (in space).
    """
    comm = problem.comm
    given = [*loads[1:], loads[0] if steady is None else steady]
    reduced = [_under(problem, loads[0])]
    try:
        reduced += [_under(problem, load) for load in given]
    finally:
        with everywhere(comm, "a load"):
            loads[0]()
    return on_root(
        comm,
        lambda: shakedown_of(
            _same(reduced),
            np.array([points.p for points in reduced[:-1]]),
            reduced[-1].p,
            factor=factor,
            cycles=int(cycles),
            steps=int(steps),
            starts=int(starts),
            seconds=seconds,
        ),
    )


def _under(problem: ContactProblem, load: Load) -> PointProblem:
    """The contact points under a load. Collective."""
    with everywhere(problem.comm, "a load"):
        load()
    return problem.reduced()


def _same(reduced: list[PointProblem]) -> PointProblem:
    """The points of the first load, if all have its stiffness and friction."""
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
    """The same of contact points alone: loads of the corners (K, dim m). Not collective."""
    begun = time.monotonic()
    steady = loads[0] if steady is None else steady
    _, r = _statically(points, steady)
    static = largest_factor(points, steady, loads, r[:, -1] <= 0, begun + seconds)
    bound, upper = static.state.lower, static.state.upper
    holds, why = _theorem(points)
    chosen = _factor_of(static.ranges) if factor is None else factor
    corners = steady + chosen * (loads - steady)
    found = _stepped(points, corners, static.opened, chosen, cycles, steps, starts)
    limits = _limits(points, static.state.forces, static.state.displacements, static.opened)
    return Shakedown(
        factor=bound,
        ranges=static.ranges,
        upper=upper,
        complete=static.complete,
        theorem_holds=holds,
        why=why,
        slip=static.state.slip,
        forces=static.state.forces,
        opened=static.opened,
        limits=limits if np.isfinite(bound) else (),
        cycles=tuple(found),
        seconds=time.monotonic() - begun,
    )


def _factor_of(ranges: tuple[tuple[float, float], ...]) -> float:
    """At which cycles are stepped through: in the last range, below its end."""
    a, b = ranges[-1] if ranges else (0.0, 0.0)
    if b == np.inf:
        return max(1.0, 2.0 * a)
    return max(_BELOW * b, (a + b) / 2) or 1.0


def _theorem(points: PointProblem) -> tuple[bool, str]:
    """Whether rest is a theorem where there is a state at rest, and why."""
    m, d = points.number, points.dim
    rubs = (points.friction > 0) | (points.bound > 0)
    tangents = np.zeros((m, d), dtype=bool)
    tangents[:, :-1] = True
    free = tangents & ~rubs[:, None]
    S = _eliminated(points.S, free.reshape(-1))
    held = (tangents & ~free)[~free]
    point = np.repeat(np.arange(m), d)[~free.reshape(-1)]
    # Points may be of unlike stiffness: an entry is measured by those of its own two points.
    size = np.sqrt(np.diag(S))
    joined = np.abs(S) > _UNCOUPLED * size[:, None] * size
    coupled = np.unique(point[(joined & (held[:, None] != held)).any(axis=1)])
    if len(coupled) == 0:
        return True, "sufficient, as slips do not change normal forces"
    others = joined & (point[:, None] != point)
    # Of a point that is alone both rows are in S: what slides freely beside it makes it softer.
    alone = not others[np.isin(point, coupled)].any()
    if (
        d == 2
        and alone
        and all(
            _below_critical(points.friction[i], S[np.ix_(point == i, point == i)]) for i in coupled
        )
    ):
        if m == 1:
            return True, "sufficient, as one point with less than its critical friction k_t/|k|"
        return True, (
            "sufficient, as each point whose slip changes its normal force is joined to no other "
            "and has less than its critical friction k_t/|k|"
        )
    return False, "necessary, not sufficient from every start, as slips change normal forces"


def _below_critical(friction: float, S: Array) -> bool:
    """Whether a point in the plane has less than its critical friction k_t/|k|, S = [k_t, k]."""
    k_t, k = S[0]
    return bool(friction * abs(k) < k_t)


def _eliminated(S: Array, free: Flags) -> Array:
    """The stiffness of what is not free, where that bears no force."""
    if not free.any():
        return S
    inner = np.linalg.solve(S[np.ix_(free, free)], S[np.ix_(free, ~free)])
    return np.asarray(S[np.ix_(~free, ~free)] - S[np.ix_(~free, free)] @ inner)


def _statically(points: PointProblem, p: Array) -> tuple[Array, Array]:
    """A solution of the static problem, displacements and forces (m, dim)."""
    at = replace(points, p=p, S_error=None, p_error=None)
    if points.dim == 2:
        state, _ = coulomb_by_lemke(at.S, at.p, at.friction, bound=at.bound)
        return state[:, :2], state[:, 2:]
    found = GaussSeidel(max_iterations=20_000).run(at, tolerance=1e-11)
    if not found.converged:
        raise RuntimeError(f"no solution under the first load: {found.reason}")
    return found.a, found.r


def _stepped(
    points: PointProblem,
    corners: Array,
    opened: Flags,
    factor: float,
    cycles: int,
    steps: int,
    starts: int,
) -> list[LoadCycles]:
    """Cycles from points that have not slipped, then from states at rest under the first load."""
    shares = np.arange(1, steps + 1) / steps
    after = np.roll(corners, -1, axis=0)
    loads = np.concatenate(
        [p + shares[:, None] * (q - p) for p, q in zip(corners, after, strict=True)]
    )
    first = {"from no slip": _statically(points, corners[0])}
    others = states_at_rest(points, corners[0], opened, starts)
    first |= {f"from slips {i}": state for i, state in enumerate(others, 1)}
    return [
        step_cycles(points, loads, state, start=start, factor=factor, cycles=cycles)
        for start, state in first.items()
    ]


def _limits(points: PointProblem, forces: Array, a: Array, opened: Flags) -> tuple[str, ...]:
    """Which points are at their bounds, and at which corners."""
    size = _LIMIT * float(np.abs(forces).max(initial=0.0))
    length = _LIMIT * float(np.abs(a).max(initial=0.0))
    rubs = (points.friction > 0) | (points.bound > 0)
    found = []
    for k, i in np.ndindex(forces.shape[:2]):
        rt, rn = np.linalg.norm(forces[k, i, :-1]), forces[k, i, -1]
        if opened[i]:
            if a[k, i, -1] <= length:
                found.append(f"point {i} is about to close at corner {k}")
        elif rn <= size:
            found.append(f"point {i} is about to open at corner {k}")
        elif rubs[i] and rt >= points.friction[i] * rn + points.bound[i] - size:
            found.append(f"point {i} is about to slip at corner {k}")
    return tuple(found)
