# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Residual of a body with inertia in a time step, a drop-in replacement for `Bulk`.

The equation of motion in terms of measures (Jean and Moreau, CISM Lectures 304, 1987)

    M (v_1 - v_0) = integral of (F - R(u) - C v) dt + integral of the contact forces,
    u_1 = u_0 + integral of v dt

for displacement u and velocity v is integrated over a step from t_0 to t_1 = t_0 + h, with the mass
matrix M, loads F, internal forces R and damping matrix C. The first integral is approximated by the
theta method, h (theta f_1 + (1 - theta) f_0) for an integrand with the values f_0 and f_1 at t_0
and t_1. The integral of the contact forces is approximated by the theta method or by the implicit
Euler method. Multipliers are the contact forces averaged over the step. The unknown is the
displacement w that enters the contact law,

    theta            w = u_1 = u_0 + h ((1 - theta) v_0 + theta v_1)
    theta-euler      w = u_1 = u_0 + h v_1
    modified-theta   w = u_1 + h (1 - theta) v_1,  u_1 as in theta

Hence v_1 = (w - w_0)/(a h), where w_0 depends on the start of the step only; a = theta for the
scheme "theta" and 1 otherwise. The displacement is u_1 = w - k h v_1 with k = 1 - theta for
"modified-theta" and 0 otherwise. Divided by h, the equation of motion is

    M (v_1 - v_0)/h + theta (R(u_1) + C v_1) + (1 - theta) (R(u_0) + C v_0) = contact forces.

In this equation R includes the loads F with a negative sign: at t_1 in R(u_1), at t_0 in R(u_0).
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from petsc4py import PETSc

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact._arrays import Array
from dolfinx_contact._petsc import destroy, is_symmetric, product
from dolfinx_contact.body.bulk import Bulk, Stiffness

__all__ = ["MovingBody", "Scheme", "TimeStep"]

#: Approximations of the two integrals in the equation of motion.
Scheme: TypeAlias = Literal["theta", "theta-euler", "modified-theta"]


@dataclass(frozen=True)
class TimeStep:
    """Time step, with the relations between unknown, final displacement and final velocity.

    Attributes:
        length: duration h of the step.
        theta: weight of the end of the step in the theta method.
        scheme: integration scheme: ``"theta"``, ``"theta-euler"`` or ``"modified-theta"``.
    """

    length: float
    theta: float
    scheme: Scheme

    @property
    def gain(self) -> float:
        """Factor a in w - w_0 = a h v_1, with the unknown w and the final velocity v_1.

        h is the duration of the step, and w_0 the value of w for v_1 = 0 (`origin`).
        """
        return self.theta if self.scheme == "theta" else 1.0

    @property
    def _ahead(self) -> float:
        return 1.0 - self.theta if self.scheme == "modified-theta" else 0.0

    @property
    def share(self) -> float:
        """Derivative of the displacement at the end of the step with respect to the unknown w."""
        return 1.0 - self._ahead / self.gain

    @property
    def rate(self) -> float:
        """Derivative of the velocity at the end of the step with respect to the unknown w."""
        return 1.0 / (self.gain * self.length)

    def origin(self, u: Array, v: Array) -> Array:
        """Return w_0, the value of the unknown w for which the final velocity vanishes.

        Args:
            u: displacement at the start of the step.
            v: velocity at the start of the step.
        """
        if self.scheme == "theta-euler":
            return u.copy()
        return np.asarray(u + self.length * (1.0 - self.theta) * v)

    def velocity(self, w: Array, w0: Array) -> Array:
        """Return the velocity at the end of the step.

        Args:
            w: unknown of the step.
            w0: unknown for which the final velocity is zero (`origin`).
        """
        return np.asarray(self.rate * (w - w0))

    def displacement(self, w: Array, w0: Array) -> Array:
        """Return the displacement at the end of the step.

        Args:
            w: unknown of the step.
            w0: unknown for which the final velocity is zero (`origin`).
        """
        return np.asarray(w0 + self.share * (w - w0))

    def seen(self, u: Array, w0: Array) -> Array:
        """Return the unknown w for which the displacement at the end of the step equals ``u``.

        Args:
            u: displacement at the end of the step.
            w0: unknown for which the final velocity is zero (`origin`).
        """
        return np.asarray(w0 + (u - w0) / self.share)


class MovingBody(Stiffness):
    """Body with inertia in a time step, with the interface of `Bulk`; the unknown is w.

    The displacement w enters the contact law (module docstring).

    Args:
        body: body without inertia.
        mass: mass matrix.
        damping: damping matrix; None for no damping.
        step: first time step.

    Attributes:
        body: body without inertia.
        mass: mass matrix.
        damping: damping matrix; None for no damping.
        step: current time step.
        origin: unknown w_0 for zero final velocity (`TimeStep.origin`), local values with ghosts.
        linear, kinks, is_energy, functions, constants, displacement, jacobian_constants,
            assemblies: attributes with the same meaning as in `Bulk`.
    """

    has_mass = True

    def __init__(self, body: Bulk, mass: PETSc.Mat, damping: PETSc.Mat | None, step: TimeStep):
        self.body = body
        self.comm = body.comm
        self.linear = body.linear
        self.is_energy = body.is_energy
        self.functions = body.functions
        self.constants = body.constants
        self.displacement = body.displacement
        self.jacobian_constants = body.jacobian_constants
        self.kinks = body.kinks
        self.materials = body.materials
        self.assemblies = 0
        self._owned = mass.getLocalSize()[0]
        self.step = step
        zeros = np.zeros_like(body.displacement.x.array)
        self.origin = zeros
        self._given = zeros[: self._owned]
        self.reach = 0.0
        self._of: tuple[int, TimeStep] | None = None
        self._take(mass, damping)
        #: R(0), number of the stiffness assembly, and residual at w_0 computed from them.
        self._start: tuple[Array, tuple[int, TimeStep], Array] | None = None

    def take_matrices(self, mass: PETSc.Mat, damping: PETSc.Mat | None) -> None:
        """Replace the mass and damping matrices and destroy the previous ones. Not collective."""
        destroy(self.mass, self.damping)
        self._take(mass, damping)
        self._of = self._start = None

    def _take(self, mass: PETSc.Mat, damping: PETSc.Mat | None) -> None:
        self.mass = mass
        self.damping = damping
        self._symmetric = self.is_energy and (damping is None or is_symmetric(damping))

    def begin(self, step: TimeStep, u: Array, v: Array, rows: Array) -> None:
        """Begin a time step. Collective.

        Args:
            step: time step that begins.
            u: local values of the displacement at the start of the step.
            v: local values of the velocity at the start of the step.
            rows: owned values returned by `forces` for the start of the step.
        """
        self.step = step
        self.origin = step.origin(u, v)
        self._start = None
        before = product(self.mass, v) / step.length
        self._given = (1.0 - step.theta) * rows - before
        self.reach = float(np.max(np.abs(self.origin), initial=0.0))

    @property
    def residual(self) -> ufl.Form:
        """UFL residual of the body without inertia."""
        return self.body.residual

    def _rows(self, w: Array, inner: Array) -> Array:
        """Return the left-hand side of the equation of motion (module docstring). Collective."""
        v = self.step.velocity(w, self.origin)
        rows = self.step.theta * inner + product(self.mass, v) / self.step.length
        if self.damping is not None:
            rows += self.step.theta * product(self.damping, v)
        return np.asarray(rows + self._given)

    def forces(self, u: Array, v: Array) -> Array:
        """Return owned values of the internal and damping forces minus the loads. Collective.

        Args:
            u: local values of the displacement.
            v: local values of the velocity.
        """
        inner = self.body.rows(u)
        return inner if self.damping is None else inner + product(self.damping, v)

    def load(self) -> Array:
        """Return the owned values of the current loads. Collective."""
        f = self.body.affine_load()
        return -(self.body.residual_at(np.zeros_like(self.origin)) if f is None else f)

    # -- interface of a Bulk ---------------------------------------------------------------------

    def read_data(self) -> None:
        """Read the present values of the Functions and Constants in the forms. Collective."""
        self.body.read_data()

    def energy_at(self, w: Array) -> float | None:
        """Return the energy of the body at the end of the step; None for a residual. Collective."""
        return self.body.energy_at(self.step.displacement(w, self.origin))

    def residual_at(self, w: Array) -> Array:
        """Return the owned residual of the step, with internal forces assembled. Collective."""
        return self._rows(w, self.body.residual_at(self.step.displacement(w, self.origin)))

    def affine_residual(self, w: Array) -> Array | None:
        """Return the owned residual of the step, computed from the cached stiffness. Collective.

        It is the residual at w = w_0 (`origin`), assembled once per step, plus the stiffness times
        w - w_0. None if the body is nonlinear or its stiffness is not up to date.
        """
        f = self.body.affine_load()
        if f is None:
            return None
        if self._K is None or self._of != (self.body.assemblies, self.step):
            self.stiffness(w)
        assert self._of is not None
        if self._start is None or self._start[0] is not f or self._start[1] != self._of:
            at = self._rows(self.origin, f + self.body.times(self.origin))
            self._start = f, self._of, at
        return self._start[2] + product(self.for_products, w - self.origin)

    def assembled(self, form: fem.Form, w: Array) -> Array:
        """Return the owned derivative of the step residual with respect to a parameter. Collective.

        Args:
            form: linear form, the derivative of the residual of the body without inertia.
            w: unknown of the step.
        """
        u = self.step.displacement(w, self.origin)
        return np.asarray(self.step.theta * self.body.assembled(form, u))

    def rate_at(self, w: Array, step: Array) -> Array:
        """Return the owned entries of the stiffness at ``w`` times an increment. Collective.

        Args:
            w: unknown of the step.
            step: increment of ``w`` at all local dofs.
        """
        return product(self.stiffness(w), step)

    def stiffness(self, w: Array) -> PETSc.Mat:
        """Return the derivative of the step residual by w (see `Bulk.stiffness`). Collective."""
        step = self.step
        K = self.body.stiffness(step.displacement(w, self.origin))
        of = self.body.assemblies, step
        if self._K is not None and of == self._of:
            return self._K
        if self._K is None:
            self._K = K.copy()
            structure = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
        else:
            self._K.zeroEntries()
            structure = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN
            self._K.axpy(1.0, K, structure)
        self._K.scale(step.theta * step.share)
        self._K.axpy(step.rate / step.length, self.mass, structure)
        if self.damping is not None:
            self._K.axpy(step.theta * step.rate, self.damping, structure)
        self._forget_half()
        self._of = of
        self.assemblies = self.assemblies + 1
        return self._K

    @property
    def stiffness_mark(self) -> int:
        """Checksum of the time step and of `Bulk.stiffness_mark`, the same on every rank."""
        return zlib.crc32(repr((self.step, self.body.stiffness_mark)).encode())

    @property
    def stiffness_data(self) -> list[Any]:
        """Functions and Constants in the stiffness of the body without inertia."""
        return self.body.stiffness_data
