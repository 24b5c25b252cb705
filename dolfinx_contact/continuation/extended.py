# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Curves of special points in two parameters, by the extended system.

    H(x, gamma, mu) = 0,    phi(x, gamma, mu) = 0

in the unknowns (x, gamma) with the parameter mu, where phi is a condition of `conditions.py`. It is
a `System` like any other, with the pieces of H: a curve is followed by predictor and corrector, by
arc length, through changes of status of further points. Where mu turns back smoothly on a curve of
smooth folds there is a cusp of these.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol, get_args

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._errors import require
from dolfinx_contact.continuation.arguments import (
    check_system,
    checked_gamma,
    checked_range,
    leads_out,
    require_smooth,
)
from dolfinx_contact.continuation.branch import Branch, BranchPoint, Change, SpecialPoint
from dolfinx_contact.continuation.conditions import (
    Condition,
    Derivative,
    SmoothFold,
    StatusChange,
    with_status,
)
from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.continuation.factorised import Factorised
from dolfinx_contact.continuation.follow import follow
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.continuation.parameters import Direction, StepControl, sign_of
from dolfinx_contact.continuation.system import Events, Piece, System

__all__ = ["ParameterSystem", "SpecialCurve", "follow_special"]

_LOST = 127  # status of the point of a `StatusChange` beyond the end of its border


class ParameterSystem(Protocol):
    """A system whose parameter can be set; two with one H and two parameters are followed."""

    def set_parameter(self, gamma: float) -> None:
        """Take the parameter into H. Collective."""

    def parameter_derivative(
        self, x: PETSc.Vec, gamma: float, c: PETSc.Vec, piece: Piece | None
    ) -> None:
        """The derivative of H by the parameter into ``c``, the other parameter as it was set."""

    def check_parameter(self, gammas: Sequence[float]) -> None:
        """Raise ``ValueError`` if there is no problem at one of these."""


@dataclass(frozen=True)
class SpecialCurve:
    """A curve of special points.

    Attributes:
        points: (mu, gamma) of its points, mu first rising from the least one (n, 2).
        meetings: (mu, gamma) where further points change their status (n, 2).
        turns: (mu, gamma) where mu turns back: cusps of smooth folds (n, 2).
        branches: what was followed, towards smaller and towards larger mu.
        reasons: why these ended.
    """

    points: npt.NDArray[np.float64]
    meetings: npt.NDArray[np.float64]
    turns: npt.NDArray[np.float64]
    branches: tuple[Branch, Branch]
    reasons: tuple[str, str]

    def at(self, mu: float) -> list[float]:
        """Gamma at points of the curve whose mu is ``mu``, to the accuracy of a straight line."""
        m, g = self.points.T
        k = np.flatnonzero((m[:-1] - mu) * (m[1:] - mu) <= 0)
        parts = [(mu - m[i]) / (m[i + 1] - m[i]) if m[i + 1] != m[i] else 0.0 for i in k]
        return [float(g[i] + part * (g[i + 1] - g[i])) for i, part in zip(k, parts, strict=True)]


class _Extended(System):
    """H and a condition, in X = (x, gamma), with the parameter mu.

    Args:
        system: H with gamma.
        other: the same H with mu.
        condition: that holds as well.
        gamma_scale: size of gamma that counts as 1.
        x_size: square of the length of x that counts as 1, in the metric of the system.
        border: the change of status that is the condition; None for a smooth fold.
    """

    def __init__(
        self,
        system: System,
        other: ParameterSystem,
        condition: Condition,
        *,
        gamma_scale: float,
        x_size: float,
        border: Change | None,
    ):
        self.comm = system.comm
        self.system = system
        self.other = other
        self.condition = condition
        self.layout = Layout(system)
        self._solver = Factorised(self.layout, "special_", reuse=False)
        self._c, self._d, self._x = (system.create_vector() for _ in range(3))
        self._row = self.layout.vector()
        self._gamma_scale = gamma_scale
        self._x_size = x_size
        self._border = border
        self._mine = border is not None and border.rank == self.comm.rank

    # -- H and the condition ---------------------------------------------------------------------

    def _split(self, X: PETSc.Vec) -> tuple[PETSc.Vec, float]:
        """x, in a vector of its own, and gamma."""
        x, gamma = self.layout.split(X)
        x.copy(self._x)
        return self._x, gamma

    @property
    def matrix(self) -> PETSc.Mat:  # type: ignore[override]
        return self._solver.matrix

    @property
    def scales(self) -> tuple[float, ...]:  # type: ignore[override]
        return self.system.scales

    @scales.setter
    def scales(self, scales: tuple[float, ...]) -> None:
        if scales:
            self.system.scales = scales

    def create_vector(self) -> PETSc.Vec:
        return self.layout.vector()

    def _held(self, x: PETSc.Vec, gamma: float, piece: Piece | None) -> Piece:
        """The piece of H; where none is given the one that the state determines."""
        piece = self.system.piece_at(x, gamma) if piece is None else piece
        border = self._border
        return piece if border is None else with_status(self.comm, piece, border, border.before)

    def residual(self, X: PETSc.Vec, mu: float, b: PETSc.Vec, piece: Piece | None) -> float:
        x, gamma = self._split(X)
        self.other.set_parameter(mu)
        held = self._held(x, gamma, piece)
        phi, small = self.condition.value(x, gamma, held)
        size = self.system.residual(x, gamma, self._c, held)
        self.layout.join(self._c, phi, b)
        return max(size, small)

    def jacobian(self, X: PETSc.Vec, mu: float, piece: Piece | None) -> None:
        x, gamma = self._split(X)
        self.other.set_parameter(mu)
        held = self._held(x, gamma, piece)
        self.condition.gradient(x, gamma, held, self._d)
        slope = self.condition.derivative(x, gamma, held, self._by_gamma(gamma))
        self.layout.join(self._d, slope, self._row)
        self._solver.assemble(X, self._row, held)

    def _by_gamma(self, gamma: float) -> Derivative:
        return lambda x, piece, c: self.system.parameter_derivative(x, gamma, c, piece)

    def parameter_derivative(
        self, X: PETSc.Vec, mu: float, c: PETSc.Vec, piece: Piece | None
    ) -> None:
        x, gamma = self._split(X)
        self.other.set_parameter(mu)
        held = self._held(x, gamma, piece)
        self.system.residual(x, gamma, self._c, held)  # which takes gamma into H

        def by_mu(at: PETSc.Vec, there: Piece, out: PETSc.Vec) -> None:
            self.other.parameter_derivative(at, mu, out, there)

        slope = self.condition.derivative(x, gamma, held, by_mu)
        by_mu(x, held, self._c)
        self.layout.join(self._c, slope, c)

    def metric(self, X: PETSc.Vec, out: PETSc.Vec) -> None:
        x, gamma = self._split(X)
        self.system.metric(x, self._d)
        self._d.scale(1.0 / self._x_size)
        self.layout.join(self._d, gamma / self._gamma_scale**2, out)

    def probe(self, seed: int) -> PETSc.Vec:
        x = self.system.probe(seed)
        out = self.create_vector()
        self.layout.join(x, float(np.cos(seed)), out)
        x.destroy()
        return out

    # -- pieces ----------------------------------------------------------------------------------

    def piece_at(self, X: PETSc.Vec, mu: float) -> Piece:
        x, gamma = self._split(X)
        self.other.set_parameter(mu)
        return self._held(x, gamma, None)

    def events(self, X: PETSc.Vec, mu: float, piece: Piece) -> Events:
        """Those of H on both sides of the border, but for the change that is the condition."""
        x, gamma = self._split(X)
        self.other.set_parameter(mu)
        found = self.system.events(x, gamma, self._held(x, gamma, piece))
        border = self._border
        if border is None:
            return found
        other = with_status(self.comm, piece, border, border.after)
        beyond = self.system.events(x, gamma, other)
        if not self._mine:
            return found
        here = found.point == border.point
        there = beyond.point == border.point
        own = np.concatenate(
            [
                found.distance[here & (found.target != border.after)],
                beyond.distance[there & (beyond.target != border.before)],
            ]
        )
        if piece.codes[border.point] == _LOST:
            own = np.full(max(len(own), 1), -1.0)
        n = len(own)
        return Events(
            np.concatenate([found.distance[~here], own]),
            np.concatenate([found.point[~here], np.full(n, border.point, dtype=np.int32)]),
            np.concatenate([found.target[~here], np.full(n, _LOST, dtype=np.int8)]),
        )

    def statuses(self, point: int) -> Sequence[int]:
        if self._mine and self._border is not None and point == self._border.point:
            return (self._border.before,)
        return self.system.statuses(point)

    # -- the rest --------------------------------------------------------------------------------

    def put(self, X: PETSc.Vec, mu: float, piece: Piece) -> None:
        x, gamma = self._split(X)
        self.other.set_parameter(mu)
        self.system.put(x, gamma, self._held(x, gamma, piece))

    def check_parameter(self, gammas: Sequence[float]) -> None:
        self.other.check_parameter(gammas)

    @contextmanager
    def restored(self, *, always: bool = False) -> Iterator[None]:
        with self.system.restored(always=always):
            yield

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._solver.destroy()
        self.condition.destroy()
        for v in (self._c, self._d, self._x, self._row, self.layout.x):
            v.destroy()


def _is_smooth_fold(special: SpecialPoint) -> bool:
    return special.smooth and special.kind == "fold"


def _check(a: Arguments) -> None:
    check_system(a.system)
    require_smooth(a.system)
    a.mu = checked_gamma(a.mu, "mu")
    a.mu_range = checked_range(a.mu_range, [a.mu], "mu")
    one = a.special.located and len(a.special.changes) == 1
    if not (one or _is_smooth_fold(a.special)):
        raise ValueError("a smooth fold, or a located change of one point, is needed")
    if not a.gamma_scale > 0:
        raise ValueError(f"the scale of gamma must be positive, got {a.gamma_scale}")


@collective("follow_special", _check)
def follow_special(
    system: System,
    other: ParameterSystem,
    mu: float,
    branch: Branch,
    special: SpecialPoint,
    *,
    mu_range: tuple[float, float],
    gamma_scale: float,
    control: StepControl | None = None,
    max_steps: int = 1000,
) -> SpecialCurve:
    """Follow a fold, or another event of one point, as a second parameter varies. Collective.

    Where that point comes to a further border of its own the curve ends. What the systems write to
    is left as it was.

    Args:
        system: H with its parameter gamma, with assembled matrices.
        other: the same H with its parameter mu, in the same vectors.
        mu: its value on the branch.
        branch: that was followed with ``system``.
        special: a special point of it: a located change of status of one point, or a smooth fold.
        mu_range: the curve ends where mu reaches either end.
        gamma_scale: size of gamma that counts as 1.
        control: step lengths.
        max_steps: budget, each way.

    Raises:
        ValueError: on every rank, if an argument does not fit or differs between ranks, the special
            point is of another kind, or there is no curve through it.
    """
    require(
        system.comm,
        system.preconditioner is None,
        "curves in two parameters need assembled matrices: take the direct linear solver",
    )
    low, high = mu_range
    smooth = _is_smooth_fold(special)
    layout = Layout(system)
    before = branch.points[special.index - 1]
    x, gamma = layout.split(special.y)
    x = x.copy()
    other.set_parameter(mu)
    border = None if smooth else special.changes[0]
    condition = _condition(system, layout, before, border, x, gamma)
    weight = system.create_vector()
    system.metric(x, weight)
    x_size = float(weight.dot(x)) or 1.0
    extended = _Extended(
        system, other, condition, gamma_scale=gamma_scale, x_size=x_size, border=border
    )
    X = extended.create_vector()
    layout.join(x, gamma, X)
    way: dict[str, Any] = dict(gamma_range=(low, high), control=control, max_steps=max_steps)
    try:
        with system.restored(always=True):
            ways = {
                to: follow(extended, X, mu, direction=to, route="steps", progress=False, **way)
                for to in get_args(Direction)
                if not leads_out(mu, sign_of(to), (low, high))
            }
        down, up = (ways.get(to) or _nowhere(ways) for to in reversed(get_args(Direction)))
        return _curve(extended, down, up)
    finally:
        other.set_parameter(mu)
        extended.destroy()
        for v in (x, X, weight, layout.x):
            v.destroy()


def _condition(
    system: System,
    layout: Layout,
    before: BranchPoint,
    border: Change | None,
    x: PETSc.Vec,
    gamma: float,
) -> Condition:
    """What holds at (x, gamma): that a point changes its status there, or else a smooth fold.

    ``before`` is the point before it on the branch, in whose piece it lies.
    """
    if border is None:
        return SmoothFold(system, x, gamma, before.piece)
    away, there = layout.split(before.y)
    return StatusChange(system, border, away.copy(), there, before.piece)


def _nowhere(ways: Mapping[Direction, Branch]) -> Branch:
    """The way that is none, from the end of the range: the start of the other one."""
    (other,) = ways.values()
    branch = Branch([other.points[0]])
    branch.end(Ending.REACHED)
    return branch


def _curve(extended: _Extended, down: Branch, up: Branch) -> SpecialCurve:
    layout = Layout(extended)

    def place(y: PETSc.Vec) -> tuple[float, float]:
        X, mu = layout.split(y)
        return mu, extended.layout.gamma(X)

    def places(ys: Sequence[PETSc.Vec]) -> npt.NDArray[np.float64]:
        return np.array([place(y) for y in ys], dtype=float).reshape(-1, 2)

    both = [*reversed(down.points[1:]), *up.points]
    special = [*reversed(down.special), *up.special]
    curve = SpecialCurve(
        places([p.y for p in both]),
        places([s.y for s in special if not s.smooth]),
        places([s.y for s in special if s.kind == "fold" and s.smooth]),
        (down, up),
        (down.reason, up.reason),
    )
    layout.x.destroy()
    return curve
