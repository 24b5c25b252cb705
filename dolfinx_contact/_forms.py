# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cache of compiled UFL forms, and evaluation of UFL at points outside quadrature rules.

A look-up in FFCx's cache lists the cache folder, which may contain thousands of files. This package
therefore uses a separate folder for each pair of first characters of a signature.

Within a process, a compiled form is found by the signature of the form from which it is derived, so
that neither derivatives nor signatures are computed again. In a signature, Functions and Constants
are numbered in UFL's order; forms with the same signature differ only in these objects and in their
mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, jit, mesh
from ufl.corealg.traversal import unique_pre_traversal
from ufl.domain import extract_unique_domain

from dolfinx_contact._arrays import Array
from dolfinx_contact._compat import instantiated
from dolfinx_contact._mpi import all_ranks, everywhere

__all__ = [
    "PointValues",
    "ScalarList",
    "at_middle",
    "compiled_expression",
    "compiled_form",
    "derived_form",
    "is_of_cells",
    "point_data",
]

_CHUNK = 256  # number of points evaluated at once
_PARTS = {"cell": "cells", "exterior_facet": "boundary", "interior_facet": "facets between cells"}


def compiled_form(form: ufl.Form, entity_maps: Any = None) -> fem.Form:
    """Compile a form, reusing the result for another form of the same signature. Collective.

    Args:
        form: UFL form to compile.
        entity_maps: entity maps of submeshes in the form; default: none.

    Raises:
        ValueError: if values are complex, integrals of one kind have different tags, which DOLFINx
            does not support, or an integrand that is only defined at the midpoints of cells is
            evaluated at other points.
    """
    return derived_form("itself", form, lambda: form, entity_maps=entity_maps)


@dataclass(frozen=True)
class _Compiled:
    """Compiled form of FFCx, independent of Functions, Constants and meshes.

    Attributes:
        ufcx: compiled form, as returned by the JIT compiler.
        module: Python module of the compiled form.
        functions: indices of its Functions among the Functions of the original form.
        constants: indices of its Constants among the Constants of the original form.
    """

    ufcx: Any
    module: Any
    functions: tuple[int, ...]
    constants: tuple[int, ...]


#: Compiled forms by name and signature.
_compiled: dict[Hashable, _Compiled] = {}


def derived_form(
    name: Hashable,
    original: ufl.Form,
    make: Callable[[], ufl.Form],
    spaces: Sequence[fem.FunctionSpace] | None = None,
    *,
    functions: Sequence[fem.Function] | None = None,
    entity_maps: Any = None,
) -> fem.Form:
    """Compile a form that is derived from another form, using a cache. Collective.

    Args:
        name: unique name of the derived form.
        original: UFL form from which the derived form is made.
        make: function returning the derived form, called only if the form is not in the cache. Its
            result must depend on the original form only.
        spaces: function spaces of the arguments; default: spaces of the original form.
        functions: Functions of the derived form, in the order of the Functions of the original
            form; default: Functions of the original form.
        entity_maps: entity maps of submeshes in the form; default: none.

    Raises:
        ValueError: for the reasons listed in `compiled_form`.
    """
    key = name, original.signature()
    comm = original.integrals()[0].ufl_domain().ufl_cargo().comm
    given = original.coefficients() if functions is None else functions
    constants = original.constants()
    values = [c.value for c in constants if isinstance(c, fem.Constant)]
    values += [f.x.array for f in original.coefficients() if isinstance(f, fem.Function)]
    if any(np.iscomplexobj(v) for v in values):
        raise ValueError("a Constant or Function has complex values: give real ones")
    known = _compiled.get(key) if _tags_agree(original) else None
    if all_ranks(comm, known is not None) and known is not None:
        if spaces is None:
            spaces = [a.ufl_function_space() for a in original.arguments()]
        found = instantiated(
            known.ufcx,
            known.module,
            spaces,
            [given[i] for i in known.functions],
            [constants[i] for i in known.constants],
            original,
            entity_maps,
        )
        if found is not None:
            return found
    form = make()
    found = _compiled_anew(form, entity_maps)
    ufcx = found.ufcx_form
    coefficients = form.coefficients()
    used = [ufcx.original_coefficient_positions[i] for i in range(ufcx.num_coefficients)]
    places = [_place(given, coefficients[i]) for i in used]
    of_constants = [_place(constants, c) for c in form.constants()]
    if -1 not in places and -1 not in of_constants:
        _compiled[key] = _Compiled(ufcx, found.module, tuple(places), tuple(of_constants))
    return found


def _place(things: Sequence[Any], thing: Any) -> int:
    return next((i for i, other in enumerate(things) if other is thing), -1)


def _tags_agree(form: ufl.Form) -> bool:
    """Return whether all integrals are on one mesh, and those of one type share their MeshTags."""
    data = form.subdomain_data()
    kinds = [given for tags in data.values() for given in tags.values()]
    return len(data) == 1 and all(each is given[0] for given in kinds for each in given)


def _compiled_anew(form: ufl.Form, entity_maps: Any) -> fem.Form:
    """Compile a form, or load it from the folder of its signature in the cache. Collective."""
    maps = {} if entity_maps is None else {"entity_maps": entity_maps}
    ((domain, tags),) = form.subdomain_data().items()
    for kind, given in tags.items():
        if any(each is not given[0] for each in given):
            raise ValueError(
                f"integrals over the {_PARTS.get(kind, kind)} have tags, and others have none or "
                "different ones: use one measure, ufl.Measure('dx', domain, subdomain_data=tags), "
                "for all of them; without the number of a tag it covers everything"
            )
    if any(is_of_cells(i.integrand()) and not _at_middle(i) for i in form.integrals()):
        raise ValueError(
            "the stress of a mean dilatation is known only at the midpoints of cells, where an "
            'integral has to evaluate it: dx(metadata={"quadrature_degree": 1})'
        )
    form = _without_one_point_beside_others(form)
    with _compiler_named(domain.ufl_cargo().comm):
        return fem.form(form, jit_options=_folder(form.signature()[:2]), **maps)


def compiled_expression(e: Any, points: Array, comm: MPI.Comm | None = None) -> fem.Expression:
    """Compile a UFL expression for points of the reference cell. Collective.

    Args:
        e: UFL expression to evaluate.
        points: points of the reference cell.
        comm: communicator; default: communicator of the mesh.
    """
    with _compiler_named(comm or extract_unique_domain(e).ufl_cargo().comm):
        return fem.Expression(e, points, comm=comm, jit_options=_folder("expressions"))


def at_middle(dim: int) -> dict[str, Any]:
    """Return metadata of a one-point rule at the midpoint of quadrilaterals or hexahedra.

    The rule has a second point nearby with zero weight. Without this point, FFCx (0.9, 0.11) treats
    quantities that are constant over the points of the rule, such as the Jacobian, as constant for
    all rules of an integral. The values of all these rules are then wrong on cells that are not
    parallelograms.

    Args:
        dim: dimension of the cells.
    """
    return {
        "quadrature_rule": "custom",
        "quadrature_points": ((0.5,) * dim, (0.51,) * dim),
        "quadrature_weights": (1.0, 0.0),
    }


def is_of_cells(e: Any) -> bool:
    """Return whether a UFL expression contains volume changes of whole cells (`_cell_volumes`).

    These are only defined at the midpoints of cells.
    """
    kinds = {ufl.classes.CellVertices, ufl.classes.Grad}
    determinants = [n for n in unique_pre_traversal(e) if isinstance(n, ufl.classes.Determinant)]
    return any([kinds <= {type(part) for part in unique_pre_traversal(d)} for d in determinants])


def _at_middle(integral: ufl.Integral) -> bool:
    """Return whether an integral over cells is evaluated at their midpoints."""
    if integral.integral_type() != "cell":
        return False
    rule = integral.metadata()
    if rule.get("quadrature_rule") != "custom":
        return _has_one_point(integral)
    weighted = zip(rule["quadrature_points"], rule["quadrature_weights"], strict=True)
    return all(w == 0 or all(x == 0.5 for x in point) for point, w in weighted)


def _without_one_point_beside_others(form: ufl.Form) -> ufl.Form:
    """Replace one-point rules that FFCx would mix with other rules by the rule `at_middle`.

    Raises:
        ValueError: if FFCx would mix rules and `at_middle` does not help: on facets, where FFCx
            (0.11) also adds up such rules wrongly, for custom rules, and for other cells than
            quadrilaterals and hexahedra.
    """
    mixed = [
        len(form.integrals_by_type(integral.integral_type())) > 1 and _has_one_point(integral)
        for integral in form.integrals()
    ]
    if not any(mixed):
        return form
    integrals = []
    for integral, is_mixed in zip(form.integrals(), mixed, strict=True):
        if is_mixed:
            topology = integral.ufl_domain().ufl_cargo().topology
            cell = topology.cell_type.name
            own = integral.metadata().get("quadrature_rule") == "custom"
            over_cells = integral.integral_type() == "cell"
            if own or not over_cells or cell not in ("quadrilateral", "hexahedron"):
                raise ValueError(
                    "an integral with one quadrature point is combined with integrals of other "
                    f"rules over {'' if over_cells else 'facets of '}cells that are not affine "
                    f"({cell}), which FFCx does not compile correctly: use quadrature_degree 2"
                )
            integral = integral.reconstruct(metadata=at_middle(topology.dim))
        integrals.append(integral)
    return ufl.Form(integrals)


def _has_one_point(integral: ufl.Integral) -> bool:
    """Return whether an integral over non-affine cells has a prescribed one-point rule."""
    domain = integral.ufl_domain()
    simplex = domain.ufl_cargo().topology.cell_type.name in ("interval", "triangle", "tetrahedron")
    if simplex and domain.ufl_coordinate_element().degree == 1:
        return False
    rule = integral.metadata()
    kind = rule.get("quadrature_rule", "default")
    if kind == "custom":
        return len(rule["quadrature_points"]) == 1
    degree = rule.get("quadrature_degree", -1)
    return kind in ("default", "Gauss-Jacobi", "GJ") and degree in (0, 1)


@contextmanager
def _compiler_named(comm: MPI.Comm) -> Iterator[None]:
    """Context manager that adds a hint about the C compiler to errors of FFCx. Collective."""
    # Only rank 0 compiles and receives the error.
    with everywhere(comm, "compiling a form"):
        try:
            yield
        except Exception as error:
            kinds = ("CompileError", "LinkError", "PlatformError")  # in messages of cffi
            if not any(kind in str(error) for kind in kinds):
                raise
            raise RuntimeError(
                "FFCx could not compile a form. It needs a C compiler (gcc, or the one that CC "
                "names) and the headers of Python (Python.h): apt install gcc libc6-dev "
                f"python3-dev, or conda install c-compiler. The error was: {error}"
            ) from error


def _folder(name: str) -> dict[str, Any]:
    cache: Path = jit.get_options()["cache_dir"]
    return {"cache_dir": cache / "dolfinx_contact" / name}


# -- values at points ------------------------------------------------------------------------------
# The points are the cells of a small mesh, with one value of each datum per cell. The code that is
# compiled therefore does not depend on a discretisation.


def point_data(width: int) -> fem.Function:
    """Return a Function whose values on a cell are ``width`` data of one point."""
    points = mesh.create_interval(MPI.COMM_SELF, _CHUNK, (0.0, 1.0))
    element = basix.ufl.element("DG", "interval", 0, shape=(width,))
    return fem.Function(fem.functionspace(points, element))


class ScalarList:
    """List of the scalar components of UFL expressions."""

    def __init__(self) -> None:
        self.components: list[Any] = []

    def add(self, expression: Any) -> list[int]:
        """Append the components of an expression and return their indices."""
        e = ufl.as_ufl(expression)
        first = len(self.components)
        self.components += [e[i] for i in np.ndindex(e.ufl_shape)] if e.ufl_shape else [e]
        return list(range(first, len(self.components)))


class PointValues:
    """Compiled UFL scalars, evaluated at any number of points. Only construction is collective.

    The points are evaluated in batches as large as the number of cells of the mesh of ``w``.

    Args:
        components: UFL scalars that depend on the components of ``w``.
        w: Function with the data of a point, one component per datum; see `point_data`.
        comm: communicator of the ranks that compile together.
    """

    def __init__(self, components: Sequence[Any], w: fem.Function, comm: MPI.Comm):
        self.components = list(components)
        self._w = w
        self._mesh = w.function_space.mesh
        self._dofs = w.function_space.dofmap.list[:, 0]
        middle = np.array([[0.5]])
        self._compiled = compiled_expression(ufl.as_vector(self.components), middle, comm)

    def __call__(self, columns: Array) -> Array:
        """Return the values of the scalars at n points, shape (n, number of scalars).

        Args:
            columns: data of the points, one row per point, shape (n, components of ``w``).
        """
        n = len(columns)
        chunk = len(self._dofs)
        width = len(self.components)
        given = self._w.x.array.reshape(chunk, -1)
        found = np.empty((n, width))
        for a in range(0, n, chunk):
            part = columns[a : a + chunk]
            given[self._dofs[: len(part)]] = part
            cells = np.arange(len(part), dtype=np.int32)
            found[a : a + chunk] = self._compiled.eval(self._mesh, cells).reshape(len(part), width)
        return found
