# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Correctors: from a predicted point to a point of the branch, and tangents.

All correctors are a SNES for H = 0 and one more row:

- *Moore-Penrose* (Ligursky and Renard, Comput. Mech. 56, 2015, after Dhooge, Govaerts and
  Kuznetsov) moves orthogonally to a tangent that is improved with the same factorisation;
- *pseudo-arclength* prescribes the distance along a fixed tangent;
- *natural* prescribes gamma.

If further solves with a matrix are cheap, a correction may use the matrix of the last one (a
*chord*). Convergence is always tested with the residual of H.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._forcing import Forcing
from dolfinx_contact._petsc import as_raised, options_in_database
from dolfinx_contact._settling import ROUNDS, settle
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.continuation.system import Piece

__all__ = ["Corrector"]

Array = npt.NDArray[np.float64]

logger = logging.getLogger(__name__)

_MOST_CHORDS = 5  # in a row
#: Length of a solution of J t = (0, 1) beyond which the row determines the tangent too poorly.
_NEARLY_SINGULAR = 1e8
#: Relative residual of the linear solve for one more correction within the tolerance, where
#: exactness has a price.
_POLISHED = 1e-4
#: Of the tolerance, down to which a point that a chord leads to is corrected once more: a step of
#: Newton's method would have led further.
_SHARP = 3e-2
_MOST_TESTS = 10  # over the number of corrections, for PETSc
_ROUND_OFF = 4 * float(np.finfo(np.float64).eps)  # of gamma
#: Relative residual of a tangent that is no more than a direction to step along.
_TO_STEP_ALONG = 1e-4


class _Chords:
    """Matrices and chords of a run.

    Chords replace the last Newton step: where it would reach the tolerance, and a few chords do as
    well (C. T. Kelley, Iterative Methods for Linear and Nonlinear Equations, SIAM 1995, section
    5.4). The point is the one that the step would have reached, and steps are as long.

    Attributes:
        number: number of chords since the last matrix.
    """

    def __init__(self) -> None:
        self.begin(kept=False)

    def begin(self, *, kept: bool) -> None:
        """Begin a run; ``kept``: whether it begins with the matrix of the last one."""
        self._kept = self._serves = kept
        self._matrices = 0
        self.number = 0

    def new_matrix(self, *, serves: bool) -> None:
        """Count a new matrix; ``serves``: whether further corrections may use it."""
        self._kept = False
        self._serves = serves
        self._matrices += 1
        self.number = 0

    @property
    def iterations(self) -> int:
        """Number of corrections; chords in a row count as one."""
        return self._matrices + int(self.number > 0)

    def lead_on(self, error: float, before: float, tolerance: float) -> bool:
        """Whether the next correction uses the matrix again.

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
        # A Newton step would square the rate of convergence, which chords keep.
        steps = _MOST_CHORDS - self.number if self._kept or self.number else 2
        return bool(error * rate**steps <= tolerance)


class _ModelTest:
    """Ends a linear solve below the remainder of the linear model, as `Forcing` says.

    Args:
        forcing: the rule.
        remainder: the norm of H after a correction, in the rows where the linear model errs.
    """

    def __init__(self, forcing: Forcing, remainder: Callable[[PETSc.Vec], float]):
        self._remainder = remainder
        self.is_due = forcing.is_due
        self._suffices = forcing.suffices

    def __call__(self, reduction: float, size: float, solution: PETSc.Vec) -> bool:
        return self._suffices(reduction, self._remainder(solution) / size)


class _BorderedSolve:
    """The linear solve of a correction, for PETSc."""

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
        chords: whether corrections may keep the matrix of the one before. A path with memory, along
            which round-off decides what comes first, has Newton's method to its end.
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
        self._along: PETSc.Vec | None = None  # whose dual vector the last row is
        self._error = self._residual = 0.0
        self._chords = _Chords()
        self._rule = Forcing()
        self._model = _ModelTest(self._rule, self._remainder)
        self._keeps = self._polished = False
        self._codes: npt.NDArray[np.int8] | None = None
        self._last_codes: npt.NDArray[np.int8] | None = None
        self._scales: tuple[float, ...] = ()  # at the start of the run
        self._predicted: tuple[float, ...] | None = None  # with the state it started from
        #: The y after a step, and the size of H and H there.
        self._known: tuple[Array, float, Array] | None = None
        #: Relative residual to which a correction is worth solving.
        self.forcing = 0.0

    @property
    def iterations(self) -> int:
        """Corrections of the last run, in steps of Newton's method."""
        return self._chords.iterations

    # -- the three correctors --------------------------------------------------------------------

    def moore_penrose(self, y: PETSc.Vec, t: PETSc.Vec, piece: Piece | None) -> bool:
        """Correct ``y`` in place, orthogonally to ``t``, which is improved in place."""
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

        With ``polish`` it is corrected once more when it is within the tolerance. With ``keep`` the
        matrix of the last run, with the same ``t`` and piece, serves as far as it leads.
        """
        self._reference = start
        self._T = None
        self._distance = distance
        self._polish = polish
        return self._run(y, t, piece, keep=keep)

    def natural(self, y: PETSc.Vec, gamma: float, piece: Piece | None) -> bool:
        """Correct ``y`` in place at fixed gamma, which it then has to the last bit."""
        b = self.bordered
        start = b.vector()
        t = b.last_unit()
        t.scale(2 * b.gamma_scale**2)  # whose dual vector is the unit vector of gamma
        start.set(0.0)
        ok = self.pseudo_arclength(y, start, t, gamma, piece)
        for v in (start, t):
            v.destroy()
        if ok:  # no more than round-off is taken away here
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
        """Unit tangent of ``piece`` at ``y``, on the side of ``towards``; None if there is no one.

        The matrix stays behind for other right-hand sides, with ``factorise`` factorised. Where
        exactness has a price, a tangent to step along need not be ``precise``, and is looked for
        near that of the parabola to ``y`` from ``start``, where ``towards`` is tangent.
        """
        b = self.bordered
        solver = self.bordered.solver
        # Beyond a kink the tangent may be orthogonal to the one before; then another row will do.
        axis = b.last_unit()
        axis.scale(b.gamma_scale)
        both = towards + axis
        rows = (towards, axis, both)
        rtol = 0.0 if precise or b.x_scale == 0 else _TO_STEP_ALONG
        found = None
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
                    along = float(self._row.dot(t))  # of the row
                    ahead = along if row is towards else b.inner(t, towards)
                    sense = 1.0 if ahead >= 0 else -1.0
                    t.scale(sense / size)
                    found = t
                    b.sense = sense * float(np.sign(along))
                    break
            t.destroy()
        axis.destroy(), both.destroy()
        return found

    def _extrapolated(self, t: PETSc.Vec, start: PETSc.Vec | None, y: PETSc.Vec) -> PETSc.Vec:
        """The tangent at ``y`` of a parabola from ``start``, where it is ``t``. Collective.

        Its part along ``t`` is 1, by the row as it is; without a start it is ``t``.
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
        """Sign of det [grad H; t^T] at the `tangent` t that was computed last.

        It is the same all along a branch but beyond bifurcations.
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
        """Judge what follows as if the last run had not been: where it went is no size of H."""
        self.bordered.system.scales = self._scales

    def _matrix(self, y: PETSc.Vec) -> PETSc.Mat:
        solver = self.bordered.solver
        if not solver.matrix:
            solver.assemble(y, self._row, self._piece, along=self._along)
        return solver.matrix

    def _function(self, _snes: PETSc.SNES, y: PETSc.Vec, out: PETSc.Vec) -> None:
        b = self.bordered
        x, gamma = b.split(y)
        # Beside a wild iterate every other one would be a solution.
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
        """H into ``hx``, and its size in the scales that it has at the prediction. Collective."""
        system = self.bordered.system
        if self._predicted is not None:
            system.scales = self._predicted
        size = system.residual(x, gamma, hx, self._piece)
        if self._predicted is None:
            self._predicted = system.scales
        return size

    def _is_known(self, y: PETSc.Vec) -> bool:
        """Whether H at ``y`` is what was evaluated last on the way there. Collective."""
        known = self._known
        if known is None:
            return False
        same = bool(np.array_equal(known[0], y.array_r))
        return bool(self.bordered.comm.allreduce(same, op=MPI.LAND))

    def _jacobian(self, _snes: PETSc.SNES, y: PETSc.Vec, A: PETSc.Mat, _P: PETSc.Mat) -> None:
        if self._keeps:
            self._chords.number += 1
            return
        self.bordered.solver.assemble(y, self._row, self._piece, along=self._along)
        self._chords.new_matrix(serves=self._serves)
        self._codes = self._codes_at(y) if self._serves else None

    def _codes_at(self, y: PETSc.Vec) -> npt.NDArray[np.int8] | None:
        """The statuses on this rank by which H is linearised at ``y``; None if they are held."""
        system = self.bordered.system
        return None if self._piece is not None else system.piece_at(*self.bordered.split(y)).codes

    def _leads_on(self, y: PETSc.Vec, error: float) -> bool:
        """Whether the next correction from ``y`` keeps the matrix. Collective."""
        if not self._chords.lead_on(error, self._error, self.control.tolerance):
            return False
        codes = self._codes_at(y)
        if self._codes is None or codes is None:
            return True
        same = bool(np.array_equal(self._codes, codes))
        return bool(self.bordered.comm.allreduce(same, op=MPI.LAND))

    def solve(self, rhs: PETSc.Vec, out: PETSc.Vec) -> bool:
        """Solve for a correction, whose last row is that of the tangent as it is; for PETSc."""
        enough = None if self._polished else self._model
        ok = self.bordered.solver.solve(rhs, out, rtol=self.forcing, enough=enough)
        if ok and self._keeps and self._T is not None:
            # The tangent spans what the other rows leave free.
            out.axpy(self.bordered.gamma(rhs) - self._row.dot(out), self._T)
        return ok

    def _remainder(self, step: PETSc.Vec) -> float:
        """Norm of H after a full step, in the rows where its linear model errs. Collective."""
        self._away.waxpy(-1.0, step, self.snes.getSolution())
        x, gamma = self.bordered.split(self._away)
        rows = self.bordered.system.contact_rows(x, gamma, self._piece)
        if rows is None:
            return 0.0
        return float(np.sqrt(self.bordered.comm.allreduce(float(rows @ rows))))

    def _settle(self, y: PETSc.Vec, step: PETSc.Vec) -> None:
        """Put right after the step y - step what is cheap to solve on its own; see `settle`."""
        b = self.bordered
        if not b.solver.corrects:
            return
        self._away.waxpy(-1.0, step, y)
        x, gamma = b.split(self._away)
        x.copy(self._x)

        size = 0.0
        there = np.zeros(0)

        def evaluate(x: PETSc.Vec, hx: PETSc.Vec) -> None:
            nonlocal size, there
            size = self._evaluate(x, gamma, hx)
            there = x.array_r.copy()

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
        same = bool(np.array_equal(self._x.array_r, there))
        if b.comm.allreduce(same, op=MPI.LAND):  # no correction was refused
            self._away.waxpy(-1.0, step, y)  # as PETSc will
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
        """Whether the last row, here ``last``, holds up to the round-off of gamma. Collective."""
        scale = max(abs(self._distance), 1e-6) if self._reference is not None else 1.0
        if abs(last) <= 1e-10 * scale:
            return True
        b = self.bordered
        return abs(last) <= _ROUND_OFF * abs(b.gamma(self._row) * b.gamma(y))

    def _changed(self, y: PETSc.Vec, it: int) -> float:
        """The share of the kinked points whose status the last correction changed. Collective.

        Where exactness has a price; before the first correction all.
        """
        if self.bordered.solver.many_sides:
            return 0.0
        before = self._last_codes
        codes = self._last_codes = self._codes_at(y)
        if codes is None:
            return 0.0
        if it == 0 or before is None:
            return 1.0
        mine = np.array([np.sum(codes != before), len(before)])
        changed, number = self.bordered.comm.allreduce(mine)
        return float(changed / max(number, 1))

    def _forcing(self, error: float, changed: float) -> float:
        """To what part the residual is worth reducing. Collective."""
        if error <= self.control.tolerance:
            return _POLISHED
        if self._error == 0.0:
            self._rule.restart(warm=True)
        return self._rule.tolerance(error, self.control.tolerance, changed)

    def _improve(self, _snes: PETSc.SNES, it: int, _norm: float) -> None:
        """Moore-Penrose: a better tangent from the factorisation of the step just taken.

        Where another right-hand side costs another solve the tangent stays as it is.
        """
        b = self.bordered
        if it == 0 or self._T is None or not b.solver.many_sides or self._chords.number:
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
        mine = (self._b, self._row, self._away, self._e, self._hx, self._x, self._d)
        for thing in (self.snes, *mine):
            thing.destroy()
