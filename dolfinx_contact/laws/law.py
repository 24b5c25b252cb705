# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Contact laws: UFL in the jump and the traction at one point, status by status.

A law maps the jump j and the traction t at a point (and its own fields there) to the traction tau
that it requires; a state satisfies the law if t = tau(j, t). Statuses, derivatives, events,
measures of violation, rates by a parameter, and the cones of a polyhedral law follow from the same
expressions (`compiled`).

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
    """Kernel that averages the pressures of neighbouring points (`spreading`).

    Attributes:
        shape: name of the kernel.
        radius: radius of the kernel, a length.
        normalised: whether a constant pressure stays constant.
    """

    shape: str
    radius: float
    normalised: bool


@dataclass(frozen=True)
class ContactPoint:
    """UFL quantities at a contact point, from which a law is composed.

    Attributes:
        jump: displacement of the body minus that of the obstacle, a vector.
        traction: traction on the body, a vector.
        n: unit normal, from the body into the obstacle.
        gap: initial gap.
        r: augmentation parameter, a stiffness per area.
        dim: dimension, 2 or 3.
        slid: distance slipped, accumulated in a history; in a slip it is measured in the direction
            of the slip, so that it is smooth where the slip begins.
        pressure: pressure of a compliant surface; None where contact is unilateral.
        shear: shear of a compliant surface before it slips, a vector; None for a surface that is
            rigid until it slips.
        touches: distance to the border of open points, a traction; None if it is p.
        around: averaged pressure of the neighbours (`Law.averaging`); None for a local law.
        before: jump of the last accepted state of an evolution, a vector, of which ``jump``
            contains the normal part only; zero under the static law.
        step: time since that state; negative under the static law. A law that uses it must define
            the static case by a comparison with 0, as in the speed ``ufl.conditional(ufl.gt(a.step,
            0.0), (a.slid - a.slid_before) / a.step, 0.0)``; otherwise it needs a history.
        slid_before: part of ``slid`` up to that state; 0 under the static law, whose ``slid`` is
            the whole slip.
        kept: internal variables of that state that are not fields of the law, by name
            (`Internal.components`).
        solved: solutions of the equations of the law (`Law.equations`), by their names.
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
    """Internal variable of a law, stored in the memory at each accepted state.

    Attributes:
        name: name of the variable; for a scalar, the field of the law that has its value at the
            start.
        change: ``"any"``; or ``"falls"`` or ``"grows"`` for the one scalar by which a bond weakens.
        end: last value of a monotone variable; None for no end.
        vector: whether the variable is a vector with the components of the jump, 0 at the start.
        hidden: whether the variable is omitted in tables; it is then 0 at the start.

    Raises:
        ValueError: if the attributes do not fit together.
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
        """1 if the variable only grows, -1 if it only falls, otherwise 0."""
        return {"any": 0, "falls": -1, "grows": 1}[self.change]

    @property
    def is_field(self) -> bool:
        """Whether a field of the law contains the value at the start."""
        return not (self.vector or self.hidden)

    def components(self, dim: int) -> list[str]:
        """Return the names of the components in memory; a dot marks those without a field."""
        if self.vector:
            return [f".{self.name}_{i}" for i in range(dim)]
        return [self.name if self.is_field else f".{self.name}"]


class Bond(NamedTuple):
    """Adhesion and memory of a law at a state.

    Attributes:
        after: UFL values of the internal variables after the state is accepted, by name in memory.
        traction: UFL adhesive part of the answer, a vector.
        stored: UFL energy per area.
        spent: UFL energy per area dissipated by damage since the last accepted state; negative if
            growing bonds gain energy.
        broken: UFL number, 1 if the bond counts as broken, otherwise 0.
    """

    after: Mapping[str, Any]
    traction: Any
    stored: Any
    spent: Any
    broken: Any


class Equations(NamedTuple):
    """Nonlinear equations at a point whose solutions enter a law.

    Their matrix of derivatives should be positive definite.

    Attributes:
        residual: UFL residuals in `ContactPoint.solved`, one for each unknown.
        start: UFL start values of the unknowns.
        sense: 1 if the first unknown may only grow from its start, -1 if it may only fall, else 0.
        end: UFL limit of the first unknown; None for no limit.
    """

    residual: Sequence[Any]
    start: Sequence[Any]
    sense: int = 0
    end: Any = None


class Border(NamedTuple):
    """Where a status ends.

    Attributes:
        distance: UFL distance, positive inside, a traction.
        target: status beyond the border.
        where: UFL condition under which the border exists; None for always.
    """

    distance: Any
    target: int
    where: Any = None


@dataclass(frozen=True)
class StatusPiece:
    """Piece of a law for one status, smooth also beyond its borders.

    Attributes:
        answer: UFL traction on the body.
        borders: borders of the status.
        exists: UFL condition under which points can have this status; None for always.
    """

    answer: Any
    borders: Sequence[Border]
    exists: Any = None


class Law:
    """Contact law: a frozen dataclass whose fields are the parameters, with `pieces`.

    Fields are numbers, Constants, Functions or UFL expressions on the mesh of the body; their
    values may change between solves (``surface.law.friction.value = 0.2``). In `pieces` they are
    symbols for their values at the point. Nothing else may vary from point to point or from solve
    to solve, because laws of one class are compiled once. Pressure and shear of a point are
    *augmented*: answers are fixed points, which do not depend on r at states that satisfy the law.
    """

    #: Whether open points are free of traction.
    needs_pressure: bool = True
    #: Admissible values of fields, by name; default: any number.
    signs: ClassVar[Mapping[str, Sign]] = {}
    #: Dependence of `bound` on the pressure for unilateral contact with isotropic friction (a zero
    #: bound is proportional); None for any other law.
    bound_kind: BoundKind | None = None
    #: Whether the surface is compliant, so that points penetrate.
    compliant: bool = False
    #: Whether points that slip resist more slip, so that friction alone holds a body.
    creeps: bool = False
    #: Internal variables, stored in the memory of an evolution; `bond` has their new values.
    internal: tuple[Internal, ...] = ()
    #: Fields by which an evolution depends on the lengths of its steps, unless they vanish.
    needs_time: tuple[str, ...] = ()

    def pieces(self, a: ContactPoint) -> Mapping[int, StatusPiece]:
        """Return the smooth pieces of the law by status (`laws.status`).

        Statuses are OPEN, STICK, PLUS (slip; in 2D with u_t > 0) and, in 2D, MINUS. On a border
        between several statuses, a point has the first of them. Every jump and traction should have
        a status: otherwise a point takes the nearest status and counts as a violation.
        """
        raise NotImplementedError(f"{type(self).__name__} has no method pieces(a)")

    def bound(self, a: ContactPoint, p: Any) -> Any | None:
        """Return the UFL radius of the friction disc at pressure ``p``; None without a disc."""
        return None

    def with_pressure(self, a: ContactPoint) -> ContactPoint:
        """Return the point with the pressure of the law; default: the augmented pressure."""
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
        cls: Any = type(self)
        return cls if "__dataclass_fields__" in vars(cls) else None

    def unknowns(self, dim: int) -> Mapping[str, int]:
        """Return the number of unknowns of each of the `equations`, by name."""
        return {}

    def equations(self, a: ContactPoint) -> Mapping[str, Equations]:
        """Return the nonlinear equations whose solutions are in ``a.solved``, by name."""
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
        """Monotone variable of the bond, such as damage."""
        return next((x for x in self.internal if x.change != "any"), None)

    @property
    def weakens(self) -> bool:
        """Whether bonds weaken and never grow again, and the law has no other memory."""
        return self.weakening is not None and all(x.is_field for x in self.internal)

    @property
    def given(self) -> dict[str, Scalar]:
        """The fields of the law by name."""
        if not is_dataclass(self):
            return {}
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def having(self, symbols: Mapping[str, Any]) -> Self:
        """Return this law with other fields."""
        return replace(self, **symbols) if symbols else self  # type: ignore[type-var]

    def bind(self, domain: mesh.Mesh) -> Self:
        """Return this law with its numbers as Constants of ``domain``. Not collective.

        Raises:
            ValueError: if a number is not admissible, or a field belongs to another mesh.
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
    """Return the mask of numbers with an admissible sign, up to round-off."""
    v = np.asarray(values)
    return {
        "any": np.ones(v.shape, dtype=bool),
        "nonnegative": v >= -slack,
        "positive": v > 0,
        "fraction": (v >= -slack) & (v <= 1 + slack),
    }[sign]


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
        if ufl.as_ufl(piece.answer).ufl_shape != (dim,):
            raise ValueError(f"{where}: the answer must be a UFL vector of {dim} components")
        for border in piece.borders:
            one_of(border.target, f"{where}: the target of a border", pieces)
    return {int(code): piece for code, piece in pieces.items()}


def _as_coefficient(domain: mesh.Mesh, value: Scalar, what: str, sign: Sign) -> Scalar:
    """Return a value as UFL; numbers become Constants."""
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
