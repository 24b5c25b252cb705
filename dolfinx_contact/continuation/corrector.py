# SPDX-License-Identifier: LGPL-3.0-or-later
"""Correctors and tangents of branches.

A corrector computes a point of a branch of H(x, gamma) = 0 from a predicted point. All correctors
use a SNES for H = 0 and one additional equation:

- *Moore-Penrose* (Ligursky and Renard, Comput. Mech. 56, 2015, after Dhooge, Govaerts and
  Kuznetsov) corrects orthogonally to a tangent, which is updated using the same factorisation;
- *pseudo-arclength* prescribes the distance along a fixed tangent;
- *natural* prescribes gamma.

If further solves with a matrix are cheap, a few corrections with the previous matrix (*chord*
steps) replace the last Newton step if they reach the tolerance as well (C. T. Kelley, Iterative
Methods for Linear and Nonlinear Equations, SIAM 1995, section 5.4). Otherwise linear solves are
inexact (`Forcing`), and a few rows that are cheap to evaluate are corrected between the steps
(`settle`). Convergence is always tested with the residual of H.

The SNES has the type "python": PETSc iterates, calls monitors and counts; `_Run` evaluates H, tests
convergence and takes the steps of one correction. Options have the prefix of the branch, such as
``-continuation_snes_monitor``.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import partial
from typing import Any

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Codes
from dolfinx_contact._inexact import ROUNDS, Forcing, settle
from dolfinx_contact._petsc import as_raised
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.step_control import StepControl
from dolfinx_contact.continuation.system import Piece, ResidualScales

__all__ = ["Corrector"]


logger = logging.getLogger(__name__)

_MOST_CHORDS = 5  # largest number of consecutive chord steps
_STEPS = 10  # largest number of steps per allowed correction, chord steps included
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
    """Matrices and chord steps (steps with an earlier matrix) of one run of Newton's method.

    Attributes:
        from_before: whether the present run still uses the matrix of the previous run.
        reusable: whether further corrections may use the present matrix.
        number: number of matrices assembled in the run.
        chords: number of chord steps since the last matrix.
        codes: statuses on this rank with which the matrix was assembled; None if they are fixed.
    """

    from_before: bool
    reusable: bool
    number: int = 0
    chords: int = 0
    codes: Codes | None = None

    def begin(self, codes: Codes | None, *, reusable: bool) -> None:
        """Record that a matrix has been assembled, for statuses and possibly for chord steps."""
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
    """Correction of predicted points of a branch by Newton's method. Methods are collective.

    Args:
        bordered: vectors and linear algebra.
        control: tolerance and largest number of corrections.
        chords: whether corrections may use chord steps, which reuse a matrix. A path with memory
            needs pure Newton steps: round-off decides the order of its events.

    Attributes:
        snes: SNES of all corrections.
        iterations: number of corrections of the last run; consecutive chord steps count as one.
        scales: scales of residuals (`System.measure`) at the accepted states of the branch.

    Raises:
        ValueError: if the PETSc options set a type of the SNES.
    """

    def __init__(self, bordered: Bordered, control: StepControl, *, chords: bool = True):
        self.bordered = bordered
        self.control = control
        self.iterations = 0
        self.work = _Work(bordered)
        self.forcing = Forcing()
        self.chords = chords and bordered.solver.is_direct
        self.last_unit = bordered.last_unit()
        self.scales: ResidualScales = ()
        self.snes = PETSc.SNES().create(bordered.comm)
        self.snes.setOptionsPrefix(bordered.prefix)
        self.snes.setType(PETSc.SNES.Type.PYTHON)
        self.snes.setTolerances(max_it=_STEPS * control.corrections)
        self.snes.setFromOptions()
        if self.snes.getType() != PETSc.SNES.Type.PYTHON:
            raise ValueError(
                f"-{bordered.prefix}snes_type cannot be used: a correction takes its own steps"
            )

    # -- the three correctors --------------------------------------------------------------------

    def moore_penrose(
        self, y: PETSc.Vec, t: PETSc.Vec, piece: Piece | None
    ) -> ResidualScales | None:
        """Correct ``y`` in place, orthogonally to ``t``, and update ``t`` in place.

        Returns:
            Scales of the residuals on the branch, the point ``y`` included; None if the correction
            fails. A caller that accepts ``y`` assigns them to `scales`.
        """
        return self._solve(y, t, piece)

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

        After a successful correction, `scales` include the point.

        Args:
            y: predicted point, corrected in place.
            start: point from which the distance is measured.
            t: unit tangent along which the distance is measured.
            distance: prescribed distance.
            piece: piece of H; None for H itself.
            polish: whether to add a correction after the tolerance has been reached.
            keep: whether to begin with the matrix of the previous run, in which ``t`` and piece
                must have been the same.
        """
        scales = self._solve(y, t, piece, to=(start, distance), polish=polish, keep=keep)
        if scales is not None:
            self.scales = scales
        return scales is not None

    def natural(self, y: PETSc.Vec, gamma: float, piece: Piece | None) -> bool:
        """Correct ``y`` in place at exactly the given gamma; return False if this fails."""
        b = self.bordered
        t = b.last_unit(2 * b.gamma_scale**2)  # its dual vector is the unit vector of gamma
        corrected = self.pseudo_arclength(y, b.last_unit(0.0), t, gamma, piece)
        if corrected:  # remove the round-off of gamma
            b.join(b.split(y)[0], gamma, y)
        return corrected

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
        """Compute the unit tangent of a branch at ``y``; None if it is not unique.

        The solver keeps the matrix at ``y`` for additional right-hand sides.

        Args:
            y: point of the branch.
            towards: direction with which the tangent encloses an angle of at most 90 degrees.
            piece: fixed statuses of all points; None to determine them from the state.
            start: previous point of the branch, at which ``towards`` is the tangent. The parabola
                through both points provides the initial guess of an iterative solve. Default:
                ``towards`` is the guess.
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
            if factorise and not solver.prepare():
                continue
            if not solver.solve(self.last_unit, t, rtol=rtol, near=near):
                continue
            size = b.length(t)
            if not 0 < size < _NEARLY_SINGULAR:
                continue
            ahead = float(row.dot(t)) if direction is towards else b.inner(t, towards)
            t.scale((1.0 if ahead >= 0 else -1.0) / size)
            return t
        return None

    def _extrapolated(
        self, y: PETSc.Vec, start: PETSc.Vec | None, t: PETSc.Vec, row: PETSc.Vec
    ) -> PETSc.Vec:
        """Return an initial guess for the tangent at ``y``, extrapolated along a parabola.

        The parabola leaves ``start`` along ``t`` and passes ``y``. The product of the guess with
        the last row ``row`` of the matrix is 1. Without a start, or with a direct solver, the
        result is ``t``.
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

    def _solve(
        self, y: PETSc.Vec, t: PETSc.Vec, piece: Piece | None, **target: Any
    ) -> ResidualScales | None:
        """Correct ``y`` in place; return the scales of residuals, or None if the correction fails.

        Args:
            y: predicted point.
            t: direction; the last row of the matrix is the inner product with it.
            piece: fixed statuses of all points; None to determine them from the state.
            target: further keyword arguments of `_Run`.
        """
        if self.bordered.comm.size > 1:
            PETSc.garbage_cleanup(self.bordered.comm)
        run = _Run(self, y, t, piece, **target)
        self.snes.setPythonContext(run)
        self.snes.setFunction(run.evaluate, self.work.rhs)
        self.snes.setConvergenceTest(run.test)
        with as_raised():
            self.snes.solve(None, y)
        self.iterations = run.iterations
        return run.scales if self.snes.getConvergedReason() > 0 else None


class _Work:
    """Work vectors of a `Corrector`."""

    def __init__(self, bordered: Bordered):
        self.rhs, self.step, self.away = (bordered.vector() for _ in range(3))
        self.hx, self.x, self.d = (bordered.system.create_vector() for _ in range(3))


class _Run:
    """Newton's method for one correction; context of the SNES. Methods are collective.

    Args:
        corrector: corrector with the control, the linear solver and the work vectors.
        y: predicted point.
        t: direction whose dual vector is the last row.
        piece: piece of H; None for H itself.
        to: start of the step and prescribed distance from the start along ``t``. If None, every
            correction is orthogonal to ``t``, and ``t`` is updated in place.
        polish: see `Corrector.pseudo_arclength`.
        keep: see `Corrector.pseudo_arclength`.

    Attributes:
        scales: scales of residuals including the present iterate.
    """

    def __init__(
        self,
        corrector: Corrector,
        y: PETSc.Vec,
        t: PETSc.Vec,
        piece: Piece | None,
        *,
        to: tuple[PETSc.Vec, float] | None = None,
        polish: bool = False,
        keep: bool = False,
    ):
        self._b = b = corrector.bordered
        self._solver = b.solver
        self._control = corrector.control
        self._work = corrector.work
        self._rule = corrector.forcing
        self._chords = corrector.chords
        self._e = corrector.last_unit
        self._t = t
        self._row = b.dual(t)
        self._piece = piece
        self._to = to
        self._further = polish  # whether to correct once more within the tolerance
        self._polished = False
        keep = keep and self._chords
        self._matrices = _Matrices(from_before=keep, reusable=keep)
        self._before = 0.0  # relative size of H before the last correction
        self._error: float | None = None  # relative size of H at the iterate, if it is evaluated
        self._last = 0.0  # residual of the last row
        self.scales = corrector.scales
        #: Scales of residuals including those of the predicted state; None before its evaluation.
        self._predicted: ResidualScales | None = None
        if not self._solver.matrix:
            # The first assembly differs from later ones by round-off, which may decide at ties of
            # statuses.
            self._solver.assemble(y, self._row, piece, along=t)

    @property
    def iterations(self) -> int:
        """Number of corrections; consecutive chord steps count as one."""
        return self._matrices.number + int(self._matrices.chords > 0)

    # -- callbacks of the SNES -------------------------------------------------------------------

    def evaluate(self, _snes: PETSc.SNES, y: PETSc.Vec, rhs: PETSc.Vec) -> None:
        """Write the residuals of H and of the additional equation into ``rhs``."""
        work = self._work
        if self._error is None:
            self._error = self._size(*self._b.split(y), work.hx)
        if self._to is not None:
            start, distance = self._to
            work.away.waxpy(-1.0, start, y)
            self._last = float(self._row.dot(work.away)) - distance
        self._b.join(work.hx, self._last, rhs)

    def test(self, snes: PETSc.SNES, _it: int, _norms: tuple[float, float, float]) -> int:
        """Return the reason to end the iteration, a code of the SNES, or 0 to continue."""
        assert self._error is not None
        reasons = PETSc.SNES.ConvergedReason
        tolerance = self._control.tolerance
        if not np.isfinite(self._error + self._last):
            return int(reasons.DIVERGED_LOCAL_MIN)
        if self._error <= tolerance and self._is_round_off(snes.getSolution()):
            blunt = self._matrices.chords > 0 and self._error > _SHARP * tolerance
            if self._polished or not (self._further or blunt):
                return int(reasons.CONVERGED_FNORM_RELATIVE)
            self._polished = True
        return 0

    def step(self, snes: PETSc.SNES, y: PETSc.Vec, rhs: PETSc.Vec, _step: PETSc.Vec) -> None:
        """Correct ``y`` in place by a chord step or a Newton step."""
        assert self._error is not None
        reasons = PETSc.SNES.ConvergedReason
        solver, matrices, step = self._solver, self._matrices, self._work.step
        if self._to is None and matrices.number > 0 and solver.is_direct and not matrices.chords:
            self._improve_tangent()
        codes = self._codes_at(y)
        changed = self._share_of_changes(codes)
        chord = changed == 0 and matrices.suffice(
            self._error, self._before, self._control.tolerance
        )
        if chord:
            matrices.chords += 1
        elif self.iterations >= self._control.corrections:
            snes.setConvergedReason(reasons.DIVERGED_MAX_IT)
            return
        else:
            solver.assemble(y, self._row, self._piece, along=self._t)
            matrices.begin(codes, reusable=self._chords)
        how = {} if solver.is_direct else self._accuracy(y, changed)
        if not solver.solve(rhs, step, **how):
            snes.setConvergedReason(reasons.DIVERGED_LINEAR_SOLVE)
            return
        if chord and self._to is None:
            # the kept matrix has an old last row; the tangent spans the kernel of the others
            step.axpy(self._b.gamma(rhs) - self._row.dot(step), self._t)
        y.axpy(-1.0, step)
        self._before = self._error
        self._error = None if solver.is_direct else self._settled(y)

    # -- parts of a step -------------------------------------------------------------------------

    def _size(self, x: PETSc.Vec, gamma: float, hx: PETSc.Vec) -> float:
        """Write H into ``hx``; return its size relative to the scales of the predicted state."""
        # in the scales of a diverging iterate every other state would look like a solution
        scales = self.scales if self._predicted is None else self._predicted
        size, self.scales = self._b.system.measure(x, gamma, hx, self._piece, scales)
        if self._predicted is None:
            self._predicted = self.scales
        return size

    def _is_round_off(self, y: PETSc.Vec) -> bool:
        """Return True if the residual of the additional equation is within round-off."""
        scale = 1.0 if self._to is None else max(abs(self._to[1]), 1e-6)
        if abs(self._last) <= 1e-10 * scale:
            return True
        return abs(self._last) <= _ROUND_OFF * abs(self._b.gamma(self._row) * self._b.gamma(y))

    def _improve_tangent(self) -> None:
        """Update the tangent using the factorisation of the last Newton step."""
        b = self._b
        new = b.vector()
        size = b.length(new) if self._solver.solve(self._e, new) else 0.0
        if 0 < size < np.inf:
            new.scale(1.0 / size)
            new.copy(self._t)
            self._row = b.dual(self._t)

    def _codes_at(self, y: PETSc.Vec) -> Codes | None:
        """Return the statuses at ``y`` on this rank; None if they are fixed or not needed."""
        if self._piece is not None or (self._solver.is_direct and not self._chords):
            return None
        return self._b.piece_at(y).codes

    def _share_of_changes(self, codes: Codes | None) -> float:
        """Return the fraction of points whose status has changed since the matrix was assembled.

        Before the first matrix the fraction is 1.
        """
        before = self._matrices.codes
        if codes is None:
            return 0.0
        if before is None:
            return 1.0
        numbers = np.array([np.sum(codes != before), len(before)])
        changed, number = self._b.comm.allreduce(numbers)
        return float(changed / max(number, 1))

    # -- iterative solves ------------------------------------------------------------------------

    def _accuracy(self, y: PETSc.Vec, changed: float) -> dict[str, Any]:
        """Return the accuracy of the next linear solve, as keyword arguments of `Krylov.solve`."""
        assert self._error is not None
        tolerance = self._control.tolerance
        if self._error <= tolerance:
            return {"rtol": _POLISHED}
        if self._before == 0.0:
            self._rule.restart(warm=True)
        rtol = self._rule.tolerance(self._error, tolerance, changed)
        return {"rtol": rtol, "model": (self._rule, partial(self._remainder, y))}

    def _remainder(self, y: PETSc.Vec, step: PETSc.Vec) -> float:
        """Return the norm of the contact rows of H (`System.contact_rows`) at ``y - step``."""
        b = self._b
        self._work.away.waxpy(-1.0, step, y)
        rows = b.system.contact_rows(*b.split(self._work.away), self._piece)
        return 0.0 if rows is None else float(np.sqrt(b.comm.allreduce(float(rows @ rows))))

    def _settled(self, y: PETSc.Vec) -> float | None:
        """Solve a few cheap rows of H by correcting ``y`` in place (`settle`).

        Returns:
            Scaled norm of H at ``y`` if H has been evaluated there; otherwise None.
        """
        b, work = self._b, self._work
        x, gamma = b.split(y)
        x.copy(work.x)
        size = 0.0

        def evaluate(x: PETSc.Vec, hx: PETSc.Vec) -> None:
            nonlocal size
            size = self._size(x, gamma, hx)

        def correct(x: PETSc.Vec, hx: PETSc.Vec, d: PETSc.Vec) -> bool:
            try:
                return b.system.correct(x, gamma, hx, d, self._piece)
            except ArithmeticError as error:
                if b.comm.rank == 0:
                    logger.debug("no correction: %s", error)
                return False

        changed, evaluated = settle(evaluate, correct, work.x, work.hx, work.d, ROUNDS)
        if changed:
            b.join(work.x, gamma, y)
        return size if evaluated else None
