# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Curves of special points in two parameters.

The curves are branches of the extended system

    H(x, gamma, mu) = 0,    phi(x, gamma, mu) = 0

in the unknowns (x, gamma) with the parameter mu, where phi is a condition of `conditions.py`. The
extended system is a `System` with the pieces of H. A curve is traced by arc length, also through
changes of status of other points. A smooth fold of mu on a curve of smooth folds is a cusp.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol, get_args

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._mpi import Arguments, collective, require
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

_LOST = 127  # artificial status of the point of a `StatusChange` beyond the end of the curve


class ParameterSystem(Protocol):
    """A system whose parameter can be set: H as a function of mu, with gamma fixed."""

    def set_parameter(self, gamma: float) -> None:
        """Set the value of the parameter in H. Collective."""

    def parameter_derivative(
        self, x: PETSc.Vec, gamma: float, c: PETSc.Vec, piece: Piece | None
    ) -> None:
        """Write the derivative of H by the parameter into ``c``; the other parameter is as set."""

    def check_parameter(self, gammas: Sequence[float]) -> None:
        """Raise ``ValueError`` if the problem does not exist at one of these values."""


@dataclass(frozen=True)
class SpecialCurve:
    """A curve of special points.

    Attributes:
        points: (mu, gamma) of the points of the curve in order, beginning with the end that was
            traced towards smaller mu, shape (n, 2).
        meetings: (mu, gamma) where further points change their status, shape (n, 2).
        turns: (mu, gamma) where mu turns back, which are cusps of smooth folds, shape (n, 2).
        branches: branches of the extended system, towards smaller and towards larger mu.
        reasons: descriptions of the endings of the two branches.
    """

    points: npt.NDArray[np.float64]
    meetings: npt.NDArray[np.float64]
    turns: npt.NDArray[np.float64]
    branches: tuple[Branch, Branch]
    reasons: tuple[str, str]

    def at(self, mu: float) -> list[float]:
        """Return the values of gamma of the curve at ``mu``, interpolated linearly."""
        m, g = self.points.T
        k = np.flatnonzero((m[:-1] - mu) * (m[1:] - mu) <= 0)
        parts = [(mu - m[i]) / (m[i + 1] - m[i]) if m[i + 1] != m[i] else 0.0 for i in k]
        return [float(g[i] + part * (g[i + 1] - g[i])) for i, part in zip(k, parts, strict=True)]


class _Extended(System):
    """Extended system: H and a condition phi in the unknowns X = (x, gamma) and parameter mu.

    Args:
        system: H with gamma.
        other: the same H with mu.
        condition: condition phi.
        gamma_scale: size of gamma that counts as 1.
        x_size: square of the length of x that counts as 1, in the metric of the system.
        border: change of status that is the condition; None for a smooth fold.
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
        self._owns_border = border is not None and border.rank == self.comm.rank

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

    def _set(self, X: PETSc.Vec, mu: float, piece: Piece | None) -> tuple[PETSc.Vec, float, Piece]:
        """Set mu, and return a copy of x, gamma, and the piece of H.

        By default the state determines the piece. The point of a status change keeps the status
        before the change.
        """
        x, gamma = self.layout.split(X)
        x.copy(self._x)
        self.other.set_parameter(mu)
        piece = self.system.piece_at(self._x, gamma) if piece is None else piece
        border = self._border
        if border is not None:
            piece = with_status(self.comm, piece, border, border.before)
        return self._x, gamma, piece

    # -- H and the condition ---------------------------------------------------------------------

    def residual(self, X: PETSc.Vec, mu: float, b: PETSc.Vec, piece: Piece | None) -> float:
        x, gamma, own = self._set(X, mu, piece)
        phi, size_of_phi = self.condition.value(x, gamma, own)
        size = self.system.residual(x, gamma, self._c, own)
        self.layout.join(self._c, phi, b)
        return max(size, size_of_phi)

    def jacobian(self, X: PETSc.Vec, mu: float, piece: Piece | None) -> None:
        x, gamma, own = self._set(X, mu, piece)

        def by_gamma(state: PETSc.Vec, side: Piece, out: PETSc.Vec) -> None:
            self.system.parameter_derivative(state, gamma, out, side)

        self.condition.gradient(x, gamma, own, self._d)
        slope = self.condition.derivative(x, gamma, own, by_gamma)
        self.layout.join(self._d, slope, self._row)
        self._solver.assemble(X, self._row, own)

    def parameter_derivative(
        self, X: PETSc.Vec, mu: float, c: PETSc.Vec, piece: Piece | None
    ) -> None:
        x, gamma, own = self._set(X, mu, piece)
        self.system.residual(x, gamma, self._c, own)  # sets gamma in H

        def by_mu(state: PETSc.Vec, side: Piece, out: PETSc.Vec) -> None:
            self.other.parameter_derivative(state, mu, out, side)

        slope = self.condition.derivative(x, gamma, own, by_mu)
        by_mu(x, own, self._c)
        self.layout.join(self._c, slope, c)

    def metric(self, X: PETSc.Vec, out: PETSc.Vec) -> None:
        x, gamma = self.layout.split(X)
        self.system.metric(x, self._d)
        self._d.scale(1.0 / self._x_size)
        self.layout.join(self._d, gamma / self._gamma_scale**2, out)

    def probe(self, seed: int) -> PETSc.Vec:
        x = self.system.probe(seed)
        out = self.layout.joined(x, float(np.cos(seed)))
        x.destroy()
        return out

    # -- pieces ----------------------------------------------------------------------------------

    def piece_at(self, X: PETSc.Vec, mu: float) -> Piece:
        return self._set(X, mu, None)[2]

    def events(self, X: PETSc.Vec, mu: float, piece: Piece) -> Events:
        """Return the events of H, on both sides of the border that the condition describes.

        The change across this border is not an event. All events of its point end the curve.
        """
        x, gamma, own = self._set(X, mu, piece)
        before = self.system.events(x, gamma, own)
        border = self._border
        if border is None:
            return before
        other = with_status(self.comm, piece, border, border.after)
        after = self.system.events(x, gamma, other)
        if not self._owns_border:
            return before
        at = before.point == border.point
        distance = np.concatenate(
            [
                before.distance[at & (before.target != border.after)],
                after.distance[(after.point == border.point) & (after.target != border.before)],
            ]
        )
        if piece.codes[border.point] == _LOST:
            distance = np.full(max(len(distance), 1), -1.0)
        n = len(distance)
        return Events(
            np.concatenate([before.distance[~at], distance]),
            np.concatenate([before.point[~at], np.full(n, border.point, dtype=np.int32)]),
            np.concatenate([before.target[~at], np.full(n, _LOST, dtype=np.int8)]),
        )

    def statuses(self, point: int) -> Sequence[int]:
        if self._owns_border and self._border is not None and point == self._border.point:
            return (self._border.before,)
        return self.system.statuses(point)

    # -- the data --------------------------------------------------------------------------------

    def put(self, X: PETSc.Vec, mu: float, piece: Piece) -> None:
        self.system.put(*self._set(X, mu, piece))

    def check_parameter(self, gammas: Sequence[float]) -> None:
        self.other.check_parameter(gammas)

    def restored(self, *, always: bool = False) -> AbstractContextManager[None]:
        return self.system.restored(always=always)

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
    """Trace a fold, or another event of one point, as a second parameter varies. Collective.

    The curve of an event ends where its point reaches another border. The data of the systems are
    restored.

    Args:
        system: H with its parameter gamma, with assembled matrices.
        other: the same H with its parameter mu, with the same vectors.
        mu: value of mu on the branch.
        branch: branch of ``system``.
        special: special point of the branch: a located change of status of one point, or a smooth
            fold.
        mu_range: range of mu; the curve ends at either end.
        gamma_scale: size of gamma that counts as 1.
        control: step lengths.
        max_steps: largest number of steps in each direction.

    Raises:
        ValueError: on every rank, if an argument is invalid or differs between ranks, or there is
            no curve through the special point.
    """
    require(
        system.comm,
        system.preconditioner is None,
        "curves in two parameters need assembled matrices: use the direct linear solver",
    )
    layout = Layout(system)
    x, gamma = layout.split(special.y)
    x = x.copy()
    other.set_parameter(mu)
    # the condition, on the piece of the point before
    before = branch.points[special.index - 1]
    border = None if _is_smooth_fold(special) else special.changes[0]
    condition: Condition
    if border is None:
        condition = SmoothFold(system, x, gamma, before.piece)
    else:
        away, its_gamma = layout.split(before.y)
        condition = StatusChange(system, border, away.copy(), its_gamma, before.piece)
    weight = system.create_vector()
    system.metric(x, weight)
    x_size = float(weight.dot(x)) or 1.0
    extended = _Extended(
        system, other, condition, gamma_scale=gamma_scale, x_size=x_size, border=border
    )
    X = layout.joined(x, gamma)
    branches: dict[Direction, Branch] = {}
    try:
        with system.restored(always=True):
            for direction in get_args(Direction):
                if not leads_out(mu, sign_of(direction), mu_range):
                    branches[direction] = follow(
                        extended,
                        X,
                        mu,
                        gamma_range=mu_range,
                        direction=direction,
                        control=control,
                        max_steps=max_steps,
                        route="steps",
                        progress=False,
                    )
        if len(branches) == 1:  # the branch starts at an end of the range
            ((direction, only),) = branches.items()
            empty = Branch([only.points[0]])
            empty.end(Ending.REACHED)
            branches["decreasing" if direction == "increasing" else "increasing"] = empty
        return _curve(extended, branches["decreasing"], branches["increasing"])
    finally:
        other.set_parameter(mu)
        extended.destroy()
        for v in (x, X, weight, layout.x):
            v.destroy()


def _curve(extended: _Extended, down: Branch, up: Branch) -> SpecialCurve:
    """Return the curve that consists of two branches from one point. Collective."""
    layout = Layout(extended)

    def places(points: Sequence[BranchPoint | SpecialPoint]) -> npt.NDArray[np.float64]:
        rows = []
        for point in points:
            X, mu = layout.split(point.y)
            rows.append((mu, extended.layout.gamma(X)))
        return np.array(rows, dtype=float).reshape(-1, 2)

    special = [*reversed(down.special), *up.special]
    curve = SpecialCurve(
        places([*reversed(down.points[1:]), *up.points]),
        places([s for s in special if not s.smooth]),
        places([s for s in special if s.kind == "fold" and s.smooth]),
        (down, up),
        (down.reason, up.reason),
    )
    layout.x.destroy()
    return curve
