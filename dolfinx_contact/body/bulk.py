# SPDX-License-Identifier: LGPL-3.0-or-later
"""Residual and stiffness of a body without contact, reassembled only if necessary.

If the residual is affine in the displacement u (`_ufl`), it equals K u + f with the stiffness K. K
and f depend only on the user's Functions and Constants, and are reassembled only if `read_data`
finds that these values have changed.

A residual with kinks is nonlinear. Its derivative is one-sided at a kink, so Newton's method is
semismooth, as for contact. A residual with jumps has in general no root that Newton's method could
find; friction must therefore be modelled by the law of a surface.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, TypeVar

from petsc4py import PETSc

import numpy as np

import dolfinx.fem.petsc
import ufl
from dolfinx import fem, la

from dolfinx_contact._arrays import Array
from dolfinx_contact._forms import derived_form
from dolfinx_contact._mpi import SharedValues, all_ranks, any_rank
from dolfinx_contact._petsc import destroy, half_of, product
from dolfinx_contact._ufl import kinks_of
from dolfinx_contact.materials import materials_in

__all__ = ["Bulk", "Stiffness", "checksum", "circumference", "weighted"]


_Fact = TypeVar("_Fact")


# -- bodies of revolution --------------------------------------------------------------------------
# Users write integrands per volume or area of the body. Every form of the user is passed to
# `weighted` once, when it enters the package, so that later modules do not need the weight.


def circumference(domain: Any) -> Any:
    """Return the circumference 2 pi r with r = x, a UFL expression.

    Args:
        domain: mesh of the section, from DOLFINx or UFL.
    """
    return 2 * np.pi * ufl.SpatialCoordinate(domain)[0]


def weighted(form: ufl.Form, *, axisymmetric: bool) -> ufl.Form:
    """Weight a form so that integrals over the section become integrals over the body.

    Args:
        form: form of any rank, over cells, exterior or interior facets, without the weight.
        axisymmetric: whether the mesh is half of a section of a body of revolution. If False, the
            form is returned unchanged.
    """
    if not axisymmetric:
        return form
    return ufl.Form(
        [
            it.reconstruct(integrand=circumference(it.ufl_domain()) * it.integrand())
            for it in form.integrals()
        ]
    )


# -- the body --------------------------------------------------------------------------------------


class Stiffness:
    """Residual and stiffness of a body, with fast products if the stiffness is symmetric.

    Attributes:
        linear: whether the stiffness does not depend on the displacement.
    """

    linear: bool
    #: Whether the stiffness is symmetric.
    _symmetric: bool
    _K: PETSc.Mat | None = None
    _half: PETSc.Mat | None = None

    @property
    def for_products(self) -> PETSc.Mat:
        """Most recently assembled stiffness, in a format for fast products. Collective.

        If the body is linear and the stiffness symmetric, only the upper triangle is stored. The
        conversion costs as much as a few tens of matrix-vector products.
        """
        assert self._K is not None
        if not self.linear or not self._symmetric:
            return self._K
        if self._half is None:
            self._half = half_of(self._K)
        return self._half

    def rows(self, u: Array) -> Array:
        """Return the owned entries of the residual at the displacement ``u``. Collective.

        For a linear body the residual is computed by a product with the cached stiffness, which is
        cheaper than assembly.
        """
        rows = self.affine_residual(u)
        return self.residual_at(u) if rows is None else rows

    def residual_at(self, u: Array) -> Array:
        """Return the owned entries of the residual at ``u``, always by assembly. Collective."""
        raise NotImplementedError

    def affine_residual(self, u: Array) -> Array | None:
        """Return the owned residual at ``u`` from the cached stiffness; None if out of date."""
        raise NotImplementedError

    def _forget_half(self) -> None:
        destroy(self._half)
        self._half = None

    def destroy(self) -> None:
        """Free the matrices."""
        destroy(self._half, self._K)
        self._half = self._K = None


class Bulk(Stiffness):
    """Residual and stiffness of a body, evaluated at displacements passed as arguments.

    Displacements are arrays of all local values, including ghosts. Symbolic properties of the form,
    for example whether it is affine in u, are determined once for all forms with the same
    signature. Derivatives are expanded when they are first needed.

    Args:
        form: UFL energy (a functional of ``u``) or residual (linear in a test function).
        u: displacement Function in the user's form; its values are neither read nor written.

    Attributes:
        residual: UFL residual in ``displacement``.
        is_energy: whether the form is an energy.
        displacement: Function that replaces ``u`` in the compiled forms. Each evaluation sets it to
            the displacement passed as argument.
        functions: Functions of the residual in UFL order, including the displacement.
        constants: Constants of the residual in UFL order.
        residual_form: compiled residual.
        jacobian_form: compiled stiffness.
        jacobian_constants: Constants of the stiffness.
        materials: materials of this package in the form.
        linear: whether the residual is affine in ``u``.
        kinks: description of the parts of the form with kinks or jumps in ``u``, or "".
        stiffness_mark: counter of data changes in the stiffness, the same on every rank.
        assemblies: number of assemblies of the stiffness.

    Raises:
        ValueError: on every rank, if ``form`` is neither an energy nor a residual of ``u``.
    """

    #: Whether the body has inertia.
    has_mass = False
    #: Largest displacement at the start of a time step, on this rank.
    reach = 0.0

    def __init__(self, form: ufl.Form, u: fem.Function):
        _require_bulk(form, u)
        self._V = u.function_space
        self.comm = u.function_space.mesh.comm
        self.materials = materials_in(form)
        self.displacement = own = fem.Function(self._V, name=u.name)
        self._given = form, u
        self.is_energy = self._symmetric = not form.arguments()
        #: Functions in the user's form, in UFL order.
        self._ordered = [own if f is u else f for f in form.coefficients()]
        #: Key of the form: its signature, and the position of the displacement among its Functions.
        self._key = form.signature(), next(i for i, f in enumerate(self._ordered) if f is own)
        self.functions = sorted(self._ordered, key=lambda f: f.count())
        self.constants = list(form.constants())
        self.residual_form = self._derived("residual", lambda: self.residual, 1)
        self.jacobian_form = self._derived("Jacobian", lambda: self._derivative, 2)
        coefficients, self.jacobian_constants = self._given_in_derivative()
        # The derivative of an energy with jumps does not contain the jumps, so the form itself is
        # classified as well.
        self.kinks = kinks_of(form, u)
        self.linear: bool = not any(f is own for f in coefficients) and not self.kinks
        #: Functions and Constants in the stiffness, excluding the displacement.
        self.stiffness_data: list[fem.Function | fem.Constant] = [
            d for d in (*coefficients, *self.jacobian_constants) if d is not own
        ]
        self._others = [f for f in self.functions if f is not own]
        self._data = [*self._others, *self.constants]
        self.stiffness_mark = 0
        self._update_ghosts()
        self._owned = self._V.dofmap.index_map.size_local * self._V.dofmap.index_map_bs
        self._rows = SharedValues(self._V.dofmap.index_map)
        self._f: Array | None = None
        #: Data and displacement of the assembled stiffness: `stiffness_mark` and a checksum.
        self._K_mark = 0, 0
        self.assemblies = 0

    # -- forms -----------------------------------------------------------------------------------

    @cached_property
    def _form(self) -> ufl.Form:
        """The user's form, with its displacement Function replaced by `displacement`."""
        form, u = self._given
        return ufl.replace(form, {u: self.displacement})

    @cached_property
    def residual(self) -> ufl.Form:
        """UFL residual as a function of `displacement`."""
        if not self.is_energy:
            return self._form
        return ufl.derivative(self._form, self.displacement, ufl.TestFunction(self._V))

    @cached_property
    def _derivative(self) -> ufl.Form:
        return ufl.derivative(self.residual, self.displacement, ufl.TrialFunction(self._V))

    def _derived(self, what: str, make: Callable[[], ufl.Form], rank: int) -> fem.Form:
        """Return the compiled form ``what``, derived from the user's form. Collective."""
        name = f"{what} of a body", self._key[1]
        spaces = [self._V] * rank
        return derived_form(name, self._given[0], make, spaces, functions=self._ordered)

    def _fact(self, what: str, find: Callable[[], _Fact]) -> _Fact:
        """Return the property ``what`` of the form, cached by the signature of the form."""
        key = what, *self._key
        if key not in _facts:
            _facts[key] = find()
        fact: _Fact = _facts[key]
        return fact

    def _given_in_derivative(self) -> tuple[list[fem.Function], list[fem.Constant]]:
        """Return the Functions and Constants that occur in the expanded stiffness form."""

        def find() -> tuple[list[int], list[int]]:
            expanded = ufl.algorithms.expand_derivatives(self._derivative)
            return (
                [self._ordered.index(f) for f in expanded.coefficients()],
                [self.constants.index(c) for c in expanded.constants()],
            )

        functions, constants = self._fact("data of the Jacobian", find)
        return [self._ordered[i] for i in functions], [self.constants[i] for i in constants]

    def loaded(self, load: ufl.Form) -> Bulk:
        """Return this body with an additional load: a linear form that does not contain ``u``."""
        own = self.displacement
        if not self.is_energy:
            made = Bulk(self.residual + load, own)
        else:
            (test,) = load.arguments()
            made = Bulk(self._form + ufl.replace(load, {test: own}), own)
        made.materials = self.materials  # the new form does not refer to them
        return made

    # -- data ------------------------------------------------------------------------------------

    def read_data(self) -> None:
        """Read the present values of the Functions and Constants in the forms. Collective."""
        of_data, of_stiffness = self._checksums
        if all_ranks(self.comm, checksum(self._data) == of_data):
            return
        self._update_ghosts()
        self._f = None
        self.stiffness_mark += any_rank(self.comm, self._checksums[1] != of_stiffness)

    def _update_ghosts(self) -> None:
        """Update the ghosts of Functions, and store checksums of all data. Collective."""
        for f in self._others:
            f.x.scatter_forward()
        #: Checksums of the local values of all data and of those in the stiffness.
        self._checksums = checksum(self._data), checksum(self.stiffness_data)

    # -- residual and energy ---------------------------------------------------------------------

    def energy_at(self, u: Array) -> float | None:
        """Return the energy of the body at ``u``; None if the form is a residual. Collective."""
        if not self.is_energy:
            return None
        rows = self.affine_residual(u)
        if rows is None:
            return self._assembled_energy(u)
        # Energy of a linear body: energy at rest plus work of the mean forces.
        assert self._f is not None
        work = float(self.comm.allreduce(0.5 * float(np.dot(u[: self._owned], rows + self._f))))
        if self._fact("no energy at rest", lambda: _vanishes(self._form, self.displacement)):
            return work
        return self._assembled_energy(np.zeros_like(u)) + work

    @cached_property
    def _energy_form(self) -> fem.Form:
        return self._derived("energy", lambda: self._form, 0)

    def _assembled_energy(self, u: Array) -> float:
        self.displacement.x.array[:] = u
        return float(self.comm.allreduce(float(np.real(fem.assemble_scalar(self._energy_form)))))

    def residual_at(self, u: Array) -> Array:
        """Assemble the residual at the displacement ``u``; return owned entries. Collective."""
        return self.assembled(self.residual_form, u)

    def assembled(self, form: fem.Form, u: Array) -> Array:
        """Assemble a linear form for the displacement ``u``; return owned entries. Collective."""
        self.displacement.x.array[:] = u
        b = self._rows.zeros(self._V.dofmap.index_map_bs)
        fem.assemble_vector(b.array, form)
        b.scatter_reverse(la.InsertMode.add)
        return b.array[: self._owned].copy()

    def rate_at(self, u: Array, step: Array) -> Array:
        """Return the owned entries of K(u) d for an increment d of Dirichlet data. Collective.

        Unless the stiffness K is up to date, only cells with dofs at which d is nonzero are
        assembled.

        Args:
            u: displacement.
            step: increment d at all local dofs.
        """
        if self._is_current:
            return self.times(step)
        self.displacement.x.array[:] = u
        self._step.x.array[:] = step
        dofs = np.flatnonzero(step).astype(np.int32)
        b = self._rows.zeros(self._V.dofmap.index_map_bs)
        bc = fem.dirichletbc(self._step, [dofs, dofs], self._V)
        fem.apply_lifting(b.array, [self.jacobian_form], [[bc]], alpha=-1.0)
        b.scatter_reverse(la.InsertMode.add)
        return b.array[: self._owned].copy()

    @cached_property
    def _step(self) -> fem.Function:
        """Function that holds the increment of the Dirichlet data in `rate_at`."""
        return fem.Function(self._V)

    def affine_residual(self, u: Array) -> Array | None:
        """Return the owned residual of a linear body from the cached stiffness. Collective.

        None if the body is nonlinear or the stiffness is not up to date: assembly of the residual
        is then cheaper.
        """
        f = self.affine_load()
        return None if f is None else self.times(u) + f

    def affine_load(self) -> Array | None:
        """Return the owned entries of the residual of a linear body at u = 0. Collective.

        None if the body is nonlinear or the cached stiffness is not up to date. The array is cached
        and must not be modified; if the data have changed, a new one is created.
        """
        if not self._is_current:
            return None
        if self._f is None:
            at_rest = "no residual at rest", lambda: _vanishes(self.residual, self.displacement)
            zero = np.zeros_like(self.displacement.x.array)
            self._f = zero[: self._owned] if self._fact(*at_rest) else self.residual_at(zero)
        return self._f

    # -- stiffness -------------------------------------------------------------------------------

    def stiffness(self, u: Array) -> PETSc.Mat:
        """Return the derivative of the residual at ``u``, without Dirichlet conditions. Collective.

        The matrix is reassembled only if its data (or ``u``, for a nonlinear body) have changed. It
        is owned by this object: the caller must neither modify nor destroy it.
        """
        self.displacement.x.array[:] = u
        mark = self.stiffness_mark, 0 if self.linear else checksum([self.displacement])
        if self._K is None:
            self._K = dolfinx.fem.petsc.create_matrix(self.jacobian_form)
        elif self._is_current or all_ranks(self.comm, mark == self._K_mark):
            return self._K
        self._K.zeroEntries()
        dolfinx.fem.petsc.assemble_matrix(self._K, self.jacobian_form)
        self._K.assemble()
        self._forget_half()
        self._K_mark = mark
        self.assemblies += 1
        return self._K

    @property
    def _is_current(self) -> bool:
        """Whether the body is linear and its stiffness was assembled with the present data."""
        return self.linear and self._K is not None and self._K_mark[0] == self.stiffness_mark

    def times(self, u: Array) -> Array:
        """Return the owned entries of the product of the cached stiffness and ``u``. Collective."""
        assert self._K is not None
        return product(self._K if self._half is None else self._half, u)


def checksum(data: Sequence[Any]) -> int:
    """Return a checksum of the local values of Functions and Constants."""
    mark = 0
    for d in data:
        values = d.x.array if hasattr(d, "x") else d.value
        mark = zlib.crc32(np.ascontiguousarray(values), mark)
    return mark


#: Cached properties of forms by name, signature and position of the displacement.
_facts: dict[tuple[Any, ...], Any] = {}


def _vanishes(form: ufl.Form, u: fem.Function) -> bool:
    """Return whether a form is symbolically zero if ``u`` is replaced by zero."""
    none = ufl.classes.Zero(u.ufl_shape)
    return bool(ufl.replace(form, {u: none}).empty())


def _require_bulk(bulk: ufl.Form, u: fem.Function) -> None:
    """Raise ``ValueError`` if a form is neither an energy nor a residual of ``u``."""
    arguments = bulk.arguments()
    if any(a.number() > 0 for a in arguments):
        raise ValueError(
            "the bulk form contains a TrialFunction: write it with the displacement u, a "
            "fem.Function, also for a linear body; the stiffness is derived from it"
        )
    if not any(f is u for f in bulk.coefficients()):
        raise ValueError("the bulk form does not contain the displacement u")
    if any(a.ufl_function_space() != u.function_space for a in arguments):
        raise ValueError(
            "the bulk must be an energy (no test function) or a residual with one test function of "
            "the space of the displacement"
        )
    terms = [integral.integrand() for integral in bulk.integrals()]
    for term in terms:  # the loop reaches the terms that it appends
        if isinstance(term, ufl.classes.Sum):
            terms += term.ufl_operands
        elif arguments and not ufl.algorithms.extract_arguments(term):
            raise ValueError(
                "the bulk mixes an energy and a residual: write the loads with u, or everything "
                "with a TestFunction"
            )
