# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Curves of special points in two parameters.

The curves are branches of the extended system

    H(x, gamma, mu) = 0,    phi(x, gamma, mu) = 0

in the unknowns X = (x, gamma) with the parameter mu. There are two conditions phi:

- Change of a status: the pieces H_0 and H_1 on either side agree there, so that on H_0 = 0

      phi = w . (H_1 - H_0)(x, gamma)

  vanishes for one fixed w. The gradient is (J_1 - J_0)^T w.
- Smooth fold: H_x is singular, and phi = g in

      [ H_x  b ] [ v ]   [ 0 ]          [ H_x^T  c ] [ psi ]   [ 0 ]
      [ c^T  0 ] [ g ] = [ 1 ],         [ b^T    0 ] [ g   ] = [ 1 ]

  vanishes, with fixed b and c (Govaerts, Numerical Methods for Bifurcations of Dynamical
  Equilibria, SIAM 2000, ch. 4). The derivative in any direction is - psi . (H_x)' v. The derivative
  of H_x v by x is the transposed derivative of H_x along v, computed by central differences.

The extended system is a `System` with the pieces of H. A curve is traced by arc length, also
through changes of status of other points. A smooth fold of mu on a curve of smooth folds is a cusp.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, get_args

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._ending import Ending
from dolfinx_contact._mpi import Arguments, collective, require
from dolfinx_contact._petsc import Factor
from dolfinx_contact._validate import number, positive
from dolfinx_contact.continuation.arguments import (
    check_system,
    checked_range,
    leads_out,
    require_smooth,
)
from dolfinx_contact.continuation.branch import Branch, BranchPoint, Change, SpecialPoint
from dolfinx_contact.continuation.factorised import BorderedMatrix
from dolfinx_contact.continuation.follow import follow
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.continuation.parameters import Direction, StepControl, sign_of
from dolfinx_contact.continuation.system import Events, Piece, ResidualScales, System

__all__ = ["SpecialCurve", "follow_special"]

_STEP = 1e-5  # step of central differences, relative to the size of x
_LOST = 127  # artificial status of the point of a status change beyond the end of the curve

#: Function (x, piece, out) that writes the derivative of H by a parameter into a vector.
Derivative = Callable[[PETSc.Vec, Piece, PETSc.Vec], None]


@dataclass(frozen=True)
class SpecialCurve:
    """A curve of special points.

    Attributes:
        points: (mu, gamma) of the points of the curve in order, beginning with the end that was
            traced towards smaller mu, shape (n, 2).
        meetings: (mu, gamma) where further points change their status, shape (n, 2).
        turns: (mu, gamma) where mu turns back, which are cusps of smooth folds, shape (n, 2).
        branches: branches of the extended system, towards smaller and towards larger mu.
    """

    points: npt.NDArray[np.float64]
    meetings: npt.NDArray[np.float64]
    turns: npt.NDArray[np.float64]
    branches: tuple[Branch, Branch]


# -- conditions ------------------------------------------------------------------------------------


class _Condition:
    """A condition phi(x, gamma) = 0 next to H = 0. Methods are collective.

    Subclasses define ``value``: phi, its relative size and the scales of residuals; ``gradient``:
    derivative of phi by x; ``derivative``: derivative of phi by a parameter, given the derivative
    of H.

    Args:
        system: system H.
    """

    def __init__(self, system: System):
        self._system = system

    def own(self, piece: Piece) -> Piece:
        """Return the piece on which a point of the curve lies."""
        return piece

    def events(self, x: PETSc.Vec, gamma: float, piece: Piece) -> Events:
        """Return the events of the curve."""
        return self._system.events(x, gamma, piece)

    def statuses(self, point: int) -> Sequence[int]:
        """Return all statuses that a local point can have on the curve."""
        return self._system.statuses(point)


class _StatusChange(_Condition):
    """Condition of the border between two statuses of a point, which keeps the first status.

    Args:
        system: system H.
        change: point and statuses on both sides.
        x: state with H = 0 on the first side, away from the border.
        gamma: parameter at the state.
        piece: piece of the first side.

    Raises:
        ValueError: on every rank, if the two pieces do not differ at the state.
    """

    def __init__(self, system: System, change: Change, x: PETSc.Vec, gamma: float, piece: Piece):
        super().__init__(system)
        self._change = change
        #: Local number of the point on its rank, shape (1,); on other ranks shape (0,).
        here = system.comm.rank == change.rank
        self._point = np.array([change.point] if here else [], dtype=np.int32)
        self._before, self._after = (system.create_vector() for _ in range(2))
        self._difference(x, gamma, piece, ())
        self._w = self._after.copy()
        size = self._w.norm()
        if not size > 0:
            raise ValueError("the pieces on either side of the border do not differ at the state")
        self._w.scale(1.0 / size)

    def own(self, piece: Piece) -> Piece:
        return self._with(piece, self._change.before)

    def _beyond(self, piece: Piece) -> Piece:
        return self._with(piece, self._change.after)

    def _with(self, piece: Piece, code: int) -> Piece:
        return piece.with_codes(self._point, [code] * len(self._point))

    def _difference(
        self, x: PETSc.Vec, gamma: float, piece: Piece, scales: ResidualScales
    ) -> tuple[float, ResidualScales]:
        """Compute H_1 - H_0, and return the relative size of H_1 and the scales of residuals."""
        _, scales = self._system.measure(x, gamma, self._before, piece, scales)
        size, scales = self._system.measure(x, gamma, self._after, self._beyond(piece), scales)
        self._after.axpy(-1.0, self._before)
        return size, scales

    def value(
        self, x: PETSc.Vec, gamma: float, piece: Piece, scales: ResidualScales
    ) -> tuple[float, float, ResidualScales]:
        size, scales = self._difference(x, gamma, piece, scales)
        return float(self._w.dot(self._after)), size, scales

    def gradient(self, x: PETSc.Vec, gamma: float, piece: Piece) -> PETSc.Vec:
        system = self._system
        row, row_before = (system.create_vector() for _ in range(2))
        system.jacobian(x, gamma, self._beyond(piece))
        system.matrix.multTranspose(self._w, row)
        system.jacobian(x, gamma, piece)
        system.matrix.multTranspose(self._w, row_before)
        row.axpy(-1.0, row_before)
        return row

    def derivative(self, x: PETSc.Vec, gamma: float, piece: Piece, by: Derivative) -> float:
        by(x, self._beyond(piece), self._after)
        by(x, piece, self._before)
        return float(self._w.dot(self._after) - self._w.dot(self._before))

    def events(self, x: PETSc.Vec, gamma: float, piece: Piece) -> Events:
        """Return the events of H on both sides of the border, without the change across it.

        All events of the point end the curve.
        """
        change = self._change
        before = self._system.events(x, gamma, self.own(piece))
        after = self._system.events(x, gamma, self._beyond(piece))
        if not len(self._point):
            return before
        at = before.point == change.point
        distance = np.concatenate(
            [
                before.distance[at & (before.target != change.after)],
                after.distance[(after.point == change.point) & (after.target != change.before)],
            ]
        )
        if piece.codes[change.point] == _LOST:
            distance = np.full(max(len(distance), 1), -1.0)
        n = len(distance)
        return Events(
            np.concatenate([before.distance[~at], distance]),
            np.concatenate([before.point[~at], np.full(n, change.point, dtype=np.int32)]),
            np.concatenate([before.target[~at], np.full(n, _LOST, dtype=np.int8)]),
        )

    def statuses(self, point: int) -> Sequence[int]:
        return (self._change.before,) if point in self._point else super().statuses(point)


class _SmoothFold(_Condition):
    """Condition of a fold of one piece.

    Args:
        system: system H.
        x: state near the fold.
        gamma: parameter at the state.
        piece: piece that the fold belongs to.

    Raises:
        ValueError: on every rank, if the bordered matrix is singular at the state.
    """

    def __init__(self, system: System, x: PETSc.Vec, gamma: float, piece: Piece):
        super().__init__(system)
        self._layout = Layout(system)
        self._bordered = BorderedMatrix(self._layout)
        self._factor = Factor(system.comm, "fold_")
        self._b, self._c = system.probe(7), system.probe(5)
        for vector in (self._c, self._b):
            vector.scale(1.0 / vector.norm())
        # borders in the kernels make the bordered matrix as regular as possible
        v, psi, _ = self._solve(x, gamma, piece)
        for vector, kernel in ((self._c, v), (self._b, psi)):
            kernel.copy(vector)
            vector.scale(1.0 / vector.norm())
        row = self.gradient(x, gamma, piece)
        steep = float(row.norm(PETSc.NormType.NORM_1))
        row.pointwiseMult(row, x)
        #: Change of g if every entry of x changes by its own size.
        self._size = float(row.norm(PETSc.NormType.NORM_1)) or steep
        if not self._size > 0:
            raise ValueError("the Jacobian does not depend on x here: this is not a smooth fold")

    def _solve(
        self, x: PETSc.Vec, gamma: float, piece: Piece
    ) -> tuple[PETSc.Vec, PETSc.Vec, float]:
        """Return v, psi and g."""
        layout = self._layout
        self._system.jacobian(x, gamma, piece)
        self._bordered.assemble(self._system.matrix, self._b, layout.joined(self._c, 0.0))
        if not self._factor.factorise(self._bordered.matrix):
            raise ValueError("the bordered matrix is singular: this is not a simple fold")
        y = layout.vector()
        self._factor.solve_transposed(layout.last_unit(), y)
        psi = layout.split(y)[0].copy()
        self._factor.solve(layout.last_unit(), y)
        v, g = layout.split(y)
        return v.copy(), psi, g

    def value(
        self, x: PETSc.Vec, gamma: float, piece: Piece, scales: ResidualScales
    ) -> tuple[float, float, ResidualScales]:
        _, _, g = self._solve(x, gamma, piece)
        return g, abs(g) / self._size, scales

    def _along(
        self, x: PETSc.Vec, v: PETSc.Vec, evaluate: Callable[[PETSc.Vec, PETSc.Vec], None]
    ) -> PETSc.Vec:
        """Return the central difference of ``evaluate`` along v."""
        step = _STEP * (x.norm() or 1.0) / v.norm()
        ahead, behind = (self._system.create_vector() for _ in range(2))
        evaluate(x - step * v, behind)
        evaluate(x + step * v, ahead)
        ahead.axpy(-1.0, behind)
        ahead.scale(0.5 / step)
        return ahead

    def gradient(self, x: PETSc.Vec, gamma: float, piece: Piece) -> PETSc.Vec:
        v, psi, _ = self._solve(x, gamma, piece)

        def transposed(at: PETSc.Vec, out: PETSc.Vec) -> None:
            self._system.jacobian(at, gamma, piece)
            self._system.matrix.multTranspose(psi, out)

        row = self._along(x, v, transposed)
        row.scale(-1.0)
        return row

    def derivative(self, x: PETSc.Vec, gamma: float, piece: Piece, by: Derivative) -> float:
        v, psi, _ = self._solve(x, gamma, piece)
        return -float(psi.dot(self._along(x, v, lambda state, out: by(state, piece, out))))


# -- the extended system ---------------------------------------------------------------------------


class _Extended(System):
    """H and a condition phi in the unknowns X = (x, gamma) with the parameter mu.

    Args:
        system: H with gamma.
        other: the same H with mu.
        start: X at the special point.
        condition: condition phi.
        gamma_scale: size of gamma that counts as 1.
    """

    def __init__(
        self,
        system: System,
        other: System,
        start: PETSc.Vec,
        condition: _StatusChange | _SmoothFold,
        *,
        gamma_scale: float,
    ):
        self.comm = system.comm
        self.system = system
        self.other = other
        self.condition = condition
        self.layout = Layout(system)
        self._bordered = BorderedMatrix(self.layout)
        self._c, self._d, self._x = (system.create_vector() for _ in range(3))
        self._gamma_scale = gamma_scale
        x, _ = self.layout.split(start)
        system.metric(x, self._d)
        self._x_size = float(self._d.dot(x)) or 1.0

    @property
    def matrix(self) -> PETSc.Mat:  # type: ignore[override]
        return self._bordered.matrix

    def create_vector(self) -> PETSc.Vec:
        return self.layout.vector()

    def _set(self, X: PETSc.Vec, mu: float, piece: Piece | None) -> tuple[PETSc.Vec, float, Piece]:
        """Set mu; return a copy of x, gamma, and the piece, by default the piece of the state."""
        x, gamma = self.layout.split(X)
        x.copy(self._x)
        self.other.set_parameter(mu)
        piece = self.system.piece_at(self._x, gamma) if piece is None else piece
        return self._x, gamma, self.condition.own(piece)

    def measure(
        self, X: PETSc.Vec, mu: float, b: PETSc.Vec, piece: Piece | None, scales: ResidualScales
    ) -> tuple[float, ResidualScales]:
        x, gamma, own = self._set(X, mu, piece)
        phi, size_of_phi, scales = self.condition.value(x, gamma, own, scales)
        size, scales = self.system.measure(x, gamma, self._c, own, scales)
        self.layout.join(self._c, phi, b)
        return max(size, size_of_phi), scales

    def residual(self, X: PETSc.Vec, mu: float, b: PETSc.Vec, piece: Piece | None) -> float:
        return self.measure(X, mu, b, piece, ())[0]

    def jacobian(self, X: PETSc.Vec, mu: float, piece: Piece | None) -> None:
        x, gamma, own = self._set(X, mu, piece)

        def by_gamma(state: PETSc.Vec, side: Piece, out: PETSc.Vec) -> None:
            self.system.parameter_derivative(state, gamma, out, side)

        gradient = self.condition.gradient(x, gamma, own)
        slope = self.condition.derivative(x, gamma, own, by_gamma)
        self.system.jacobian(x, gamma, own)
        by_gamma(x, own, self._c)
        self._bordered.assemble(self.system.matrix, self._c, self.layout.joined(gradient, slope))

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
        return self.layout.joined(self.system.probe(seed), float(np.cos(seed)))

    def piece_at(self, X: PETSc.Vec, mu: float) -> Piece:
        return self._set(X, mu, None)[2]

    def events(self, X: PETSc.Vec, mu: float, piece: Piece) -> Events:
        x, gamma, _ = self._set(X, mu, piece)
        return self.condition.events(x, gamma, piece)

    def statuses(self, point: int) -> Sequence[int]:
        return self.condition.statuses(point)

    def put(self, X: PETSc.Vec, mu: float, piece: Piece) -> None:
        self.system.put(*self._set(X, mu, piece))

    def check_parameter(self, gammas: Sequence[float]) -> None:
        self.other.check_parameter(gammas)

    def restored(self, *, always: bool = False) -> AbstractContextManager[None]:
        return self.system.restored(always=always)

    def places(self, points: Sequence[BranchPoint | SpecialPoint]) -> npt.NDArray[np.float64]:
        """Return (mu, gamma) of points of a branch, shape (n, 2)."""
        layout = Layout(self)
        split = (layout.split(point.y) for point in points)
        rows = [(mu, self.layout.gamma(X)) for X, mu in split]
        return np.array(rows, dtype=float).reshape(-1, 2)


def _is_smooth_fold(special: SpecialPoint) -> bool:
    return special.smooth and special.kind == "fold"


def _check(a: Arguments) -> None:
    check_system(a.system)
    require_smooth(a.system)
    a.mu = number(a.mu, "mu")
    a.mu_range = checked_range(a.mu_range, [a.mu], "mu")
    one = a.special.located and len(a.special.changes) == 1
    if not (one or _is_smooth_fold(a.special)):
        raise ValueError("a smooth fold, or a located change of one point, is needed")
    positive(a.gamma_scale, "gamma_scale")


@collective("follow_special", _check)
def follow_special(
    system: System,
    other: System,
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
    X = layout.vector()
    special.y.copy(X)
    other.set_parameter(mu)
    condition = _condition_at(system, layout, X, branch, special)
    extended = _Extended(system, other, X, condition, gamma_scale=gamma_scale)
    try:
        with system.restored(always=True):
            down, up = _both_directions(
                extended, X, mu, mu_range, control=control, max_steps=max_steps
            )
        points = [*reversed(down.points[1:]), *up.points]
        events = [*reversed(down.special), *up.special]
        return SpecialCurve(
            extended.places(points),
            extended.places([s for s in events if not s.smooth]),
            extended.places([s for s in events if _is_smooth_fold(s)]),
            (down, up),
        )
    finally:
        other.set_parameter(mu)


def _condition_at(
    system: System, layout: Layout, X: PETSc.Vec, branch: Branch, special: SpecialPoint
) -> _StatusChange | _SmoothFold:
    """Return the condition of a special point, on the piece of the point before it."""
    before = branch.points[special.index - 1]
    if _is_smooth_fold(special):
        return _SmoothFold(system, *_copied(layout, X), before.piece)
    away = _copied(layout, before.y)
    return _StatusChange(system, special.changes[0], *away, before.piece)


def _both_directions(
    extended: _Extended, X: PETSc.Vec, mu: float, mu_range: tuple[float, float], **options: Any
) -> tuple[Branch, Branch]:
    """Trace a curve from X to both ends of the range of mu; return decreasing and increasing mu."""
    branches: dict[Direction, Branch] = {}
    for direction in get_args(Direction):
        if not leads_out(mu, sign_of(direction), mu_range):
            branches[direction] = follow(
                extended,
                X,
                mu,
                gamma_range=mu_range,
                direction=direction,
                route="steps",
                progress=False,
                **options,
            )
    for direction in get_args(Direction):
        if direction not in branches:  # the branch starts at an end of the range
            (only,) = branches.values()
            branches[direction] = Branch([only.points[0]])
            branches[direction].end(Ending.REACHED)
    return branches["decreasing"], branches["increasing"]


def _copied(layout: Layout, y: PETSc.Vec) -> tuple[PETSc.Vec, float]:
    """Return copies of x and gamma."""
    x, gamma = layout.split(y)
    return x.copy(), gamma
