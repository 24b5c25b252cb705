# SPDX-License-Identifier: LGPL-3.0-or-later
"""Semismooth Newton method for H(x) = 0, using SNES of PETSc.

At every iterate, statuses are determined from the unknowns before residual and Jacobian are
evaluated, so that the Jacobian is an element of the generalised Jacobian of H. Exceptions are
statuses prescribed by the caller, and guessed statuses in the first step of a body without contact.
Convergence is tested for each kind of residual (`equations.measures`). Full steps returning to
earlier statuses are stopped as a cycle.

SNES requests residual, Jacobian and convergence in separate calls, each for given unknowns. Every
call takes the evaluation from `_Run.at`, which evaluates H only once for equal unknowns, so that no
call depends on the calls before it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._inexact import ROUNDS, settle
from dolfinx_contact._mpi import any_rank, anywhere, count_of, sorted_rows
from dolfinx_contact._petsc import as_raised, destroy, logged, options_in_database, reason_name
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation, Statuses, differs
from dolfinx_contact.equations.jacobian import JacobianSolver
from dolfinx_contact.equations.measures import Measures, Scales, measure, without_normal
from dolfinx_contact.equations.touching import touches_nothing, touching
from dolfinx_contact.solvers.attempts import Attempt, FloatingBodyError, LinearSolverError, Step

__all__ = ["LinearSolver", "Newton"]

logger = logging.getLogger(__name__)

_DEFAULTS: dict[str, Any] = {
    "snes_rtol": 1e-10,
    "snes_max_it": 40,
}
_SMALL = 1e-8  # residual that may be round-off
_FAR = 1e6  # ratio of the scales of the start to those of a state from which they are dropped
_RETRIES = 5  # new preconditioners in one run
_CONVERGED = int(PETSc.SNES.ConvergedReason.CONVERGED_FNORM_RELATIVE)
_ENOUGH_STEPS = int(PETSc.SNES.ConvergedReason.CONVERGED_ITS)
_TOO_MANY_STEPS = int(PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT)
_STOPPED = int(PETSc.SNES.ConvergedReason.DIVERGED_LOCAL_MIN)
_LINEAR = int(PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE)
_NOT_A_NUMBER = -4  # DIVERGED_FNORM_NAN, since PETSc 3.24 DIVERGED_FUNCTION_NANORINF


class LinearSolver(JacobianSolver):
    """Interface of the linear solvers of Newton's method.

    Attributes:
        name: name of the solver, ``direct`` or ``amg``.
        defaults: default PETSc options of the KSP.
        reduction: ratio of the final to the initial residual of the last solve; 0 if unknown.
        iterates_on_request: whether the user's options replace the factorisation by an iterative
            method.
    """

    name: str
    reduction = 0.0
    iterates_on_request = False
    defaults: dict[str, Any]

    def attach(self, ksp: PETSc.KSP, remainder: Callable[[PETSc.Vec], float]) -> None:
        """Prepare a KSP before it reads its options.

        Args:
            ksp: linear solver of SNES.
            remainder: collective function that maps a Newton correction to the norm of the contact
                rows of H after this correction.
        """

    def prepare(
        self, ksp: PETSc.KSP, step: Step, target: float, evaluation: Evaluation, *, warm: bool
    ) -> None:
        """Set tolerances and preconditioner for the Newton step from an iterate. Collective.

        Args:
            ksp: linear solver of SNES.
            step: Newton iterate from which the step is taken.
            target: relative residual at which Newton's method ends.
            evaluation: evaluation at the iterate.
            warm: whether Newton's method began from a state in contact.
        """

    def retry(self, evaluation: Evaluation) -> bool:
        """Return whether another preconditioner is available after a failed solve. Collective.

        Args:
            evaluation: evaluation at the iterate of the failed step.
        """
        return False

    def explain(self, ksp: PETSc.KSP) -> str:
        """Return the reason for a failed linear solve as text. Collective."""
        raise NotImplementedError

    def inaccuracy(self, ksp: PETSc.KSP) -> str:
        """Return a message if PETSc accepted an inaccurate solve, otherwise "". Collective."""
        return ""

    def tighten(self) -> bool:
        """Tighten linear tolerances after a cycle of statuses; return whether this was possible."""
        return False


@dataclass(eq=False)
class _Run:
    """Arguments and state of one run of Newton's method.

    Attributes:
        equations: contact problem.
        attempt: attempt recording the iterates.
        latest: latest evaluation of the residual H; None before the first evaluation.
        prescribed: statuses with which H is evaluated; None for the statuses determined by the
            unknowns.
        most: number of steps after which the run ends; None to end only at a solution.
        history: statuses and largest relative residual of each iterate.
        guess: statuses for the next Jacobian; None for the statuses of the iterate.
        warm: whether the run began from a state in contact.
        floating: error that ended the run because nothing prevents a rigid motion; None otherwise.
    """

    equations: ContactEquations
    attempt: Attempt
    latest: Evaluation | None
    prescribed: Statuses | None
    most: int | None
    history: list[tuple[Statuses, float]] = field(default_factory=list)
    guess: Statuses | None = None
    warm: bool = False

    def known(self, x: PETSc.Vec) -> Evaluation | None:
        """Return the latest evaluation of H if it is at ``x``, otherwise None. Collective."""
        latest = self.latest
        same = latest is not None and np.array_equal(x.array_r, latest.unknowns)
        return None if any_rank(self.equations.comm, not same) else latest

    def at(self, x: PETSc.Vec) -> Evaluation:
        """Return the evaluation of H at ``x``, reusing the latest one if possible. Collective."""
        state = self.known(x)
        if state is None:
            with logged("ContactResidual"):
                state = self.latest = self.equations.evaluate(x, self.prescribed)
            self.attempt.evaluations += 1
        return state


class Newton:
    """Semismooth Newton method for a contact problem, a context manager owning the SNES.

    All methods are collective. All runs use the same force and length scales for the residual.

    Args:
        equations: contact problem.
        linear: linear solver.
        line_search: name of a line search of PETSc; ``"none"`` for full steps.
        monitor: function called with every iterate (`Step`); None for no monitor.

    Attributes:
        snes: SNES.
        tolerance: relative residual at which a run ends.
        max_iterations: largest number of steps of a run.
    """

    tolerance: float
    max_iterations: int

    def __init__(
        self,
        equations: ContactEquations,
        linear: LinearSolver,
        line_search: str,
        monitor: Callable[[Step], None] | None,
    ):
        self.equations = equations
        self.linear = linear
        self.monitor = monitor
        self.comm = equations.comm
        self._full_steps = line_search == "none"
        self.scales = Scales()
        options = equations.options
        defaults = {**_DEFAULTS, **linear.defaults, "snes_linesearch_type": line_search}
        self.options = {**defaults, **options.given}
        #: Vectors for the unknowns, H and the correction after a step of an iterative solver.
        number = 3 if linear.corrects else 0
        self._after = [equations.unknowns.create_vector() for _ in range(number)]
        self._run: _Run
        self._create()

    def _create(self) -> None:
        """Create the SNES.

        Raises:
            ValueError: if the options name a solver that PETSc does not know, or that does not
                solve contact problems with this linear solver.
        """
        prefix = self.equations.options.prefix
        self.snes, self.b = PETSc.SNES().create(self.comm), self.equations.unknowns.create_vector()
        self.snes.setFunction(lambda _snes, x, b: self._residual(x, b), self.b)
        self.snes.setJacobian(self._jacobian, self.linear.matrix)
        self.snes.setConvergenceTest(self._test)
        self.snes.setOptionsPrefix(prefix)
        self.linear.attach(self.snes.getKSP(), self._remainder)
        if self._full_steps and self.linear.corrects:
            self.snes.setLineSearchPreCheck(self._settle)
        read = self.equations.options.read
        with options_in_database(prefix, self.options, read=read), as_raised():
            self.snes.setFromOptions()
        self.snes.setTolerances(atol=0.0, stol=0.0)
        self.tolerance, _, _, self.max_iterations = self.snes.getTolerances()
        if self.linear.name != "direct" and self.snes.getType() != PETSc.SNES.Type.NEWTONLS:
            raise ValueError(
                f"-{prefix}snes_type {self.snes.getType()} needs an assembled matrix; "
                f"with the linear solver {self.linear.name} only newtonls can be used"
            )

    def __enter__(self) -> Newton:
        return self

    def __exit__(self, *_: object) -> None:
        destroy(self.snes, self.b, *self._after)

    def run(
        self,
        x: PETSc.Vec,
        attempt: Attempt,
        start: Evaluation | None = None,
        *,
        prescribed: Statuses | None = None,
        most: int | None = None,
    ) -> bool:
        """Solve H(x) = 0 under the present load and return whether a solution was found.

        Args:
            x: start; receives the solution, or the last iterate.
            attempt: attempt recording the iterates, the reason for the end, and the evaluation
                at a solution of H.
            start: evaluation at the start, if available.
            prescribed: statuses with which H is evaluated; default: statuses determined by the
                unknowns.
            most: number of steps after which the run ends successfully; default: no such number.

        Raises:
            FloatingBodyError: if a rigid motion is free.
        """
        self._run = run = _Run(self.equations, attempt, start, prescribed, most)
        attempt.evaluation = None
        attempt.linear_solver_failed = False
        attempt.evaluations += start is not None
        ksp = self.snes.getKSP()
        y = x.copy()
        try:
            options = self.equations.options
            kept = options_in_database(options.prefix, self.options, read=options.read)
            with kept, as_raised():
                self.snes.solve(None, y)
                self._retry(y)
            y.copy(x)
            reason = self.snes.getConvergedReason()
            # Only H with its own statuses is the state of the result.
            if reason > 0 and prescribed is None:
                attempt.evaluation = run.known(x)
        except LinearSolverError as error:
            attempt.reason = str(error)
            destroy(self.snes, self.b)  # PETSc objects remain locked after an error
            self._create()
            return False
        finally:
            y.destroy()
        if not attempt.steps and reason == _NOT_A_NUMBER:
            raise ValueError(
                "the residual overflows at the start: its square is beyond 1e308. Look at the "
                "starting displacement, loads, Dirichlet and material data, or use other units"
            )
        if attempt.floats:
            raise FloatingBodyError(attempt.reason)
        if reason > 0:
            attempt.reason = "converged"
        elif reason != _STOPPED:
            attempt.reason = self._explain()
            attempt.linear_solver_failed = reason == _LINEAR
            ksp.reset()  # MUMPS does not recover from a singular matrix
        return bool(reason > 0)

    def run_from_statuses(self, x: PETSc.Vec, attempt: Attempt, statuses: Statuses) -> bool:
        """Like `run` from ``x``, but with given statuses in the first step."""
        start = x.copy()
        if not self.run(x, attempt, prescribed=statuses, most=1):
            start.copy(x)
        start.destroy()
        return self.run(x, attempt)

    def _retry(self, y: PETSc.Vec) -> None:
        """Continue from ``y`` with other preconditioners as long as linear solves fail."""
        for again in range(_RETRIES):
            # A preconditioner that failed in its first step is not worth another of its kind.
            useless = again > 0 and self.snes.getIterationNumber() == 0
            if self.snes.getConvergedReason() != _LINEAR or useless:
                return
            if not self.linear.retry(self._run.at(y)):
                return
            failure = self._explain()
            if self.comm.rank == 0:
                logger.info("%s; repeated with a new preconditioner", failure)
            self.snes.solve(None, y)

    # -- evaluation ------------------------------------------------------------------------------

    def _residual(self, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Write the residual H(x) into ``b``."""
        b.array[:] = np.concatenate(self._run.at(x).rows)

    def _jacobian(self, _snes: PETSc.SNES, x: PETSc.Vec, _A: PETSc.Mat, _P: PETSc.Mat) -> None:
        run = self._run
        guess, run.guess = run.guess, None
        if guess is not None:
            evaluation = self.equations.evaluate_contact(x, guess)
        else:
            evaluation = run.known(x) or self.equations.evaluate_contact(x, run.prescribed)
        before = self.linear.matrix
        self.linear.update(evaluation)
        matrix = self.linear.matrix
        if matrix is not before:  # the SNES takes its matrix after this call
            self.snes.setJacobian(self._jacobian, matrix)
        step = run.attempt.steps[-1]
        self.linear.prepare(self.snes.getKSP(), step, self.tolerance, evaluation, warm=run.warm)

    def _settle(self, x: PETSc.Vec, step: PETSc.Vec) -> None:
        """Correct the contact unknowns after the full step x - step by changing ``step``."""
        run = self._run
        after, b, d = self._after
        after.waxpy(-1.0, step, x)

        def correct(x: PETSc.Vec, b: PETSc.Vec, d: PETSc.Vec) -> bool:
            evaluation = run.at(x)
            return not self._is_solved(evaluation) and self.linear.correct(evaluation, b, d)

        rounds = ROUNDS if run.warm else 1
        changed, evaluated = settle(self._residual, correct, after, b, d, rounds)
        if changed:
            step.waxpy(-1.0, after, x)
        if evaluated:
            # The line search computes x - step, which differs from this state by round-off.
            state = run.at(after)
            after.waxpy(-1.0, step, x)
            run.latest = replace(state, unknowns=after.array_r.copy())

    def _remainder(self, correction: PETSc.Vec) -> float:
        """Return the norm of the contact rows of H after a full step with a given correction."""
        after = self._after[0]
        after.waxpy(-1.0, correction, self.snes.getSolution())
        rows = self.equations.contact_rows(after, self._run.prescribed)
        return float(np.sqrt(self.comm.allreduce(float(rows @ rows))))

    def _is_solved(self, evaluation: Evaluation) -> bool:
        """Return whether the state after a full step is a solution."""
        if self.linear.reduction * self._run.attempt.steps[-1].measures.worst > self.tolerance:
            return False  # the linear system was not solved accurately enough
        measures, _ = measure(self.equations, evaluation, self.scales)
        return measures.worst <= self.tolerance

    # -- convergence -----------------------------------------------------------------------------

    def _test(self, snes: PETSc.SNES, it: int, _norms: tuple[float, float, float]) -> int:
        """Record an iterate; return 0 to continue or the SNES reason to stop."""
        run = self._run
        evaluation = run.at(snes.getSolution())
        measures = self._measure(evaluation)
        statuses = evaluation.statuses
        self._record(it, measures, statuses)
        if not np.isfinite(measures.worst):
            lost = without_normal(self.equations, evaluation)
            run.attempt.reason = lost or "the residual is not finite"
            return _STOPPED
        if measures.worst <= self.tolerance:
            # A solution that a rigid motion may carry away is not an answer.
            return _STOPPED if self._floats(statuses, evaluation) else _CONVERGED
        if run.most is not None and it >= run.most:
            return _ENOUGH_STEPS
        if run.attempt.gives_up():
            return _STOPPED
        if it >= self.max_iterations:
            return _TOO_MANY_STEPS
        cycles = self._full_steps and self._in_cycle(statuses, measures.worst)
        if cycles and not self.linear.tighten():
            inaccurate = self.linear.inaccuracy(self.snes.getKSP())
            floor = self._at_round_off(statuses, measures.worst)
            run.attempt.reason = floor or inaccurate or "statuses recur in a cycle"
            run.attempt.restless = _restless(self.equations, run.history[-1][0], statuses)
            return _STOPPED
        run.history.append((statuses, measures.worst))
        if it == 0:
            statuses = self._first_statuses(statuses, evaluation)
        return _STOPPED if self._floats(statuses, evaluation) else 0

    def _record(self, it: int, measures: Measures, statuses: Statuses) -> None:
        """Add an iterate to the attempt, log it, and call the monitor."""
        run = self._run
        flips = 0
        if run.history:
            changed = differs(statuses, run.history[-1][0])
            flips = count_of(self.comm, np.concatenate(changed))
        krylov = self.snes.getKSP().getIterationNumber() if it > 0 else 0
        step = Step(it, measures, flips, self.equations.constraints.load, krylov)
        run.attempt.steps.append(step)
        if self.comm.rank == 0:
            logger.info("%s, %s", run.attempt.strategy, step)
        if self.monitor is not None:
            self.monitor(step)

    def _measure(self, evaluation: Evaluation) -> Measures:
        """Return the relative residuals of a state.

        The scales include forces and lengths of the start. If the scales of an apparently converged
        state are a million times smaller, these are used from then on, because any residual is
        small relative to a distant start.
        """
        measures, self.scales = measure(self.equations, evaluation, self.scales)
        if measures.worst <= self.tolerance:
            start = self.scales
            judged, own = measure(self.equations, evaluation, settled=True)
            if start.force > _FAR * own.force or start.length > _FAR * own.length:
                self.scales = own
                measures = judged
                self._run.history = []
        return measures

    def _first_statuses(self, statuses: Statuses, evaluation: Evaluation) -> Statuses:
        """Return the statuses for the first step, guessed if a body touches nothing.

        Without a guess, the first step would move such a body into the obstacle, and in the second
        step all points inside the obstacle would be closed. Therefore points that are expected to
        close stick in the first step. With a line search, which needs the statuses of the iterate,
        or prescribed statuses, guesses are made only if a body could move rigidly.
        """
        eq, run = self.equations, self._run
        run.warm = not touches_nothing(eq, evaluation)
        cold = self._full_steps and not run.warm and run.prescribed is None
        if cold or eq.scaling.unrestrained_motions(statuses, evaluation):
            run.guess = statuses = touching(eq, evaluation)
        return statuses

    def _floats(self, statuses: Statuses, evaluation: Evaluation) -> bool:
        """Return whether nothing prevents a rigid motion; if so, store the error in the run."""
        loose = self.equations.scaling.unrestrained_motions(statuses, evaluation)
        if loose:
            rigid = ", hold the rigid body" if self.equations.rigid.bodies else ""
            neither = "neither Dirichlet data nor the contact of this iterate holds it"
            if not self.equations.bcs:
                neither = "bcs is empty, and the contact of this iterate does not hold it"
            self._run.attempt.reason = (
                f"a rigid motion of the body is free ({loose}): {neither}. Add a "
                f"Dirichlet condition{rigid}, or start from a state in contact; if friction holds "
                "it, the load may exceed the friction bound"
            )
            self._run.attempt.floats = True
        return bool(loose)

    def _in_cycle(self, statuses: Statuses, worst: float) -> bool:
        """Return whether earlier statuses recur although the residual has not been halved."""
        others = [
            worst <= 0.5 * old_worst or any(c.any() for c in differs(statuses, old))
            for old, old_worst in self._run.history[:-1]
        ]
        return not all(anywhere(self.comm, *others))

    def _at_round_off(self, statuses: Statuses, worst: float) -> str:
        """Return a message if round-off prevents a further decrease of the residual, else "".

        This is assumed if the residual is small and no status has changed in the last steps.
        """
        last = [old for old, _ in self._run.history[-2:]]
        changed = any(c.any() for old in last for c in differs(statuses, old))
        if len(last) < 2 or worst > _SMALL or any_rank(self.comm, changed):
            return ""
        return (
            f"the residual stays at {worst:.2g} while no status changes, which is round-off: "
            f"snes_rtol {self.tolerance:g} asks for less"
        )

    def _explain(self) -> str:
        """Return the reason why SNES failed, as text."""
        reasons = PETSc.SNES.ConvergedReason
        reason = self.snes.getConvergedReason()
        ksp, steps = self.snes.getKSP(), self.snes.getIterationNumber()
        if reason == _LINEAR:
            return self.linear.explain(ksp)
        # Without a linear solve in this run there is neither a matrix nor an inaccuracy.
        inaccurate = self.linear.inaccuracy(ksp) if steps > 0 else ""
        because = f"; {inaccurate}" if inaccurate else ""
        if reason == reasons.DIVERGED_LINE_SEARCH:
            return f"the line search found no decrease of the norm of H{because}"
        if reason == reasons.DIVERGED_MAX_IT:
            return f"no convergence in {steps} iterations{because}"
        if reason == _NOT_A_NUMBER:
            latest = self._run.latest
            lost = "" if latest is None else without_normal(self.equations, latest)
            return lost or "the residual is not a number"
        return reason_name(reasons, reason)


def _restless(
    equations: ContactEquations, before: Statuses, after: Statuses
) -> dict[str, list[list[float]]]:
    """Return coordinates of points whose status changed, at most five per surface. Collective."""
    places = {}
    for s, changed in zip(equations.surfaces, differs(before, after), strict=True):
        everyone = sorted_rows(equations.comm, s.positions[changed])
        if everyone:
            places[s.name] = everyone[:5]
    return places
