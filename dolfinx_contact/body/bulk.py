# SPDX-License-Identifier: LGPL-3.0-or-later
"""Body without contact: residual and stiffness, assembled once if they are linear.

A residual that is affine in the displacement (`_ufl`) equals K u + f, where K and
f change only with the user's data. Both are kept until a coefficient or a Constant changes.

A residual with kinks is nonlinear. Its derivative is that of the side on which a state lies, so
Newton's method is semismooth, as for contact. A residual with jumps has in general no root that
Newton's method could find; friction must be the law of a surface.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, TypeVar

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import dolfinx.fem.petsc
import ufl
from dolfinx import fem, la

from dolfinx_contact._forms import derived_form
from dolfinx_contact._mpi import SharedValues, anywhere
from dolfinx_contact._petsc import half_of
from dolfinx_contact._ufl import has_branches, is_affine, kinks_of
from dolfinx_contact.materials import materials_in

__all__ = ["Bulk", "circumference", "weighted"]

Array = npt.NDArray[np.float64]

_Fact = TypeVar("_Fact")


# -- bodies of revolution --------------------------------------------------------------------------
# Users write integrands per volume or area of the body. Every form of the user passes once through
# `weighted`, where it enters the package, so that later modules need not know the weight.


def circumference(domain: Any) -> Any:
    """Return 2 pi r with r = x, a UFL expression.

    Args:
        domain: mesh of the section, from DOLFINx or UFL.
    """
    return 2 * np.pi * ufl.SpatialCoordinate(domain)[0]


def weighted(form: ufl.Form, *, axisymmetric: bool) -> ufl.Form:
    """Return a form whose integrals over the section equal those over the whole body.

    Args:
        form: form of any rank, over cells, exterior or interior facets, without the weight.
        axisymmetric: whether the mesh is half of a section of a body of revolution; if not, the
            form is returned as it is.
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


class Bulk:
    """Residual and stiffness of a body at displacements that are arguments.

    Displacements are arrays of all local values, ghosts included. Properties of the form alone,
    such as whether it is affine, are determined once for all forms of one signature, and
    derivatives are written out when they are used.

    Args:
        form: UFL energy (a functional of ``u``) or residual (linear in a test function).
        u: displacement of the user, which occurs in the form and is neither read nor written.

    Attributes:
        energy: UFL energy in ``displacement``; None if a residual was given.
        residual: UFL residual in ``displacement``.
        is_energy: whether the form is an energy.
        displacement: Function in the forms; it receives the displacement of an evaluation.
        functions: Functions of the residual, the displacement included, in the order of UFL.
        constants: Constants of the residual, in the order of UFL.
        residual_form: compiled residual.
        jacobian_form: compiled stiffness.
        jacobian_constants: Constants of the stiffness.
        materials: materials of this package in the form.
        linear: whether the residual is affine in ``u``.
        kinks: parts of the form with kinks or jumps in ``u``, as text; "" if there are none.
        assemblies: number of assemblies of the stiffness.

    Raises:
        ValueError: on every rank, if ``form`` is neither an energy nor a residual of ``u``.
    """

    #: Whether mass resists motions.
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
        self.is_energy = not form.arguments()
        #: Functions in the order of the given form.
        self._ordered = [own if f is u else f for f in form.coefficients()]
        #: Key of the form: its signature, and the place of the displacement.
        self._key = form.signature(), next(i for i, f in enumerate(self._ordered) if f is own)
        self.functions = sorted(self._ordered, key=lambda f: f.count())
        self.constants = list(form.constants())
        self.residual_form = self._derived("residual", lambda: self.residual, 1)
        self.jacobian_form = self._derived("Jacobian", lambda: self._derivative, 2)
        self._energy_form: fem.Form | None = None
        coefficients, self.jacobian_constants = self._given_in_derivative()
        # Without branches the derivative decides. The derivative of an energy with jumps does not
        # contain the jumps, so the form itself is classified as well.
        branches = self._fact("branches", lambda: has_branches(self._form))
        self.kinks = kinks_of(self._form, own) if branches else ""
        smooth = not branches or (not self.kinks and is_affine(self.residual, own))
        self.linear: bool = not any(f is own for f in coefficients) and smooth
        self._data = [*coefficients, *self.jacobian_constants]
        self._others = [f for f in self.functions if f is not own]
        self.update_ghosts()
        self._loads = [*self._others, *self.constants]
        self._owned = self._V.dofmap.index_map.size_local * self._V.dofmap.index_map_bs
        self._rows = SharedValues(self._V.dofmap.index_map)
        self._K: PETSc.Mat | None = None
        self._half: PETSc.Mat | None = None
        self._f: Array | None = None
        self._K_mark = self._f_mark = 0
        self.assemblies = 0

    # -- forms -----------------------------------------------------------------------------------

    @cached_property
    def _form(self) -> ufl.Form:
        """Form of the user in `displacement`."""
        form, u = self._given
        return ufl.replace(form, {u: self.displacement})

    @property
    def energy(self) -> ufl.Form | None:
        """UFL energy in `displacement`; None if a residual was given."""
        return self._form if self.is_energy else None

    @cached_property
    def residual(self) -> ufl.Form:
        """UFL residual in `displacement`."""
        if not self.is_energy:
            return self._form
        return ufl.derivative(self._form, self.displacement, ufl.TestFunction(self._V))

    @cached_property
    def _derivative(self) -> ufl.Form:
        return ufl.derivative(self.residual, self.displacement, ufl.TrialFunction(self._V))

    def _derived(self, what: str, make: Callable[[], ufl.Form], rank: int) -> fem.Form:
        """Return a compiled form of this body. Collective."""
        name = f"{what} of a body", self._key[1]
        spaces = [self._V] * rank
        return derived_form(name, self._given[0], make, spaces, functions=self._ordered)

    def _fact(self, what: str, find: Callable[[], _Fact]) -> _Fact:
        """Return a property of the form, which is determined once for its signature."""
        key = what, *self._key
        if key not in _facts:
            _facts[key] = find()
        fact: _Fact = _facts[key]
        return fact

    def _given_in_derivative(self) -> tuple[list[fem.Function], list[fem.Constant]]:
        """Return the coefficients and Constants of the expanded derivative."""

        def find() -> tuple[list[int], list[int]]:
            expanded = ufl.algorithms.expand_derivatives(self._derivative)
            return (
                [self._ordered.index(f) for f in expanded.coefficients()],
                [self.constants.index(c) for c in expanded.constants()],
            )

        functions, constants = self._fact("data of the Jacobian", find)
        return [self._ordered[i] for i in functions], [self.constants[i] for i in constants]

    def loaded(self, load: ufl.Form) -> Bulk:
        """Return this body with an additional load, a form in a test function without ``u``."""
        own = self.displacement
        if not self.is_energy:
            made = Bulk(self.residual + load, own)
        else:
            (test,) = load.arguments()
            made = Bulk(self._form + ufl.replace(load, {test: own}), own)
        made.materials = self.materials  # the new form does not refer to them
        return made

    # -- data ------------------------------------------------------------------------------------

    @property
    def has_changed(self) -> bool:
        """Whether Functions of the forms have changed on this rank since `update_ghosts`."""
        return bool(self._others) and _checksum(self._others) != self._others_mark

    def update_ghosts(self) -> None:
        """Update the ghosts of Functions in the forms. Collective."""
        for f in self._others:
            f.x.scatter_forward()
        self._others_mark = _checksum(self._others)

    @property
    def stiffness_data(self) -> list[Any]:
        """Functions and Constants of the stiffness without the displacement."""
        return [d for d in self._data if d is not self.displacement]

    @property
    def stiffness_mark(self) -> int:
        """Checksum on this rank of `stiffness_data`."""
        return _checksum(self.stiffness_data)

    # -- residual and energy ---------------------------------------------------------------------

    def energy_at(self, u: Array) -> float | None:
        """Return the energy of the user; None if a residual was given. Collective."""
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

    def _assembled_energy(self, u: Array) -> float:
        if self._energy_form is None:
            self._energy_form = self._derived("energy", lambda: self._form, 0)
        self.displacement.x.array[:] = u
        return float(self.comm.allreduce(float(np.real(fem.assemble_scalar(self._energy_form)))))

    def residual_at(self, u: Array) -> Array:
        """Return owned entries of the residual, by assembly. Collective."""
        return self.assembled(self.residual_form, u)

    def local_rows(self, u: Array) -> Array:
        """Return rows (n, dim) whose sum over all ranks is that of the residual. Collective.

        For a linear body they are products with the kept stiffness, which is cheaper than assembly.
        """
        rows = self.affine_residual(u)
        # Unlike owned rows, the local contributions of every rank count once.
        rows = self._local(self.residual_form, u).array.copy() if rows is None else rows
        return np.asarray(rows).reshape(-1, self._V.dofmap.index_map_bs)

    def assembled(self, form: fem.Form, u: Array) -> Array:
        """Return owned entries of a linear form in `displacement`. Collective."""
        b = self._local(form, u)
        b.scatter_reverse(la.InsertMode.add)
        return b.array[: self._owned].copy()

    def _local(self, form: fem.Form, u: Array) -> la.Vector:
        self.displacement.x.array[:] = u
        b = self._rows.zeros(self._V.dofmap.index_map_bs)
        fem.assemble_vector(b.array, form)
        return b

    def lifting(self, u: Array, bcs: Sequence[fem.DirichletBC], start: Array) -> Array:
        """Return K(u) (g - start), where g is ``start`` with the values of ``bcs``. Collective."""
        self.displacement.x.array[:] = u
        b = self._rows.zeros(self._V.dofmap.index_map_bs)
        fem.apply_lifting(b.array, [self.jacobian_form], [list(bcs)], x0=[start], alpha=-1.0)
        b.scatter_reverse(la.InsertMode.add)
        return b.array[: self._owned].copy()

    def affine_residual(self, u: Array) -> Array | None:
        """Return the owned entries of K u + f if K is available. Collective.

        It is None if the body is not linear or its stiffness has changed, because assembling the
        residual is then cheaper.
        """
        f = self.affine_load()
        return None if f is None else self.times(u) + f

    def affine_load(self) -> Array | None:
        """Return the owned residual at zero displacement if K is available. Collective.

        The array is kept: the caller must not change it. It is replaced when data change.
        """
        if not self.linear or self._K is None:
            return None
        mark = _checksum(self._loads)
        outdated, loaded = anywhere(
            self.comm,
            _checksum(self._data) != self._K_mark,
            self._f is None or mark != self._f_mark,
        )
        if outdated:
            return None
        if loaded:
            at_rest = "no residual at rest", lambda: _vanishes(self.residual, self.displacement)
            zero = np.zeros_like(self.displacement.x.array)
            self._f = zero[: self._owned] if self._fact(*at_rest) else self.residual_at(zero)
            self._f_mark = mark
        return self._f

    # -- stiffness -------------------------------------------------------------------------------

    def stiffness(self, u: Array) -> PETSc.Mat:
        """Return the derivative of the residual at ``u``, without Dirichlet rows. Collective.

        It is assembled if its data, or ``u`` for a nonlinear body, have changed. The matrix is
        kept: the caller must neither change nor destroy it.
        """
        self.displacement.x.array[:] = u
        mark = _checksum(self._data)
        if self._K is None:
            self._K = dolfinx.fem.petsc.create_matrix(self.jacobian_form)
        elif not anywhere(self.comm, mark != self._K_mark)[0]:
            return self._K
        self._K.zeroEntries()
        dolfinx.fem.petsc.assemble_matrix(self._K, self.jacobian_form)
        self._K.assemble()
        self._forget_half()
        self._K_mark = mark
        self.assemblies += 1
        return self._K

    @property
    def for_products(self) -> PETSc.Mat:
        """Stiffness assembled last, for many products. Collective.

        The stiffness of a linear body with an energy is stored as its upper half, which takes as
        long as some tens of products.
        """
        assert self._K is not None
        if not self.linear or not self.is_energy:
            return self._K
        if self._half is None:
            self._half = half_of(self._K)
        return self._half

    def product(self, u: Array) -> Array | None:
        """Return K u if K is constant and belongs to the present data. Collective."""
        if not self.linear or self._K is None:
            return None
        (outdated,) = anywhere(self.comm, _checksum(self._data) != self._K_mark)
        return None if outdated else self.times(u)

    def times(self, u: Array) -> Array:
        """Return the product of the stiffness assembled last with ``u``, owned. Collective."""
        assert self._K is not None
        x = self._K.createVecRight()
        y = self._K.createVecLeft()
        x.array[:] = u[: x.getLocalSize()]
        (self._K if self._half is None else self._half).mult(x, y)
        values = y.array_r.copy()
        x.destroy(), y.destroy()
        return values

    def _forget_half(self) -> None:
        if self._half is not None:
            self._half.destroy()
            self._half = None

    def destroy(self) -> None:
        """Free the matrices."""
        self._forget_half()
        if self._K is not None:
            self._K.destroy()
            self._K = None


def _checksum(data: Sequence[fem.Function | fem.Constant]) -> int:
    """Return a checksum of the values of data on this rank."""
    mark = 0
    for d in data:
        values = d.value if isinstance(d, fem.Constant) else d.x.array
        mark = zlib.crc32(np.ascontiguousarray(values), mark)
    return mark


#: Properties of forms, by name, signature and place of the displacement.
_facts: dict[tuple[Any, ...], Any] = {}


def _vanishes(form: ufl.Form, u: fem.Function) -> bool:
    """Return whether a form vanishes symbolically where ``u`` is zero."""
    none = ufl.classes.Zero(u.ufl_shape)
    return bool(ufl.replace(form, {u: none}).empty())


def _require_bulk(bulk: ufl.Form, u: fem.Function) -> None:
    """Raise ``ValueError`` if a form is neither an energy nor a residual of ``u``."""
    if not any(f is u for f in bulk.coefficients()):
        raise ValueError("the bulk form does not contain the displacement u")
    arguments = bulk.arguments()
    if len(arguments) > 1 or any(a.ufl_function_space() != u.function_space for a in arguments):
        raise ValueError(
            "the bulk must be an energy (no test function) or a residual with one test function of "
            "the space of the displacement"
        )
