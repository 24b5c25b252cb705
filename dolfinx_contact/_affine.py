# SPDX-License-Identifier: LGPL-3.0-or-later
r"""How UFL depends on a Function, a Constant or a variable: by what it is made of, not by samples.

An expression E is walked from its terminals up, once its algebra is lowered and its derivatives are
taken. Every node is absent of v, a polynomial in v of some degree, kinked (continuous, as |v|),
jumping (as the sign of v), or anything else:

    sums                      the worst of their terms
    products                  degrees add up; a kinked or jumping factor makes them that
    quotients                 as the numerator where the denominator is absent of v
    powers                    degrees are multiplied by a whole exponent >= 1
    abs, max_value, min_value of what holds v are kinked
    sign, and a conditional   whose condition holds v, whatever its arms, are jumping
    parts, sums over indices, gradients, restrictions pass through; else it is anything else

*Affine* is of degree 1 at most. A second derivative that vanishes is not the test: it vanishes on
both sides of a kink. Nor are samples, between which anything may be.

What jumps by its form may be continuous: max_value(v, 0)**2 has the derivative 2 max_value(v, 0) c
with a condition c. `jumps_in` compares values on both sides of the border of every condition.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

import ufl
from dolfinx import fem, mesh
from ufl import classes
from ufl.algorithms import expand_derivatives, expand_indices, extract_coefficients
from ufl.algorithms.apply_restrictions import apply_restrictions
from ufl.algorithms.remove_complex_nodes import remove_complex_nodes
from ufl.corealg.traversal import unique_post_traversal, unique_pre_traversal

__all__ = ["Dependence", "Kind", "dependence", "has_branches", "is_affine", "jumps_in"]

Array = npt.NDArray[np.float64]


class Kind(IntEnum):
    """Kinds of dependence, the worse the larger."""

    ABSENT = 0
    POLYNOMIAL = 1
    KINKED = 2
    JUMPING = 3
    OTHER = 4


@dataclass(frozen=True)
class Dependence:
    """How an expression depends on something.

    Attributes:
        kind: of the whole.
        degree: of a polynomial; 0 of what is absent.
        node: the first part of it that is of the kind, where it is no polynomial.
        kinks: all parts that are kinked or jumping by themselves, whatever the whole is.
    """

    kind: Kind
    degree: int = 0
    node: Any = None
    kinks: tuple[Any, ...] = ()

    @property
    def is_affine(self) -> bool:
        """Whether it is a polynomial of degree 1 at most."""
        return self.kind <= Kind.POLYNOMIAL and self.degree <= 1

    @property
    def text(self) -> str:
        """The node that made it so, for messages."""
        if self.kind == Kind.POLYNOMIAL:
            return "" if self.degree <= 1 else f"degree {self.degree}"
        return "" if self.node is None else _text(self.node)

    @property
    def text_of_kinks(self) -> str:
        """The outermost kinks, for messages; "" if there are none."""
        shown: list[Any] = []
        for node in reversed(self.kinks):
            if not any(node in set(unique_pre_traversal(other)) for other in shown):
                shown.append(node)
        return " and ".join(dict.fromkeys(_text(node) for node in shown[:_SHOWN]))


def dependence(e: Any, *terminals: Any) -> Dependence:
    """How an expression or a form depends on Functions, Constants or variables, taken together.

    Args:
        e: UFL expression of any shape, or form.
        terminals: what may change, or components of it; a ``ufl.variable`` counts as a whole.
    """
    labels = {t.ufl_operands[1] for t in terminals if isinstance(t, classes.Variable)}
    wanted = {t for t in terminals if not isinstance(t, classes.Variable)}
    found = Dependence(Kind.ABSENT)
    for integrand in _integrands(expand_derivatives(_as_ufl(e))):
        part = _walked(integrand, wanted, labels)
        if part.kinks and not labels:
            # Of a vector or tensor only some components may be used.
            part = Dependence(Kind.ABSENT)
            for component in _components(remove_complex_nodes(integrand)):
                part = _joined(part, _walked(expand_indices(component), wanted, labels))
        found = _joined(found, part)
    return found


def is_affine(form: ufl.Form, terminal: Any) -> bool:
    """Whether a form is affine in one of its Functions or Constants; forms are known again.

    Args:
        form: of any rank.
        terminal: a Function or a Constant, which need not be in the form.
    """
    constants = isinstance(terminal, fem.Constant)
    among = form.constants() if constants else form.coefficients()
    places = [i for i, t in enumerate(among) if t == terminal]
    if not places:
        return True
    key = form.signature(), constants, places[0]
    if key not in _known:
        _known[key] = dependence(form, terminal).is_affine
    return _known[key]


def has_branches(form: ufl.Form) -> bool:
    """Whether anything in a form may have kinks or jump: without that its derivatives have none."""
    return any(
        isinstance(node, _BRANCHING)
        for integral in form.integrals()
        for node in unique_pre_traversal(integral.integrand())
    )


_BRANCHING = classes.Conditional | classes.Abs | classes.MaxValue | classes.MinValue
#: By signature, kind of terminal and its place.
_known: dict[tuple[str, bool, int], bool] = {}


def _as_ufl(e: Any) -> Any:
    return e if isinstance(e, ufl.Form) else ufl.as_ufl(e)


def _integrands(e: Any) -> list[Any]:
    return [i.integrand() for i in e.integrals()] if isinstance(e, ufl.Form) else [e]


def _components(e: Any) -> list[Any]:
    """The components of an expression; one that is a scalar itself."""
    return [e[index] if index else e for index in np.ndindex(e.ufl_shape)]


def _text(node: Any) -> str:
    """A node as users write it, where that is short."""
    words = str(node)
    if isinstance(node, classes.Conditional) and isinstance(node.ufl_operands[0], classes.EQ):
        of = node.ufl_operands[0].ufl_operands[0]
        if node == ufl.sign(of):
            words = f"sign({of})"
    return words if len(words) <= _LONGEST else f"{words[:_LONGEST]}..."


_SHOWN = 2  # kinks in a message
_LONGEST = 120  # letters of a node in a message


# -- the walk --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Part:
    """What is known of a node: kind, degree, and the node that made it so."""

    kind: Kind
    degree: int = 0
    node: Any = None


_ABSENT = _Part(Kind.ABSENT)
_THROUGH = (
    classes.Sum,
    classes.Indexed,
    classes.ListTensor,
    classes.ComponentTensor,
    classes.IndexSum,
    classes.Variable,
    classes.Restricted,
    classes.CellAvg,
    classes.FacetAvg,
    classes.Grad,
    classes.ReferenceGrad,
    classes.ReferenceValue,
    classes.Conj,
    classes.Real,
    classes.Imag,
)


def _joined(a: Dependence, b: Dependence) -> Dependence:
    """That of a sum."""
    worst = max(a, b, key=lambda d: (d.kind, d.degree))
    return Dependence(worst.kind, worst.degree, worst.node, (*a.kinks, *b.kinks))


def _order(part: _Part) -> tuple[int, int]:
    return part.kind, part.degree


def _walked(e: Any, terminals: set[Any], labels: set[Any]) -> Dependence:
    """The dependence of an expression without derivatives but those of terminals."""
    known: dict[Any, _Part] = {}
    kinks: list[Any] = []
    for node in unique_post_traversal(e):
        if (
            isinstance(node, classes.Variable) and node.ufl_operands[1] in labels
        ) or node in terminals:
            known[node] = _Part(Kind.POLYNOMIAL, 1)
        elif not node.ufl_operands:
            known[node] = _ABSENT
        else:
            known[node] = part = _combined(node, [known[o] for o in node.ufl_operands])
            if part.node is node and part.kind in (Kind.KINKED, Kind.JUMPING):
                kinks.append(node)
    part = known[e]
    return Dependence(part.kind, part.degree, part.node, tuple(kinks))


def _combined(node: Any, parts: list[_Part]) -> _Part:
    """What a node is, of what its operands are."""
    if all(p.kind == Kind.ABSENT for p in parts):
        return _ABSENT
    if isinstance(node, _THROUGH):
        return max(parts, key=_order)
    if isinstance(node, classes.Product | classes.Inner | classes.Dot | classes.Outer):
        worst = max(parts, key=_order)
        if worst.kind > Kind.POLYNOMIAL:
            return worst
        return _Part(Kind.POLYNOMIAL, sum(p.degree for p in parts))
    if isinstance(node, classes.Division):
        numerator, denominator = parts
        return numerator if denominator.kind == Kind.ABSENT else _Part(Kind.OTHER, node=node)
    if isinstance(node, classes.Power):
        return _power(node, parts[0])
    if isinstance(node, classes.Conditional):
        condition, *arms = parts
        if condition.kind == Kind.ABSENT:
            return max(arms, key=_order)
        return _Part(Kind.JUMPING, node=node)
    if isinstance(node, classes.Condition):
        return max(parts, key=_order)  # its conditional shows what it makes of it
    if isinstance(node, classes.Abs | classes.MaxValue | classes.MinValue):
        worst = max(parts, key=_order)
        return worst if worst.kind > Kind.KINKED else _Part(Kind.KINKED, node=node)
    return _Part(Kind.OTHER, node=node)


def _power(node: Any, base: _Part) -> _Part:
    """A power of which the base or the exponent hold v."""
    exponent = node.ufl_operands[1]
    if not isinstance(exponent, classes.RealValue):
        return _Part(Kind.OTHER, node=node)
    number = float(exponent)
    if number != round(number) or number < 1:
        return _Part(Kind.OTHER, node=node)
    if base.kind > Kind.POLYNOMIAL:
        return base
    return _Part(Kind.POLYNOMIAL, base.degree * round(number))


# -- jumps -----------------------------------------------------------------------------------------

_EQUAL = 1e-10  # of the values around, up to which two sides of a border agree
_PLACES = 4  # of an integral and a rank, at which they are compared, but where data differ
_LOOKED_AT = 20_000  # places at which data are evaluated
_PATTERNS = 32  # such directions
_SIZES = (1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e3)  # of v and its gradient beside the border
_WAYS = 2  # to the border, of each size
_REACH = 10.0 ** np.arange(-15, 12.25, 0.25)  # how far borders are looked for
_MOST = 400  # borders that are met
_HALVINGS = 110  # of a bracket
_NEAR = 16 * np.finfo(float).eps  # of v, within which values vary by its round-off


@dataclass(frozen=True)
class Jump:
    """A condition at whose border a form has, or may have, two values.

    Attributes:
        node: the condition.
        decided: whether it certainly jumps; else its border was not reached.
    """

    node: Any
    decided: bool

    @property
    def text(self) -> str:
        """The condition, for messages."""
        return _text(self.node)


def jumps_in(form: ufl.Form, v: fem.Function) -> list[Jump]:
    """Conditions of a form in v at whose border it jumps, or might. Collective.

    Both sides of the border of every condition are compared, at points of some cells of every
    integral, with the data as they are there and with any values of v and of its gradient, which
    are moved onto the border. So a derivative of ``max_value(v, 0)**2`` is found continuous and one
    of ``abs(v)`` not.

    Args:
        form: energy, or residual with a test function.
        v: a Function that it depends on.
    """
    comm = v.function_space.mesh.comm
    found = []
    for integral in expand_derivatives(form).integrals():
        e = remove_complex_nodes(integral.integrand())
        if not _walked(e, {v}, set()).kinks:
            continue
        if integral.integral_type().startswith("interior_facet"):
            e = apply_restrictions(integral.reconstruct(integrand=e)).integrand()
        e = expand_indices(e)
        borders = [
            node
            for node in unique_post_traversal(e)
            if isinstance(node, classes.BinaryCondition)
            and not isinstance(node, classes.AndCondition | classes.OrCondition)
            and v in extract_coefficients(node)
        ]
        sides = _Sides(e, v, _covering(e, v, _places(integral, v.function_space.mesh)))
        for border in borders:
            reached, jumps = sides.compare(border)
            reached, jumps = comm.allreduce(np.array([reached, jumps], dtype=np.int64))
            if jumps or not reached:
                found.append(Jump(border, bool(jumps)))
    return found


class _Sides:
    """Values of an expanded scalar integrand on both sides of the borders of its conditions.

    Args:
        e: without indices that are summed over.
        v: what is moved.
        places: cells and points (n,), (n, 3), those of this rank.
        sizes: of v and its gradient.
    """

    def __init__(self, e: Any, v: fem.Function, places: Places, sizes: Sequence[float] = _SIZES):
        self._terms = list(_summands(e))
        self._v = v
        cells, points = places
        samples = len(sizes) * _WAYS
        self._cells = np.repeat(cells, samples)
        self._points = np.repeat(points, samples, axis=0)
        self._size = np.tile(np.repeat(sizes, _WAYS), len(cells))
        self._random = np.random.default_rng(24)
        self._leaves: dict[Any, tuple[Array, Array]] = {}

    def given_signs(self) -> Array:
        """Signs (k, n) at the places of what data make of conditions and fields without v."""
        first = np.arange(0, len(self._cells), _WAYS)
        rows: list[Array] = [np.zeros(len(first))]
        for node in {n: None for t in self._terms for n in unique_post_traversal(t)}:
            held = extract_coefficients(node)
            if self._v in held or isinstance(node, classes.MultiIndex | classes.Label):
                continue
            if type(node) in _COMPARED:
                rows.append(self._value(node, np.zeros(len(first)), first).astype(float))
            elif held and not isinstance(node, classes.Condition) and _is_leaf(node):
                rows.append(np.sign(self._leaf(node)[0][first]))
        return np.stack(rows)

    def compare(self, border: Any) -> tuple[int, int]:
        """How often a border was reached, and how often it was a jump."""
        terms = [t for t in self._terms if border in set(unique_post_traversal(t))]
        reach = np.concatenate([-_REACH[::-1], [0.0], _REACH])
        every = np.arange(len(self._cells))
        if not len(every):
            return 0, 0
        with np.errstate(all="ignore"):
            tried = [self._distance(border, np.full(len(every), s), every) for s in reach]
            distance = np.stack(tried)
            sign = np.sign(distance.T)
            which, k = np.nonzero(sign[:, :-1] != sign[:, 1:])
            both = sign[which, k] + sign[which, k + 1]
            finite = np.isfinite(both)
            which = which[finite][:_MOST]
            k = k[finite][:_MOST]
            low = reach[k]
            high = reach[k + 1]
            below = sign[which, k]
            above = sign[which, k + 1]
            for _ in range(_HALVINGS):
                middle = (low + high) / 2
                same = np.sign(self._distance(border, middle, which)) == below
                low = np.where(same, middle, low)
                high = np.where(same, high, middle)
            return self._jumps(border, terms, which, (low, high), (below, above))

    def _jumps(
        self, border: Any, terms: Sequence[Any], which: Any, ends: Any, signs: Any
    ) -> tuple[int, int]:
        """At how many borders both sides have values, and at how many these differ."""
        low, high = ends
        below, above = signs
        size = np.maximum(np.abs(high), self._size[which])
        turns = below == -above
        before = self._forced(terms, which, low, high, last=False, turns=turns)
        after = self._forced(terms, which, low, high, last=True, turns=turns)
        first = self._sum(terms, low, which, before | {border: below})
        others = [self._sum(terms, high, which, after | {border: above})]
        if isinstance(border, classes.EQ | classes.NE):
            others.append(self._sum(terms, high, which, after | {border: 0.0 * above}))
        off = np.max([np.abs(other - first) for other in others], axis=0)
        # What round-off of v alone makes of the values, and what they are around the border.
        near = _NEAR * size
        steep = np.abs(self._sum(terms, low - near, which, {}) - first)
        steep += np.abs(self._sum(terms, high + near, which, {}) - others[0])
        scale = np.max(np.abs([first, *others]), axis=0)
        for at in (low - size / 2, high + size / 2):
            scale = np.fmax(scale, np.abs(self._sum(terms, at, which, {})))
        finite = np.isfinite(off)
        allowed = _EQUAL * scale + np.where(np.isfinite(steep), 4.0 * steep, 0.0)
        return int(finite.sum()), int(np.sum(off[finite] > allowed[finite]))

    def _forced(
        self, terms: Sequence[Any], which: Any, low: Array, high: Array, *, last: bool, turns: Any
    ) -> dict[Any, Array]:
        """Signs of the conditions that share a border, which round-off must not decide."""
        found = {}
        for node in _comparisons(terms):
            a = np.sign(self._distance(node, low, which))
            b = np.sign(self._distance(node, high, which))
            b = np.where((b == 0) & turns, -a, b)
            found[node] = b if last else a
        return found

    def _sum(self, terms: Sequence[Any], s: Array, which: Any, forced: dict[Any, Array]) -> Array:
        total: Array = np.zeros(len(which))
        for term in terms:
            total = total + self._value(term, s, which, forced)
        return total

    def _distance(self, border: Any, s: Array, which: Any) -> Array:
        """The left side of a condition less the right one."""
        left, right = border.ufl_operands
        return self._value(left, s, which) - self._value(right, s, which)

    def _value(self, e: Any, s: Array, which: Any, forced: dict[Any, Array] | None = None) -> Array:
        """Values (n,) of a scalar at samples, where v is s on its way."""
        known: dict[Any, Any] = {}
        for node in unique_post_traversal(e):
            if isinstance(node, classes.MultiIndex | classes.Label):
                continue
            if isinstance(node, classes.RealValue | classes.Zero) and node.ufl_shape == ():
                known[node] = np.full(len(which), float(node))
            elif type(node) in _COMPARED:
                left, right = (known[o] for o in node.ufl_operands)
                given = None if forced is None else forced.get(node)
                sign = np.sign(left - right) if given is None else given
                known[node] = _COMPARED[type(node)](sign, 0.0)
            elif _is_leaf(node):
                start, way = self._leaf(node)
                known[node] = start[which] + s * way[which]
            elif node.ufl_operands and (
                isinstance(node, classes.Condition) or node.ufl_shape == ()
            ):
                values = [known.get(o) for o in node.ufl_operands]
                known[node] = _computed(node, values)
        return np.asarray(known[e])

    def _leaf(self, node: Any) -> tuple[Array, Array]:
        """Values of what an integrand is made of, at the start of all directions and along them."""
        if node not in self._leaves:
            n = len(self._cells)
            if self._v in extract_coefficients(node):
                start, way = self._random.uniform(-1.0, 1.0, (2, n))
                self._leaves[node] = start * self._size, way
            else:
                self._leaves[node] = self._given(node, n), np.zeros(n)
        return self._leaves[node]

    def _given(self, node: Any, n: int) -> Array:
        """Data as they are at the points; anything for derivatives, normals and test functions."""
        index: tuple[int, ...] = ()
        if isinstance(node, classes.Indexed):
            node, places = node.ufl_operands
            index = tuple(int(i) for i in places)
        while isinstance(node, classes.Restricted):
            (node,) = node.ufl_operands
        if isinstance(node, fem.Constant):
            return np.full(n, float(np.real(node.value[index])))
        if isinstance(node, classes.SpatialCoordinate):
            return np.array(self._points[:, index[0]])
        if isinstance(node, fem.Function) and _is_known_at_points(node, self._v):
            values = node.eval(self._points, self._cells).reshape(n, -1)
            place = np.ravel_multi_index(index, node.ufl_shape) if index else 0
            return np.array(np.real(values[:, place]))
        return self._random.uniform(0.5, 1.5, n)


_COMPARED: dict[type, Callable[[Array, float], Array]] = {
    classes.EQ: np.equal,
    classes.NE: np.not_equal,
    classes.LT: np.less,
    classes.GT: np.greater,
    classes.LE: np.less_equal,
    classes.GE: np.greater_equal,
}


def _comparisons(expressions: Iterable[Any]) -> list[Any]:
    found: dict[Any, None] = {}
    for e in expressions:
        for node in unique_post_traversal(e):
            if type(node) in _COMPARED:
                found[node] = None
    return list(found)


def _summands(e: Any) -> Iterator[Any]:
    waiting = [e]
    while waiting:
        node = waiting.pop()
        if isinstance(node, classes.Sum):
            waiting += node.ufl_operands
        else:
            yield node


def _is_leaf(node: Any) -> bool:
    """Whether a scalar is a component of a terminal, of its gradient, or of one side of it."""
    if isinstance(node, classes.Indexed):
        return True
    if isinstance(node, classes.Condition) or node.ufl_shape != ():
        return False
    whole = classes.Restricted | classes.ReferenceValue | classes.CellAvg | classes.FacetAvg
    return not node.ufl_operands or isinstance(node, whole)


def _computed(node: Any, values: list[Any]) -> Array:
    """A scalar of its operands; not a number where it is not known how."""
    for kind, compute in _RULES:
        if isinstance(node, kind):
            return np.asarray(compute(*values))
    if isinstance(node, classes.MathFunction):
        name = node._name
        function = scipy.special.erf if name == "erf" else _FUNCTIONS[name]
        return np.asarray(function(values[0]))
    return np.full(np.shape(values[-1]), np.nan)


_RULES: list[tuple[Any, Callable[..., Any]]] = [
    (classes.Sum, np.add),
    (classes.Product, np.multiply),
    (classes.Division, np.divide),
    (classes.Power, np.power),
    (classes.Abs, np.abs),
    (classes.MaxValue, np.maximum),
    (classes.MinValue, np.minimum),
    (classes.Conditional, np.where),
    (classes.AndCondition, np.logical_and),
    (classes.OrCondition, np.logical_or),
    (classes.NotCondition, np.logical_not),
    (classes.Atan2, np.arctan2),
    (classes.Variable, lambda value, _: value),
]
_FUNCTIONS: dict[str, Callable[[Array], Array]] = {
    "sqrt": np.sqrt,
    "exp": np.exp,
    "ln": np.log,
    "cos": np.cos,
    "sin": np.sin,
    "tan": np.tan,
    "cosh": np.cosh,
    "sinh": np.sinh,
    "tanh": np.tanh,
    "acos": np.arccos,
    "asin": np.arcsin,
    "atan": np.arctan,
}


def _is_known_at_points(f: fem.Function, v: fem.Function) -> bool:
    """Whether a Function has values at any point of the cells of v."""
    V = f.function_space
    return V.mesh == v.function_space.mesh and not V.ufl_element().has_custom_quadrature


Places = tuple[npt.NDArray[np.int32], Array]


def _covering(e: Any, v: fem.Function, places: Places) -> Places:
    """Some places, with one for each case in which data decide what an integrand contains.

    A term may be that of a part of the body, by a condition on the place or a field that vanishes
    elsewhere. Not collective.
    """
    cells, points = places
    if not len(cells):
        return places
    few = np.unique(np.linspace(0, len(cells) - 1, _PLACES).astype(int))
    many = np.unique(np.linspace(0, len(cells) - 1, _LOOKED_AT).astype(int))
    with np.errstate(all="ignore"):
        signs = _Sides(e, v, (cells[many], points[many]), _SIZES[:1]).given_signs()
    _, first = np.unique(np.nan_to_num(signs), axis=1, return_index=True)
    chosen = np.union1d(few, many[np.sort(first)[:_PATTERNS]])
    return cells[chosen], points[chosen]


def _places(integral: Any, domain: mesh.Mesh) -> Places:
    """Cells (n,) and points in them (n, 3) of an integral, all of this rank. Collective."""
    topology = domain.topology
    tdim = domain.topology.dim
    data = integral.subdomain_data()
    number = integral.subdomain_id()
    of_cells = integral.integral_type() == "cell"
    dim = tdim if of_cells else tdim - 1
    size = topology.index_map(tdim).size_local
    entities = np.arange(size, dtype=np.int32)
    if dim < tdim:
        topology.create_connectivity(dim, tdim)
    if getattr(data, "dim", None) == dim:
        numbers = number if isinstance(number, tuple) else (number,)
        tagged = [data.find(i) for i in numbers if isinstance(i, int | np.integer)]
        entities = np.concatenate([data.indices[:0], *tagged]) if tagged else entities
    elif integral.integral_type() == "exterior_facet":
        entities = mesh.exterior_facet_indices(topology)
    elif not of_cells:
        dim = tdim
    cells: npt.NDArray[np.int32] = entities
    if dim < tdim:
        cells_of = topology.connectivity(dim, tdim)
        cells = np.array([cells_of.links(f)[0] for f in entities], dtype=np.int32)
    mine = np.flatnonzero(cells < size)
    points = mesh.compute_midpoints(domain, dim, np.asarray(entities[mine], dtype=np.int32))
    return cells[mine], points
