# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Whether the integrals of a body of revolution carry the weight 2 pi r.

Each integral over a section represents one over the body, so that 2 pi r must be a factor
of it. Two things are checked, term by term of every integrand.

- Symbolically: a factor k r, written as x[0] or otherwise (`abs`, a Function of the values r), with
  2 pi beside it is right; without 2 pi it is refused. Whether a number contains 2 pi shows where
  it is, or is over 2 pi, a fraction of small numbers (5000/13 times 2 pi is one with 2 pi).
- Else by numbers, cell by cell: the second derivative in u, and the part linear in u, along (r, 0)
  and (1, 1). Of a homogeneous body the former is that of a uniform strain, so that over the right
  weight it is the same in all cells, as a homogeneous load along (1, 1) is; of a sum without weight
  it varies like 1/r, of one with the weight r^2 like r.

A missing constant factor shows nowhere in numbers: what does not vary is a doubt, not a proof.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, mesh
from ufl.algorithms import expand_derivatives, extract_coefficients
from ufl.algorithms.analysis import extract_constants
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.corealg.traversal import unique_pre_traversal

from dolfinx_contact._errors import require
from dolfinx_contact._forms import compiled_form

__all__ = ["check_circumference", "refuse_revolution"]

logger = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]

_ROUND_OFF = 1e-12  # relative, of numbers that stand in a form
_SAME = 1e-6  # relative, of the integrals of cells
_DENOMINATOR = 10**4  # up to which a fraction is one of small numbers
_TERMS = 256  # of an integrand, beyond which it is not looked through
_PLACES = {
    "cell": "cells",
    "exterior_facet": "exterior facets",
    "interior_facet": "interior facets",
}
_PLANE = (
    "the contact surfaces are plane: make them with axisymmetric=True, or take a plane material "
    "and no materials.circumference"
)
#: What is evaluated of expressions in the coordinates.
_EVALUATED = (
    ufl.classes.SpatialCoordinate
    | ufl.classes.ConstantValue
    | ufl.classes.MultiIndex
    | ufl.classes.Indexed
    | ufl.classes.Sum
    | ufl.classes.Product
    | ufl.classes.Division
    | ufl.classes.Power
    | ufl.classes.Abs
    | ufl.classes.MathFunction
    | ufl.classes.MinValue
    | ufl.classes.MaxValue
    | ufl.classes.Conditional
    | ufl.classes.Condition
)
_WAY = "multiply each integrand by materials.circumference(mesh), which is 2 pi r"
_TWO_PI = 2 * np.pi


def check_circumference(form: ufl.Form, u: fem.Function, what: str = "the bulk") -> None:
    """Refuse integrals of a body of revolution without the weight 2 pi r. Collective.

    Where neither the form nor its values decide, it warns.

    Args:
        form: energy, or residual with a test function.
        u: displacement (u_r, u_z).
        what: the form is, for messages.

    Raises:
        ValueError: on every rank, if x[0] is the weight of an integral with no 2 pi beside it, or
            its values over 2 pi r vary like r or 1/r, or a part of the body has no hoop strain.
    """
    comm = u.function_space.mesh.comm
    weights = _Weights(u)
    _require_hoop_strain(form, u, what)
    doubts = []
    for integral in _terms(form):
        if not _depends_on(integral.integrand(), u):
            continue
        where = f"{what}: an integral over {_place(integral)}"
        found = weights.verdict(integral.integrand())
        if found == "no 2 pi":
            raise ValueError(
                f"{where} of a body of revolution has the weight x[0] with no 2 pi beside it; "
                f"{_WAY}"
            )
        if found == "rounded":
            doubts.append(f"{where} has a weight in which 2 pi is rounded; {_WAY}")
        elif found == "not decided":
            variation = _variation(integral, u)
            require(
                comm,
                variation is None,
                f"{where} of a body of revolution has not the weight 2 pi r: over that it varies "
                f"like {variation}; {_WAY}",
            )
            doubts.append(
                f"{where} of a body of revolution: not decided whether it has the weight 2 pi r, "
                "which is no factor of it; over 2 pi r it does not vary like r or 1/r, but a "
                f"missing constant factor shows nowhere; {_WAY}"
            )
    if comm.rank == 0:
        for words in dict.fromkeys(doubts):
            logger.warning("%s", words)


def refuse_revolution(form: ufl.Form, u: fem.Function) -> None:
    """``ValueError`` if the bulk of plane surfaces is that of a body of revolution. Collective.

    That is one in which the displacement over r, a hoop strain, occurs.
    """
    if u.function_space.mesh.geometry.dim != 2 or not _knows_place(form, u):
        return
    weights = _Weights(u)
    around = [i for i in form.integrals() if weights.has_hoop_strain(i.integrand())]
    for integral in around:
        # A load over r is none.
        if any(weights.has_hoop_strain(i.integrand()) for i in _stiffness([integral], u)):
            raise ValueError(
                f"the bulk: an integral over {_place(integral)} has the hoop strain u[0]/x[0] of a "
                f"body of revolution, but {_PLANE}"
            )
    for integral in _terms(form):
        if integral.integral_type() != "cell" or not _stiffness([integral], u):
            continue
        if weights.verdict(integral.integrand()) == "right":
            raise ValueError(
                f"the bulk: an integral over {_place(integral)} has the weight 2 pi x[0] of a body "
                f"of revolution, but {_PLANE}"
            )


# -- forms ---------------------------------------------------------------------------------------


def _terms(form: ufl.Form) -> Iterator[ufl.Integral]:
    """Integrals of the terms of a form, compound operators written out."""
    for integral in apply_algebra_lowering(form).integrals():
        left = [integral.integrand()]
        while left:
            e = left.pop(0)
            if isinstance(e, ufl.classes.Sum):
                left = [*e.ufl_operands, *left]
            else:
                yield integral.reconstruct(integrand=e)


def _place(integral: ufl.Integral) -> str:
    kind = _PLACES.get(integral.integral_type(), integral.integral_type())
    name = integral.subdomain_id()
    return kind if name in ("everywhere", "otherwise") else f"the {kind} {name}"


def _depends_on(e: Any, u: fem.Function) -> bool:
    """Whether a displacement or a test function occurs."""
    return any(n is u or isinstance(n, ufl.classes.Argument) for n in unique_pre_traversal(e))


def _require_hoop_strain(form: ufl.Form, u: fem.Function, what: str) -> None:
    """``ValueError`` if the stiffness of a part of the cells has gradients of u alone."""
    resisting: dict[Any, ufl.Integral] = {}
    around: set[Any] = set()
    cells = [i for i in form.integrals() if i.integral_type() == "cell"]
    for integral in _stiffness(cells, u):
        names = integral.subdomain_id()
        names = names if isinstance(names, tuple) else (names,)
        resisting |= {name: integral for name in names}
        around |= set(names) if _has_bare_argument(integral.integrand()) else set()
    if {"everywhere", "otherwise"} & around:
        return
    for name, integral in resisting.items():
        if name not in around:
            raise ValueError(
                f"{what} is that of a plane body over {_place(integral)}, where it has no hoop "
                "strain u[0]/r, but the contact surfaces are axisymmetric: take "
                "materials.Axisymmetric, and materials.circumference(mesh) as the weight of its "
                "energy"
            )


def _stiffness(integrals: list[ufl.Integral], u: fem.Function) -> list[ufl.Integral]:
    """Integrals of the derivative of the residual, taken."""
    form = ufl.Form(integrals)
    residual = form if form.arguments() else ufl.derivative(form, u)
    return list(expand_derivatives(ufl.derivative(residual, u)).integrals())


def _knows_place(form: ufl.Form, u: fem.Function) -> bool:
    """Whether the radius may occur in a form: as a coordinate, or as the values of a Function."""
    nodes = (n for i in form.integrals() for n in unique_pre_traversal(i.integrand()))
    return any(
        isinstance(n, ufl.classes.SpatialCoordinate)
        or (isinstance(n, ufl.classes.Coefficient) and n is not u)
        for n in nodes
    )


def _has_bare_argument(e: Any) -> bool:
    """Whether an argument of a form occurs outside of gradients."""
    if isinstance(e, ufl.classes.Argument):
        return e.number() == 1
    if isinstance(e, ufl.classes.Grad):
        return False
    return any(_has_bare_argument(part) for part in e.ufl_operands)


# -- factors -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Factor:
    """The factor ``number`` r^``power`` of a term; denominators are left out."""

    number: float = 1.0
    power: int = 0

    def __mul__(self, other: _Factor) -> _Factor:
        return _Factor(self.number * other.number, self.power + other.power)


_NONE = frozenset({_Factor()})


class _Weights:
    """Factors that are powers of r in UFL expressions on a section.

    Args:
        u: displacement of the section.
    """

    def __init__(self, u: fem.Function):
        self._u = u
        self._domain = u.function_space.mesh
        comm = self._domain.comm
        x = self._domain.geometry.x
        low = np.array(
            [comm.allreduce(float(x[:, i].min(initial=np.inf)), op=MPI.MIN) for i in (0, 1)]
        )
        high = np.array(
            [comm.allreduce(float(x[:, i].max(initial=-np.inf)), op=MPI.MAX) for i in (0, 1)]
        )
        shares = ((0.31, 0.83), (0.57, 0.29), (0.83, 0.61), (0.97, 0.43))
        self._points = [low + np.array(s) * (high - low) for s in shares]
        self._given: dict[Any, _Factor | None] = {}  # of Constants and Functions

    def verdict(self, term: Any) -> str:
        """The finding on a term's weight: right, no 2 pi, rounded, or not decided. Collective."""
        found = self.factors(term)
        if found is None or any(f.power < 1 for f in found):
            return "not decided"
        words = {_has_two_pi(f.number) for f in found}
        return next((w for w in ("no 2 pi", "not decided", "rounded") if w in words), "right")

    def factors(self, e: Any) -> frozenset[_Factor] | None:
        """Factors of all terms of a scalar or tensor; None if they are too many. Collective."""
        if isinstance(e, ufl.classes.Zero):
            return frozenset()
        parts = e.ufl_operands
        if isinstance(e, ufl.classes.Product):
            return self._products(parts)
        if isinstance(e, ufl.classes.Division):
            return self._quotients(*parts)
        radial = self._fitted(e)
        if radial is not None:
            return frozenset({radial})
        if isinstance(e, ufl.classes.Sum | ufl.classes.ListTensor):
            return self._union(parts)
        if isinstance(e, ufl.classes.Conditional):
            return self._union(parts[1:])
        if isinstance(e, ufl.classes.Power) and isinstance(parts[1], ufl.classes.IntValue):
            times = int(parts[1])
            return self._products([parts[0]] * times) if 1 <= times <= 8 else _NONE
        through = (
            ufl.classes.ComponentTensor
            | ufl.classes.Indexed
            | ufl.classes.IndexSum
            | ufl.classes.Variable
            | ufl.classes.Restricted
            | ufl.classes.CoefficientDerivative
            | ufl.classes.VariableDerivative
        )
        if isinstance(e, ufl.classes.Indexed):
            tensor, (index, *more) = parts[0], parts[1].indices()
            if isinstance(tensor, ufl.classes.ListTensor) and isinstance(
                index, ufl.core.multiindex.FixedIndex
            ):
                row = tensor.ufl_operands[int(index)]
                return self.factors(row[tuple(more)] if more else row)
        return self.factors(parts[0]) if isinstance(e, through) else _NONE

    def _products(self, parts: Any) -> frozenset[_Factor] | None:
        known = []
        for part in parts:
            found = self.factors(part)
            if found is None:
                return None
            known.append(found)
        if np.prod([len(found) for found in known], dtype=float) > _TERMS:
            return None
        return frozenset(_multiplied(several) for several in product(*known))

    def _quotients(self, above: Any, below: Any) -> frozenset[_Factor] | None:
        if any(isinstance(n, ufl.classes.CellVertices) for n in unique_pre_traversal(below)):
            return _NONE  # a change of the volume of a cell
        found = self.factors(above)
        if found is None or not isinstance(below, ufl.classes.ScalarValue):
            return found
        return frozenset(f * _Factor(abs(1.0 / float(below))) for f in found)

    def _union(self, parts: Any) -> frozenset[_Factor] | None:
        whole: frozenset[_Factor] = frozenset()
        for part in parts:
            found = self.factors(part)
            if found is None:
                return None
            whole |= found
        return whole if len(whole) <= _TERMS else None

    def _fitted(self, e: Any) -> _Factor | None:
        """K r^n, n >= 0, of an expression that holds the coordinates alone, or None. Collective."""
        if e.ufl_shape or e.ufl_free_indices:
            return None
        given: dict[Any, Any] = {}
        for node in unique_pre_traversal(e):
            if isinstance(node, fem.Constant | fem.Function):
                factor = self._of_given(node)
                if factor is None:
                    return None
                given[node] = lambda x, f=factor: f.number * x[0] ** f.power
            elif not isinstance(node, _EVALUATED):
                return None
        try:
            values = np.array([float(e(tuple(p), given)) for p in self._points])
        except (ArithmeticError, TypeError, ValueError):  # not real, or not defined at all points
            return None
        r = np.array([p[0] for p in self._points])
        return _power_of(r, values, MPI.COMM_SELF)

    def _of_given(self, f: fem.Constant | fem.Function) -> _Factor | None:
        """K r^n of a scalar Constant or Function, or None. Collective."""
        if f not in self._given and f is not self._u and not f.ufl_shape:
            found = self._of_values(f)
            # What has no 2 pi in it is the user's affair.
            if found is not None and _has_two_pi(found.number) in ("right", "rounded"):
                # A single field 2 pi r^2 is rather a wrong weight than a right one times r.
                found = _Factor(_TWO_PI, found.power) if found.power <= 1 else None
            elif found is not None:
                found = _Factor(1.0, found.power)
            self._given[f] = found
        return self._given.get(f)

    def _of_values(self, f: fem.Constant | fem.Function) -> _Factor | None:
        if isinstance(f, fem.Constant):
            return _Factor(abs(float(f.value)))
        r = fem.Function(f.function_space)
        try:
            r.interpolate(lambda x: x[:1])
        except RuntimeError:  # of an element without points
            return None
        return _power_of(r.x.array, f.x.array, self._domain.comm)

    # -- hoop strain -----------------------------------------------------------------------------

    def has_hoop_strain(self, e: Any) -> bool:
        """Whether the displacement, not its gradient, is divided by a multiple of r. Collective."""
        for node in unique_pre_traversal(e):
            if isinstance(node, ufl.classes.Division):
                above, below = node.ufl_operands
                if _is_bare(above, self._u) and self._is_radius(below):
                    return True
            elif isinstance(node, ufl.classes.Product):
                for a, b in (node.ufl_operands, node.ufl_operands[::-1]):
                    if _is_bare(a, self._u) and self._is_radius(_inverse(b)):
                        return True
        return False

    def _is_radius(self, e: Any) -> bool:
        factor = None if e is None else self._fitted(e)
        return factor is not None and factor.power == 1


def _inverse(e: Any) -> Any:
    """The denominator e of 1/e or e^-1, or None."""
    if isinstance(e, ufl.classes.Division):
        return e.ufl_operands[1]
    if isinstance(e, ufl.classes.Power):
        base, exponent = e.ufl_operands
        return (
            base
            if isinstance(exponent, ufl.classes.ScalarValue) and float(exponent) == -1
            else None
        )
    return None


def _is_bare(e: Any, u: fem.Function) -> bool:
    """Whether an expression is a component of the displacement, once, times something."""
    return _occurrences(e, u) == 1


def _occurrences(e: Any, u: fem.Function) -> int:
    if isinstance(e, ufl.classes.Product):
        return sum(_occurrences(part, u) for part in e.ufl_operands)
    if isinstance(e, ufl.classes.Indexed):
        whole = e.ufl_operands[0]
        return int(whole is u or isinstance(whole, ufl.classes.Argument))
    return 0


def _multiplied(factors: tuple[_Factor, ...]) -> _Factor:
    whole = _Factor()
    for f in factors:
        whole *= f
    return whole


def _power_of(r: Array, values: Array, comm: MPI.Comm) -> _Factor | None:
    """K r^n, n = 0, 1, ..., of the values on all ranks, or None. Collective."""
    largest = comm.allreduce(float(np.abs(r).max(initial=0.0)), op=MPI.MAX)
    off = np.abs(r) > 1e-9 * largest
    for n in range(4):
        low, high = _range(comm, values[off] / r[off] ** n)
        size = max(abs(low), abs(high))
        if not np.isfinite(size) or size == 0.0:
            return None
        if high - low <= 1e-9 * size:
            at_axis = high if n == 0 else 0.0
            same = bool(np.all(np.abs(values[~off] - at_axis) <= 1e-9 * size))
            return _Factor(size, n) if comm.allreduce(same, op=MPI.LAND) else None
    return None


def _range(comm: MPI.Comm, values: Array) -> tuple[float, float]:
    """Smallest and largest value of all ranks; not finite if one is not, or there is none."""
    mine = np.array([np.inf, np.inf])
    if len(values):
        mine = np.array([values.min(), -values.max()])
    low, high = np.min(comm.allgather(mine), axis=0)
    return float(low), float(-high)


def _has_two_pi(number: float) -> str:
    """Whether a number contains 2 pi: right, rounded, no 2 pi, or not decided."""
    if number == 0.0 or not np.isfinite(number):
        return "not decided"
    over = number / _TWO_PI
    if _is_fraction(over):
        return "right"
    nearest = min((0.5, 1.0), key=lambda m: abs(over / m - 1))
    if abs(over / nearest - 1) < 1e-3:
        return "right" if abs(over / nearest - 1) < 1e-6 else "rounded"
    return "no 2 pi" if _is_fraction(number) else "not decided"


def _is_fraction(number: float) -> bool:
    """Whether a positive number is a fraction of small numbers times a power of ten."""
    mantissa = number / 10.0 ** np.floor(np.log10(number))
    near = Fraction(mantissa).limit_denominator(_DENOMINATOR)
    return abs(float(near) / mantissa - 1) < _ROUND_OFF / 100


# -- values --------------------------------------------------------------------------------------


def _variation(integral: ufl.Integral, u: fem.Function) -> str | None:
    """How the values of an integral vary over 2 pi r, "r" or "1/r"; None for anything else.

    Functions in it may vary themselves, and one of them may be the weight: it is checked whether
    anything is constant where all, all but one, or none are replaced by their means. What is zero
    by now, as a load that sets in later, counts as 1. Collective.
    """
    if integral.integral_type() not in ("cell", "exterior_facet"):
        return None
    domain = u.function_space.mesh
    z = ufl.TestFunction(fem.functionspace(domain, ("Discontinuous Lagrange", 0)))
    x = ufl.SpatialCoordinate(domain)
    weights = [
        _cell_values(integral.reconstruct(integrand=z * x[0] ** m, metadata={})) for m in range(3)
    ]
    given = [f for f in extract_coefficients(integral.integrand()) if f is not u]
    copies = {f: f.copy() for f in given}
    set_in = {
        c: _ones(domain, c) for c in extract_constants(integral.integrand()) if not np.any(c.value)
    }
    here = fem.Function(u.function_space)
    along = fem.Function(u.function_space)
    e = integral.integrand()
    # The weight is neither in normals nor in sizes of cells, which are no matter of r.
    plain = {
        node: ufl.as_vector([1.0, 1.0]) if node.ufl_shape else ufl.as_ufl(1.0)
        for node in unique_pre_traversal(e)
        if isinstance(node, ufl.classes.GeometricQuantity) and node.ufl_shape in ((), (2,))
        if not isinstance(node, ufl.classes.SpatialCoordinate)
    }
    tests = {a: along for a in ufl.algorithms.extract_arguments(e)}
    form = ufl.replace(ufl.Form([integral]), {u: here, **tests, **copies, **set_in, **plain})
    form = ufl.Form([i.reconstruct(integrand=z * i.integrand()) for i in form.integrals()])
    first = form if tests else ufl.derivative(form, here, along)
    # Along (r, 0) a load without weight looks like one with it; what resists a strain does not.
    probes = [_uniform, _radial] if _has_gradient(e) else [_uniform]
    for form in (ufl.derivative(first, here, along), first):
        found = _kinds(expand_derivatives(form), along, copies, weights, probes)
        if found & {"r", "1/r"} and "constant" not in found:
            return "r" if "r" in found else "1/r"
    return None


def _uniform(x: Array) -> Array:
    return np.ones((2, x.shape[1]))


def _radial(x: Array) -> Array:
    return np.stack([x[0], np.zeros_like(x[0])])


def _has_gradient(e: Any) -> bool:
    nodes = unique_pre_traversal(expand_derivatives(e))
    return any(isinstance(n, ufl.classes.Grad) for n in nodes)


def _kinds(
    form: ufl.Form,
    along: fem.Function,
    copies: dict[Any, fem.Function],
    weights: list[Array],
    probes: Sequence[Callable[[Array], Array]],
) -> set[str]:
    """How the values vary along (r, 0) and (1, 1), with Functions as they are and as means."""
    if form.empty():
        return set()
    comm = along.function_space.mesh.comm
    compiled = compiled_form(form)
    found = set()
    choices = [[], *([f] for f in copies), list(copies)]
    for live in choices:
        for f, copy in copies.items():
            copy.x.array[:] = _values(f) if f in live else _means(f)
        for probe in probes:
            along.interpolate(probe)
            kind = _kind(comm, _assembled(compiled), weights)
            if kind == "constant" or (kind and not live):
                found.add(kind)
    return found


def _ones(domain: mesh.Mesh, c: fem.Constant) -> fem.Constant:
    """A Constant of the shape of another."""
    return fem.Constant(domain, np.ones(c.ufl_shape) if c.ufl_shape else 1.0)


def _values(f: fem.Function) -> Array:
    """Values of a Function on this rank, 1 where it is zero on all ranks. Collective."""
    vanishes = f.function_space.mesh.comm.allreduce(not np.any(f.x.array), op=MPI.LAND)
    return np.ones_like(f.x.array) if vanishes else np.asarray(f.x.array)


def _means(f: fem.Function) -> Array:
    bs = f.function_space.dofmap.index_map_bs
    comm = f.function_space.mesh.comm
    n = f.function_space.dofmap.index_map.size_local
    mine = _values(f)[: n * bs].reshape(-1, bs)
    sums = comm.allreduce(np.append(mine.sum(axis=0), len(mine)))
    return np.asarray(np.tile(sums[:-1] / sums[-1], len(f.x.array) // bs))


def _kind(comm: MPI.Comm, values: Array, weights: list[Array]) -> str:
    """Which weight the values of cells have: "1/r" for none, "constant", "r" for r^2, or ""."""
    fits = []
    for name, weight in zip(("1/r", "constant", "r"), weights, strict=True):
        largest = comm.allreduce(float(weight.max(initial=0.0)), op=MPI.MAX)
        inside = weight > _ROUND_OFF * largest
        low, high = _range(comm, values[inside] / weight[inside])
        size = max(abs(low), abs(high))
        if np.isfinite(size) and size > 0.0 and high - low <= _SAME * size:
            fits.append(name)
    return fits[0] if len(fits) == 1 else ""


def _cell_values(integral: ufl.Integral) -> Array:
    return _assembled(compiled_form(ufl.Form([integral])))


def _assembled(form: fem.Form) -> Array:
    """Integrals of the owned cells. Collective."""
    b = fem.assemble_vector(form)
    index_map = form.function_spaces[0].dofmap.index_map
    return np.array(b.array[: index_map.size_local])
