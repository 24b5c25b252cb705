# SPDX-License-Identifier: LGPL-3.0-or-later
"""The body without contact: its residual and its stiffness, assembled once where they are linear.

A residual that is affine in the displacement (by what it is made of, `_affine`) is K u + f with K
and f that change only when the user's data do. Both are kept, and thrown away when a coefficient, a
Constant or the mesh differs from what it was.

A residual with kinks is nonlinear, and its derivative is that of the side at which a state lies:
Newton's method is semismooth there, as it is for contact. A residual that jumps has in general no
root that Newton's method could find: friction is a law of a surface.
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

from dolfinx_contact._affine import dependence, has_branches, is_affine
from dolfinx_contact._forms import Content, content_of, derived_form
from dolfinx_contact._petsc import half_of
from dolfinx_contact._shared import SharedValues, anywhere
from dolfinx_contact.materials import materials_in

__all__ = ["Bulk", "circumference", "weighted"]

Array = npt.NDArray[np.float64]

_PRODUCTS = 2  # that are timed
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
    """Residual and stiffness of a body, at displacements that are arguments.

    Displacements are arrays of all local values, ghosts included.

    Args:
        form: UFL energy (a functional of ``u``) or residual (linear in a test function).
        u: the user's displacement, which occurs in the form and is neither read nor written.

    What follows from the form alone, as whether it is affine, is found once for all forms that say
    the same (`_forms.content_of`), and its derivatives are written out where somebody reads them.

    Attributes:
        energy: the UFL energy, or None; in ``displacement``, as the residual is.
        residual: the UFL residual.
        is_energy: whether the form is an energy.
        displacement: Function of the forms, which follows what is evaluated.
        functions, constants: of the residual, the displacement among them, in the order of UFL.
        residual_form, jacobian_form: compiled.
        jacobian_constants: Constants of the stiffness.
        linear: whether the residual is affine in ``u``.
        kinks: parts of the form with kinks or jumps in ``u``, as text; "" if there are none.

    Raises:
        ValueError: on every rank, if ``form`` is neither an energy nor a residual of ``u``.
    """

    #: Whether motions are resisted by mass.
    has_mass = False
    #: Largest displacement at the start of a step of time, on this rank.
    reach = 0.0

    def __init__(self, form: ufl.Form, u: fem.Function):
        self._V = u.function_space
        self.comm = u.function_space.mesh.comm
        content = content_of(form) if isinstance(form, ufl.Form) else None
        _require_bulk(form, content, u)
        #: Those that the package made, as the user's form has them.
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
        # Without branches the derivative alone decides, which is known already. The derivative of
        # an energy that jumps has no term of the jump, so that the form itself is asked as well.
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
        #: Where the stiffness was multiplied last by `affine_residual`, and the product (owned).
        self._product = _NOWHERE
        self._rest: tuple[int, float] | None = None  # energy at zero displacement
        #: How many times the stiffness was assembled.
        self.assemblies = 0
        #: Seconds of the first assembly of the stiffness, and of a product with it, on this rank.
        self.seconds = (0.0, 0.0)

    # -- forms -----------------------------------------------------------------------------------

    @cached_property
    def _form(self) -> ufl.Form:
        """The user's form in `displacement`."""
        form, u = self._given
        return ufl.replace(form, {u: self.displacement})

    @property
    def energy(self) -> ufl.Form | None:
        """The UFL energy, in `displacement`; None if a residual was given."""
        return self._form if self.is_energy else None

    @cached_property
    def residual(self) -> ufl.Form:
        """The UFL residual, in `displacement`."""
        if not self.is_energy:
            return self._form
        return ufl.derivative(self._form, self.displacement, ufl.TestFunction(self._V))

    @cached_property
    def _derivative(self) -> ufl.Form:
        return ufl.derivative(self.residual, self.displacement, ufl.TrialFunction(self._V))

    def _derived(self, what: str, make: Callable[[], ufl.Form], rank: int) -> fem.Form:
        """One of the forms of this body, compiled. Collective."""
        spaces = [self._V] * rank
        return derived_form(f"{what} of a body", self._content, make, spaces, comm=self.comm)

    def _fact(self, what: str, find: Callable[[], _Fact]) -> _Fact:
        """What follows from what the form says, and from nothing else."""
        if self._content is None:
            return find()
        key = what, self._content.key
        if key not in _facts:
            _facts[key] = find()
        found: _Fact = _facts[key]
        return found

    def _given_in_derivative(self) -> tuple[list[fem.Function], list[fem.Constant]]:
        """Coefficients and Constants of the derivative once it is taken."""

        def find() -> tuple[list[int], list[int]]:
            expanded = ufl.algorithms.expand_derivatives(self._derivative)
            return (
                [self.functions.index(f) for f in expanded.coefficients()],
                [self.constants.index(c) for c in expanded.constants()],
            )

        functions, constants = self._fact("what the Jacobian depends on", find)
        return [self.functions[i] for i in functions], [self.constants[i] for i in constants]

    def loaded(self, load: ufl.Form) -> Bulk:
        """This body with a load beside: a form in a test function, without the displacement."""
        own = self.displacement
        if not self.is_energy:
            made = Bulk(self.residual + load, own)
        else:
            (test,) = load.arguments()
            made = Bulk(self._form + ufl.replace(load, {test: own}), own)
        made.materials = self.materials  # its form is not the one that they made
        return made

    @property
    def has_changed(self) -> bool:
        """Whether Functions of the forms are others on this rank than for `update_ghosts`."""
        return _checksum(self._others) != self._others_mark

    def update_ghosts(self) -> None:
        """Let the ghosts of Functions in the forms follow their owners. Collective."""
        for f in self._others:
            f.x.scatter_forward()
        self._others_mark = _checksum(self._others)

    def energy_at(self, u: npt.NDArray[np.float64]) -> float | None:
        """The energy that the user gave; None if it was a residual. Collective."""
        if not self.is_energy:
            return None
        rows = self.affine_residual(u)
        if rows is None:
            return self._assembled_energy(u)
        # Of a linear body it is that at rest and the work of the mean forces since.
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
        """Owned entries of the residual, by assembly. Collective."""
        return self.assembled(self.residual_form, u)

    def local_rows(self, u: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Rows of the residual, (n, dim), whose sum over all ranks is that of all. Collective.

        Of a linear body by its stiffness where that is kept, which is cheaper than assembly.
        """
        rows = self.affine_residual(u)
        # Every rank's contributions count once, whoever owns the rows.
        rows = self._local(self.residual_form, u).array.copy() if rows is None else rows
        return np.asarray(rows).reshape(-1, self._V.dofmap.index_map_bs)

    def assembled(self, form: fem.Form, u: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Owned entries of a linear form in `displacement`. Collective."""
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
        """K(u) (g - start), g what ``bcs`` prescribe and start elsewhere. Collective."""
        self.displacement.x.array[:] = u
        b = self._rows.zeros(self._V.dofmap.index_map_bs)
        fem.apply_lifting(b.array, [self.jacobian_form], [list(bcs)], x0=[start], alpha=-1.0)
        b.scatter_reverse(la.InsertMode.add)
        return b.array[: self._owned].copy()

    def stiffness(self, u: npt.NDArray[np.float64]) -> PETSc.Mat:
        """Derivative of the residual at ``u``, without Dirichlet rows. Collective.

        It is assembled where what it depends on has changed since, which ``u`` may be among. The
        matrix is kept: the caller neither changes nor destroys it.
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
        """The stiffness assembled last, by half where it stays and is symmetric. Collective.

        For many products: it is made in the time of some tens of them.
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
        """K u + f at the owned values of a displacement, if K is at hand. Collective.

        Args:
            u: local values of the displacement, ghosts included.

        Returns:
            Owned entries; None if the body is not linear or its stiffness has changed, so that the
            residual is cheaper assembled than multiplied.
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
        """The residual at zero displacement (owned), if K is at hand. Collective.

        It is kept: the caller does not change it, and it is another array once the data are others.
        """
        return self._load_unless_moved()[0]

    def _load_unless_moved(
        self, moved: bool = False
    ) -> tuple[npt.NDArray[np.float64] | None, bool]:
        """See `affine_load`; and whether anything has ``moved`` on any rank. Collective."""
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
        """K u, as `affine_residual`. Collective."""
        return self.times(u) if self._is_current() else None

    def _is_current(self) -> bool:
        """Whether K is that of all displacements, and of the data as they are. Collective."""
        if not self.linear or self._K is None:
            return False
        return self._same(_checksum(self._data), self._K_mark)

    def times(self, u: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """The stiffness assembled last times ``u`` (owned). Collective."""
        assert self._K is not None
        x = self._K.createVecRight()
        y = self._K.createVecLeft()
        x.array[:] = u[: x.getLocalSize()]
        (self._K if self._half is None else self._half).mult(x, y)
        values = y.array_r.copy()
        x.destroy(), y.destroy()
        return values

    def _load(self) -> npt.NDArray[np.float64]:
        """Owned entries of the residual at zero displacement. Collective."""
        u = self.displacement
        if self._fact("no residual at rest", lambda: _vanishes(self.residual, u)):
            return np.zeros(self._owned)
        return self.residual_at(np.zeros_like(u.x.array))

    @property
    def stiffness_mark(self) -> int:
        """A checksum, on this rank, of all that the stiffness depends on but the displacement."""
        return _checksum([d for d in self._data if d is not self.displacement])

    @property
    def stiffness_data(self) -> list[Any]:
        """Functions and Constants that the stiffness depends on but the displacement."""
        return [d for d in self._data if d is not self.displacement]

    def _same(self, a: int, b: int) -> bool:
        """Whether two marks agree on every rank."""
        return not self.comm.allreduce(int(a != b))

    def destroy(self) -> None:
        """Free the matrices."""
        self._forget_half()
        if self._K is not None:
            self._K.destroy()
            self._K = None


def _checksum(data: Sequence[fem.Function | fem.Constant]) -> int:
    """Checksum of the values of data on this rank."""
    mark = 0
    for d in data:
        values = d.value if isinstance(d, fem.Constant) else d.x.array
        mark = zlib.crc32(np.ascontiguousarray(values), mark)
    return mark


#: By what is known, and what a form says.
_facts: dict[Hashable, Any] = {}


def _vanishes(form: ufl.Form, u: fem.Function) -> bool:
    """Whether nothing is left of a form where ``u`` is zero, by what it is made of."""
    none = ufl.classes.Zero(u.ufl_shape)
    return bool(ufl.replace(form, {u: none}).empty())


def _seconds_of_product(K: PETSc.Mat) -> float:
    """The least of some products. Collective."""
    x, y = K.createVecs()
    x.set(0.0)
    found = []
    for _ in range(_PRODUCTS):
        start = time.perf_counter()
        K.mult(x, y)
        found.append(time.perf_counter() - start)
    x.destroy(), y.destroy()
    return min(found)


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
