# SPDX-License-Identifier: LGPL-3.0-or-later
"""The body without contact: its residual and its stiffness, assembled once where they are linear.

A residual that is affine in the displacement is K u + f with K and f that change only when the
user's data do. Both are kept, and thrown away when a coefficient, a Constant or the mesh differs
from what it was.
"""

from __future__ import annotations

import time
import zlib
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import dolfinx.fem.petsc
import ufl
from dolfinx import fem, la

from dolfinx_contact._petsc import half_of

__all__ = ["Bulk"]

_PRODUCTS = 4  # that are timed


class Bulk:
    """Residual and stiffness of a body.

    Args:
        form: UFL energy (a functional of ``u``) or residual (linear in a test function).
        u: displacement.

    Attributes:
        energy: the UFL energy, or None.
        residual: the UFL residual.
        residual_form, jacobian_form: compiled.
        linear: whether the residual is affine in ``u``.

    Raises:
        ValueError: if ``form`` is neither an energy nor a residual of ``u``.
    """

    def __init__(self, form: ufl.Form, u: fem.Function):
        self.u, self.comm = u, u.function_space.mesh.comm
        self.energy, self.residual = _energy_and_residual(form, u)
        derivative = ufl.derivative(self.residual, u, ufl.TrialFunction(u.function_space))
        self.residual_form = fem.form(self.residual)
        self.jacobian_form = fem.form(derivative)
        expanded = ufl.algorithms.expand_derivatives(derivative)
        self.linear: bool = u not in expanded.coefficients()
        self._data = [*expanded.coefficients(), *expanded.constants()]
        self._loads = [c for c in self.residual.coefficients() if c is not u]
        self._loads += self.residual.constants()
        self._K: PETSc.Mat | None = None
        self._half: PETSc.Mat | None = None
        self._K_mark = self._f_mark = 0
        self._f: npt.NDArray[np.float64] | None = None
        #: How many times the stiffness was assembled.
        self.assemblies = 0
        #: Seconds of the first assembly of the stiffness, and of a product with it, on this rank.
        self.seconds = (0.0, 0.0)

    def stiffness(self) -> PETSc.Mat:
        """Derivative of the residual at ``u``, without Dirichlet rows. Collective.

        The matrix is kept: the caller neither changes nor destroys it.
        """
        mark = self._mark(self._data)
        if self._K is None:
            self._K = dolfinx.fem.petsc.create_matrix(self.jacobian_form)
        elif self.linear and self._same(mark, self._K_mark):
            return self._K
        start = time.perf_counter()
        self._K.zeroEntries()
        dolfinx.fem.petsc.assemble_matrix(self._K, self.jacobian_form)
        self._K.assemble()
        if self.assemblies == 0:
            self.seconds = time.perf_counter() - start, _seconds_of_product(self._K)
        self._forget_half()
        self._K_mark = mark
        self.assemblies += 1
        return self._K

    @property
    def for_products(self) -> PETSc.Mat:
        """The stiffness assembled last, by half where it stays and is symmetric. Collective."""
        assert self._K is not None
        if not self.linear or self.energy is None:
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
        values = self.product(u)
        if values is None:
            return None
        mark = self._mark(self._loads)
        if self._f is None or not self._same(mark, self._f_mark):
            self._f, self._f_mark = self._load(), mark
        return np.asarray(values + self._f)

    def product(self, u: npt.NDArray[np.float64]) -> npt.NDArray[np.float64] | None:
        """K u, as `affine_residual`. Collective."""
        if not self.linear or self._K is None:
            return None
        if not self._same(self._mark(self._data), self._K_mark):
            return None
        x, y = self._K.createVecRight(), self._K.createVecLeft()
        x.array[:] = u[: x.getLocalSize()]
        self.for_products.mult(x, y)
        values = y.array_r.copy()
        x.destroy(), y.destroy()
        return values

    def _load(self) -> npt.NDArray[np.float64]:
        """Owned entries of the residual at zero displacement. Collective."""
        V = self.u.function_space
        kept = self.u.x.array.copy()
        self.u.x.array[:] = 0.0
        b = la.vector(V.dofmap.index_map, V.dofmap.index_map_bs)
        b.array[:] = 0.0
        fem.assemble_vector(b.array, self.residual_form)
        b.scatter_reverse(la.InsertMode.add)
        self.u.x.array[:] = kept
        return b.array[: V.dofmap.index_map.size_local * V.dofmap.index_map_bs].copy()

    def _mark(self, data: list[Any]) -> int:
        """A checksum of the values of ``data`` and of the mesh, on this rank."""
        mark = zlib.crc32(np.ascontiguousarray(self.u.function_space.mesh.geometry.x))
        for d in data:
            values = d.value if isinstance(d, fem.Constant) else d.x.array
            mark = zlib.crc32(np.ascontiguousarray(values), mark)
        return mark

    def _same(self, a: int, b: int) -> bool:
        """Whether two marks agree on every rank."""
        return not self.comm.allreduce(int(a != b))

    def destroy(self) -> None:
        """Free the matrices."""
        self._forget_half()
        if self._K is not None:
            self._K.destroy()
            self._K = None


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


def _energy_and_residual(bulk: ufl.Form, u: fem.Function) -> tuple[ufl.Form | None, ufl.Form]:
    if not isinstance(bulk, ufl.Form):
        raise ValueError(f"the bulk must be a UFL form, got {type(bulk).__name__}")
    if u not in bulk.coefficients():
        raise ValueError("the bulk form does not contain the displacement u")
    arguments = bulk.arguments()
    if len(arguments) == 0:
        return bulk, ufl.derivative(bulk, u, ufl.TestFunction(u.function_space))
    if len(arguments) == 1 and arguments[0].ufl_function_space() == u.function_space:
        return None, bulk
    raise ValueError(
        "the bulk must be an energy (no test function) or a residual with one test function of the "
        "space of the displacement"
    )
