# SPDX-License-Identifier: LGPL-3.0-or-later
"""Body without contact: residual and stiffness, assembled once if they are linear.

A residual that is affine in the displacement (classified by `_ufl`) equals K u + f, where K and
f change only with the user's data. Both are kept until a coefficient or a Constant changes.

A residual with kinks is nonlinear. Its derivative is that of the side on which a state lies, so
Newton's method is semismooth, as for contact. A residual with jumps has in general no root that
Newton's method could find; friction must be the law of a surface.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Hashable, Sequence
from functools import cached_property
from typing import Any, TypeVar

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import dolfinx.fem.petsc
import ufl
from dolfinx import fem, la

from dolfinx_contact._forms import Content, content_of, derived_form
from dolfinx_contact._mpi import SharedValues, anywhere
from dolfinx_contact._petsc import half_of
from dolfinx_contact._ufl import dependence, has_branches, is_affine
from dolfinx_contact.materials import materials_in

__all__ = ["Bulk", "circumference", "weighted"]

Array = npt.NDArray[np.float64]

_PRODUCTS = 2  # number of timed products
_NOWHERE: tuple[Array, Array] = (np.empty(0), np.empty(0))
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
    such as whether it is affine, are determined once for all forms with the same content
    (`_forms.content_of`), and derivatives are written out when they are used.

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
        seconds: seconds of the first assembly of the stiffness and of a product, on this rank.

    Raises:
        ValueError: on every rank, if ``form`` is neither an energy nor a residual of ``u``.
    """

    #: Whether mass resists motions.
    has_mass = False
    #: Largest displacement at the start of a time step, on this rank.
    reach = 0.0

    def __init__(self, form: ufl.Form, u: fem.Function):
        self._V = u.function_space
        self.comm = u.function_space.mesh.comm
        content = content_of(form) if isinstance(form, ufl.Form) else None
        _require_bulk(form, content, u)
        self.materials = materials_in(form)
        self.displacement = own = fem.Function(self._V, name=u.name)
        self._given = form, u
        self._content = None if content is None else content.with_function(u, own)
        self.is_energy = not (form.arguments() if content is None else content.arguments)
        functions = form.coefficients() if content is None else content.functions
        constants = form.constants() if content is None else content.constants
        self.functions = sorted((own if f is u else f for f in functions), key=lambda f: f.count())
        self.constants = sorted(constants, key=lambda c: c.count())
        self.residual_form = self._derived("residual", lambda: self.residual, 1)
        self.jacobian_form = self._derived("Jacobian", lambda: self._derivative, 2)
        self._energy_form: fem.Form | None = None
        coefficients, self.jacobian_constants = self._given_in_derivative()
        # Without branches the derivative decides. The derivative of an energy with jumps does not
        # contain the jumps, so the form itself is classified as well.
        branches = self._fact("branches", lambda: has_branches(self._form))
        self.kinks = dependence(self._form, own).text_of_kinks if branches else ""
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
        self._K_mark = self._f_mark = 0
        self._f: npt.NDArray[np.float64] | None = None
        #: Displacement of the last product in `affine_residual`, and the product, owned values.
        self._product = _NOWHERE
        self._rest: tuple[int, float] | None = None  # energy at zero displacement
        self.assemblies = 0
        self.seconds = (0.0, 0.0)

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
        spaces = [self._V] * rank
        return derived_form(f"{what} of a body", self._content, make, spaces, comm=self.comm)

    def _fact(self, what: str, find: Callable[[], _Fact]) -> _Fact:
        """Return a property of the content of the form, which is determined once."""
        if self._content is None:
            return find()
        key = what, self._content.key
        if key not in _facts:
            _facts[key] = find()
        fact: _Fact = _facts[key]
        return fact

    def _given_in_derivative(self) -> tuple[list[fem.Function], list[fem.Constant]]:
        """Return the coefficients and Constants of the expanded derivative."""

        def find() -> tuple[list[int], list[int]]:
            expanded = ufl.algorithms.expand_derivatives(self._derivative)
            return (
                [self.functions.index(f) for f in expanded.coefficients()],
                [self.constants.index(c) for c in expanded.constants()],
            )

        functions, constants = self._fact("what the Jacobian depends on", find)
        return [self.functions[i] for i in functions], [self.constants[i] for i in constants]

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

    @property
    def has_changed(self) -> bool:
        """Whether Functions of the forms have changed on this rank since `update_ghosts`."""
        return _checksum(self._others) != self._others_mark

    def update_ghosts(self) -> None:
        """Update the ghosts of Functions in the forms. Collective."""
        for f in self._others:
            f.x.scatter_forward()
        self._others_mark = _checksum(self._others)

    def energy_at(self, u: npt.NDArray[np.float64]) -> float | None:
        """Return the energy of the user; None if a residual was given. Collective."""
        if not self.is_energy:
            return None
        rows = self.affine_residual(u)
        if rows is None:
            return self._assembled_energy(u)
        # Energy of a linear body: energy at rest plus work of the mean forces.
        mark = _checksum([*self._data, *self._loads])
        if self._rest is None or not self._same(mark, self._rest[0]):
            rest = 0.0
            if not self._fact(
                "no energy at rest", lambda: _vanishes(self._form, self.displacement)
            ):
                rest = self._assembled_energy(np.zeros_like(u))
            self._rest = mark, rest
        assert self._f is not None
        work = 0.5 * float(np.dot(u[: self._owned], rows + self._f))
        return self._rest[1] + float(self.comm.allreduce(work))

    def _assembled_energy(self, u: npt.NDArray[np.float64]) -> float:
        if self._energy_form is None:
            self._energy_form = self._derived("energy", lambda: self._form, 0)
        self.displacement.x.array[:] = u
        return float(self.comm.allreduce(float(np.real(fem.assemble_scalar(self._energy_form)))))

    def residual_at(self, u: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return owned entries of the residual, by assembly. Collective."""
        return self.assembled(self.residual_form, u)

    def local_rows(self, u: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return rows (n, dim) whose sum over all ranks is that of the residual. Collective.

        For a linear body they are products with the kept stiffness, which is cheaper than assembly.
        """
        rows = self.affine_residual(u)
        # Unlike owned rows, the local contributions of every rank count once.
        rows = self._local(self.residual_form, u).array.copy() if rows is None else rows
        return np.asarray(rows).reshape(-1, self._V.dofmap.index_map_bs)

    def assembled(self, form: fem.Form, u: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return owned entries of a linear form in `displacement`. Collective."""
        b = self._local(form, u)
        b.scatter_reverse(la.InsertMode.add)
        return b.array[: self._owned].copy()

    def _local(self, form: fem.Form, u: npt.NDArray[np.float64]) -> la.Vector:
        self.displacement.x.array[:] = u
        b = self._rows.zeros(self._V.dofmap.index_map_bs)
        fem.assemble_vector(b.array, form)
        return b

    def lifting(
        self,
        u: npt.NDArray[np.float64],
        bcs: Sequence[fem.DirichletBC],
        start: npt.NDArray[np.float64],
    ) -> npt.NDArray[np.float64]:
        """Return K(u) (g - start), where g is ``start`` with the values of ``bcs``. Collective."""
        self.displacement.x.array[:] = u
        b = self._rows.zeros(self._V.dofmap.index_map_bs)
        fem.apply_lifting(b.array, [self.jacobian_form], [list(bcs)], x0=[start], alpha=-1.0)
        b.scatter_reverse(la.InsertMode.add)
        return b.array[: self._owned].copy()

    def stiffness(self, u: npt.NDArray[np.float64]) -> PETSc.Mat:
        """Return the derivative of the residual at ``u``, without Dirichlet rows. Collective.

        It is assembled if its data, or ``u`` for a nonlinear body, have changed. The matrix is
        kept: the caller must neither change nor destroy it.
        """
        self.displacement.x.array[:] = u
        mark = _checksum(self._data)
        if self._K is None:
            self._K = dolfinx.fem.petsc.create_matrix(self.jacobian_form)
        elif self._same(mark, self._K_mark):
            return self._K
        start = time.perf_counter()
        self._K.zeroEntries()
        dolfinx.fem.petsc.assemble_matrix(self._K, self.jacobian_form)
        self._K.assemble()
        if self.assemblies == 0:
            self.seconds = time.perf_counter() - start, _seconds_of_product(self._K)
        self._forget_half()
        self._product = _NOWHERE
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

    def _forget_half(self) -> None:
        if self._half is not None:
            self._half.destroy()
            self._half = None

    def affine_residual(self, u: npt.NDArray[np.float64]) -> npt.NDArray[np.float64] | None:
        """Return K u + f if K is available. Collective.

        Args:
            u: local values of the displacement, ghosts included.

        Returns:
            Owned entries; None if the body is not linear or its stiffness has changed, because
            assembling the residual is then cheaper.
        """
        mine = u[: self._owned]
        at, product = self._product
        f, moved = self._load_unless_moved(not np.array_equal(mine, at))
        if f is None:
            return None
        if moved:
            product = self.times(u)
            self._product = mine.copy(), product
        return np.asarray(product + f)

    def affine_load(self) -> npt.NDArray[np.float64] | None:
        """Return the owned residual at zero displacement if K is available. Collective.

        The array is kept: the caller must not change it. It is replaced when data change.
        """
        return self._load_unless_moved()[0]

    def _load_unless_moved(
        self, moved: bool = False
    ) -> tuple[npt.NDArray[np.float64] | None, bool]:
        """Return `affine_load`, and whether ``moved`` is set on any rank. Collective."""
        if not self.linear or self._K is None:
            return None, moved
        mark = _checksum(self._loads)
        outdated, loaded, moved = anywhere(
            self.comm,
            _checksum(self._data) != self._K_mark,
            self._f is None or mark != self._f_mark,
            moved,
        )
        if outdated:
            return None, moved
        if loaded:
            self._f = self._load()
            self._f_mark = mark
        return self._f, moved

    def product(self, u: npt.NDArray[np.float64]) -> npt.NDArray[np.float64] | None:
        """Return K u if K is available. Collective."""
        return self.times(u) if self._is_current() else None

    def _is_current(self) -> bool:
        """Return whether K is constant and belongs to the present data. Collective."""
        if not self.linear or self._K is None:
            return False
        return self._same(_checksum(self._data), self._K_mark)

    def times(self, u: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the product of the stiffness assembled last with ``u``, owned. Collective."""
        assert self._K is not None
        x = self._K.createVecRight()
        y = self._K.createVecLeft()
        x.array[:] = u[: x.getLocalSize()]
        (self._K if self._half is None else self._half).mult(x, y)
        values = y.array_r.copy()
        x.destroy(), y.destroy()
        return values

    def _load(self) -> npt.NDArray[np.float64]:
        """Return owned entries of the residual at zero displacement. Collective."""
        u = self.displacement
        if self._fact("no residual at rest", lambda: _vanishes(self.residual, u)):
            return np.zeros(self._owned)
        return self.residual_at(np.zeros_like(u.x.array))

    @property
    def stiffness_mark(self) -> int:
        """Checksum on this rank of the data of the stiffness without the displacement."""
        return _checksum([d for d in self._data if d is not self.displacement])

    @property
    def stiffness_data(self) -> list[Any]:
        """Functions and Constants of the stiffness without the displacement."""
        return [d for d in self._data if d is not self.displacement]

    def _same(self, a: int, b: int) -> bool:
        """Return whether two checksums agree on every rank. Collective."""
        return not self.comm.allreduce(int(a != b))

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


#: Properties of forms, by name and content.
_facts: dict[Hashable, Any] = {}


def _vanishes(form: ufl.Form, u: fem.Function) -> bool:
    """Return whether a form vanishes symbolically where ``u`` is zero."""
    none = ufl.classes.Zero(u.ufl_shape)
    return bool(ufl.replace(form, {u: none}).empty())


def _seconds_of_product(K: PETSc.Mat) -> float:
    """Return the shortest time of some products. Collective."""
    x, y = K.createVecs()
    x.set(0.0)
    seconds = []
    for _ in range(_PRODUCTS):
        start = time.perf_counter()
        K.mult(x, y)
        seconds.append(time.perf_counter() - start)
    x.destroy(), y.destroy()
    return min(seconds)


def _require_bulk(bulk: ufl.Form, content: Content | None, u: fem.Function) -> None:
    """Raise ``ValueError`` if a form is neither an energy nor a residual of ``u``."""
    if not isinstance(bulk, ufl.Form):
        raise ValueError(f"the bulk must be a UFL form, got {type(bulk).__name__}")
    functions = bulk.coefficients() if content is None else content.functions
    if not any(f is u for f in functions):
        raise ValueError("the bulk form does not contain the displacement u")
    arguments = bulk.arguments() if content is None else content.arguments
    if len(arguments) > 1 or any(a.ufl_function_space() != u.function_space for a in arguments):
        raise ValueError(
            "the bulk must be an energy (no test function) or a residual with one test function of "
            "the space of the displacement"
        )
