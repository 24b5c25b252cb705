# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Stability of steady sliding: growing vibrations (squeal).

A body slides steadily over a moving obstacle. Under perturbations u e^{lambda t}, closed points
remain closed and the shear remains F times the pressure against the slip, so that at these points

    (K + lambda C + lambda^2 M)_t - s F (...)_n = 0,    v_n = 0,

with s = 1 where the obstacle drags along t (`vibrations.py`). Coulomb friction does not depend on
the velocity. A vibration grows if the pressure changes in phase with the slip, usually where two
frequencies meet (mode coupling: A. Akay, Acoustics of friction, J. Acoust. Soc. Am. 111, 2002). In
3D, a point moves across the slip without resistance, provided that the sliding is fast compared
with the vibration.

Without damping, the highest frequencies of the mesh meet first, and the onset decreases under
refinement. Only a damped body has an onset that does not depend on the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq, minimize_scalar

import ufl
from dolfinx import fem

from dolfinx_contact._mpi import Arguments, collective, require
from dolfinx_contact._petsc import staged
from dolfinx_contact._validate import ReadOnly, count, flag, nonnegative, positive
from dolfinx_contact.analysis.rows import Problem, static_equations
from dolfinx_contact.analysis.slip import Direction, Slip, SlipPattern
from dolfinx_contact.analysis.vibrations import Spectrum, Vibrations, body_of
from dolfinx_contact.equations.measures import require_solution

__all__ = ["Onset", "SlidingModes", "SteadySliding"]

_STEADY = {True: 1e-11, False: 1e-7}  # round-off of growth over |lambda|, with damping or not


@dataclass(frozen=True)
class SlidingModes:
    """Vibrations of a sliding body.

    Attributes:
        eigenvalues: lambda with Im >= 0, sorted by decreasing real part (growth) (k,).
        known_up_to: size |lambda| (of the undamped body) up to which no eigenvalue is missing;
            infinite if all were computed.
        real, imaginary: displacements of the first vibration, a quarter of a period apart.
    """

    eigenvalues: npt.NDArray[np.complex128]
    known_up_to: float
    real: fem.Function
    imaginary: fem.Function

    @property
    def growth(self) -> float:
        """Growth rate of the fastest growing vibration."""
        return float(self.eigenvalues[0].real)

    @property
    def frequency(self) -> float:
        """Angular frequency of the fastest growing vibration."""
        return float(self.eigenvalues[0].imag)


@dataclass(frozen=True)
class Onset:
    """Smallest friction at which a vibration begins to grow.

    Attributes:
        friction: coefficient F.
        frequency: angular frequency of the vibration; 0 for growth without oscillation.
    """

    friction: float
    frequency: float


def _check(a: Arguments) -> None:
    flag(a.hold_across, "hold_across")
    count(a.count, "count")


def _check_onset(a: Arguments) -> None:
    positive(a.max_friction, "max_friction")
    positive(a.step, "step")


def _check_modes(a: Arguments) -> None:
    if a.friction is not None:
        nonnegative(a.friction, "friction")


class SteadySliding(ReadOnly):
    """Vibrations of a body sliding steadily over an obstacle. Collective.

    Args:
        problem: contact problem, nodal or mixed. A nonlinear bulk is linearised at the displacement
            in the Functions.
        direction: vector of the slip of the body relative to the obstacle; all contact points are
            closed and slip along its tangential part. By default t = (-n_y, n_x) in 2D. With
            ``"solution"``, points slip, stick or are open as in the solution in the Functions.
        density: mass density, a number, Constant, Function or UFL expression.
        damping: time eta of the damping C = eta K, or a UFL form C(trial, test).
        hold_across: whether slip across the direction is held in 3D.
        dense: whether all eigenvalues are computed; by default with up to 700 unknowns.
        count: number of eigenvalues nearest to zero that SLEPc computes otherwise.

    Raises:
        ValueError: on every rank, for invalid arguments.
    """

    @collective("steady sliding", _check)
    def __init__(
        self,
        problem: Problem,
        direction: Direction = None,
        *,
        density: Any,
        damping: float | ufl.Form = 0.0,
        hold_across: bool = False,
        dense: bool | None = None,
        count: int = 40,
    ):
        eq = static_equations(problem)
        self._eq = eq
        self.comm = eq.comm
        state = problem.evaluate()
        if isinstance(direction, str):
            require_solution(problem)
        pattern = SlipPattern.of(eq, direction, state)
        self._slip = Slip(eq, pattern, hold_across=hold_across)
        self._body = body_of(eq, state.u, density, damping)
        self._damped = self._body.C is not None or self._body.eta > 0
        self._vibrations = Vibrations(self._slip, self._body, dense=dense, count=int(count))
        slopes = [s.answers.unit_bound for s in state.surfaces]
        self._slope = np.concatenate(slopes)[self._slip.places]

    @collective("vibrations", _check_modes)
    @staged("ContactSliding")
    def modes(self, friction: float | None = None) -> SlidingModes:
        """Compute the vibrations. Collective.

        Args:
            friction: coefficient F at all slipping points; by default the coefficient of the law.

        Raises:
            ValueError: on every rank, if F is negative, or the law has no coefficient.
            RuntimeError: if SLEPc does not converge.
        """
        found = self._spectrum(friction, vectors=True)
        parts = []
        for name, values in (("real", np.real), ("imaginary", np.imag)):
            f = fem.Function(self._eq.V, name=name)
            mine = found.vectors[:, 0]
            f.x.array[: len(mine)] = values(mine)
            f.x.scatter_forward()
            parts.append(f)
        return SlidingModes(found.values, found.known_up_to, *parts)

    @collective("the onset of growth", _check_onset)
    @staged("ContactSliding")
    def onset(self, max_friction: float = 5.0, *, step: float = 0.05) -> Onset | None:
        """Find the smallest friction at which a vibration grows. Collective.

        Args:
            max_friction: largest friction of the search.
            step: step of friction. Between two steps, a maximum of the growth is searched for;
                growth on a smaller interval may be missed.

        Returns:
            The onset, or None if nothing grows up to ``max_friction``.

        Raises:
            ValueError: on every rank, for arguments that are not positive.
            RuntimeError: if SLEPc does not converge.
        """
        frictions = [0.0]
        growths = [self._growth(0.0)]
        if growths[0] > 0:
            return self._at(0.0)
        number = int(np.ceil(max_friction / step))
        for friction in max_friction * np.arange(1, number + 1) / number:
            frictions.append(float(friction))
            growths.append(self._growth(float(friction)))
            if growths[-1] <= 0:
                self._look_between(frictions, growths)
            if growths[-1] > 0:
                return self._at(brentq(self._growth, *frictions[-2:], xtol=1e-13, rtol=1e-12))
        return None

    def _look_between(self, frictions: list[float], growths: list[float]) -> None:
        """Replace the last entries by a positive maximum of the growth among the last three."""
        if len(growths) < 3 or not growths[-3] < growths[-2] > growths[-1]:
            return
        best = minimize_scalar(
            lambda F: -self._growth(F), bounds=(frictions[-3], frictions[-1]), method="bounded"
        )
        if best.fun < 0:
            frictions[-2:] = [float(best.x)]
            growths[-2:] = [-float(best.fun)]

    def _growth(self, friction: float) -> float:
        """Return the largest growth relative to |lambda|, minus the round-off."""
        values = self._spectrum(friction).values
        ratio = values.real / np.maximum(np.abs(values), np.abs(values).max() * 1e-15)
        return float(ratio.max()) - _STEADY[self._damped]

    def _at(self, friction: float) -> Onset:
        """Return the onset at a friction, with the frequency of growth just beyond it."""
        values = self._spectrum(friction * (1.0 + 1e-11)).values
        size = np.maximum(np.abs(values), np.abs(values).max() * 1e-15)
        return Onset(friction, float(values[np.argmax(values.real / size)].imag))

    def _spectrum(self, friction: float | None, *, vectors: bool = False) -> Spectrum:
        if friction is None:
            known = bool(np.isfinite(self._slope).all())
            require(self._eq.comm, known, "the law has no coefficient of friction: say which")
            return self._vibrations.spectrum(self._slope, vectors=vectors)
        return self._vibrations.spectrum(
            np.full(len(self._slip.places), float(friction)), vectors=vectors
        )

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._slip.destroy()
        self._body.destroy()
