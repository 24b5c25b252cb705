# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Steady sliding, and the vibrations that grow out of it: squeal.

A body slides steadily over an obstacle that moves. Perturbations u e^{lambda t} keep closed points
closed and the shear at F times the pressure against the slip, so that at these points

    (K + lambda C + lambda^2 M)_t - s F (...)_n = 0,    v_n = 0,

s = 1 where the obstacle drags along t (`vibrations.py`). Coulomb's friction does not depend on the
velocity; what makes a vibration grow is that the pressure changes in phase with the slip, usually
where two frequencies meet (mode coupling): A. Akay, Acoustics of friction, J. Acoust. Soc. Am. 111,
2002. Across the slip, in 3D, a point moves without resistance as long as the
speed of sliding is large against that of the vibration.

Without damping the frequencies that meet first are the highest of the mesh, and the onset falls as
it is refined: only a damped body has an onset of its own.
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
from dolfinx_contact._validate import ReadOnly, is_count
from dolfinx_contact.analysis.rows import Problem, static_equations
from dolfinx_contact.analysis.slip import Direction, Slip, SlipPattern
from dolfinx_contact.analysis.vibrations import (
    Spectrum,
    Vibrations,
    body_of,
    is_number,
    require_positive,
)
from dolfinx_contact.equations.measures import require_solution

__all__ = ["Onset", "SlidingModes", "SteadySliding"]

_STEADY = {True: 1e-11, False: 1e-7}  # growth over |lambda| that is round-off, with damping or not


@dataclass(frozen=True)
class SlidingModes:
    """Vibrations of a body that slides.

    Attributes:
        eigenvalues: lambda with Im >= 0, by falling growth, the real part (k,).
        known_up_to: size |lambda| (of the undamped body) up to which all are there; inf if they are
            complete.
        real, imaginary: the displacement of the first at two times a quarter of a period apart.
    """

    eigenvalues: npt.NDArray[np.complex128]
    known_up_to: float
    real: fem.Function
    imaginary: fem.Function

    @property
    def growth(self) -> float:
        """Of the one that grows fastest, per time."""
        return float(self.eigenvalues[0].real)

    @property
    def frequency(self) -> float:
        """Of the one that grows fastest, radians per time."""
        return float(self.eigenvalues[0].imag)


@dataclass(frozen=True)
class Onset:
    """The smallest friction at which a vibration begins to grow.

    Attributes:
        friction: F.
        frequency: of the vibration, radians per time; 0 for one that only grows.
    """

    friction: float
    frequency: float


def _check(a: Arguments) -> None:
    if not isinstance(a.hold_across, bool | np.bool_):
        raise ValueError(f"hold_across is True or False, got {a.hold_across!r}")
    if not is_count(a.count):
        raise ValueError(f"the number of eigenvalues must be 1 or more, got {a.count!r}")


def _check_onset(a: Arguments) -> None:
    require_positive("largest friction", a.max_friction)
    require_positive("step of friction", a.step)


def _check_modes(a: Arguments) -> None:
    if a.friction is not None and not (is_number(a.friction) and a.friction >= 0):
        raise ValueError(f"the friction must be a number >= 0, got {a.friction!r}")


class SteadySliding(ReadOnly):
    """A body that slides steadily over an obstacle, and its vibrations. Collective.

    Args:
        problem: the contact problem, nodal or mixed. A bulk that is not linear is taken at the
            displacement in the Functions.
        direction: of the slip of the body relative to the obstacle: a vector, whose tangential part
            is taken, with all contact points in contact and slipping; by default t = (-n_y, n_x) in
            2D. Or ``"solution"``: points slip, stick or are open as in the solution in the
            Functions.
        density: of mass, a number, Constant, Function or UFL expression.
        damping: eta of the damping C = eta K, a time, or a UFL form C(trial, test) of any damping.
        hold_across: whether slip across the direction is held, in 3D.
        dense: whether all eigenvalues are computed; by default with up to 700 unknowns.
        count: of eigenvalues, those next to zero, that SLEPc computes otherwise.

    Raises:
        ValueError: on every rank, for arguments that do not fit.
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
        self._vibrations = Vibrations(eq, self._slip, self._body, dense=dense, count=int(count))
        slopes = [s.answers.unit_bound for s in state.surfaces]
        self._slope = np.concatenate(slopes)[self._slip.places]

    @collective("vibrations", _check_modes)
    @staged("ContactSliding")
    def modes(self, friction: float | None = None) -> SlidingModes:
        """The vibrations. Collective.

        Args:
            friction: F at all points that slip; by default that of the law.

        Raises:
            ValueError: on every rank, if it is negative, or the law has no coefficient.
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
        """The smallest friction at which a vibration grows. Collective.

        Args:
            max_friction: up to which it is looked for.
            step: of friction. Between two steps growth is looked for where it is largest; what
                grows within a smaller interval alone may be missed.

        Returns:
            None if nothing grows up to ``max_friction``.

        Raises:
            ValueError: on every rank, for bounds that are not positive.
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
        """Let the lists end at a maximum of growth among their last three, if that is > 0."""
        if len(growths) < 3 or not growths[-3] < growths[-2] > growths[-1]:
            return
        best = minimize_scalar(
            lambda F: -self._growth(F), bounds=(frictions[-3], frictions[-1]), method="bounded"
        )
        if best.fun < 0:
            frictions[-2:] = [float(best.x)]
            growths[-2:] = [-float(best.fun)]

    def _growth(self, friction: float) -> float:
        """The largest growth over the size of its lambda, less what is round-off."""
        values = self._spectrum(friction).values
        ratio = values.real / np.maximum(np.abs(values), np.abs(values).max() * 1e-15)
        return float(ratio.max()) - _STEADY[self._damped]

    def _at(self, friction: float) -> Onset:
        """What grows just beyond a friction."""
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
