# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Correctors and tangents.

A corrector computes a point of the branch from a predicted point. All correctors are Newton's
method for H = 0 and one additional row:

- *Moore-Penrose* (Ligursky and Renard, Comput. Mech. 56, 2015, after Dhooge, Govaerts and
  Kuznetsov) corrects orthogonally to a tangent, which is updated using the same factorisation;
- *pseudo-arclength* prescribes the distance along a fixed tangent;
- *natural* prescribes gamma.

If further solves with a matrix are cheap, a few corrections with the previous matrix (*chord*
steps) replace the last Newton step if they reach the tolerance as well (C. T. Kelley, Iterative
Methods for Linear and Nonlinear Equations, SIAM 1995, section 5.4). Otherwise linear solves are
inexact (`Forcing`), and a few cheap rows are corrected between the steps (`settle`). Convergence is
always tested with the residual of H.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import partial
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._inexact import ROUNDS, Forcing, settle
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.krylov import ModelTest
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.continuation.system import Piece

__all__ = ["Corrector"]

Codes = npt.NDArray[np.int8]

logger = logging.getLogger(__name__)

_MOST_CHORDS = 5  # largest number of consecutive chord steps
#: Length of a solution of J t = (0, 1) beyond which the row determines the tangent too poorly.
_NEARLY_SINGULAR = 1e8
#: Relative residual of an iterative linear solve for an additional correction within the tolerance.
_POLISHED = 1e-4
#: Fraction of the tolerance. After a chord step, a larger residual is corrected once more, because
#: a Newton step would have reduced it further.
_SHARP = 3e-2
_ROUND_OFF = 4 * float(np.finfo(np.float64).eps)  # relative round-off of gamma
#: Relative residual of a tangent that only serves as the direction of the next step.
_TO_STEP_ALONG = 1e-4


@dataclass
class _Matrices:
    """Matrices and chord steps of one run.

    Attributes:
        from_before: whether the run still uses the matrix of the previous run.
        reusable: whether further corrections may use the matrix.
        number: number of matrices.
        chords: number of chord steps since the last matrix.
        codes: statuses on this rank at which the matrix was assembled; None on a fixed piece.
    """

    from_before: bool
    reusable: bool
    number: int = 0
    chords: int = 0
    codes: Codes | None = None

    def begin(self, codes: Codes | None, *, reusable: bool) -> None:
        """Count a new matrix."""
        self.from_before = False
        self.reusable = reusable
        self.number += 1
        self.chords = 0
        self.codes = codes

    def suffice(self, error: float, before: float, tolerance: float) -> bool:
        """Return True if a few chord steps are expected to reach the tolerance.

        Args:
            error: relative residual.
            before: relative residual before the last correction; 0 if there was none.
            tolerance: relative residual to reach.
        """
        if not self.reusable or self.chords >= _MOST_CHORDS:
            return False
        if before == 0:
            return True
        # a Newton step would square the convergence rate; chord steps keep it
        steps = _MOST_CHORDS - self.chords if self.from_before or self.chords else 2
        return bool(error * (error / before) ** steps <= tolerance)


class Corrector:
    """Correctors on a bordered system. Methods are collective.

    Args:
        bordered: vectors and linear algebra.
        control: tolerance and number of corrections.
        chords: whether corrections may use chord steps. A path with memory needs pure Newton steps,
            because round-off decides the order of its events.
    """

    def __init__(self, bordered: Bordered, control: StepControl, *, chords: bool = True):
        self.bordered = bordered
        self.control = control
        self._may_use_chords = chords and bordered.solver.is_direct
        self._rhs, self._step, self._away = (bordered.vector() for _ in range(3))
        self._hx, self._x, self._d = (bordered.system.create_vector() for _ in range(3))
        self._e = bordered.last_unit()
        self._matrices = _Matrices(False, False)
        self._rule = Forcing()
        #: Scales of the residual before the run, and at its predicted state.
        self._scales: tuple[float, ...] = ()
        self._predicted: tuple[float, ...] | None = None

    @property
    def iterations(self) -> int:
        """Number of corrections of the last run; consecutive chord steps count as one."""
        return self._matrices.number + int(self._matrices.chords > 0)

    # -- the three correctors --------------------------------------------------------------------

    def moore_penrose(self, y: PETSc.Vec, t: PETSc.Vec, piece: Piece | None) -> bool:
        """Correct ``y`` in place, orthogonally to ``t``, and update ``t`` in place."""
        return self._newton(y, t, piece)

    def pseudo_arclength(
        self,
        y: PETSc.Vec,
        start: PETSc.Vec,
        t: PETSc.Vec,
        distance: float,
        piece: Piece | None,
        *,
        polish: bool = False,
        keep: bool = False,
    ) -> bool:
        """Correct ``y`` in place to the point at ``distance`` from ``start`` along ``t``.

        Args:
            y: predicted point, corrected in place.
            start: point from which the distance is measured.
            t: unit tangent along which the distance is measured.
            distance: prescribed distance.
            piece: piece of H; None for H itself.
            polish: whether to add a correction after the tolerance has been reached.
            keep: whether to begin with the matrix of the previous run, which must have had the same
                ``t`` and piece.
        """
        return self._newton(y, t, piece, to=(start, distance), polish=polish, keep=keep)

    def natural(self, y: PETSc.Vec, gamma: float, piece: Piece | None) -> bool:
        """Correct ``y`` in place at fixed gamma; the result has exactly this gamma."""
        b = self.bordered
        t = b.last_unit(2 * b.gamma_scale**2)  # its dual vector is the unit vector of gamma
        corrected = self.pseudo_arclength(y, b.last_unit(0.0), t, gamma, piece)
        if corrected:  # remove the round-off of gamma
            b.join(b.split(y)[0], gamma, y)
        return corrected

    def reject(self) -> None:
        """Restore the scales of the residual, which a diverging run may have enlarged."""
        self.bordered.system.scales = self._scales

    # -- tangents --------------------------------------------------------------------------------

    def tangent(
        self,
        y: PETSc.Vec,
        towards: PETSc.Vec,
        piece: Piece | None,
        *,
        start: PETSc.Vec | None = None,
        factorise: bool = False,
        precise: bool = True,
    ) -> PETSc.Vec | None:
        """Return the unit tangent of ``piece`` at ``y``; None if it is not unique.

        The solver keeps the matrix at ``y`` for further right-hand sides.

        Args:
            y: point of the branch.
            towards: direction with which the tangent encloses an angle of at most 90 degrees.
            piece: piece of H; None for H itself.
            start: previous point of the branch, at which ``towards`` is the tangent. The parabola
                through both points provides the initial guess of an iterative solve; default: the
                guess is ``towards``.
            factorise: whether to factorise the matrix in any case.
            precise: False if an iterative solve may be inaccurate, because the tangent only serves
                as the direction of the next step.
        """
        b = self.bordered
        solver = b.solver
        rtol = 0.0 if precise or b.x_scale == 0 else _TO_STEP_ALONG
        # beyond a kink the tangent may be orthogonal to the previous one: try other last rows
        axis = b.last_unit(b.gamma_scale)
        for direction in (towards, axis, towards + axis):
            row = b.dual(direction)
            near = self._extrapolated(y, start, towards, row) if direction is towards else None
            solver.assemble(y, row, piece, along=near)
            t = b.vector()
            if factorise and not solver.factorise():
                continue
            if not solver.solve(self._e, t, rtol=rtol, near=near):
                continue
            size = b.length(t)
            if not 0 < size < _NEARLY_SINGULAR:
                continue
            along = float(row.dot(t))  # component along the row
            ahead = along if direction is towards else b.inner(t, towards)
            sense = 1.0 if ahead >= 0 else -1.0
            t.scale(sense / size)
            b.sense = sense * float(np.sign(along))
            return t
        return None

    def _extrapolated(
        self, y: PETSc.Vec, start: PETSc.Vec | None, t: PETSc.Vec, row: PETSc.Vec
    ) -> PETSc.Vec:
        """Return the tangent at ``y`` of the parabola from ``start`` along ``t``.

        It is scaled so that its product with the last row is 1. Without a start it is ``t``.
        """
        if start is None or self.bordered.solver.is_direct:
            return t
        away = y - start
        along = float(row.dot(away))
        if not along > 0:
            return t
        away.scale(2.0 / along)
        away.axpy(-1.0, t)
        return away

    def orientation(self) -> float:
        """Return the sign of det [grad H; t^T] for the last computed `tangent` t.

        Along a branch the sign changes at bifurcations only.
        """
        return self.bordered.solver.determinant_sign() * self.bordered.sense

    # -- Newton's method -------------------------------------------------------------------------

    def _newton(
        self,
        y: PETSc.Vec,
        t: PETSc.Vec,
        piece: Piece | None,
        *,
        to: tuple[PETSc.Vec, float] | None = None,
        polish: bool = False,
        keep: bool = False,
    ) -> bool:
        """Correct ``y`` in place; False if that fails.

        Args:
            y: predicted point.
            t: direction whose dual vector is the last row.
            piece: piece of H; None for H itself.
            to: start and distance along ``t``. None: every correction is orthogonal to ``t``, which
                is updated in place.
            polish: see `pseudo_arclength`.
            keep: see `pseudo_arclength`.
        """
        b = self.bordered
        solver = b.solver
        tolerance = self.control.tolerance
        if b.comm.size > 1:
            PETSc.garbage_cleanup(b.comm)
        keep = keep and self._may_use_chords
        matrices = self._matrices = _Matrices(from_before=keep, reusable=keep)
        self._scales = b.system.scales
        self._predicted = None
        row = b.dual(t)
        if not solver.matrix:
            # The first assembly differs from later ones by round-off, which may decide at ties of
            # statuses.
            solver.assemble(y, row, piece, along=t)
        polished = False
        before = 0.0
        error: float | None = None
        while True:
            # evaluate H and the last row
            if error is None:
                error = self._evaluate(*b.split(y), self._hx, piece)
            last = 0.0
            if to is not None:
                self._away.waxpy(-1.0, to[0], y)
                last = float(row.dot(self._away)) - to[1]
            if not np.isfinite(error + last):
                break
            # test convergence
            if error <= tolerance and self._is_round_off(last, y, row, to):
                blunt = matrices.chords > 0 and error > _SHARP * tolerance
                if polished or not (polish or blunt):
                    return True
                polished = True
            if to is None and matrices.number > 0 and solver.is_direct and not matrices.chords:
                row = self._improved(t, row)
            # a chord step, or a new matrix
            codes = self._codes_at(y, piece)
            changed = self._share_of_changes(matrices.codes, codes)
            chord = matrices.suffice(error, before, tolerance) and changed == 0
            if chord:
                matrices.chords += 1
            elif self.iterations >= self.control.corrections:
                break
            else:
                solver.assemble(y, row, piece, along=t)
                matrices.begin(codes, reusable=self._may_use_chords)
            # the correction
            b.join(self._hx, last, self._rhs)
            how = {} if solver.is_direct else self._accuracy(y, piece, error, before, changed)
            if not solver.solve(self._rhs, self._step, **how):
                break
            if chord and to is None:
                # the kept matrix has an old last row; the tangent spans the kernel of the others
                self._step.axpy(b.gamma(self._rhs) - row.dot(self._step), t)
            y.axpy(-1.0, self._step)
            before = error
            error = None if solver.is_direct else self._settled(y, piece)
        self.reject()
        return False

    def _evaluate(self, x: PETSc.Vec, gamma: float, hx: PETSc.Vec, piece: Piece | None) -> float:
        """Write H into ``hx``, and return its size relative to the predicted state."""
        system = self.bordered.system
        # with the scales of a diverging iterate every other state would look like a solution
        if self._predicted is not None:
            system.scales = self._predicted
        size = system.residual(x, gamma, hx, piece)
        if self._predicted is None:
            self._predicted = system.scales
        return size

    def _is_round_off(
        self, last: float, y: PETSc.Vec, row: PETSc.Vec, to: tuple[PETSc.Vec, float] | None
    ) -> bool:
        """Return True if the residual ``last`` of the last row is round-off."""
        scale = 1.0 if to is None else max(abs(to[1]), 1e-6)
        b = self.bordered
        return abs(last) <= 1e-10 * scale or abs(last) <= _ROUND_OFF * abs(
            b.gamma(row) * b.gamma(y)
        )

    def _improved(self, t: PETSc.Vec, row: PETSc.Vec) -> PETSc.Vec:
        """Update a tangent with the factorisation of the last step; return its dual vector."""
        b = self.bordered
        new = b.vector()
        size = b.length(new) if b.solver.solve(self._e, new) else 0.0
        if not 0 < size < np.inf:
            return row
        new.scale(1.0 / size)
        new.copy(t)
        return b.dual(t)

    def _codes_at(self, y: PETSc.Vec, piece: Piece | None) -> Codes | None:
        """Return the statuses at ``y`` on this rank; None on a fixed piece and if unused."""
        b = self.bordered
        if piece is not None or (b.solver.is_direct and not self._may_use_chords):
            return None
        return b.piece_at(y).codes

    def _share_of_changes(self, before: Codes | None, codes: Codes | None) -> float:
        """Return the fraction of all points whose status has changed; 1 before the first matrix."""
        if codes is None:
            return 0.0
        if before is None:
            return 1.0
        numbers = np.array([np.sum(codes != before), len(before)])
        changed, number = self.bordered.comm.allreduce(numbers)
        return float(changed / max(number, 1))

    # -- iterative solves ------------------------------------------------------------------------

    def _accuracy(
        self, y: PETSc.Vec, piece: Piece | None, error: float, before: float, changed: float
    ) -> dict[str, Any]:
        """Return the accuracy of the next linear solve, arguments of `Krylov.solve`."""
        if error <= self.control.tolerance:
            return {"rtol": _POLISHED}
        if before == 0.0:
            self._rule.restart(warm=True)
        rtol = self._rule.tolerance(error, self.control.tolerance, changed)
        return {"rtol": rtol, "model": ModelTest(self._rule, partial(self._remainder, y, piece))}

    def _remainder(self, y: PETSc.Vec, piece: Piece | None, step: PETSc.Vec) -> float:
        """Return the norm of H at ``y - step``, in its cheap nonlinear rows."""
        b = self.bordered
        self._away.waxpy(-1.0, step, y)
        rows = b.system.contact_rows(*b.split(self._away), piece)
        return 0.0 if rows is None else float(np.sqrt(b.comm.allreduce(float(rows @ rows))))

    def _settled(self, y: PETSc.Vec, piece: Piece | None) -> float | None:
        """Correct a few cheap rows of ``y`` in place, see `settle`.

        Returns:
            Relative size of H at ``y`` if H has been evaluated there; otherwise None.
        """
        b = self.bordered
        x, gamma = b.split(y)
        x.copy(self._x)
        size = 0.0
        evaluated = np.zeros(0)  # state of the last evaluation of H

        def evaluate(x: PETSc.Vec, hx: PETSc.Vec) -> None:
            nonlocal size, evaluated
            size = self._evaluate(x, gamma, hx, piece)
            evaluated = x.array_r.copy()

        def correct(x: PETSc.Vec, hx: PETSc.Vec, d: PETSc.Vec) -> bool:
            try:
                return b.system.correct(x, gamma, hx, d, piece)
            except ArithmeticError as error:
                if b.comm.rank == 0:
                    logger.debug("no correction: %s", error)
                return False

        if settle(evaluate, correct, self._x, self._hx, self._d, ROUNDS):
            b.join(self._x, gamma, y)
        same = bool(np.array_equal(self._x.array_r, evaluated))
        return size if b.comm.allreduce(same, op=MPI.LAND) else None
