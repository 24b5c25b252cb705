# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mass and damping of a body in motion, assembled when a run starts."""

from __future__ import annotations

import logging
import math
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import dolfinx.fem.petsc
import ufl
from dolfinx import fem

from dolfinx_contact._affine import dependence
from dolfinx_contact._errors import everywhere
from dolfinx_contact._forms import compiled_form
from dolfinx_contact._validate import is_number
from dolfinx_contact.body.bulk import circumference, weighted
from dolfinx_contact.body.inertia import Mass, mass_matrix, rigid_errors
from dolfinx_contact.body.moving import MovingBody, TimeStep
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.data import Constancy, Datum, data_in, placed_data
from dolfinx_contact.problem import ContactProblem

__all__ = ["Matrices", "data_of", "is_scalar_constant"]

logger = logging.getLogger(__name__)

_WRONG_INERTIA = 0.01  # of an acceleration, from which the log warns


class Matrices:
    """Mass and damping matrices with the data in them.

    Args:
        problem: contact problem of the body without inertia.
        velocity: Function of the velocity.
        density: mass per volume.
        mass: kind of the mass matrix.
        damping: form, pair of Rayleigh's factors, or None.

    Raises:
        ValueError: on every rank, if the damping is neither a pair nor a form affine in the
            velocity.
    """

    def __init__(
        self,
        problem: ContactProblem,
        velocity: fem.Function,
        density: Any,
        mass: Mass,
        damping: ufl.Form | tuple[Any, Any] | None,
    ):
        self._given = problem, velocity, density, mass, damping
        if damping is not None and not isinstance(damping, ufl.Form):
            with everywhere(problem.comm, "damping"):
                _rayleigh(damping)
        data = _of_matrices(density, damping, velocity) + _of_stiffness(problem, damping)
        self._data = data
        self._assembled = Constancy(problem.comm, data)

    def body(self, step: TimeStep) -> MovingBody:
        """The body of the problem with its mass and damping, in a step of time. Collective."""
        problem = self._given[0]
        mass, damping, wind = self._assemble()
        body = problem.equations.bulk
        if isinstance(body, MovingBody):
            body = body.body
        if wind is not None:
            body = body.loaded(wind)
        return MovingBody(body, mass, damping, step)

    def update(self, body: MovingBody) -> None:
        """Assemble again if the data have changed. Collective."""
        if not self._assembled.changed():
            return
        mass, damping, _ = self._assemble()
        body.take_matrices(mass, damping)
        self._assembled = Constancy(self._given[0].comm, self._data)

    def require_constant(self, time: float) -> None:
        """Raise ``ValueError`` if the load of a time has changed the data. Collective."""
        changed = self._assembled.changed()
        if changed:
            raise ValueError(
                f"the load at the time {time:g} changes {changed}. Mass and damping are assembled "
                "when a run starts: change them between two runs"
            )

    def _assemble(self) -> tuple[PETSc.Mat, PETSc.Mat | None, ufl.Form | None]:
        """Mass, damping and the form of damping at zero velocity. Collective."""
        problem, velocity, density, mass, damping = self._given
        V = problem.V
        for given in (ufl.as_ufl(density), damping):
            if isinstance(given, ufl.Form | ufl.core.expr.Expr):
                for d in data_in(given, ""):
                    if isinstance(d.value, fem.Function):
                        d.value.x.scatter_forward()
        around = problem.equations.axisymmetric
        weighted_density = density * circumference(V.mesh) if around else density
        M = mass_matrix(V, weighted_density, mass, _touching(problem.equations))
        if mass == "redistributed":
            _warn_of_inertia(problem, M, weighted_density)
        C, wind = _damping(problem, velocity, weighted_density, damping)
        return M, C, wind


def _touching(eq: ContactEquations) -> npt.NDArray[np.bool_]:
    """Owned dofs of nodes that may touch, of either body. Collective."""
    marks = np.zeros(eq.owned_sizes[0])
    slide = np.zeros(eq.owned_sizes[0] // eq.dim, dtype=bool)
    for s in eq.surfaces:
        if s.slides:  # any two points of the faces may meet
            slide |= np.any(s.obstacle.opposite.sides, axis=0)[: len(slide)]
            continue
        B = s.constant_operator("a motion").B
        weights = B.copy()
        indptr, indices, values = weights.getValuesCSR()
        weights.setValuesCSR(indptr, indices, np.abs(values))
        weights.assemble()
        ones = weights.createVecLeft()
        sums = weights.createVecRight()
        ones.set(1.0)
        weights.multTranspose(ones, sums)
        marks += sums.array_r
        for thing in (weights, ones, sums):
            thing.destroy()
    nodes = (marks.reshape(-1, eq.dim).sum(axis=1) > 0) | slide
    return np.repeat(nodes, eq.dim)


def _warn_of_inertia(problem: ContactProblem, M: PETSc.Mat, density: Any) -> None:
    """Warn where a mass that was moved lies elsewhere than that of the body. Collective."""
    eq = problem.equations
    V = problem.V
    consistent = mass_matrix(V, density, "consistent", np.zeros(eq.owned_sizes[0], dtype=bool))
    fixed = eq.constraints.fixed
    share, falls = rigid_errors(V, M, consistent, fixed, axisymmetric=eq.axisymmetric)
    consistent.destroy()
    if max([share, *falls.values()]) > _WRONG_INERTIA and problem.comm.rank == 0:
        turning = ", ".join(f"{100 * v:.2g} % along {axis}" for axis, v in falls.items())
        logger.warning(
            "mass='redistributed' has its centre and moments elsewhere than the body on this mesh: "
            "motions that nothing holds are accelerated by up to %.2g %% otherwise than they "
            "should be%s; take a finer mesh, mass='consistent', or mass='lumped', which keeps the "
            "centre",
            100 * share,
            f", and a body that falls turns by shares of its fall ({turning})" if falls else "",
        )


def _damping(
    problem: ContactProblem,
    velocity: fem.Function,
    density: Any,
    damping: ufl.Form | tuple[Any, Any] | None,
) -> tuple[PETSc.Mat | None, ufl.Form | None]:
    """The matrix C, and the form of what acts at no velocity. Collective.

    Raises:
        ValueError: on every rank, if that is neither a pair nor a form affine in the velocity.
    """
    if damping is None:
        return None, None
    V = problem.V
    body = problem.equations.bulk
    with everywhere(problem.comm, "damping"):
        if isinstance(damping, ufl.Form):
            form = weighted(damping, axisymmetric=problem.equations.axisymmetric)
            form, wind = _damping_form(problem.u, velocity, form)
        else:
            a, b = _rayleigh(damping)
    if isinstance(damping, ufl.Form):
        C = dolfinx.fem.petsc.assemble_matrix(compiled_form(form))
        C.assemble()
        return C, wind
    C = body.stiffness(np.zeros_like(velocity.x.array)).copy()
    C.scale(b)
    M = mass_matrix(V, density, "consistent", np.zeros(C.getLocalSize()[0], dtype=bool))
    C.axpy(a, M, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    M.destroy()
    return C, None


def _damping_form(
    u: fem.Function, velocity: fem.Function, form: ufl.Form
) -> tuple[ufl.Form, ufl.Form | None]:
    """The derivative of damping by the velocity, and what is left at none, if anything is."""
    V = u.function_space
    arguments = form.arguments()
    given = form.coefficients()
    if not arguments or any(a.ufl_function_space() != V for a in arguments):
        raise ValueError("damping must have a test function of the displacement's space")
    if u in given:
        raise ValueError(
            "damping depends on the displacement: it is that of the undeformed body; what depends "
            "on the displacement alone belongs into the bulk"
        )
    if len(arguments) == 2:
        if velocity in given:
            raise ValueError("damping in a trial and a test function must not hold the velocity")
        return form, None
    if velocity not in given:
        raise ValueError("damping must be a form in the Function that is given as velocity")
    found = dependence(form, velocity)
    if not found.is_affine:
        what = found.text_of_kinks or found.text
        raise ValueError(
            f"damping must be affine in the velocity, and is not by {what}; dry friction is a law "
            "of a contact surface"
        )
    at_rest = ufl.replace(form, {velocity: ufl.zero(velocity.ufl_shape)})
    wind = ufl.algorithms.expand_derivatives(at_rest)
    C = ufl.derivative(form, velocity, ufl.TrialFunction(V))
    return C, None if wind.empty() else wind


def data_of(density: Any, damping: Any, velocity: fem.Function) -> list[Datum]:
    """Functions and Constants in density and damping."""
    found = list(data_in(ufl.as_ufl(density), "the density"))
    if isinstance(damping, ufl.Form):
        found += data_in(damping, "the damping")
    elif damping is not None:
        for name, factor in zip("ab", damping, strict=True):
            if isinstance(factor, fem.Constant):
                found.append(Datum(f"the factor {name} of Rayleigh's damping", factor))
    return [d for d in found if d.value is not velocity]


def _of_matrices(density: Any, damping: Any, velocity: fem.Function) -> list[Datum]:
    """The data of the mass and of the factors of velocities in damping, without loads."""
    factors = damping
    if isinstance(damping, ufl.Form) and len(damping.arguments()) == 1:
        trial = ufl.TrialFunction(velocity.function_space)
        factors = ufl.algorithms.expand_derivatives(ufl.derivative(damping, velocity, trial))
    return data_of(density, factors, velocity)


def _of_stiffness(problem: ContactProblem, damping: Any) -> list[Datum]:
    """The data of the stiffness in Rayleigh's damping."""
    if damping is None or isinstance(damping, ufl.Form) or _rayleigh(damping)[1] == 0:
        return []
    mine = problem.equations.bulk.stiffness_data
    placed = placed_data(problem.equations, conditions=False)
    return [
        Datum(f"{d.place}, whose stiffness is in the damping,", d.value)
        for d in placed
        if any(d.value is f for f in mine)
    ]


def _rayleigh(damping: Any) -> tuple[float, float]:
    """Its factors as they are now; `_of_matrices` has the Constants among them."""
    try:
        a, b = damping
    except (TypeError, ValueError):
        a = b = None
    if not all(is_number(v) or is_scalar_constant(v) for v in (a, b)):
        raise ValueError(
            f"damping must be a form or a pair of numbers or scalar Constants, got {damping!r}; "
            "what varies over the body is to be a form"
        )
    a = float(a)
    b = float(b)
    if not (math.isfinite(a) and math.isfinite(b) and min(a, b) >= 0):
        raise ValueError(f"the factors of damping must not be negative, got {(a, b)!r}")
    return a, b


def is_scalar_constant(value: Any) -> bool:
    """Whether a value is a scalar Constant."""
    return isinstance(value, fem.Constant) and value.ufl_shape == ()
