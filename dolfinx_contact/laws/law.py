# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Contact laws: UFL in the jump and the traction at one point, status by status.

A law answers to the jump j and the traction t at a point (and to its own fields there) with the
traction tau that it allows; a state obeys the law where t = tau(j, t). Everything else follows from
the same expressions (`compiled`): statuses, derivatives, events, the measures of a violation, the
rates by a parameter, and the cones of a polyhedral law.

With n the unit normal from the body into the obstacle, the initial gap g and the augmentation
parameter r,

    u_n = j.n - g,   u_t = j - (j.n) n,   p = -(t.n - r u_n),   s = t - (t.n) n - r u_t

are penetration, tangential displacement, augmented pressure and augmented shear, in which
Signorini's conditions and friction are projections (Alart and Curnier, CMAME 92, 1991, eq. 3.7).
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, ClassVar, Literal, NamedTuple, Self, TypeAlias, get_args

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact._ufl import refuse_other_mesh
from dolfinx_contact._validate import instance, one_of
from dolfinx_contact.laws.status import BROKEN, DAMAGING, MINUS, WHERE_OPEN

__all__ = [
    "Bond",
    "Border",
    "BoundKind",
    "ContactPoint",
    "Equations",
    "Internal",
    "Kernel",
    "Law",
    "Scalar",
    "Sign",
    "StatusPiece",
    "checked_pieces",
    "obeys",
]

#: Which numbers may be given.
Sign: TypeAlias = Literal["any", "nonnegative", "positive", "fraction"]
#: A number, a `dolfinx.fem.Constant`, a `dolfinx.fem.Function` or any scalar UFL expression.
Scalar: TypeAlias = Any
#: How a friction bound depends on the pressure: as a coefficient times it, or not at all.
BoundKind: TypeAlias = Literal["proportional", "given", "other"]
#: How an internal variable may change.
Monotone: TypeAlias = Literal["any", "falls", "grows"]


class Kernel(NamedTuple):
    """Over which points a point of a law that is not local spreads its pressure (`spreading`).

    Attributes:
        shape: name of the kernel.
        radius: a length.
        normalised: whether a constant pressure stays constant.
    """

    shape: str
    radius: float
    normalised: bool


@dataclass(frozen=True)
class ContactPoint:
    """UFL quantities at a contact point, of which a law is made.

    Attributes:
        jump: displacement of the body less the obstacle's, a vector.
        traction: traction on the body, a vector.
        n: unit normal, from the body into the obstacle.
        gap: initial gap.
        r: augmentation parameter, stiffness per area.
        dim: 2 or 3.
        slid: distance by which it has slipped, in a history all the way; in a slip it is counted in
            the sense of the slip, and so smooth where the slip begins.
        pressure: pressure of a compliant surface; None where contact is unilateral.
        shear: shear of a compliant surface before it slips, a vector; None for a surface that is
            rigid until it slips.
        touches: distance to the border of open points, a traction; None where that is p.
        around: mean of the pressures of the points around (`Law.averaging`); None of a local law.
        before: jump of the last accepted state of an evolution, a vector, of which ``jump`` has the
            normal part alone; zero under the static law.
        step: time since that state. The static law has none, and a negative number here: define
            what holds then by comparing it with 0, as in the speed ``ufl.conditional(ufl.gt(a.step,
            0.0), (a.slid - a.slid_before) / a.step, 0.0)``. A law that depends on the step where
            none is known is refused without a history.
        slid_before: part of ``slid`` up to that state; 0 under the static law, whose ``slid`` is
            the whole slip.
        kept: internal variables of that state that are no fields of the law, by name
            (`Internal.components`).
        solved: numbers that equations of the law give (`Law.equations`), by the names of these.
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
    solved: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)

    @property
    def t(self) -> Any:
        """Unit tangent (-n_y, n_x) in 2D."""
        return ufl.as_vector([-self.n[1], self.n[0]])

    @property
    def u_n(self) -> Any:
        """Penetration, the negative gap."""
        return ufl.dot(self.jump, self.n) - self.gap

    @property
    def u_t(self) -> Any:
        """Tangential displacement, a vector."""
        return self.jump - ufl.dot(self.jump, self.n) * self.n

    @property
    def p(self) -> Any:
        """Augmented pressure, or that of a compliant surface."""
        if self.pressure is not None:
            return self.pressure
        return -(ufl.dot(self.traction, self.n) - self.r * self.u_n)

    @property
    def touch(self) -> Any:
        """Distance to the border of open points, a traction, positive in contact."""
        return self.p if self.touches is None else self.touches

    @property
    def s(self) -> Any:
        """Augmented shear, or that of a compliant surface, a vector."""
        if self.shear is not None:
            return self.shear
        return self.traction - ufl.dot(self.traction, self.n) * self.n - self.r * self.u_t


@dataclass(frozen=True)
class Internal:
    """An internal variable of a law, which memory has from the last accepted state.

    Attributes:
        name: name of the variable; for a scalar, the field of the law that has its value at the
            start.
        change: ``"any"``; or ``"falls"``, ``"grows"``, of one scalar at most, by which the law
            weakens.
        end: number beyond which it does not fall or grow; None for no end.
        vector: whether it is one, of as many components as the jump; 0 at the start.
        hidden: whether it is of no interest to others: it is 0 at the start, as no field has its
            value, and in no table.

    Raises:
        ValueError: if something of this does not fit the rest.
    """

    name: str
    change: Monotone = "any"
    end: float | None = None
    vector: bool = False
    hidden: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.isidentifier():
            raise ValueError(f"an internal variable needs a name, got {self.name!r}")
        if self.change not in get_args(Monotone):
            known = ", ".join(map(repr, get_args(Monotone)))
            raise ValueError(f"{self.name} may change by one of {known}, not {self.change!r}")
        one_way = self.change != "any"
        if one_way and self.vector:
            raise ValueError(f"{self.name} is a vector: it neither falls nor grows")
        end: Any = self.end
        number = isinstance(end, int | float | np.number) and not isinstance(end, bool)
        good = one_way and number and bool(np.isfinite(end))
        if end is not None and not good:
            raise ValueError(
                f"the end of {self.name} must be a number, of a variable that falls or grows; "
                f"got {end!r}"
            )

    @property
    def sense(self) -> int:
        """1 if it only grows, -1 if it only falls, else 0."""
        return {"any": 0, "falls": -1, "grows": 1}[self.change]

    @property
    def is_field(self) -> bool:
        """Whether a field of the law has its value."""
        return not (self.vector or self.hidden)

    def components(self, dim: int) -> list[str]:
        """Names of its components in memory; those of no field of the law begin with a dot."""
        if self.vector:
            return [f".{self.name}_{i}" for i in range(dim)]
        return [self.name if self.is_field else f".{self.name}"]


class Bond(NamedTuple):
    """Adhesion and memory of a law at a state, beside its traction.

    Attributes:
        after: UFL by the names in `Law.memory`: their values once the state is accepted.
        traction: UFL, the part of the answer that is adhesion, a vector.
        stored: UFL energy per area.
        spent: UFL energy per area that damage has dissipated since the last accepted state;
            negative by what springs of bonds that grow are given.
        broken: UFL, 1 where the bond counts as broken, else 0.
    """

    after: Mapping[str, Any]
    traction: Any
    stored: Any
    spent: Any
    broken: Any


class Equations(NamedTuple):
    """Equations at a point for numbers of which a law is made, that no formula gives.

    Their matrix of derivatives should be positive definite.

    Attributes:
        residual: UFL in `ContactPoint.solved`, one for each number.
        start: UFL, values where the search begins.
        sense: 1 if the first number may only be larger than its start, -1 if smaller; 0 if any.
        end: UFL, which the first number does not pass either; None for no end.
    """

    residual: Sequence[Any]
    start: Sequence[Any]
    sense: int = 0
    end: Any = None


class Border(NamedTuple):
    """Where a status ends.

    Attributes:
        distance: UFL, positive inside, a traction.
        target: status that the point takes beyond it.
        where: UFL condition under which there is this border; None for always.
    """

    distance: Any
    target: int
    where: Any = None


@dataclass(frozen=True)
class StatusPiece:
    """The law at points of one status, a smooth function beyond its own borders.

    Attributes:
        answer: UFL traction on the body.
        borders: borders of the status.
        exists: UFL condition under which points can have this status; None for always.
    """

    answer: Any
    borders: Sequence[Border]
    exists: Any = None


class Law:
    """A law of contact: a frozen dataclass whose fields are what it is given, with `pieces`.

    Fields may be numbers, Constants, Functions or UFL expressions of the body's mesh, and may
    change between solves by their values (``surface.law.friction.value = 0.2``). In `pieces` they
    are symbols for their values at the point; nothing else may vary from point to point or from
    solve to solve, for laws of one class are compiled once. Pressure and shear of a point are
    *augmented*: answers are fixed points, and those of a state that obeys the law do not depend
    on r.
    """

    #: Whether all that the law knows of a body that touches nothing is that it is free.
    needs_pressure: bool = True
    #: What fields must be, by name; any number will do for those that are not named.
    signs: ClassVar[Mapping[str, Sign]] = {}
    #: Of unilateral contact with isotropic friction, how `bound` depends on the pressure (one that
    #: is zero is proportional to it); None for any other law.
    bound_kind: BoundKind | None = None
    #: Whether what is touched gives way, so that points penetrate.
    compliant: bool = False
    #: Whether points that slip resist more slip, so that friction alone holds a body.
    creeps: bool = False
    #: Variables of which an evolution has a memory; `bond` has their values after a step.
    internal: tuple[Internal, ...] = ()
    #: Fields by which an evolution depends on the lengths of its steps, unless they vanish.
    needs_time: tuple[str, ...] = ()

    def pieces(self, a: ContactPoint) -> Mapping[int, StatusPiece]:
        """Return the smooth pieces of the law by status (`laws.status`).

        Numbers are OPEN, STICK, PLUS (a slip; in 2D one with u_t > 0) and, in 2D, MINUS. Where
        borders of several statuses meet a point has the first of them. Statuses should leave no
        jump and traction out: a point there takes the nearest, and counts as a violation.
        """
        raise NotImplementedError(f"{type(self).__name__} has no method pieces(a)")

    def bound(self, a: ContactPoint, p: Any) -> Any | None:
        """UFL radius of the disc that holds the shear at pressure ``p``; None if there is none."""
        return None

    def with_pressure(self, a: ContactPoint) -> ContactPoint:
        """The point with the pressure that the law answers, by default the augmented one."""
        return a

    def bond(self, a: ContactPoint) -> Bond | None:
        """Return adhesion and the new `internal` variables; None if the law has neither."""
        return None

    def lacks(self, *, history: bool) -> str:
        """Return what is missing for a step of a history, or a static solve; "" if nothing is."""
        return ""

    @property
    def averaging(self) -> Kernel | None:
        """Kernel that averages the pressures of closed points; None for a local law."""
        return None

    @property
    def name(self) -> str:
        """Name of the law in messages."""
        return type(self).__name__

    @property
    def kind(self) -> Hashable | None:
        """Key that laws share if they differ only in their `given` fields; None for no sharing."""
        if "__dataclass_fields__" not in vars(type(self)):
            return None
        return type(self), _settings(type(self))

    def unknowns(self, dim: int) -> Mapping[str, int]:
        """Return the number of unknowns of each of the `equations`, by name."""
        return {}

    def equations(self, a: ContactPoint) -> Mapping[str, Equations]:
        """Equations for numbers that the law then finds in ``a.solved``, point by point."""
        return {}

    def memory(self, dim: int) -> list[str]:
        """Return the names of the `internal` variables in memory, fields of the law first."""
        ordered = sorted(self.internal, key=lambda x: not x.is_field)
        return [name for x in ordered for name in x.components(dim)]

    def variables(self, dim: int) -> Mapping[str, str]:
        """Return the name in memory of each variable that tables show, by its name there."""
        return {
            name.removeprefix("."): name
            for x in self.internal
            if not x.hidden
            for name in x.components(dim)
        }

    @property
    def weakening(self) -> Internal | None:
        """The variable by which a bond weakens: the one that falls or grows."""
        return next((x for x in self.internal if x.change != "any"), None)

    @property
    def given(self) -> dict[str, Scalar]:
        """The fields of the law by name."""
        if not is_dataclass(self):
            return {}
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def having(self, symbols: Mapping[str, Any]) -> Self:
        """This law with other fields."""
        return replace(self, **symbols) if symbols else self  # type: ignore[type-var]

    def bind(self, domain: mesh.Mesh) -> Self:
        """This law with its numbers as Constants of ``domain``. Not collective.

        Raises:
            ValueError: if a number is not finite, or negative where it must not be, or something
                is of another mesh.
        """
        kind = self.name
        hiding = sorted(set(self.given) & set(dir(Law)))
        if hiding:
            kind = type(self).__name__  # the name may be one of them
            raise ValueError(f"fields of {kind} must not have the names of methods: {hiding}")
        return self.having(
            {
                k: _as_coefficient(domain, v, f"{k} of {kind}", self.signs.get(k, "any"))
                for k, v in self.given.items()
            }
        )


def obeys(sign: Sign, values: Any, slack: float = 1e-14) -> Any:
    """Which numbers are as they must be, but for round-off."""
    v = np.asarray(values)
    return {
        "any": np.ones(v.shape, dtype=bool),
        "nonnegative": v >= -slack,
        "positive": v > 0,
        "fraction": (v >= -slack) & (v <= 1 + slack),
    }[sign]


def _settings(kind: type) -> tuple[tuple[str, Hashable], ...]:
    """Return the current class attributes and methods, without the fields of instances."""
    found = {
        name: _as_key(value)
        for base in reversed(kind.__mro__)
        for name, value in vars(base).items()
        if not name.startswith("__")
    }
    return tuple(sorted(found.items(), key=lambda item: item[0]))


def _as_key(value: Any) -> Hashable:
    """A method is itself, an array all its digits, anything else what it prints."""
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return value.shape, value.dtype.str, value.tobytes()
    is_method = callable(value) or isinstance(value, property | classmethod)
    return value if is_method and isinstance(value, Hashable) else repr(value)


def checked_pieces(pieces: Any, dim: int) -> dict[int, StatusPiece]:
    """Return the pieces of a law; raise ``ValueError`` if they do not define one."""
    if not isinstance(pieces, Mapping) or not pieces:
        raise ValueError(f"pieces must return a dictionary of StatusPieces, got {pieces!r}")
    codes = [c for c in range(BROKEN + DAMAGING) if c % DAMAGING <= MINUS + WHERE_OPEN]
    for code, piece in pieces.items():
        where = f"status {code!r}"
        if code not in codes:
            raise ValueError(f"{where} is none of laws.status: OPEN, STICK, PLUS, MINUS, ...")
        instance(piece, where, StatusPiece)
        if _shape(piece.answer) != (dim,):
            raise ValueError(f"{where}: the answer must be a UFL vector of {dim} components")
        for border in piece.borders:
            instance(border, f"{where}: a border", Border)
            if _shape(border.distance) != ():
                raise ValueError(f"{where}: the distance of a border must be a UFL scalar")
            one_of(border.target, f"{where}: the target of a border", pieces)
        for condition in (piece.exists, *(b.where for b in piece.borders)):
            if condition is not None:
                instance(condition, f"{where}: exists and where", ufl.classes.Condition)
    return {int(code): piece for code, piece in pieces.items()}


def _shape(e: Any) -> tuple[int, ...] | None:
    """The shape of a UFL expression or number; None if it is neither."""
    try:
        return tuple(ufl.as_ufl(e).ufl_shape)
    except ValueError:
        return None


def _as_coefficient(domain: mesh.Mesh, value: Scalar, what: str, sign: Sign) -> Scalar:
    """``value`` as UFL: numbers become Constants, which may be changed later."""
    if isinstance(value, int | float | np.floating | np.integer) and not isinstance(value, bool):
        if not (np.isfinite(value) and bool(obeys(sign, value, 0.0))):
            kind = {"any": "finite", "fraction": "between 0 and 1"}.get(sign, f"finite and {sign}")
            raise ValueError(f"{what} must be {kind}, got {value}")
        return fem.Constant(domain, float(value))
    if not isinstance(value, ufl.core.expr.Expr) or value.ufl_shape != ():
        raise ValueError(
            f"{what} must be a {'' if sign == 'any' else sign + ' '}number, a Constant, a scalar "
            f"Function or a scalar UFL expression, got {value!r}"
        )
    refuse_other_mesh(value, domain, what)
    return value
