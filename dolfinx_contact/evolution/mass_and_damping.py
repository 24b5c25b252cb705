# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mass and damping matrices of a body in motion.

The mass matrix of the density is consistent, lumped or redistributed. The damping matrix is

    C = d(damping form)/d(velocity)                   for a damping form affine in the velocity
    C = a M_consistent + b K(0)                       for Rayleigh damping with the factors (a, b)

with the stiffness K(0) of the undeformed body. The matrices are assembled when a run starts. The
value of a damping form at zero velocity, such as the wind w in c (v - w), is added to the loads.
"""

from __future__ import annotations

import logging
import math
from typing import Any

from petsc4py import PETSc

import numpy as np

import dolfinx.fem.petsc
import ufl
from dolfinx import fem

from dolfinx_contact._arrays import Mask
from dolfinx_contact._forms import compiled_form
from dolfinx_contact._mpi import everywhere
from dolfinx_contact._petsc import destroy
from dolfinx_contact._ufl import not_affine
from dolfinx_contact._validate import is_number
from dolfinx_contact.body.bulk import circumference, weighted
from dolfinx_contact.body.inertia import Mass, inertia_error, mass_matrix
from dolfinx_contact.body.moving import MovingBody, TimeStep
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.data import Datum, data_in, placed_data
from dolfinx_contact.evolution.constancy import Constancy
from dolfinx_contact.problem import ContactProblem

__all__ = ["Matrices"]

logger = logging.getLogger(__name__)

_WRONG_INERTIA = 0.01  # relative error of a rigid acceleration that is reported


class Matrices:
    """Mass and damping matrices of a body, and their data.

    Args:
        problem: contact problem of the body without inertia.
        velocity: Function of the velocity, used in a damping form.
        density: mass per volume.
        mass: kind of the mass matrix.
        damping: damping form, pair of factors of Rayleigh damping, or None.

    Attributes:
        data: Functions and Constants of density and damping.

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
        eq = problem.equations
        self._problem = problem
        self._bulk = eq.bulk.body if isinstance(eq.bulk, MovingBody) else eq.bulk
        self._kind = mass
        self._density = density * circumference(problem.V.mesh) if eq.axisymmetric else density
        self._rayleigh = None if isinstance(damping, ufl.Form) else damping
        self._form: fem.Form | None = None
        self._wind: ufl.Form | None = None
        in_matrices: Any = damping
        fixed: list[Datum] = []
        with everywhere(problem.comm, "damping"):
            if isinstance(damping, ufl.Form):
                form = weighted(damping, axisymmetric=eq.axisymmetric)
                in_matrices, self._wind = _affine_parts(form, problem.u, velocity)
            elif damping is not None and _factors(damping)[1] > 0:
                fixed = self._data_of_stiffness()
        if isinstance(in_matrices, ufl.Form):
            self._form = compiled_form(in_matrices)
        self.data = _data(density, damping, velocity)
        #: Data that must be constant during a run.
        self._fixed = _data(density, in_matrices, velocity) + fixed
        self._assembled = Constancy(problem.comm, self._fixed)

    def body(self, step: TimeStep) -> MovingBody:
        """Create the body with mass and damping that is used in time steps. Collective."""
        body = self._bulk if self._wind is None else self._bulk.loaded(self._wind)
        return MovingBody(body, *self._assemble(), step)

    def update(self, body: MovingBody) -> None:
        """Reassemble the matrices of a body if their data have changed. Collective."""
        if self._assembled.changed():
            body.take_matrices(*self._assemble())
            self._assembled = Constancy(self._problem.comm, self._fixed)

    def require_constant(self, time: float) -> None:
        """Raise `ValueError` if the load at a time has changed density or damping. Collective."""
        changed = self._assembled.changed()
        if changed:
            raise ValueError(
                f"the load at the time {time:g} changes {changed}. Mass and damping are assembled "
                "when a run starts: change them between two runs"
            )

    def _assemble(self) -> tuple[PETSc.Mat, PETSc.Mat | None]:
        """Assemble the mass and damping matrices. Collective."""
        problem = self._problem
        for datum in self.data:
            if isinstance(datum.value, fem.Function):
                datum.value.x.scatter_forward()
        M = mass_matrix(problem.V, self._density, self._kind, _touching_dofs(problem.equations))
        if self._kind == "redistributed":
            _warn_of_inertia(problem, M, self._consistent())
        if self._form is not None:
            C = dolfinx.fem.petsc.assemble_matrix(self._form)
            C.assemble()
            return M, C
        if self._rayleigh is None:
            return M, None
        a, b = _factors(self._rayleigh)
        self._bulk.read_data()
        C = self._bulk.stiffness(np.zeros_like(problem.u.x.array)).copy()
        C.scale(b)
        consistent = self._consistent()
        C.axpy(a, consistent, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        consistent.destroy()
        return M, C

    def _consistent(self) -> PETSc.Mat:
        """Assemble the consistent mass matrix. Collective."""
        no_dofs = np.zeros(self._problem.equations.owned_sizes[0], dtype=bool)
        return mass_matrix(self._problem.V, self._density, "consistent", no_dofs)

    def _data_of_stiffness(self) -> list[Datum]:
        """Return the Functions and Constants of the stiffness matrix used in Rayleigh damping."""
        stiff = self._bulk.stiffness_data
        return [
            Datum(f"{d.place}, whose stiffness is in the damping,", d.value)
            for d in placed_data(self._problem.equations, conditions=False)
            if any(d.value is f for f in stiff)
        ]


def _touching_dofs(eq: ContactEquations) -> Mask:
    """Return a mask of the owned dofs at nodes that may come into contact. Collective."""
    n = eq.owned_sizes[0]
    touching = np.zeros(n // eq.dim, dtype=bool)
    for s in eq.surfaces:
        if s.slides:  # any two points of the faces may meet
            touching |= np.any(s.obstacle.opposite.sides, axis=0)[: len(touching)]
            continue
        # columns of the operator B with a nonzero entry
        weights = s.constant_operator("a motion").B.copy()
        indptr, indices, values = weights.getValuesCSR()
        weights.setValuesCSR(indptr, indices, np.abs(values))
        weights.assemble()
        rows, columns = weights.createVecLeft(), weights.createVecRight()
        rows.set(1.0)
        weights.multTranspose(rows, columns)
        touching |= np.any(columns.array_r.reshape(-1, eq.dim) > 0, axis=1)
        destroy(weights, rows, columns)
    return np.repeat(touching, eq.dim)


def _warn_of_inertia(problem: ContactProblem, M: PETSc.Mat, consistent: PETSc.Mat) -> None:
    """Log a warning if redistribution changes the inertia of rigid motions. Collective.

    Args:
        problem: contact problem of the body.
        M: redistributed mass matrix.
        consistent: consistent mass matrix, which is destroyed.
    """
    eq = problem.equations
    fixed = eq.constraints.fixed
    error = inertia_error(problem.V, M, consistent, fixed, axisymmetric=eq.axisymmetric)
    consistent.destroy()
    if error > _WRONG_INERTIA and problem.comm.rank == 0:
        logger.warning(
            "mass='redistributed' has a wrong centre and wrong moments on this mesh: accelerations "
            "of unconstrained rigid motions are wrong by up to %.2g %%; use a finer mesh, "
            "mass='consistent', or mass='lumped', which has the right centre",
            100 * error,
        )


def _affine_parts(
    form: ufl.Form, u: fem.Function, velocity: fem.Function
) -> tuple[ufl.Form, ufl.Form | None]:
    """Return the velocity derivative of a damping form, and the form at zero velocity.

    Raises:
        ValueError: if the form is not affine in the velocity.
    """
    V = u.function_space
    arguments = form.arguments()
    coefficients = form.coefficients()
    if not arguments or any(a.ufl_function_space() != V for a in arguments):
        raise ValueError("damping must have a test function of the space of the displacement")
    if u in coefficients:
        raise ValueError(
            "damping must not depend on the displacement: it refers to the undeformed body; move "
            "terms that contain only the displacement to the bulk form"
        )
    if len(arguments) == 2:
        if velocity in coefficients:
            raise ValueError("damping with trial and test function must not contain the velocity")
        return form, None
    if velocity not in coefficients:
        raise ValueError("damping must contain the Function passed as velocity")
    nonlinear = not_affine(form, velocity)
    if nonlinear:
        raise ValueError(
            "damping must be affine in the velocity; not affine: "
            f"{nonlinear}. Dry friction is a law of a contact surface"
        )
    expand = ufl.algorithms.expand_derivatives
    at_rest = expand(ufl.replace(form, {velocity: ufl.zero(velocity.ufl_shape)}))
    slope = expand(ufl.derivative(form, velocity, ufl.TrialFunction(V)))
    return slope, None if at_rest.empty() else at_rest


def _data(density: Any, damping: Any, velocity: fem.Function) -> list[Datum]:
    """Return the Functions and Constants on which density and damping depend."""
    found = list(data_in(ufl.as_ufl(density), "the density"))
    if isinstance(damping, ufl.Form):
        found += data_in(damping, "the damping")
    return [d for d in found if d.value is not velocity]


def _factors(damping: Any) -> tuple[float, float]:
    """Return the factors (a, b) of Rayleigh damping a M + b K as numbers.

    Raises:
        ValueError: unless they are two nonnegative numbers.
    """
    pair = isinstance(damping, tuple | list) and len(damping) == 2
    if not (pair and all(is_number(v) and math.isfinite(v) and v >= 0 for v in damping)):
        raise ValueError(
            f"damping must be a form or a pair of numbers that are not negative, got {damping!r}; "
            "use a form for damping that varies over the body"
        )
    return float(damping[0]), float(damping[1])
