# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points of faces that slide over each other: the nodes of the slave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, mesh

from dolfinx_contact._geometry import node_positions
from dolfinx_contact._mpi import require
from dolfinx_contact.body.rigid import bounding_box
from dolfinx_contact.laws import Frictionless, LawAtPoints
from dolfinx_contact.laws.compiled import CompiledLaw
from dolfinx_contact.laws.symbols import before
from dolfinx_contact.obstacles import Obstacle
from dolfinx_contact.points.contact_points import ContactPoints
from dolfinx_contact.points.descriptions import ContactMethod, Overlap
from dolfinx_contact.points.kinematics import Kinematics
from dolfinx_contact.points.memory import Memory, with_memory
from dolfinx_contact.points.node_points import NodePoints
from dolfinx_contact.points.operators import Operator, Stencils
from dolfinx_contact.points.opposite import Opposite
from dolfinx_contact.points.sliding.faces import SlidingFaces
from dolfinx_contact.points.sliding.operator import SlidingOperator
from dolfinx_contact.points.trace import across_planes, nodes_on, outward_normals

__all__ = [
    "SlidingFacets",
    "SlidingOpposite",
    "SlidingPoints",
    "check_slave",
    "kinematics",
]

Array = npt.NDArray[np.float64]

_OVERLAP = 1e-3  # of a facet, that of chords of curved faces
_ALONG = 0.1  # of a normal, its part along planes of symmetry, below which it looks across them
_SHARP = 35.0  # degrees between the normals of a node and of a facet, beyond which it is an edge
_IN_PLACE = 1e-9  # of the body's size, a displacement off a plane of symmetry that is none
_REACH = 0.25  # of the size of the smaller face, how far rays reach by default


@dataclass(frozen=True, kw_only=True)
class SlidingOpposite(Opposite):
    """The other face, of which every point may come to be opposite to the nodes of a surface.

    Its rows and weights are those of no node: the opposing points are known at states alone.

    Attributes:
        depth: how far rays reach.
        direction: of a face opposite to itself, along which slaves lie farther (dim,); None of two
            faces.
        across: local nodes x dim, True across planes of symmetry on which nodes of both faces lie.
        planes: of symmetry, where they are by their axis.
    """

    across: npt.NDArray[np.bool_]
    planes: Mapping[int, float]
    depth: float = 0.0
    direction: Array | None = None

    @property
    def points(self) -> type[SlidingPoints]:
        return SlidingPoints

    @property
    def matching(self) -> bool:
        return False


class SlidingFacets(Obstacle):
    """Facets of another body of the same mesh, over which a face slides.

    Args:
        V: displacement space.
        slave: local facets, ghosts included.
        master: likewise.
        depth: how far rays reach; None for a quarter of the size of the smaller face.
        name: of the pair, for messages.
        planes: of symmetry, where they are by their axis.
        direction: as `SlidingOpposite` has it.

    Attributes:
        opposite: the other face.

    Raises:
        ValueError: on every rank, if the faces have facets or nodes in common.
    """

    opposite: SlidingOpposite

    def __init__(
        self,
        V: fem.FunctionSpace,
        slave: npt.NDArray[np.int32],
        master: npt.NDArray[np.int32],
        depth: float | None,
        name: str,
        *,
        planes: Mapping[int, float],
        direction: Array | None = None,
    ):
        domain = V.mesh
        comm = domain.comm
        dim = domain.geometry.dim
        owned = domain.topology.index_map(dim - 1).size_local
        itself = direction is not None
        common = comm.allreduce(int((np.intersect1d(slave, master) < owned).sum()))
        require(
            comm,
            common == 0 or itself,
            f"{name}: slave and master have {common} facets in common; for a face that may touch "
            "itself there is SelfContact",
        )
        sides = nodes_on(V, slave), nodes_on(V, master)
        n = V.dofmap.index_map.size_local
        shared = comm.allreduce(int((sides[0] & sides[1])[:n].sum()))
        require(
            comm,
            shared == 0 or itself,
            f"{name}: slave and master share {shared} nodes of the mesh",
        )
        if depth is None:
            x = node_positions(V)[:, :dim]
            depth = _REACH * min(_size(comm, x[side]) for side in sides)
        size = len(sides[0])
        none = np.zeros((1, 1))
        self.opposite = SlidingOpposite(
            rows=np.where(sides[0], 0, -1),
            nodes=none.astype(np.int64),
            weights=none,
            none=np.zeros(size, dtype=bool),
            areas=None,
            sides=sides,
            master_facets=master,
            across=across_planes(V, *sides, planes, name),
            planes=planes,
            depth=depth,
            direction=direction,
        )
        W = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
        field = fem.Function(W)
        normals = outward_normals(W, slave)[0]
        normals[self.opposite.across] = 0.0
        _require_ends(comm, np.linalg.norm(normals[sides[0]], axis=1), name)
        field.x.array[:] = normals.reshape(-1)
        self._normal = field / ufl.sqrt(ufl.dot(field, field))

    @property
    def flat(self) -> bool:
        """Whether no displacement is too large: what faces what is found at every state."""
        return True

    def on(self, domain: mesh.Mesh) -> tuple[Any, Any]:
        return fem.Constant(domain, 0.0), self._normal


def _require_ends(comm: MPI.Comm, left: Array, name: str) -> None:
    """Raise ``ValueError`` if nodes have no normal along the planes on which they lie. Collective.

    Args:
        comm: communicator.
        left: lengths of the unit normals at nodes without their parts across these planes.
        name: of the pair.
    """
    count = comm.allreduce(int((left < _ALONG).sum()))
    require(
        comm,
        count == 0,
        f"{name}: the slave lies in a plane of symmetry instead of ending there: its normals look "
        f"across it at {count} nodes",
    )


def _size(comm: MPI.Comm, x: Array) -> float:
    """Diagonal of the box around points of all ranks. Collective."""
    low, high = bounding_box(comm, x)
    return float(np.linalg.norm(high - low))


class SlidingPoints(NodePoints):
    """The nodes of a slave that slides over its master; see `facing`."""

    method: ClassVar[ContactMethod] = "mixed"
    slides: ClassVar[bool] = True

    def _opposite_to(self, stencils: Stencils, opposite: Opposite) -> Stencils:
        assert isinstance(opposite, SlidingOpposite)
        self._opposite = opposite
        none = np.zeros((len(stencils.points), 0))
        return Stencils(
            stencils.points,
            none.astype(np.int64),
            none[:, None],
            stencils.multiplier_nodes,
            stencils.multiplier_weights,
            stencils.identity,
        )

    def _connect(self, stencils: Stencils) -> None:
        self._weights = stencils
        opposite = self._opposite
        given = self._V, self.submesh, self.vertices, self.vertex_trace_dofs
        self.faces = SlidingFaces(
            *given,
            opposite.master_facets,
            opposite.depth,
            across=opposite.across,
            planes=opposite.planes,
            direction=opposite.direction,
            axisymmetric=self._weight is not None,
        )
        self._last: tuple[Array, Array | None] | None = None
        self.known: SlidingOperator
        self.operator: Operator = self.at(np.zeros((self._owned_nodes, self.dim)), None)

    @property
    def mirrored(self) -> npt.NDArray[np.bool_]:
        return np.asarray(self.faces.kept == 0.0)

    def require_held(self, fixed: npt.NDArray[np.bool_], name: str) -> None:
        n = self._owned_nodes
        free = self._opposite.across[:n] & ~fixed[:n]
        count = self.comm.allreduce(int(free.any(axis=1).sum()))
        require(
            self.comm,
            count == 0,
            f"{name}: Dirichlet data let {count} nodes leave the plane of symmetry on which they "
            "lie; hold them across it",
        )

    def require_in_place(self, prescribed: Array, size: float, name: str) -> None:
        across = self._opposite.across
        moved = np.abs(np.where(across, prescribed[: len(across)], 0.0))
        worst, axis = max(
            (self.comm.allreduce(float(np.max(moved[:, i], initial=0.0)), op=max), -i)
            for i in range(self.dim)
        )
        where = self._opposite.planes.get(-axis, 0.0)
        require(
            self.comm,
            worst <= _IN_PLACE * size,
            f"{name}: Dirichlet data move nodes by {worst:.3g} off the plane of symmetry "
            f"{'xyz'[-axis]} = {where:g}, in which the images of both faces are made: hold them "
            "there with the value 0, and move the rest of the model instead",
        )

    @property
    def depth(self) -> float:
        """How far before and behind the slave something counts as opposite."""
        return self._opposite.depth

    def remove_overlap_of_mesh(self) -> None:
        """Take what slave and master overlap by in the mesh from all gaps to come. Collective."""
        overlap = -np.minimum(self.known.facing.nodal.gap, 0.0)
        self.faces.removed = overlap
        self._last = None
        self.operator = self.at(np.zeros((self._owned_nodes, self.dim)), None)

    @property
    def choices(self) -> list[float]:
        """Depth, planes of symmetry, and the overlap that is taken from gaps. Collective."""
        taken = float(np.max(self.faces.removed, initial=0.0))
        planes = [float(v) for plane in sorted(self._opposite.planes.items()) for v in plane]
        # Without the digits that depend on the number of ranks.
        return [self.depth, *planes, float(f"{self.comm.allreduce(taken, op=max):.6g}")]

    @cached_property
    def whole_areas(self) -> Array:
        return self._swept()

    @property
    def covered(self) -> Array:
        return np.asarray(np.minimum(self.known.facing.nodal.weight / self.whole_areas, 1.0))

    @property
    def whole_size(self) -> float:
        """Diagonal of the box around the mesh. Collective."""
        return _size(self.comm, self._V.mesh.geometry.x[:, : self.dim])

    def at(self, u: Array, before: Array | None) -> SlidingOperator:
        """B at a displacement; the last one is kept. Collective.

        Args:
            u: at the first local nodes, at least the owned ones (n, dim).
            before: of the owned nodes at the last accepted state; None: they were where the mesh
                is.
        """
        mine = u[: self._owned_nodes]
        last = self._last
        same = last is not None and last[1] is before and np.array_equal(last[0], mine)
        if not self.comm.allreduce(int(not same)):
            return self.known
        facing = self.faces.at(mine, before, self.vertex_areas)
        x = self.faces.positions(mine)
        self.known = SlidingOperator(self.faces, facing, self.number, x)
        self._last = mine.copy(), before
        return self.known


def kinematics(
    points: ContactPoints, law: CompiledLaw, memory: Memory | None, u: Array
) -> Kinematics:
    """Gap, slip and B at a displacement. Collective.

    Args:
        points: of the slave.
        law: there.
        memory: of the last accepted state; None: the mesh.
        u: at the first local nodes, at least the owned ones (n, dim).
    """
    assert isinstance(points, SlidingPoints)
    operator = points.at(u, None if memory is None else memory.displacement)
    nodal = operator.facing.nodal
    n = points.number
    slipped = np.zeros((n, points.dim))
    if memory is not None:  # turned with the surface since then
        turned = memory.reference(nodal.before[:n])
        slipped = np.einsum("nij,nj->ni", nodal.rotation[:n], turned)
    data = replace(points.data, n=nodal.normal[:n], gap=np.zeros(n))
    given = with_memory(law, memory, data)
    return Kinematics(operator, nodal.jump[:n], slipped, given, memory=memory)


def check_slave(
    points: ContactPoints,
    law: LawAtPoints,
    name: str,
    overlap: Overlap,
    *,
    itself: bool = False,
    axisymmetric: bool = False,
) -> None:
    """Raise ``ValueError`` if a slave or its law cannot slide; remove an overlap. Collective.

    Args:
        points: of the slave.
        law: there.
        name: of the surface.
        overlap: what becomes of bodies that overlap in the mesh.
        itself: whether it is a face that faces itself.
        axisymmetric: whether it is one of a body of revolution.
    """
    _check_law(law, name)
    if axisymmetric and not isinstance(law.law, Frictionless):
        raise ValueError(
            f"{name}: bodies of revolution with sliding='large' take Frictionless() alone, got the "
            f"law {law.law.name}"
        )
    _require_no_edge(points, name)
    assert isinstance(points, SlidingPoints)
    _require_apart(points, name, overlap, itself=itself)
    if overlap.removed:
        points.remove_overlap_of_mesh()


def _check_law(law: LawAtPoints, name: str) -> None:
    """Raise ``ValueError`` if a law needs more than increments of slip. Not collective."""
    compiled = law.compiled
    whole = set(compiled.names) & set(before(law.dim))
    for what, has in (
        ("averages the pressure around points", law.law.averaging is not None),
        ("has bonds", compiled.bonded),
        ("depends on the whole tangential jump", bool(whole)),
        ("bounds the shear of open points", not law.law.needs_pressure),
    ):
        if has:
            raise ValueError(
                f"{name}: the law {law.law.name} {what}: with sliding='large' a point has another "
                "one opposite at every state, and nothing of that is there yet"
            )


def _require_apart(points: SlidingPoints, name: str, overlap: Overlap, *, itself: bool) -> None:
    """Raise ``ValueError`` if faces overlap by too much in the mesh. Collective."""
    nodal = points.known.facing.nodal
    worst = float(np.min(nodal.gap[: points.number], initial=0.0))
    worst = points.comm.allreduce(worst, op=min)
    allowed = _OVERLAP * points.mean_width
    words = "or remove_overlap for a start without stress"
    overlap.require(points.comm, worst, allowed, name, words)
    depth = points.depth
    if itself:
        lost = points.comm.allreduce(int(points.faces.lost.sum()))
        require(
            points.comm,
            lost == 0,
            f"{name}: {lost} facets start in the body, and what they should meet lies farther than "
            f"the search distance {depth:.3g}",
        )
        return
    behind = points.faces.farthest_behind(points.whole_size)
    words = "take a larger search_distance" if overlap.most else "interference=True for a press fit"
    require(
        points.comm,
        behind <= depth,
        f"{name}: the master lies {behind:.3g} behind the slave, farther than the search distance "
        f"{depth:.3g}: the bodies overlap, or slave and master do not look at each other; {words}",
    )


def _require_no_edge(points: ContactPoints, name: str) -> None:
    """Raise ``ValueError`` if the face of a slave goes around an edge of the body. Collective."""
    assert isinstance(points, SlidingPoints)
    angle, place = points.faces.sharpest_edge()
    where = ", ".join(f"{c:.6g}" for c in place)
    require(
        points.comm,
        angle <= _SHARP,
        f"{name}: the slave has an edge at ({where}), where the mean normal is {angle:.0f} degrees "
        "off a facet, so that pressure there would push aside: let its face end at the edge, make "
        "the edge round with smaller facets, or exchange slave and master",
    )
