# SPDX-License-Identifier: LGPL-3.0-or-later
"""Descriptions of contact: which facets may touch an obstacle, another face or themselves.

A description only stores its arguments. `ContactProblem` discretises it; the contact points, the
multiplier and all results belong to the problem, so that one description can serve several
problems.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, TypeAlias, TypeVar

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, mesh

from dolfinx_contact._arrays import Array, Indices
from dolfinx_contact._mpi import Arguments, collective, minimum, require
from dolfinx_contact._ufl import described
from dolfinx_contact._validate import (
    count,
    flag,
    instance,
    number,
    one_of,
    positive,
    read_only,
    scalar,
    vector,
    word_in_history,
)
from dolfinx_contact.laws import Frictionless, Law
from dolfinx_contact.meshing import GmshMesh
from dolfinx_contact.obstacles import Obstacle, has_ufl
from dolfinx_contact.points.rigid_body import RigidBody
from dolfinx_contact.points.trace import exterior_facets

__all__ = [
    "Contact",
    "ContactMethod",
    "ContactPair",
    "ContactSurface",
    "Overlap",
    "SelfContact",
    "SlidingKind",
    "displacement_degree",
]

Facets: TypeAlias = GmshMesh | mesh.MeshTags | Indices

#: Placement of the contact points (`points.contact_points`).
ContactMethod: TypeAlias = Literal["nodal", "integral", "mixed"]
#: Range of sliding: small compared with the radius of curvature of the obstacle, or any.
SlidingKind: TypeAlias = Literal["small", "large"]

#: Inf-sup stable degrees of displacement and multiplier, by method. P1 multipliers are traces of
#: the displacement space or smaller; P2/P2 is stable away from Dirichlet data, where nodes are
#: removed.
_STABLE: dict[str, set[tuple[int, int]]] = {
    "nodal": {(1, 1)},
    "integral": {(1, 1), (2, 1), (2, 2)},
    "mixed": {(1, 1), (2, 1)},
}
#: Arguments of a pair that exclude others, with the reason.
_EXCLUSIVE: tuple[tuple[str, set[str], str], ...] = (
    ("remove_overlap", {"gap", "surface"}, "there is no overlap to remove"),
    ("surface", {"gap", "normal"}, "a given surface has a gap and a normal of its own"),
    ("master_facets", {"slave", "master"}, "facets by their indices have no tags"),
)
_SMALL_ONLY = ("gap", "surface", "normal", "method", "quadrature_degree")
_LARGE_ONLY = ("search_distance", "symmetry")
_ROUND_OFF = 1e-9  # relative excess of an overlap that counts as round-off
_ACROSS = 1e-9  # part of a unit direction across a plane of symmetry that counts as round-off


# -- arguments -------------------------------------------------------------------------------------


def displacement_degree(u: Any) -> int:
    """Return the degree of a displacement.

    Raises:
        ValueError: if it is not a vector Lagrange Function of degree 1 or 2.
    """
    domain = instance(u, "the displacement", fem.Function).function_space.mesh
    if len(u.function_space.component()):
        raise ValueError(
            "the displacement is a component of a mixed space, which is not supported; for nearly "
            "incompressible bodies take mean_dilatation_energy of the material, or degree 2"
        )
    element = u.function_space.ufl_element()
    cell, dim = domain.basix_cell().name, domain.geometry.dim
    cells = {2: ("triangle", "quadrilateral"), 3: ("tetrahedron", "hexahedron")}
    if cell not in cells.get(dim, ()):
        raise ValueError(
            "the body must be a 2D mesh in the plane of triangles or quadrilaterals, or a 3D mesh "
            f"of tetrahedra or hexahedra; got cells of kind {cell} in {dim}D"
        )
    lagrange = element.family_name == "P" and not element.discontinuous
    double = domain.geometry.x.dtype == u.x.array.dtype == np.float64
    if not (lagrange and double and element.reference_value_shape == (dim,)):
        raise ValueError(
            f"the displacement must be a continuous vector Lagrange Function with {dim} components "
            f"on a mesh in double precision; got {element} with values of {u.x.array.dtype}"
        )
    return int(one_of(element.degree, "the degree of the displacement", (1, 2)))


def _check_common(a: Arguments) -> int:
    """Validate the arguments common to all descriptions, and return the displacement degree.

    Numbers in the law are replaced by Constants of the mesh.
    """
    degree = displacement_degree(a.u)
    word_in_history(a.name, "the name of a contact surface")
    hint = "such as Frictionless(), Coulomb(F) or Tresca(g)"
    a.law = instance(a.law, f"{a.name}: the law", Law, hint).bind(a.u.function_space.mesh)
    return degree


def _check_elements(a: Arguments, degree: int) -> None:
    """Set the default method and quadrature degree of a description.

    The quadrature must integrate multiplier times displacement exactly on flat facets, otherwise
    stability is lost. In bodies of revolution the weight 2 pi r requires one more degree.

    Raises:
        ValueError: if the method does not support the degrees of displacement and multiplier.
    """
    one_of(a.sliding, f"{a.name}: sliding", ("small", "large", None))
    flag(a.axisymmetric, f"{a.name}: axisymmetric")
    multiplier = count(a.multiplier_degree, f"{a.name}: multiplier_degree")
    if a.method is None and (degree, multiplier) != (2, 1):  # else see `DiscreteSurface`
        a.method = "nodal" if degree == 1 else "integral"
    method = one_of(a.method or "mixed", f"{a.name}: method", sorted(_STABLE))
    if (degree, multiplier) not in _STABLE[method]:
        stable = ", ".join(f"P{d}/P{m}" for d, m in sorted(_STABLE[method]))
        raise ValueError(
            f"{a.name}: displacement P{degree} with multiplier P{multiplier} is not a stable pair "
            f"of the {method} method; stable: {stable}; without method= a stable one is taken"
        )
    if a.quadrature_degree is None:
        a.quadrature_degree = 2 * degree + a.axisymmetric
    what = f"{a.name}: the quadrature degree of P{degree} with P{multiplier}"
    count(a.quadrature_degree, what, degree + multiplier + a.axisymmetric)
    if a.axisymmetric and a.law.averaging is not None:
        raise ValueError(f"{a.name}: there is no nonlocal friction of bodies of revolution")


@dataclass(frozen=True)
class Overlap:
    """Treatment of bodies that overlap in the mesh.

    Attributes:
        most: largest overlap that is allowed; 0 if only inaccuracies of the mesh are allowed.
        removed: whether the overlap is subtracted from the gaps, so that the bodies start without
            stress; otherwise it is a press fit.
    """

    most: float = 0.0
    removed: bool = False

    @property
    def presses(self) -> bool:
        """Whether an overlap in the mesh presses the bodies together (press fit)."""
        return self.most > 0.0 and not self.removed

    @classmethod
    def of(cls, contact: Any) -> Overlap:
        """Return the treatment of overlaps requested by a description.

        Raises:
            ValueError: if ``interference`` or ``remove_overlap`` is invalid.
        """
        name, given, removed = contact.name, contact.interference, contact.remove_overlap
        if given is None:  # a rigid obstacle pushes out, and a removed overlap is not
            most = np.inf if removed is None else 0.0
        elif isinstance(given, bool | np.bool_):
            most = np.inf if given else 0.0
        else:
            must = "True, False or the largest overlap, a positive length"
            most = positive(given, f"{name}: interference", must)
        if removed is None:
            return cls(most)
        if most:
            raise ValueError(f"{name}: an overlap is a press fit, or is removed, and not both")
        must = "the largest overlap that is removed, a positive length"
        return cls(positive(removed, f"{name}: remove_overlap", must), removed=True)

    def exceeded_by(self, gap: float) -> bool:
        """Return whether the smallest gap is negative by more than the allowed overlap."""
        return not gap >= -self.most * (1.0 + _ROUND_OFF)

    def require(self, comm: MPI.Comm, gaps: Array, allowed: float, name: str, unless: str) -> None:
        """Raise ``ValueError`` if bodies overlap by more than is allowed. Collective.

        Args:
            comm: communicator.
            gaps: gaps on this rank, lengths.
            allowed: overlap allowed in any case for inaccuracies of the mesh, a length.
            name: name of the surface.
            unless: further remedies, for the message.
        """
        gap = minimum(comm, gaps)
        remedy = f"interference=True for a press fit, {unless}"
        if self.most > 0.0:
            kind = "remove_overlap" if self.removed else "interference"
            remedy = f"{kind} allows {self.most:.3g}"
        good = gap >= -allowed or not self.exceeded_by(gap)
        require(comm, good, f"{name}: the bodies overlap by {-gap:.3g}; {remedy}")


def _check_surface(a: Arguments) -> None:
    degree = _check_common(a)
    instance(a.obstacle, f"{a.name}: the obstacle", Obstacle, "such as a HalfSpace or a RigidBody")
    _check_elements(a, degree)
    if a.axisymmetric and isinstance(a.obstacle, RigidBody) and not a.obstacle.fixed_across_axis:
        raise ValueError(
            f"{a.name}: {a.obstacle.name} moves only along the axis of revolution; hold x and rz"
        )
    Overlap.of(a)


def _check_pair(a: Arguments) -> None:
    degree = _check_common(a)
    dim = a.u.function_space.mesh.geometry.dim
    large = a.sliding == "large"
    a.symmetry = _planes(a.symmetry, dim, a.name) or None
    Overlap.of(a)
    # arguments that exclude each other
    present = {name for name, value in vars(a).items() if value is not None}
    for name, others, reason in _EXCLUSIVE:
        if name in present and present & others:
            raise ValueError(f"{a.name}: {name} with {min(present & others)}: {reason}")
    unsupported = [name for name in (_SMALL_ONLY if large else _LARGE_ONLY) if name in present]
    if unsupported:
        verb = "sliding='large' does not support" if large else "only sliding='large' supports"
        raise ValueError(f"{a.name}: {verb} {', '.join(unsupported)}")
    if isinstance(a.facets, np.ndarray) and a.master_facets is None:
        raise ValueError(f"{a.name}: facets of the slave by their indices need master_facets")
    # values
    if large:
        _check_sliding(a, degree, "sliding='large'")
        return
    _check_elements(a, degree)
    formula = isinstance(a.surface, Obstacle) and a.surface.outline is None
    if a.surface is not None and (not formula or isinstance(a.surface, RigidBody)):
        raise ValueError(
            f"{a.name}: the surface must be a HalfSpace, Sphere, Cylinder or LevelSet, which is "
            "given by a formula and does not move"
        )
    a.gap = None if a.gap is None else scalar(a.gap, f"{a.name}: the gap")
    if isinstance(a.normal, ufl.core.expr.Expr) or has_ufl(a.normal):  # would be copied
        raise ValueError(f"{a.name}: the normal must be numbers, got {a.normal!r}")
    a.normal = None if a.normal is None else _unit(a.normal, dim, f"{a.name}: the normal")


def _check_sliding(a: Arguments, degree: int, what: str) -> None:
    """Raise ``ValueError`` for elements, laws or search distances that large sliding excludes."""
    cells = a.u.function_space.mesh.ufl_domain().ufl_coordinate_element()
    if (degree, getattr(a, "multiplier_degree", 1), cells.degree) != (1, 1, 1):
        raise ValueError(
            f"{a.name}: {what} needs displacements of degree 1, multipliers of degree 1, and cells "
            "with straight edges"
        )
    if getattr(a, "axisymmetric", False) and not isinstance(a.law, Frictionless):
        raise ValueError(
            f"{a.name}: bodies of revolution with sliding='large' take only Frictionless(), got "
            f"the law {a.law.name}"
        )
    if a.search_distance is not None:
        positive(a.search_distance, f"{a.name}: the search distance", "positive")


def _unit(value: Any, dim: int, name: str) -> Array:
    v = vector(value, name, dim, zero=False)
    v = v / np.abs(v).max()  # the square of a tiny number is 0
    return v / np.linalg.norm(v)


def _planes(symmetry: Any, dim: int, name: str) -> dict[int, float]:
    """Return positions of planes of symmetry by axis, or raise ``ValueError``. Not collective."""
    if symmetry is None:
        return {}
    instance(symmetry, f"{name}: symmetry", dict, "planes by their axis, as {0: 0.0} for x = 0")
    what = f"{name}: an axis of symmetry"
    return {
        one_of(int(count(axis, what, 0)), what, range(dim)): number(
            symmetry[axis], f"{name}: a plane of symmetry"
        )
        for axis in sorted(symmetry, key=str)
    }


def _check_self(a: Arguments) -> None:
    _check_sliding(a, _check_common(a), "self-contact")
    dim = a.u.function_space.mesh.geometry.dim
    a.symmetry = _planes(a.symmetry, dim, a.name)
    Overlap.of(a)
    direction = np.eye(dim)[-1] if a.direction is None else a.direction
    a.direction = _unit(direction, dim, f"{a.name}: the direction")
    across = [axis for axis in a.symmetry if abs(a.direction[axis]) > _ACROSS]
    if across:
        raise ValueError(
            f"{a.name}: the direction must be parallel to the planes of symmetry, and "
            f"{a.direction.tolist()} has a component along {'xyz'[across[0]]}"
        )


def _compared(a: Arguments) -> dict[str, Any]:
    """Return texts by which ranks check that they have equal arguments."""
    domain = a.u.function_space.mesh
    fields = [f"{k} {described(e, domain)}" for k, e in a.law.given.items()]
    return {
        "displacement": str(a.u.function_space.ufl_element()),
        "kind_of_facets": isinstance(a.facets, mesh.MeshTags),
        "law": lambda: f"{a.law.name}({', '.join(fields)})",
    }


T = TypeVar("T")

_ADVICE = (
    "descriptions are read-only. Between two solves surface.law.friction.value = ... changes a "
    "number of the law, and the Constants of an obstacle move it; for other changes make another "
    "surface and another problem"
)


def _described(contact: Contact) -> str:
    """Return kind, name, law, obstacle, sliding and tags of a description as text."""
    words = [f"law {type(contact.law).__name__}"]
    if isinstance(contact, ContactSurface):
        words.append(f"obstacle {type(contact.obstacle).__name__}")
    elif isinstance(contact, ContactPair):
        words.append(f"{contact.sliding} sliding")
    tags = {kind: getattr(contact, kind, None) for kind in ("tag", "slave", "master")}
    words += [f"{kind} {tag!r}" for kind, tag in tags.items() if tag is not None]
    return f"<{type(contact).__name__} {contact.name!r}, {', '.join(words)}>"


def _declared(
    what: str, check: Callable[[Arguments], Any], local: Collection[str]
) -> Callable[[type[T]], type[T]]:
    """Return a class decorator that validates the arguments collectively; see `collective`."""

    def decorate(cls: type[T]) -> type[T]:
        validated = collective(what, check, compare=_compared, local=local)
        setattr(cls, "__init__", validated(getattr(cls, "__init__")))  # noqa: B009, B010
        setattr(cls, "__repr__", _described)  # noqa: B010
        return read_only(_ADVICE)(cls)

    return decorate


# -- descriptions ----------------------------------------------------------------------------------


@_declared("a contact surface", _check_surface, ("facets",))
@dataclass(frozen=True, eq=False, kw_only=True)
class ContactSurface:
    """A part of the boundary that may touch a rigid obstacle.

    Numbers in the law become Constants in `law`. The values of Constants and Functions in the law
    and the obstacle may be changed between two solves. To move an obstacle, define it by Constants.

    Args:
        u: displacement of the body, a vector Lagrange Function of degree 1 or 2.
        facets: mesh from `meshing.read_mesh`, or MeshTags of the facets, together with ``tag``; or
            local indices of exterior facets.
        obstacle: rigid foundation, or a `RigidBody` that moves.
        law: law of contact and friction.
        tag: tag of the facets; for a mesh from gmsh also the name of a physical group.
        method: ``"nodal"``, ``"integral"`` or ``"mixed"`` (see `points.contact_points`); default:
            nodal for degree 1 and mixed for degree 2, but integral for degree 2 in large sliding on
            a curved obstacle (``sliding``), and for multipliers of degree 2.
        multiplier_degree: degree of the multiplier, 1 or 2; 1 is stable for both displacement
            degrees.
        quadrature_degree: quadrature degree with ``method="integral"`` or ``"mixed"``; default:
            twice the degree of the displacement.
        sliding: ``"large"`` evaluates gap and normal of a curved obstacle at the displaced points
            and slips along its surface, ``"small"`` evaluates them in the reference configuration
            (`points.displaced`). Default: large for bodies that are not linear, unless the obstacle
            is a rigid body that rotates.
        interference: whether contact points may start inside the obstacle, or the largest allowed
            depth, a length. Contact pushes such points out. If it is False, an overlap of more than
            5 % of a facet is an error. Default: allowed, with a warning (indicator `overlap`) if
            the depth exceeds 5 % of the smallest extent of the body.
        remove_overlap: length; an initial overlap up to this value is permanently subtracted from
            the gap, so that the points touch the obstacle at the start, without stress. A larger
            overlap is an error.
        axisymmetric: whether the mesh is half of a section of a body of revolution about x = 0
            (`materials.Axisymmetric`). The problem then multiplies all integrals by 2 pi r, forces
            act on the whole circumference, and areas are swept areas (`points.revolution`).
        name: name of the surface in messages and tables.

    Raises:
        ValueError: on every rank, if arguments do not fit together or differ between ranks.

    Example:
        One problem for many friction coefficients and positions of the floor::

            at = fem.Constant(domain, (0.0, 0.0))
            floor = ContactSurface(u, facets, obstacle=HalfSpace(at, (0, 1)), law=Coulomb(0.1))
            problem = ContactProblem(energy, u, [floor], bcs=bcs)
            for friction, height in product((0.1, 0.3), (0.0, 0.01)):
                floor.law.friction.value = friction
                at.value[1] = height
                result = problem.solve()
    """

    u: fem.Function = field(kw_only=False)
    facets: Facets = field(kw_only=False)
    obstacle: Obstacle
    law: Law
    tag: int | str | None = None
    method: ContactMethod | None = None
    multiplier_degree: int = 1
    quadrature_degree: int | None = None
    sliding: SlidingKind | None = None
    interference: bool | float | None = None
    remove_overlap: float | None = None
    axisymmetric: bool = False
    name: str = "contact"

    def __post_init__(self) -> None:
        # a tag without facets is an error here, not only in the problem
        exterior_facets(self.u.function_space.mesh, self.facets, self.tag, self.name)


@_declared("a contact pair", _check_pair, ("facets", "master_facets"))
@dataclass(frozen=True, eq=False, kw_only=True)
class ContactPair:
    """Two faces of one mesh that may touch each other.

    The mesh has several parts, or a crack (`meshing.crack`). Contact points, multiplier and all
    results belong to the *slave*: the normal n points from the slave to the master, tractions and
    forces act on the slave, and ``un`` and ``ut`` are the gap and the slip of the slave relative to
    the master. The slave should be the finer face and must not be clamped everywhere. Of two
    similar faces choose the smaller, softer or more curved one, so that each of its points keeps an
    opposing point (the wheel, not the rail).

    Faces *match* if every node of the slave has a node of the master opposite to it, at the same
    position or across a gap along the normal, and every facet of the slave has one of the master
    with the opposite corners. At the end of a crack slave and master share nodes, which carry no
    contact. Faces that do not match are coupled by a `mortar` at nodes, or, with
    ``method="integral"`` or ``"mixed"``, by Gauss points of the common parts of slave and master
    facets. Nodes of the slave without an opposing point carry no contact. Only the part of a slave
    facet that the master covers is integrated; facets covered by less than 5 % are ignored.

    Pairs may meet, for example at crossing cracks or joints between blocks. Where the jumps around
    such a crossing are linearly dependent (`points.shared_functions`), its nodes have no multiplier
    (status d). Their neighbours on each arm carry their share, so that uniform tractions are
    transmitted. Each arm needs two facets between a crossing and its end or the next crossing,
    multipliers of degree 1, and matching faces.

    **Small sliding** (default): a point keeps its opposing point along the reference normal. A
    solve measures the resulting error and warns if it is not small.

    **Large sliding**: at every state each slave facet is cut by the opposing master facets along
    averaged normals of the displaced slave; gaps and slips at its nodes are weighted means
    (`points.sliding_kinematics`). Slips are increments since the last accepted state of an
    evolution along the surface at that time; under the static law they count from the mesh, so that
    long slips need a history with steps of at most one master facet. Faces need not match and must
    not share nodes. Nodes without a master facet within ``search_distance`` are open, and their gap
    is NaN in tables. Where a node is barely covered, its traction is partly the mean of its
    neighbours, so that gap and shear in a table need not satisfy the law there. The soft body
    should be the slave. The master face should continue around the edges of a tool; a slave face
    has one normal per node and must not have edges. Tractions are nominal, per area of the mesh.

    Large sliding is limited to degree 1 and straight cells, and supports no given gap, surface or
    normal, no laws with bonds, no nonlocal or Tresca friction, and no friction for bodies of
    revolution. Velocities of motions (`NSCD`), reduced problems, proofs and classical algorithms
    require jumps that are linear in the displacement and do not support it.

    Args:
        u: displacement of all bodies, a vector Lagrange Function of degree 1 or 2.
        facets: facets as for `ContactSurface`; local indices belong to the slave.
        law: law of contact and friction.
        slave: tag of the slave, or name of a physical group of a mesh from gmsh.
        master: tag or name of the master.
        master_facets: local indices of the master facets if the slave facets are given by
            indices.
        gap: initial gap, a UFL scalar or a number; default: gap of the geometry. It must not be
            negative, unless ``interference`` allows an overlap of this size.
        surface: true shape of the master, an obstacle, if its facets are chords of a curve; gap and
            normal at the slave nodes are then exact.
        normal: direction from the slave to the master, shape (dim,), along which faces oppose each
            other; default: normals of the slave. Use it if both faces are curved and flatten each
            other. Faces that do not match need degree 1 for it; areas are projected along it.
        interference: whether the bodies may overlap in the mesh, as in a press fit, where the
            overlap presses them together; or the largest overlap, a length. Default: an overlap is
            an error.
        remove_overlap: length; an overlap up to this value at a slave node is permanently
            subtracted from its gap, so that the bodies touch there without stress. A larger one is
            an error.
        method: see `ContactSurface`.
        multiplier_degree: see `ContactSurface`.
        quadrature_degree: see `ContactSurface`.
        sliding: ``"small"`` or ``"large"``.
        search_distance: for large sliding, distance in front of or behind the slave within which a
            facet counts as opposing, a length; default: a quarter of the size of the smaller face.
            It should exceed the approach of the bodies in one step and be less than their
            thickness.
        symmetry: for large sliding, planes of symmetry at which the slave ends, as axis and
            position: ``{0: 0.0}`` is x = 0. Normals and slips there are averaged with their mirror
            images, and the master continues behind them. Dirichlet conditions must fix the nodes of
            both faces on such a plane across it.
        axisymmetric: see `ContactSurface`.
        name: name of the pair in messages and tables.

    Raises:
        ValueError: on every rank, if arguments do not fit together or differ between ranks.
    """

    u: fem.Function = field(kw_only=False)
    facets: Facets = field(kw_only=False)
    law: Law
    slave: int | str | None = None
    master: int | str | None = None
    master_facets: Indices | None = None
    gap: Any = None
    surface: Obstacle | None = None
    normal: npt.ArrayLike | None = None
    interference: bool | float = False
    remove_overlap: float | None = None
    method: ContactMethod | None = None
    multiplier_degree: int = 1
    quadrature_degree: int | None = None
    sliding: SlidingKind = "small"
    search_distance: float | None = None
    symmetry: Mapping[int, float] | None = None
    axisymmetric: bool = False
    name: str = "contact"


@_declared("self-contact", _check_self, ("facets",))
@dataclass(frozen=True, eq=False, kw_only=True)
class SelfContact:
    """A face that may touch itself, with displacements of any size.

    It corresponds to a `ContactPair` with ``sliding="large"`` whose slave and master are one face,
    and has the same limits. Of two facets that face each other, the one whose midpoint lies farther
    along ``direction`` in the mesh is the slave, so that each contact is counted once. Choose the
    direction such that parts that will touch are apart along it: for a ring that is pressed flat
    from above, the default makes its upper half the slave. A facet does not oppose itself, facets
    that share a node with it, facets that face the same way, and facets behind it through the body.
    Where the body is thinner than ``search_distance``, an overlap must be less than half the
    thickness T of the body, or less than (d + T)/2 at facets starting at a depth d inside it.

    Args:
        u: displacement of the body, a vector Lagrange Function of degree 1.
        facets: see `ContactSurface`.
        law: law of contact and friction.
        tag: tag of the facets, or name of a physical group of a mesh from gmsh.
        direction: direction that selects the slave, shape (dim,), parallel to the planes of
            symmetry; default: last axis.
        search_distance: distance in front of or behind a facet within which another one counts as
            opposing, a length; default: a quarter of the size of the face.
        interference: see `ContactPair`.
        remove_overlap: see `ContactPair`.
        symmetry: see `ContactPair`. Facets meet the mirror images of others, as in the whole model.
            Use a `HalfSpace` for parts touching the plane of symmetry itself.
        name: name of the surface in messages and tables.

    Raises:
        ValueError: on every rank, if arguments do not fit together or differ between ranks.
    """

    u: fem.Function = field(kw_only=False)
    facets: Facets = field(kw_only=False)
    law: Law
    tag: int | str | None = None
    direction: npt.ArrayLike | None = None
    search_distance: float | None = None
    interference: bool | float = False
    remove_overlap: float | None = None
    symmetry: Mapping[int, float] | None = None
    name: str = "contact"
    method: ClassVar[ContactMethod] = "mixed"
    multiplier_degree: ClassVar[int] = 1
    quadrature_degree: ClassVar[int] = 2
    axisymmetric: ClassVar[bool] = False


#: Any description of contact.
Contact: TypeAlias = ContactSurface | ContactPair | SelfContact
