# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cache of compiled UFL whose look-up time does not grow with the number of entries.

A look-up in FFCx's cache lists its folder, which may contain thousands of files. This cache has a
folder for every first two letters of a signature.

Within a process, compiled forms are found by the content of the form from which they are derived
(`content_of`). Then neither a signature nor a derivative is computed.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, jit
from ufl.corealg.traversal import unique_pre_traversal
from ufl.domain import extract_unique_domain

from dolfinx_contact._compat import domains_of, instantiated
from dolfinx_contact._mpi import everywhere

__all__ = [
    "Content",
    "Part",
    "at_middle",
    "compiled_expression",
    "compiled_form",
    "content_by",
    "content_of",
    "derived_form",
    "is_of_cells",
]

_PARTS = {"cell": "cells", "exterior_facet": "boundary", "interior_facet": "facets between cells"}


def compiled_form(form: ufl.Form, entity_maps: Any = None) -> fem.Form:
    """Compile a form, reusing the result for another form of the same content. Collective.

    Args:
        form: UFL form.
        entity_maps: entity maps of submeshes in the form; default: none.

    Raises:
        ValueError: if values are complex, integrals of one kind have different tags, which DOLFINx
            does not support, or an integrand that is only defined at the middles of cells is
            evaluated at other points.
    """
    content = content_of(form)
    arguments = form.arguments() if content is None else content.arguments
    spaces = [a.ufl_function_space() for a in arguments]
    comm = form.integrals()[0].ufl_domain().ufl_cargo().comm
    return derived_form("itself", content, lambda: form, spaces, comm=comm, entity_maps=entity_maps)


def _compiled_anew(form: ufl.Form, entity_maps: Any) -> fem.Form:
    """Compile a form, using the cache by signature. Collective."""
    maps = {} if entity_maps is None else {"entity_maps": entity_maps}
    values = [c.value for c in form.constants() if isinstance(c, fem.Constant)]
    values += [f.x.array for f in form.coefficients() if isinstance(f, fem.Function)]
    if any(np.iscomplexobj(v) for v in values):
        raise ValueError("a Constant or Function has complex values: give real ones")
    ((domain, tags),) = form.subdomain_data().items()
    for kind, given in tags.items():
        if any(each is not given[0] for each in given):
            raise ValueError(
                f"integrals over the {_PARTS.get(kind, kind)} have tags, and others have none or "
                "other ones: take one measure, ufl.Measure('dx', domain, subdomain_data=tags), for "
                "all of them; without a number it is over all"
            )
    if any(is_of_cells(i.integrand()) and not _at_middle(i) for i in form.integrals()):
        raise ValueError(
            "the stress of a mean dilatation is known at the middles of cells alone, where an "
            'integral over it has to take it: dx(metadata={"quadrature_degree": 1})'
        )
    form = _without_one_point_beside_others(form)
    with _compiler_named(domain.ufl_cargo().comm):
        return fem.form(form, jit_options=_folder(form.signature()[:2]), **maps)


@dataclass(frozen=True)
class Part:
    """Measure of an integral.

    Attributes:
        kind: type of the integral, such as ``cell``.
        number: identifier of the subdomain.
        metadata: metadata of the quadrature rule.
        domain: UFL mesh.
        tags: subdomain data.
    """

    kind: str
    number: Any
    metadata: Any
    domain: Any
    tags: Any

    @classmethod
    def of(cls, it: ufl.Integral | ufl.Measure) -> Part:
        """Return the measure of an integral or a UFL measure."""
        return cls(
            it.integral_type(),
            it.subdomain_id(),
            it.metadata(),
            it.ufl_domain(),
            it.subdomain_data(),
        )


@dataclass(frozen=True)
class Content:
    """Content of UFL, independent of the identity of its Functions, Constants and meshes.

    The key lists every node of the expressions with its type and the numbers of its operands, in
    the order of traversal. A Function is represented by its element and mesh, a Constant by its
    shape, a mesh by its coordinate element, and all of these, as well as indices and labels, by a
    number assigned at the first occurrence. Two keys are thus equal only if the expressions become
    equal when these objects are exchanged number by number. Derived and compiled forms of one are
    then valid for the other with its Functions and Constants in their places. Numbers that are not
    Constants are contained in the key with all digits.

    Attributes:
        key: key of the content.
        functions: Functions in the order of their numbers.
        constants: Constants in the order of their numbers.
        arguments: arguments by their numbers.
        parts: measures of the integrals.
    """

    key: Hashable
    functions: tuple[fem.Function, ...]
    constants: tuple[fem.Constant, ...]
    arguments: tuple[Any, ...]
    parts: tuple[Part, ...]

    def with_function(self, old: fem.Function, new: fem.Function) -> Content:
        """Return the content with another Function of the same space, with its own key."""
        place = _place(self.functions, old)
        functions = [*self.functions[:place], new, *self.functions[place + 1 :]]
        return replace(self, key=(self.key, place), functions=tuple(functions))


def content_of(form: ufl.Form) -> Content | None:
    """Return the content of a form; None if it cannot be determined."""
    return content_by(
        [i.integrand() for i in form.integrals()], [Part.of(i) for i in form.integrals()]
    )


def content_by(expressions: Sequence[Any], parts: Sequence[Part]) -> Content | None:
    """Return the content of expressions integrated over parts of one mesh.

    It is None for operators that are not UFL's or hold more than their operands, for integrals over
    several meshes, and for metadata other than strings and numbers.
    """
    if not parts or any(part.domain is not parts[0].domain for part in parts):
        return None
    writer = _Writer()
    try:
        written = [writer.write(e) for e in expressions]
        where = [
            (part.kind, _plain(part.number), writer.domain(part.domain), _plain(part.metadata))
            for part in parts
        ]
    except _UnknownError:
        return None
    key = tuple(writer.words), tuple(written), tuple(where), writer.order()
    return Content(
        key,
        tuple(writer.functions),
        tuple(writer.constants),
        tuple(sorted(writer.arguments, key=lambda a: a.number())),
        tuple(parts),
    )


class _UnknownError(Exception):
    """UFL that `_Writer` does not support."""


class _Writer:
    """Writer of the keys of expressions, node by node; see `Content`."""

    def __init__(self) -> None:
        self.words: list[Hashable] = []
        # first of several objects that UFL considers equal, with its number
        self.functions: dict[fem.Function, int] = {}
        self.constants: dict[fem.Constant, int] = {}
        self.arguments: dict[Any, int] = {}
        self._places: dict[int, int] = {}  # numbers of the nodes
        self._domains: dict[int, tuple[Any, int]] = {}
        self._indices: dict[int, int] = {}
        self._labels: dict[int, int] = {}

    def write(self, e: Any) -> int:
        """Return the number of an expression, after those of its operands."""
        places = self._places
        left = [e]
        while left:
            node = left[-1]
            if id(node) in places:
                left.pop()
                continue
            operands = node.ufl_operands
            missing = [o for o in operands if id(o) not in places]
            if missing:
                left += missing
                continue
            left.pop()
            if node._ufl_is_terminal_:
                word = self._terminal(node)
            elif _is_plain_operator(type(node)):
                word = type(node), *[places[id(o)] for o in operands]
            else:
                raise _UnknownError
            places[id(node)] = len(self.words)
            self.words.append(word)
        return places[id(e)]

    def domain(self, domain: Any) -> Hashable:
        """Return the key of a mesh."""
        if type(domain) is not ufl.Mesh:
            raise _UnknownError
        if id(domain) not in self._domains:
            self._domains[id(domain)] = domain, len(self._domains)
        return self._domains[id(domain)][1], domain.ufl_coordinate_element()

    def order(self) -> Hashable:
        """Return UFL's order of the numbered objects, which determines derived forms."""
        indices = list(self._indices)
        return (
            _ranks([f.count() for f in self.functions]),
            _ranks([repr(c) for c in self.constants]) if len(self.constants) > 1 else (),
            _ranks([c.count() for c in self.constants]),
            _ranks(indices),
            _ranks(list(self._labels)),
            _ranks([repr(d) for d, _ in self._domains.values()]) if len(self._domains) > 1 else (),
        )

    def _terminal(self, node: Any) -> Hashable:
        kind = type(node)
        if kind is fem.Function:
            space = node.ufl_function_space()
            word = self.domain(space.ufl_domain()), space.ufl_element(), node.dtype
            return kind, _number(self.functions, node), word
        if kind is fem.Constant:
            return (
                kind,
                _number(self.constants, node),
                node.ufl_shape,
                self.domain(node.ufl_domain()),
                node.dtype,
            )
        if kind is ufl.Argument:
            space = node.ufl_function_space()
            return (
                kind,
                _number(self.arguments, node),
                node.number(),
                node.part(),
                self.domain(space.ufl_domain()),
                space.ufl_element(),
            )
        if kind is ufl.classes.MultiIndex:
            return kind, *[self._index(i) for i in node]
        if kind is ufl.classes.Zero:
            free = [_number(self._indices, i) for i in node.ufl_free_indices]
            return kind, node.ufl_shape, *free, node.ufl_index_dimensions
        if kind is ufl.classes.Label:
            return kind, _number(self._labels, node.count())
        if isinstance(node, ufl.classes.ScalarValue):
            return kind, repr(node.value())
        if isinstance(node, ufl.classes.GeometricQuantity) and _is_of_ufl(kind):
            (domain,) = domains_of(node)
            return kind, self.domain(domain)
        if kind in (ufl.classes.Identity, ufl.classes.PermutationSymbol):
            return kind, node.ufl_shape
        raise _UnknownError

    def _index(self, i: Any) -> Hashable:
        if isinstance(i, ufl.classes.Index):
            return "free", _number(self._indices, i.count())
        return int(i)


def _number(known: dict[Any, int], thing: Any) -> int:
    return known.setdefault(thing, len(known))


def _ranks(values: list[Any]) -> tuple[int, ...]:
    return tuple(sorted(range(len(values)), key=values.__getitem__))


def _is_of_ufl(kind: type) -> bool:
    return kind.__module__.startswith("ufl.")


def _is_plain_operator(kind: type) -> bool:
    """Return whether operators of a type are determined by their operands."""
    return _is_of_ufl(kind) and not issubclass(kind, ufl.classes.BaseFormOperator)


def _plain(value: Any) -> Hashable:
    """Return strings and numbers with their types, so that 1, 1.0 and True differ."""
    if isinstance(value, dict):
        return "dict", *[(k, _plain(value[k])) for k in sorted(value)]
    if isinstance(value, tuple | list):
        return "list", *[_plain(v) for v in value]
    if value is None or isinstance(value, str | int | float):
        return type(value), repr(value)
    raise _UnknownError


@dataclass(frozen=True)
class _Compiled:
    """Compiled form of FFCx, independent of Functions, Constants and meshes.

    Attributes:
        ufcx: compiled form.
        module: compiled module.
        functions: numbers of the Functions of `Content` that it takes, in its order.
        constants: numbers of the Constants of `Content` that it takes, in its order.
    """

    ufcx: Any
    module: Any
    functions: tuple[int, ...]
    constants: tuple[int, ...]


#: Compiled forms by name and content.
_compiled: dict[Hashable, _Compiled] = {}


def derived_form(
    what: str,
    content: Content | None,
    make: Callable[[], ufl.Form],
    spaces: Sequence[fem.FunctionSpace],
    *,
    comm: MPI.Comm,
    entity_maps: Any = None,
) -> fem.Form:
    """Compile a form that is derived from UFL of a given content. Collective.

    Args:
        what: unique name of the derived form.
        content: content of the UFL; None if it could not be determined.
        make: function that returns the derived form, called unless it is in the cache; its result
            must depend on the content only.
        spaces: function spaces of the arguments.
        comm: communicator.
        entity_maps: entity maps of submeshes in the form; default: none.

    Raises:
        ValueError: as `compiled_form`.
    """
    known = None
    if content is not None and _tags_agree(content.parts):
        known = _compiled.get((what, content.key))
    here = known is not None
    if comm.size > 1:
        here = bool(comm.allreduce(int(here), op=MPI.MIN))
    if here and known is not None and content is not None:
        found = instantiated(
            known.ufcx,
            known.module,
            spaces,
            [content.functions[i] for i in known.functions],
            [content.constants[i] for i in known.constants],
            [(part.kind, part.number, part.tags) for part in content.parts],
            content.parts[0].domain.ufl_cargo(),
            entity_maps,
        )
        if found is not None:
            return found
    form = make()
    found = _compiled_anew(form, entity_maps)
    if content is not None:
        _remember((what, content.key), content, form, found)
    return found


def _remember(key: Hashable, content: Content, form: ufl.Form, found: fem.Form) -> None:
    """Store a compiled form if it depends on its content only."""
    ufcx = found.ufcx_form
    coefficients = form.coefficients()
    positions = [ufcx.original_coefficient_positions[i] for i in range(ufcx.num_coefficients)]
    functions = [_place(content.functions, coefficients[i]) for i in positions]
    constants = [_place(content.constants, c) for c in form.constants()]
    if -1 not in functions and -1 not in constants:
        _compiled[key] = _Compiled(ufcx, found.module, tuple(functions), tuple(constants))


def _place(things: Sequence[Any], thing: Any) -> int:
    return next((i for i, other in enumerate(things) if other is thing), -1)


def _tags_agree(parts: Sequence[Part]) -> bool:
    """Return whether integrals of one kind have the same tags."""
    first: dict[str, Any] = {}
    return all(first.setdefault(part.kind, part.tags) is part.tags for part in parts)


def compiled_expression(
    e: Any, points: npt.NDArray[np.float64], comm: MPI.Comm | None = None
) -> fem.Expression:
    """Compile an expression at points of the reference cell. Collective.

    Args:
        e: UFL expression.
        points: points of the reference cell.
        comm: communicator; default: that of the mesh.
    """
    with _compiler_named(comm or extract_unique_domain(e).ufl_cargo().comm):
        return fem.Expression(e, points, comm=comm, jit_options=_folder("expressions"))


def at_middle(dim: int) -> dict[str, Any]:
    """Return metadata of a one-point rule at the middle of quadrilaterals or hexahedra.

    A second point nearby has zero weight. FFCx (0.9, 0.11) treats quantities that are constant over
    the points of one rule, such as the Jacobian at a single point, as constant for all rules of an
    integral. Combined with another rule, a rule of one point makes both values wrong for cells that
    are not parallelograms.

    Args:
        dim: dimension of the cells.
    """
    return {
        "quadrature_rule": "custom",
        "quadrature_points": ((0.5,) * dim, (0.51,) * dim),
        "quadrature_weights": (1.0, 0.0),
    }


def is_of_cells(e: Any) -> bool:
    """Return whether UFL contains volume changes of cells (`_cell_volumes`).

    These are only defined at the middles of cells.
    """
    kinds = {ufl.classes.CellVertices, ufl.classes.Grad}
    return any(
        isinstance(node, ufl.classes.Determinant)
        and kinds <= {type(part) for part in unique_pre_traversal(node)}
        for node in unique_pre_traversal(e)
    )


def _at_middle(integral: ufl.Integral) -> bool:
    """Return whether an integral is over cells, evaluated at their middles."""
    if integral.integral_type() != "cell":
        return False
    rule = integral.metadata()
    if rule.get("quadrature_rule") != "custom":
        return _has_one_point(integral)
    weighted = zip(rule["quadrature_points"], rule["quadrature_weights"], strict=True)
    return all(w == 0 or all(x == 0.5 for x in point) for point, w in weighted)


def _without_one_point_beside_others(form: ufl.Form) -> ufl.Form:
    """Return the form with `at_middle` in place of one-point rules that FFCx would mix.

    Raises:
        ValueError: if FFCx would mix rules and `at_middle` does not help: on facets, where FFCx
            (0.11) also adds up such rules wrongly, for custom rules, and for other cells.
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
                    "an integral that is taken by one point stands beside integrals by other "
                    f"rules over {'' if over_cells else 'facets of '}cells that are not affine "
                    f"({cell}), which FFCx does not compile correctly: take quadrature_degree 2"
                )
            integral = integral.reconstruct(metadata=at_middle(topology.dim))
        integrals.append(integral)
    return ufl.Form(integrals)


def _has_one_point(integral: ufl.Integral) -> bool:
    """Return whether a given rule has one point, on cells that are not affine."""
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
    """Add a hint on the C compiler to errors of FFCx, on every rank. Collective."""
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
