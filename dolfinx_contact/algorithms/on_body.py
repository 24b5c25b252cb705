# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tresca's fixed point, Uzawa's method and the penalty method on the finite element problem.

These are the algorithms of the same names in `algorithms`, with equilibrium of the body in place of
the reduced stiffness. Equilibrium is solved by Newton's method with the linear solver of the
problem, or by solves with the stiffness alone (`body_solver`). Iterates are states of the whole
problem and have the same convergence measures as in Newton's method.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._mpi import total
from dolfinx_contact.algorithms import Penalty, Trend, TrescaFixedPoint, Uzawa
from dolfinx_contact.algorithms.penalty import LEAST, Extrapolation
from dolfinx_contact.algorithms.tresca import BoundRelaxation
from dolfinx_contact.algorithms.uzawa import SHARE, STIFF
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.equations.measures import Scales
from dolfinx_contact.equations.substitute import GivenBounds, YieldingContact
from dolfinx_contact.solvers.body_solver import BodySolver
from dolfinx_contact.solvers.history import Attempt, Step
from dolfinx_contact.solvers.linear import LinearSolver
from dolfinx_contact.solvers.newton import Newton
from dolfinx_contact.solvers.pivoting import pivot

__all__ = ["OnBody"]

Array = npt.NDArray[np.float64]
_POWER = 30  # largest number of steps of the power method
_ROUGH = 1e-2  # relative residual of its solves
_INNER = 0.1  # tolerance of the inner problems, relative to the tolerance
_LIMIT = 200.0  # largest number of Newton steps of an inner problem
_SOFTER = (1e-3, 1e-2, 1e-1)  # relative stiffnesses of a cold start


@dataclass
class OnBody:
    """Run of a classical algorithm on the finite element problem. Collective.

    Attributes:
        equations: contact problem.
        linear: linear solver of the problem.
        body: solver for the stiffness alone.
        tolerance: largest measure of a converged state.
        monitor: function called with every iterate.
        attempt: attempt that records the iterates and the reason of a failure.
    """

    equations: ContactEquations
    linear: LinearSolver
    body: BodySolver
    tolerance: float
    monitor: Callable[[Step], None]
    attempt: Attempt
    _trend: Trend = field(init=False)

    def __post_init__(self) -> None:
        self._scales = Scales(self.equations)
        self._state: Evaluation

    def run(self, algorithm: TrescaFixedPoint | Uzawa | Penalty, x: PETSc.Vec) -> bool:
        """Solve from ``x``, which is overwritten, and return True if the solve converged."""
        most = algorithm.max_iterations
        self._start = x.copy()
        self._trend = Trend(most, self.tolerance, self.equations.comm.allreduce)
        b = x.duplicate()
        try:
            if isinstance(algorithm, TrescaFixedPoint):
                self._tresca(algorithm, x, b)
            elif isinstance(algorithm, Penalty):
                self._penalty(algorithm, x, b)
            elif algorithm.augmented:
                self._augmented(algorithm, x, b)
            else:
                self._uzawa(algorithm, x, b)
        finally:
            b.destroy(), self._start.destroy()
        return self._trend.converged

    def _stops(
        self, x: PETSc.Vec, b: PETSc.Vec, given: list[Array] | None = None, **series: float
    ) -> bool:
        """Record an iterate and return True if the algorithm must stop.

        Args:
            x: iterate.
            b: vector that receives the residual.
            given: friction bounds of the iterate per surface, if the next iterate depends on them.
            series: further quantities to record by name.
        """
        self._state = self.equations.residual(x, b)
        measures = self._scales.measure(self._state)
        step = Step(len(self.attempt.steps), measures, 0, 1.0)
        self.attempt.steps.append(step)
        self.attempt.report(**series)
        self.monitor(step)
        units = self.equations.units[1:]
        parts = [g / unit for g, unit in zip(given or [], units, strict=False)]
        stops = self._trend.stops(np.concatenate([x.array_r, *parts]), measures.worst)
        self.attempt.reason = self._trend.reason
        return stops

    # -- Tresca ----------------------------------------------------------------------------------

    def _tresca(self, algorithm: TrescaFixedPoint, x: PETSc.Vec, b: PETSc.Vec) -> None:
        relaxed = BoundRelaxation(
            algorithm.relaxation, aitken=algorithm.aitken, total=self.equations.comm.allreduce
        )
        none: list[Array] = [np.zeros(s.points.number) for s in self.equations.surfaces]
        stops = self._stops(x, b, none, inner=0)
        bounds = self._bounds()
        while not stops:
            parts = np.split(bounds, self._ends)
            steps = self._equilibrium(GivenBounds(self.equations, parts), x)
            stops = self._stops(x, b, parts, inner=steps)
            if steps < 0:
                self.attempt.reason = f"Tresca's problem was not solved ({self.attempt.reason})"
                return
            bounds = relaxed(bounds, self._bounds())

    def _bounds(self) -> Array:
        """Return the friction bounds at the current pressures, tractions on all surfaces (n,)."""
        found = []
        for s, state in zip(self.equations.surfaces, self._state.surfaces, strict=True):
            pressure = np.maximum(-np.sum(state.traction * state.data.n, axis=1), 0.0)
            slope = state.answers.unit_bound
            bound = slope * pressure if s.law.needs_pressure else slope
            found.append(bound if s.law.averaging is None else state.answers.bound)
        return np.concatenate(found)

    @property
    def _ends(self) -> Array:
        return np.cumsum([s.points.number for s in self.equations.surfaces])[:-1]

    def _equilibrium(self, equations: ContactEquations, x: PETSc.Vec) -> int:
        """Solve an inner problem from ``x`` and return the number of steps, or -1 on failure.

        With stiff compliant contact, Newton's method cycles between stick and slip if many points
        are near the friction bound. Pivoting on the statuses does not depend on the stiffness.
        """
        start = x.copy()
        steps = 0
        reasons = []
        methods: dict[str, tuple[str, Callable[[Newton, PETSc.Vec, Attempt], bool]]] = {
            "full steps": ("none", Newton.run),
            "pivoting": ("none", pivot),
            "line search": ("bt", Newton.run),
        }
        try:
            for name, (search, run) in methods.items():
                attempt = Attempt(f"{self.attempt.strategy}, {name} within", limit=_LIMIT)
                with Newton(equations, self.linear, search, None) as newton:
                    newton.snes.setTolerances(rtol=_INNER * self.tolerance)
                    solved = run(newton, x, attempt)
                steps += attempt.iterations
                if solved:
                    return steps
                reasons.append(f"{name}: {attempt.reason}")
                start.copy(x)
        finally:
            start.destroy()
        self.attempt.reason = "; ".join(reasons)
        return -1

    # -- compliant contact -----------------------------------------------------------------------

    @contextmanager
    def _yielding(self, factor: float) -> Iterator[None]:
        """Set the contact stiffness to a multiple of the augmentation within the context."""
        eq = self.equations
        before = [s.points.r.copy() for s in eq.surfaces]
        try:
            for s, r in zip(eq.surfaces, eq.scaling.automatic_r, strict=True):
                s.points.set_augmentation(factor * r)
            yield
        finally:
            for s, r in zip(eq.surfaces, before, strict=True):
                s.points.set_augmentation(r)

    def _yield(self, tractions: list[Array], factor: float, x: PETSc.Vec, *, cold: bool) -> int:
        steps = 0
        for part in (*(_SOFTER if cold else ()), 1.0):
            with self._yielding(part * factor):
                found = self._equilibrium(YieldingContact(self.equations, tractions), x)
            steps = steps + found if found >= 0 else -1
            if steps < 0:
                how = f"by {part * factor:.3g} times the augmentation"
                why = self.attempt.reason
                self.attempt.reason = (
                    f"contact that yields {how} was not solved ({why}); less may do: options "
                    "stiffness of Penalty and step of Uzawa"
                )
                break
        return steps

    def _tractions(self) -> list[Array]:
        return [s.traction for s in self._state.surfaces]

    def _augmented(self, algorithm: Uzawa, x: PETSc.Vec, b: PETSc.Vec) -> None:
        stops = self._stops(x, b, inner=0)
        cold = True
        while not stops:
            steps = self._yield(self._tractions(), algorithm.step * STIFF, x, cold=cold)
            if steps < 0:
                return
            stops = self._stops(x, b, inner=steps)
            cold = False

    def _penalty(self, algorithm: Penalty, x: PETSc.Vec, b: PETSc.Vec) -> None:
        self._trend.tolerance = max(algorithm.accuracy, self.tolerance)
        sequence = Extrapolation(self.equations.comm.allreduce)
        stops = self._stops(x, b)
        factor = algorithm.stiffness
        cold = True
        none = [np.zeros_like(t) for t in self._tractions()]
        limit = x.copy()
        try:
            while not stops:
                steps = self._yield(none, factor, x, cold=cold)
                if steps < 0:
                    return
                sequence.add(x.array_r.copy())
                factor = 2.0 * factor
                cold = False
                if len(sequence.states) < LEAST:
                    continue
                limit.array[:] = sequence.limit()
                stops = self._stops(limit, b, order=sequence.order(), inner=steps)
            limit.copy(x)
        finally:
            limit.destroy()

    # -- Uzawa -----------------------------------------------------------------------------------

    def _uzawa(self, algorithm: Uzawa, x: PETSc.Vec, b: PETSc.Vec) -> None:
        eq = self.equations
        n = self.equations.owned_sizes[0]
        self.body.update()
        rho = algorithm.step * SHARE * 2.0 / self._largest()
        # The first iterate must be an equilibrium, like the later ones.
        eq.residual(x, b)
        x.array[:n] -= self.body(b.array_r[:n])
        exact = 0.1 * self.tolerance
        while not self._stops(x, b):
            # The residual of the last solve is corrected together with the new tractions.
            self._raise(rho, x)
            eq.residual(x, b)
            x.array[:n] -= self.body(b.array_r[:n], tolerance=max(exact, 1e-4))

    def _raise(self, rho: float, x: PETSc.Vec) -> None:
        """Write the tractions after a projected gradient step of length ``rho`` into ``x``."""
        eq = self.equations
        row = self.equations.owned_sizes[0]
        for i, (s, state) in enumerate(zip(eq.surfaces, self._state.surfaces, strict=True)):
            data = replace(state.data, r=np.full(s.points.number, rho))
            answers = s.law_at_points(state.jump, state.traction, data)
            raised = answers.traction(answers.required)
            size = raised.size
            removed = eq.constraints.removed[i].reshape(-1)[:size]
            raised = np.where(removed, 0.0, raised.reshape(-1))
            x.array[row : row + size] = raised / eq.units[i + 1]
            row += size

    def _largest(self) -> float:
        """Return the largest eigenvalue of the compliance of the surfaces, by the power method."""
        eq = self.equations
        # Begin with uneven tractions in all directions.
        t = [s.points.data.n + np.cos(s.positions / eq.body_size) for s in eq.surfaces]
        operators = [s.constant_operator("a step of an algorithm") for s in eq.surfaces]
        value = 0.0
        for _ in range(_POWER):
            load = np.sum([B.transpose(v) for B, v in zip(operators, t, strict=True)], axis=0)
            load[self.body.fixed] = 0.0
            u = self.body(load, tolerance=_ROUGH).reshape(-1, eq.dim)
            jumps = [B.apply(u) for B in operators]
            weights = [s.points.areas[:, None] for s in eq.surfaces]
            parts = zip(jumps, t, weights, strict=True)
            products = np.array(
                [[np.sum(w * j * v), np.sum(w * v * v), np.sum(w * j * j)] for j, v, w in parts]
            )
            along, before, after = total(eq.comm, products.sum(axis=0))
            new = float(along / before)
            size = np.sqrt(after)
            t = [j / size for j in jumps]
            if abs(new - value) <= 1e-3 * new:
                return new
            value = new
        return value
