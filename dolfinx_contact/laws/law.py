# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Contact laws: UFL expressions of jump and traction at one point, for each status.

A law maps the jump j and the traction t at a point (and fields of the law) to the required traction
tau; a state satisfies the law if t = tau(j, t). Statuses, derivatives, events, measures of
violation, rates with respect to a parameter, and cones of polyhedral laws are derived from the same
expressions (`compiled`).

With n the unit normal from the body into the obstacle, the initial gap g and the augmentation
parameter r,

    u_n = j.n - g,   u_t = j - (j.n) n,   p = -(t.n - r u_n),   s = t - (t.n) n - r u_t

are the penetration u_n, the tangential displacement u_t, the augmented pressure p and the augmented
shear s. In terms of these, Signorini's conditions and friction are projections (Alart and Curnier,
CMAME 92, 1991, eq. 3.7).
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, ClassVar, Literal, NamedTuple, Self, TypeAlias, get_args

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact._ufl import refuse_other_mesh
from dolfinx_contact._validate import instance, is_number, one_of, read_only
from dolfinx_contact.laws.status import BROKEN, DAMAGING, MINUS, WHERE_OPEN

__all__ = [
    "Bond",
    "Border",
    "BoundKind",
    "ContactPoint",
    "Equations",
    "Internal",
    "Law",
    "Scalar",
    "Sign",
    "StatusPiece",
    "checked_pieces",
    "constant_law",
    "obeys",
]

#: Admissible signs of a number.
Sign: TypeAlias = Literal["any", "nonnegative", "positive", "fraction"]
#: A number, a `dolfinx.fem.Constant`, a `dolfinx.fem.Function` or any scalar UFL expression.
Scalar: TypeAlias = Any
#: Dependence of a friction bound on the pressure: proportional, or independent of it.
BoundKind: TypeAlias = Literal["proportional", "given", "other"]
#: Admissible changes of an internal variable.
Monotone: TypeAlias = Literal["any", "falls", "grows"]


#: Decorator of frozen laws: the error of an assignment names the way to change a number.
constant_law = read_only(
    "laws are read-only. After surface = ContactSurface(..., law=law), surface.law.{name}.value = "
    "... changes the number between two solves"
)


@dataclass(frozen=True)
class ContactPoint:
    """UFL quantities at a contact point, in terms of which laws are defined.

    Attributes:
        jump: displacement of the body minus displacement of the obstacle, a vector.
        traction: traction on the body, a vector.
        n: unit normal, from the body into the obstacle.
        gap: initial gap, a length.
        r: augmentation parameter, a stiffness per area.
        dim: dimension, 2 or 3.
        slid: accumulated slip distance in a history. In a slip step it is measured along the slip
            direction, so that it is smooth at the onset of slip.
        pressure: pressure of a compliant surface; None for unilateral contact.
        shear: shear of a compliant surface before slip, a vector; None for a surface that is rigid
            until it slips.
        touches: distance to the border between open and closed, in units of traction; None if it
            equals the pressure ``p``.
        around: averaged pressure of the neighbouring points (`Law.averaging`); None for a local
            law.
        before: jump at the last accepted state of an evolution, a vector. The tangential part of
            ``jump`` is the increment since this state, while its normal part is the total jump.
            Zero under the static law.
        step: time since the last accepted state; negative under the static law. A law that uses it
            must define the static case by a comparison with 0, for example for the speed:
            ``ufl.conditional(ufl.gt(a.step, 0.0), (a.slid - a.slid_before) / a.step, 0.0)``.
            Otherwise the law can only be used in histories.
        slid_before: ``slid`` at the last accepted state; 0 under the static law, where ``slid`` is
            the total slip.
        kept: internal variables that are not fields of the law, by name (`Internal.components`),
            with their values at the last accepted state.
        solved: solutions of the equations of the law, by the keys of `Law.equations`.
    """

    jump: Any
    traction: Any
    n: Any
    gap: Any
    r: Any
    dim: int
    slid: Any = None
    pressure: Any = None
    shear: Any = None
    touches: Any = None
    around: Any = None
    before: Any = None
    step: Any = None
    slid_before: Any = 0.0
    kept: Mapping[str, Any] = field(default_factory=dict)
    solved: Mapping[Hashable, tuple[Any, ...]] = field(default_factory=dict)

    @property
    def t(self) -> Any:
        """Unit tangent (-n_y, n_x), in 2D only."""
        return ufl.as_vector([-self.n[1], self.n[0]])

    @property
    def u_n(self) -> Any:
        """Penetration, the negative gap."""
        return ufl.dot(self.jump, self.n) - self.gap

    @property
    def u_t(self) -> Any:
        """Vector of the tangential displacement."""
        return self.jump - ufl.dot(self.jump, self.n) * self.n

    @property
    def p(self) -> Any:
        """Augmented pressure, or pressure of a compliant surface."""
        if self.pressure is not None:
            return self.pressure
        return -(ufl.dot(self.traction, self.n) - self.r * self.u_n)

    @property
    def touch(self) -> Any:
        """Distance to the border between open and closed, positive in contact, as a traction."""
        return self.p if self.touches is None else self.touches

    @property
    def s(self) -> Any:
        """Vector of the augmented shear, or of the shear of a compliant surface."""
        if self.shear is not None:
            return self.shear
        return self.traction - ufl.dot(self.traction, self.n) * self.n - self.r * self.u_t


@dataclass(frozen=True)
class Internal:
    """Internal variable of a law, whose values at each accepted state are stored for the next step.

    Attributes:
        name: name of the variable; a scalar has the name of the field containing its initial
            value.
        change: admissible change: ``"any"``; or ``"falls"`` or ``"grows"`` for the scalar that
            describes the weakening of the bond, of which a law has at most one.
        end: final value of a monotone variable; None for an unbounded variable.
        vector: whether the variable is a vector with the components of the jump, initially 0.
        hidden: whether the variable is omitted from tables; it is then initially 0.

    Raises:
        ValueError: if the attributes are inconsistent.
    """

    name: str
    change: Monotone = "any"
    end: float | None = None
    vector: bool = False
    hidden: bool = False

    def __post_init__(self) -> None:
        one_of(self.change, f"the change of {self.name}", get_args(Monotone))
        if self.change != "any" and self.vector:
            raise ValueError(f"{self.name} is a vector: it neither falls nor grows")
        if self.change == "any" and self.end is not None:
            raise ValueError(f"only a variable that falls or grows has an end, unlike {self.name}")

    @property
    def sense(self) -> int:
        """Return 1 if the variable only grows, -1 if it only falls, otherwise 0."""
        return {"any": 0, "falls": -1, "grows": 1}[self.change]

    @property
    def is_field(self) -> bool:
        """Whether a field of the law contains the initial value."""
        return not (self.vector or self.hidden)

    def components(self, dim: int) -> list[str]:
        """Return the stored component names, beginning with a dot if not a field of the law."""
        if self.vector:
            return [f".{self.name}_{i}" for i in range(dim)]
        return [self.name if self.is_field else f".{self.name}"]


class Bond(NamedTuple):
    """Bond of a law at a state, in UFL: adhesive traction, energies and new memory.

    Attributes:
        after: values of the internal variables once the state is accepted, by the names of
            `Internal.components`.
        traction: adhesive part of the traction on the body, a vector.
        stored: stored energy per area.
        spent: energy per area dissipated by damage since the last accepted state; negative if
            growing bonds gain energy.
        broken: 1 if the bond counts as broken, otherwise 0.
    """

    after: Mapping[str, Any]
    traction: Any
    stored: Any
    spent: Any
    broken: Any


class Equations(NamedTuple):
    """Nonlinear equations at a contact point, on whose solutions a law depends.

    The Jacobian matrix should be positive definite.

    Attributes:
        residual: UFL residuals in terms of `ContactPoint.solved`, one for each unknown.
        start: UFL initial values of the unknowns.
        sense: 1 if the first unknown only grows from its initial value, -1 if it only falls,
            otherwise 0.
        end: UFL limit of the first unknown; None without a limit.
    """

    residual: Sequence[Any]
    start: Sequence[Any]
    sense: int = 0
    end: Any = None


class Border(NamedTuple):
    """Border of a status: the limit beyond which another status applies.

    Attributes:
        distance: UFL distance to the border, in units of traction, positive inside the status.
        target: status code beyond the border.
        where: UFL condition under which the border exists; default: None (always).
    """

    distance: Any
    target: int
    where: Any = None


@dataclass(frozen=True)
class StatusPiece:
    """Law for one status: required traction and borders, also smooth beyond the borders.

    Attributes:
        answer: UFL traction on the body that the law requires.
        borders: borders of the status.
        exists: UFL condition under which the status is possible; default: None (always).
    """

    answer: Any
    borders: Sequence[Border]
    exists: Any = None


class Law:
    """Contact law (abstract): a frozen dataclass of parameters with a method `pieces`.

    The parameters are numbers, Constants, Functions or UFL expressions on the mesh of the body.
    Their values may change between solves (``surface.law.friction.value = 0.2``). In `pieces` they
    are symbols for the values at a point. Dataclass fields that are not such parameters are named
    in `options` or are laws themselves. Laws of one class with the same options are compiled once,
    so that only fields may vary between points or between solves. Pressure and shear of a point are
    *augmented* by displacements times a parameter r; at states that satisfy the law, the required
    traction must not depend on r.

    Raises:
        ValueError: if a field is not a scalar, or is a number that violates `signs`.
    """

    #: Whether open points are traction-free.
    needs_pressure: bool = True
    #: Admissible sign of each field, by name; default: any number.
    signs: ClassVar[Mapping[str, Sign]] = {}
    #: Names of the fields that are not values at points, such as an exponent or a flag.
    options: ClassVar[tuple[str, ...]] = ()
    #: Dependence of `bound` on the pressure for unilateral contact with isotropic friction (a zero
    #: bound counts as proportional); None for any other law.
    bound_kind: BoundKind | None = None
    #: Whether the surface is compliant, so that closed points penetrate.
    compliant: bool = False
    #: Whether friction increases with the slip, so that friction alone can support a body.
    creeps: bool = False
    #: Radius within which pressures of closed points are averaged, a length; None for a local law.
    averaging: float | None = None
    #: Internal variables, stored in the memory of an evolution; `bond` returns their new values.
    internal: tuple[Internal, ...] = ()
    #: Fields that make an evolution depend on the lengths of its steps unless they vanish.
    needs_time: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        hiding = sorted(set(self.given) & set(dir(Law)))
        if hiding:
            kind = type(self).__name__  # the field ``name`` of a law may shadow the property
            raise ValueError(f"fields of {kind} must not have the names of methods: {hiding}")
        for k, v in self.given.items():
            _check_scalar(v, f"{k} of {self.name}", self.sign(k))

    def pieces(self, a: ContactPoint) -> Mapping[int, StatusPiece]:
        """Return the required traction and the borders for each status, by status code.

        Status codes (`laws.status`) are OPEN, STICK, PLUS (slip; in 2D with u_t > 0) and, in 2D,
        MINUS. On a border between several statuses, the first one applies. Every jump and traction
        should have a status; otherwise the nearest status is used and counts as a violation.
        """
        raise NotImplementedError(f"{type(self).__name__} has no method pieces(a)")

    def bound(self, a: ContactPoint, p: Any) -> Any | None:
        """Return the UFL radius of the friction disc at pressure ``p``; None without a disc."""
        return None

    def with_pressure(self, a: ContactPoint) -> ContactPoint:
        """Return the contact point with the pressure of the law; default: augmented pressure."""
        return a

    def bond(self, a: ContactPoint) -> Bond | None:
        """Return the adhesive bond with new values of `internal`; default: None (no bond)."""
        return None

    def lacks(self, *, history: bool) -> str:
        """Return a message naming parameters missing for a history or static solve; "" if none."""
        return ""

    @property
    def name(self) -> str:
        """Name of the law in messages."""
        return type(self).__name__

    @property
    def kind(self) -> Hashable | None:
        """Key under which the compiled law is cached; None if it cannot be shared.

        Laws that differ only in the values of `given` have the same key.
        """
        inside = [law.kind for law in self._laws.values()]
        if "__dataclass_fields__" not in vars(type(self)) or None in inside:
            return None
        options = [getattr(self, name) for name in self.options]
        return (type(self), *options, *self.given, *inside)

    def unknowns(self, dim: int) -> Mapping[Any, int]:
        """Return the number of unknowns of each system in `equations`, by key."""
        return {}

    def equations(self, a: ContactPoint) -> Mapping[Hashable, Equations]:
        """Return nonlinear equations by any hashable key; ``a.solved`` has their solutions."""
        return {}

    def memory(self, dim: int) -> list[str]:
        """Return the names under which variables in `internal` are stored, fields first."""
        ordered = sorted(self.internal, key=lambda x: not x.is_field)
        return [name for x in ordered for name in x.components(dim)]

    def variables(self, dim: int) -> Mapping[str, str]:
        """Return the stored name of each variable that is not hidden, by its name in tables."""
        return {
            name.removeprefix("."): name
            for x in self.internal
            if not x.hidden
            for name in x.components(dim)
        }

    @property
    def weakening(self) -> Internal | None:
        """Monotone internal variable of the bond, such as damage; None without one."""
        return next((x for x in self.internal if x.change != "any"), None)

    @property
    def weakens(self) -> bool:
        """Whether a variable weakens the bond, and all internal variables are fields of the law."""
        return self.weakening is not None and all(x.is_field for x in self.internal)

    @property
    def _settings(self) -> dict[str, Any]:
        """Values of all fields by name, without optional fields that are None."""
        law: Any = self
        known = [(f, getattr(law, f.name)) for f in (fields(law) if is_dataclass(law) else ())]
        return {f.name: value for f, value in known if not (value is None and f.default is None)}

    @property
    def _laws(self) -> dict[str, Law]:
        """Fields that are laws, by name."""
        return {name: v for name, v in self._settings.items() if isinstance(v, Law)}

    @property
    def given(self) -> dict[str, Scalar]:
        """Scalar fields of this law and of inner laws, by name, such as ``friction.threshold``.

        Optional fields that are None are omitted.
        """
        omitted = {*self.options, *self._laws}
        found = {name: v for name, v in self._settings.items() if name not in omitted}
        for name, law in self._laws.items():
            found |= {f"{name}.{k}": v for k, v in law.given.items()}
        return found

    def sign(self, name: str) -> Sign:
        """Return the admissible sign of the field of `given` with this name."""
        own, _, inner = name.partition(".")
        law = self._laws.get(own)
        return self.signs.get(name, "any") if law is None else law.sign(inner)

    def having(self, symbols: Mapping[str, Any]) -> Self:
        """Return a copy of this law with new values of the scalar fields in `given`."""
        changed: dict[str, Any] = {k: v for k, v in symbols.items() if "." not in k}
        for name, law in self._laws.items():
            start = f"{name}."
            inside = {k.removeprefix(start): v for k, v in symbols.items() if k.startswith(start)}
            changed[name] = law.having(inside)
        return replace(self, **changed) if changed else self  # type: ignore[type-var]

    def bind(self, domain: mesh.Mesh) -> Self:
        """Return a copy with numbers replaced by Constants of ``domain``. Not collective.

        Raises:
            ValueError: if a field is not admissible or belongs to another mesh.
        """
        Law.__post_init__(self)  # again, because a law may define its own
        coefficients = {}
        for k, v in self.given.items():
            coefficients[k] = fem.Constant(domain, float(v)) if is_number(v) else v
            refuse_other_mesh(coefficients[k], domain, f"{k} of {self.name}")
        return self.having(coefficients)


def obeys(sign: Sign, values: Any, slack: float = 1e-14) -> Any:
    """Return a mask of the values that have an admissible sign, up to the tolerance ``slack``."""
    v = np.asarray(values)
    return {
        "any": np.ones(v.shape, dtype=bool),
        "nonnegative": v >= -slack,
        "positive": v > 0,
        "fraction": (v >= -slack) & (v <= 1 + slack),
    }[sign]


def checked_pieces(pieces: Any, dim: int) -> dict[int, StatusPiece]:
    """Return the result of `Law.pieces` if it is valid; otherwise raise ``ValueError``."""
    if not isinstance(pieces, Mapping) or not pieces:
        raise ValueError(f"pieces must return a dictionary of StatusPieces, got {pieces!r}")
    codes = [c for c in range(BROKEN + DAMAGING) if c % DAMAGING <= MINUS + WHERE_OPEN]
    for code, piece in pieces.items():
        where = f"status {code!r}"
        if code not in codes:
            raise ValueError(f"{where} is not a code of laws.status: OPEN, STICK, PLUS, MINUS, ...")
        instance(piece, where, StatusPiece)
        if ufl.as_ufl(piece.answer).ufl_shape != (dim,):
            raise ValueError(f"{where}: the answer must be a UFL vector of {dim} components")
        for border in piece.borders:
            one_of(border.target, f"{where}: the target of a border", pieces)
    return {int(code): piece for code, piece in pieces.items()}


def _check_scalar(value: Scalar, what: str, sign: Sign) -> None:
    """Raise `ValueError` if a field is not a scalar, or is a number with the wrong sign."""
    if is_number(value):
        if not (np.isfinite(value) and bool(obeys(sign, value, 0.0))):
            kind = {"any": "finite", "fraction": "between 0 and 1"}.get(sign, f"finite and {sign}")
            raise ValueError(f"{what} must be {kind}, got {value}")
    elif not isinstance(value, ufl.core.expr.Expr) or value.ufl_shape != ():
        raise ValueError(
            f"{what} must be a {'' if sign == 'any' else sign + ' '}number, a Constant, a scalar "
            f"Function or a scalar UFL expression, got {value!r}"
        )
