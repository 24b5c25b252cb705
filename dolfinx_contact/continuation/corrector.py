# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Correctors and tangents.

A corrector computes a point of the branch from a predicted point. All correctors use a SNES for
H = 0 with one additional row:

- *Moore-Penrose* (Ligursky and Renard, Comput. Mech. 56, 2015, after Dhooge, Govaerts and
  Kuznetsov) corrects orthogonally to a tangent, which is updated using the same factorisation;
- *pseudo-arclength* prescribes the distance along a fixed tangent;
- *natural* prescribes gamma.

If further solves with a matrix are cheap, a correction may reuse the matrix of the previous one
(a *chord* step). Convergence is always tested with the residual of H.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._inexact import ROUNDS, Forcing, settle
from dolfinx_contact._petsc import as_raised, options_in_database
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.continuation.system import Piece

__all__ = ["Corrector"]

Array = npt.NDArray[np.float64]

logger = logging.getLogger(__name__)

_MOST_CHORDS = 5  # largest number of consecutive chord steps
#: Length of a solution of J t = (0, 1) beyond which the row determines the tangent too poorly.
_NEARLY_SINGULAR = 1e8
#: Relative residual of an iterative linear solve for an additional correction within the tolerance.
_POLISHED = 1e-4
#: Fraction of the tolerance. After a chord step, a larger residual is corrected once more, because
#: a Newton step would have reduced it further.
_SHARP = 3e-2
_MOST_TESTS = 10  # largest number of SNES iterations per allowed correction
_ROUND_OFF = 4 * float(np.finfo(np.float64).eps)  # relative round-off of gamma
#: Relative residual of a tangent that only serves as the direction of the next step.
_TO_STEP_ALONG = 1e-4


class _Chords:
    """Count of the matrices and chord steps of a run, and the decision between them.

    Chord steps replace the last Newton step if a few of them reach the tolerance as well
    (C. T. Kelley, Iterative Methods for Linear and Nonlinear Equations, SIAM 1995, section 5.4).
    The corrected point and the step lengths stay the same.

    Attributes:
        number: number of chord steps since the last matrix.
    """

    def __init__(self) -> None:
        self.begin(kept=False)

    def begin(self, *, kept: bool) -> None:
        """Begin a run.

        Args:
            kept: whether the run begins with the matrix of the previous run.
        """
        self._kept = self._serves = kept
        self._matrices = 0
        self.number = 0

    def new_matrix(self, *, serves: bool) -> None:
        """Count a new matrix.

        Args:
            serves: whether further corrections may use the matrix.
        """
        self._kept = False
        self._serves = serves
        self._matrices += 1
        self.number = 0

    @property
    def iterations(self) -> int:
        """Number of corrections; consecutive chord steps count as one."""
        return self._matrices + int(self.number > 0)

    def lead_on(self, error: float, before: float, tolerance: float) -> bool:
        """Return True if the next correction uses the matrix again.

        Args:
            error: relative residual.
            before: relative residual before the last correction; 0 if there was none.
            tolerance: relative residual to reach.
        """
        if not self._serves or self.number >= _MOST_CHORDS:
            return False
        if before == 0:
            return True
        rate = error / before
        # a Newton step would square the convergence rate; chord steps keep it
        steps = _MOST_CHORDS - self.number if self._kept or self.number else 2
        return bool(error * rate**steps <= tolerance)


class _ModelTest:
    """Criterion to end a linear solve below the remainder of the linear model, see `Forcing`.

    Args:
        forcing: rule for the relative tolerance of linear solves.
        remainder: function that returns the norm of H after a correction, in the rows in which the
            linear model is inexact.
    """

    def __init__(self, forcing: Forcing, remainder: Callable[[PETSc.Vec], float]):
        self._remainder = remainder
        self.is_due = forcing.is_due
        self._suffices = forcing.suffices

    def __call__(self, reduction: float, size: float, solution: PETSc.Vec) -> bool:
        return self._suffices(reduction, self._remainder(solution) / size)


class _BorderedSolve:
    """Linear solve of a correction, as a PETSc preconditioner."""

    def __init__(self, corrector: Corrector):
        self._corrector = corrector

    def apply(self, pc: PETSc.PC, rhs: PETSc.Vec, out: PETSc.Vec) -> None:
        reasons = PETSc.PC.FailedReason
        ok = self._corrector.solve(rhs, out)
        pc.setFailedReason(reasons.NOERROR if ok else reasons.FACTOR_NUMERIC_ZEROPIVOT)


class Corrector:
    """Correctors on a bordered system.

    Args:
        bordered: vectors and linear algebra.
        control: tolerance and number of corrections.
        chords: whether corrections may use chord steps. A path with memory needs pure Newton steps,
            because round-off decides the order of its events.
    """

    def __init__(self, bordered: Bordered, control: StepControl, *, chords: bool = True):
        self.bordered = bordered
        self.control = control
        self._serves = chords and bordered.solver.many_sides
        self.snes = PETSc.SNES().create(bordered.comm)
        self._b, self._row, self._away = (bordered.vector() for _ in range(3))
        self._hx, self._x, self._d = (bordered.system.create_vector() for _ in range(3))
        self._e = bordered.last_unit()
        self.snes.setFunction(self._function, self._b)
        self.snes.setOptionsPrefix(bordered.prefix)
        with options_in_database(bordered.prefix, {"snes_linesearch_type": "none"}):
            self.snes.setFromOptions()
        ksp = self.snes.getKSP()
        ksp.setType(PETSc.KSP.Type.PREONLY)
        ksp.getPC().setType(PETSc.PC.Type.PYTHON)
        ksp.getPC().setPythonContext(_BorderedSolve(self))
        self.snes.setConvergenceTest(self._test)
        self.snes.setLineSearchPreCheck(self._settle)
        self.snes.setMonitor(self._improve)
        self.snes.setTolerances(max_it=_MOST_TESTS * control.corrections)
        self._piece: Piece | None = None
        self._reference: PETSc.Vec | None = None
        self._distance = 0.0
        self._polish = False
        self._T: PETSc.Vec | None = None
        self._along: PETSc.Vec | None = None  # vector whose dual is the last row
        self._error = self._residual = 0.0
        self._chords = _Chords()
        self._rule = Forcing()
        self._model = _ModelTest(self._rule, self._remainder)
        self._keeps = self._polished = False
        self._codes: npt.NDArray[np.int8] | None = None
        self._last_codes: npt.NDArray[np.int8] | None = None
        self._scales: tuple[float, ...] = ()  # at the start of the run
        self._predicted: tuple[float, ...] | None = None  # scales at the predicted state
        #: Last evaluation of H: y, relative size of H, and H.
        self._known: tuple[Array, float, Array] | None = None
        #: Relative tolerance of the linear solve of the next correction.
        self.forcing = 0.0

    @property
    def iterations(self) -> int:
        """Number of corrections of the last run, counted as Newton steps."""
        return self._chords.iterations

    # -- the three correctors --------------------------------------------------------------------

    def moore_penrose(self, y: PETSc.Vec, t: PETSc.Vec, piece: Piece | None) -> bool:
        """Correct ``y`` in place, orthogonally to ``t``, which serves as work space."""
        self._reference = None
        self._polish = False
        self._T = t
        return self._run(y, t, piece)

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
        self._reference = start
        self._T = None
        self._distance = distance
        self._polish = polish
        return self._run(y, t, piece, keep=keep)

    def natural(self, y: PETSc.Vec, gamma: float, piece: Piece | None) -> bool:
        """Correct ``y`` in place at fixed gamma; the result has exactly this gamma."""
        b = self.bordered
        start = b.vector()
        t = b.last_unit()
        t.scale(2 * b.gamma_scale**2)  # its dual vector is the unit vector of gamma
        start.set(0.0)
        ok = self.pseudo_arclength(y, start, t, gamma, piece)
        for v in (start, t):
            v.destroy()
        if ok:  # remove the round-off of gamma
            b.join(b.split(y)[0], gamma, y)
        return ok

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
        solver = self.bordered.solver
        # beyond a kink the tangent may be orthogonal to the previous one: try other last rows
        axis = b.last_unit()
        axis.scale(b.gamma_scale)
        diagonal = towards + axis
        rows = (towards, axis, diagonal)
        rtol = 0.0 if precise or b.x_scale == 0 else _TO_STEP_ALONG
        tangent = None
        for row in rows:
            b.dual(row, self._row)
            near = None
            if row is towards:
                near = self._extrapolated(towards, start, y)
            solver.assemble(y, self._row, piece, along=near)
            t = b.vector()
            if (not factorise or solver.factorise()) and solver.solve(
                self._e, t, rtol=rtol, near=near
            ):
                size = np.sqrt(b.inner(t, t))
                if np.isfinite(size) and 0 < size < _NEARLY_SINGULAR:
                    along = float(self._row.dot(t))  # component along the row
                    ahead = along if row is towards else b.inner(t, towards)
                    sense = 1.0 if ahead >= 0 else -1.0
                    t.scale(sense / size)
                    tangent = t
                    b.sense = sense * float(np.sign(along))
                    break
            t.destroy()
        axis.destroy(), diagonal.destroy()
        return tangent

    def _extrapolated(self, t: PETSc.Vec, start: PETSc.Vec | None, y: PETSc.Vec) -> PETSc.Vec:
        """Return the tangent at ``y`` of the parabola from ``start`` along ``t``. Collective.

        It is scaled so that its product with the last row is 1. Without a start it is ``t``.
        """
        if start is None or self.bordered.solver.many_sides:
            return t
        self._away.waxpy(-1.0, start, y)
        along = float(self._row.dot(self._away))
        if not along > 0:
            return t
        self._away.scale(2.0 / along)
        self._away.axpy(-1.0, t)
        return self._away

    def orientation(self) -> float:
        """Return the sign of det [grad H; t^T] for the last computed `tangent` t.

        Along a branch the sign changes at bifurcations only.
        """
        return self.bordered.solver.determinant_sign() * self.bordered.sense

    # -- SNES ------------------------------------------------------------------------------------

    def _run(self, y: PETSc.Vec, t: PETSc.Vec, piece: Piece | None, *, keep: bool = False) -> bool:
        self._piece = piece
        self._error = 0.0
        self._polished = False
        self._chords.begin(kept=keep and self._serves)
        self._scales = self.bordered.system.scales
        self._predicted = None
        self._known = None
        self.bordered.dual(t, self._row)
        self._along = t
        self.snes.setJacobian(self._jacobian, self._matrix(y))
        with self.bordered.solver.options(), as_raised():
            self.snes.solve(None, y)
        ok = bool(self.snes.getConvergedReason() > 0)
        if not ok:
            self.reject()
        return ok

    def reject(self) -> None:
        """Restore the scales of the residual, which a diverging run may have enlarged."""
        self.bordered.system.scales = self._scales

    def _matrix(self, y: PETSc.Vec) -> PETSc.Mat:
        solver = self.bordered.solver
        if not solver.matrix:
            solver.assemble(y, self._row, self._piece, along=self._along)
        return solver.matrix

    def _function(self, _snes: PETSc.SNES, y: PETSc.Vec, out: PETSc.Vec) -> None:
        b = self.bordered
        x, gamma = b.split(y)
        if self._is_known(y):
            assert self._known is not None
            self._residual = self._known[1]
            self._hx.array[:] = self._known[2]
        else:
            self._residual = self._evaluate(x, gamma, self._hx)
        self._known = None
        last = 0.0
        if self._reference is not None:
            self._away.waxpy(-1.0, self._reference, y)
            last = float(self._row.dot(self._away)) - self._distance
        b.join(self._hx, last, out)

    def _evaluate(self, x: PETSc.Vec, gamma: float, hx: PETSc.Vec) -> float:
        """Write H into ``hx``, and return its size relative to the predicted state. Collective."""
        system = self.bordered.system
        # with the scales of a diverging iterate every other state would look like a solution
        if self._predicted is not None:
            system.scales = self._predicted
        size = system.residual(x, gamma, hx, self._piece)
        if self._predicted is None:
            self._predicted = system.scales
        return size

    def _is_known(self, y: PETSc.Vec) -> bool:
        """Return True if the last evaluation of H was at ``y``. Collective."""
        if self._known is None:
            return False
        same = bool(np.array_equal(self._known[0], y.array_r))
        return bool(self.bordered.comm.allreduce(same, op=MPI.LAND))

    def _jacobian(self, _snes: PETSc.SNES, y: PETSc.Vec, A: PETSc.Mat, _P: PETSc.Mat) -> None:
        if self._keeps:
            self._chords.number += 1
            return
        self.bordered.solver.assemble(y, self._row, self._piece, along=self._along)
        self._chords.new_matrix(serves=self._serves)
        self._codes = self._codes_at(y) if self._serves else None

    def _codes_at(self, y: PETSc.Vec) -> npt.NDArray[np.int8] | None:
        """Return the local statuses determined by ``y``; None if the piece is prescribed."""
        system = self.bordered.system
        return None if self._piece is not None else system.piece_at(*self.bordered.split(y)).codes

    def _leads_on(self, y: PETSc.Vec, error: float) -> bool:
        """Return True if the next correction from ``y`` is a chord step. Collective."""
        if not self._chords.lead_on(error, self._error, self.control.tolerance):
            return False
        codes = self._codes_at(y)
        if self._codes is None or codes is None:
            return True
        same = bool(np.array_equal(self._codes, codes))
        return bool(self.bordered.comm.allreduce(same, op=MPI.LAND))

    def solve(self, rhs: PETSc.Vec, out: PETSc.Vec) -> bool:
        """Solve for a correction that satisfies the current last row; called by PETSc."""
        enough = None if self._polished else self._model
        ok = self.bordered.solver.solve(rhs, out, rtol=self.forcing, enough=enough)
        if ok and self._keeps and self._T is not None:
            # the kept matrix has an old last row; the tangent spans the kernel of the other rows
            out.axpy(self.bordered.gamma(rhs) - self._row.dot(out), self._T)
        return ok

    def _remainder(self, step: PETSc.Vec) -> float:
        """Return the norm of H after a full step, in its cheap nonlinear rows. Collective."""
        self._away.waxpy(-1.0, step, self.snes.getSolution())
        x, gamma = self.bordered.split(self._away)
        rows = self.bordered.system.contact_rows(x, gamma, self._piece)
        if rows is None:
            return 0.0
        return float(np.sqrt(self.bordered.comm.allreduce(float(rows @ rows))))

    def _settle(self, y: PETSc.Vec, step: PETSc.Vec) -> None:
        """Extend a step by corrections of a few cheap rows, see `settle`; called by PETSc."""
        b = self.bordered
        if not b.solver.corrects:
            return
        self._away.waxpy(-1.0, step, y)
        x, gamma = b.split(self._away)
        x.copy(self._x)

        size = 0.0
        evaluated = np.zeros(0)  # state of the last evaluation of H

        def evaluate(x: PETSc.Vec, hx: PETSc.Vec) -> None:
            nonlocal size, evaluated
            size = self._evaluate(x, gamma, hx)
            evaluated = x.array_r.copy()

        def correct(x: PETSc.Vec, hx: PETSc.Vec, d: PETSc.Vec) -> bool:
            try:
                return b.system.correct(x, gamma, hx, d, self._piece)
            except ArithmeticError as error:
                if b.comm.rank == 0:
                    logger.debug("no correction: %s", error)
                return False

        if settle(evaluate, correct, self._x, self._hx, self._d, ROUNDS):
            b.join(self._x, gamma, self._away)
            step.waxpy(-1.0, self._away, y)
        same = bool(np.array_equal(self._x.array_r, evaluated))
        if b.comm.allreduce(same, op=MPI.LAND):  # no correction was refused
            self._away.waxpy(-1.0, step, y)  # the same operation as in PETSc, to the last bit
            self._known = self._away.array_r.copy(), size, self._hx.array_r.copy()

    def _test(self, snes: PETSc.SNES, it: int, _norms: tuple[float, float, float]) -> int:
        reasons = PETSc.SNES.ConvergedReason
        out = snes.getFunction()[0]
        last = self.bordered.gamma(out)
        error = self._residual
        if not np.isfinite(error + last):
            return int(reasons.DIVERGED_LOCAL_MIN)
        if error <= self.control.tolerance and self._is_there(snes.getSolution(), last):
            blunt = self._chords.number > 0 and error > _SHARP * self.control.tolerance
            if self._polished or not (self._polish or blunt):
                return int(reasons.CONVERGED_FNORM_RELATIVE)
            self._polished = True
        self._keeps = self._leads_on(snes.getSolution(), error)
        if not self._keeps and self.iterations >= self.control.corrections:
            return int(reasons.DIVERGED_MAX_IT)
        self.forcing = self._forcing(error, self._changed(snes.getSolution(), it))
        self._error = error
        return 0

    def _is_there(self, y: PETSc.Vec, last: float) -> bool:
        """Return True if the residual ``last`` of the last row is round-off. Collective."""
        scale = max(abs(self._distance), 1e-6) if self._reference is not None else 1.0
        if abs(last) <= 1e-10 * scale:
            return True
        b = self.bordered
        return abs(last) <= _ROUND_OFF * abs(b.gamma(self._row) * b.gamma(y))

    def _changed(self, y: PETSc.Vec, it: int) -> float:
        """Return the fraction of points whose status the last correction changed. Collective.

        It is 1 before the first correction, and 0 if the solver is direct, which does not need it.
        """
        if self.bordered.solver.many_sides:
            return 0.0
        before = self._last_codes
        codes = self._last_codes = self._codes_at(y)
        if codes is None:
            return 0.0
        if it == 0 or before is None:
            return 1.0
        numbers = np.array([np.sum(codes != before), len(before)])
        changed, number = self.bordered.comm.allreduce(numbers)
        return float(changed / max(number, 1))

    def _forcing(self, error: float, changed: float) -> float:
        """Return the relative tolerance of the next linear solve. Collective."""
        if error <= self.control.tolerance:
            return _POLISHED
        if self._error == 0.0:
            self._rule.restart(warm=True)
        return self._rule.tolerance(error, self.control.tolerance, changed)

    def _improve(self, snes: PETSc.SNES, it: int, _norm: float) -> None:
        """Update the Moore-Penrose tangent with the factorisation of the last step.

        With an iterative solver the tangent is kept, because every right-hand side costs a solve.
        """
        b = self.bordered
        if it == 0 or self._T is None or not b.solver.many_sides or self._chords.number:
            return
        if snes.getConvergedReason() > 0:  # the tangent of the point itself follows
            return
        new = b.vector()
        if b.solver.solve(self._e, new):
            size = np.sqrt(b.inner(new, new))
            if np.isfinite(size) and size > 0:
                new.scale(1.0 / size)
                new.copy(self._T)
                b.dual(self._T, self._row)
        new.destroy()

    def destroy(self) -> None:
        """Free the PETSc objects."""
        vectors = (self._b, self._row, self._away, self._e, self._hx, self._x, self._d)
        for item in (self.snes, *vectors):
            item.destroy()
