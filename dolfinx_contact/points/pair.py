# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact between two bodies, or between the sides of a crack."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, mesh

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._errors import require
from dolfinx_contact._kept import keep
from dolfinx_contact._numbers import is_number
from dolfinx_contact._shared import SharedValues
from dolfinx_contact.laws import Law
from dolfinx_contact.meshing import GmshMesh, tagged_facets
from dolfinx_contact.obstacles import Obstacle, has_ufl
from dolfinx_contact.points.contact_points import Method
from dolfinx_contact.points.displaced import SlidingKind, check_sliding
from dolfinx_contact.points.elements import check_name, displacement_degree
from dolfinx_contact.points.held_ends import held_in_place, in_place, resting
from dolfinx_contact.points.opposite import Opposite, OppositeFacets, Overlap
from dolfinx_contact.points.pair_motion import PairMotion
from dolfinx_contact.points.revolution import check_section
from dolfinx_contact.points.rigid_body import RigidBody
from dolfinx_contact.points.surface import ContactSurface
from dolfinx_contact.points.trace import checked_planes, exterior_facets

__all__ = ["ContactPair"]


#: Compared by `ContactSurface`, or those of a rank.
_SIDES = ("facets", "master_facets", "law")


def _check(a: Arguments) -> None:
    if not isinstance(a.u, fem.Function):
        raise ValueError(f"the displacement must be a Function, got {type(a.u).__name__}")
    check_name(a.name, "pair")
    displacement_degree(a.u)
    if not isinstance(a.axisymmetric, bool | np.bool_):
        raise ValueError(f"{a.name}: axisymmetric is True or False, got {a.axisymmetric!r}")
    removed = Overlap.of(a.name, a.interference, a.remove_overlap).removed
    if removed and (a.gap is not None or a.surface is not None):
        raise ValueError(f"{a.name}: with a given gap or surface there is no overlap to remove")
    check_sliding(a.name, a.sliding)
    a.symmetry = checked_planes(a.symmetry, a.u.function_space.mesh.geometry.dim, a.name)
    if a.sliding == "large":
        _check_large(a)
    elif a.search_distance is not None or a.symmetry:
        what = "planes of symmetry are" if a.symmetry else "a search distance is"
        raise ValueError(f"{a.name}: {what} for sliding='large'")
    by_index = isinstance(a.facets, np.ndarray)
    _check_sides(a.name, (a.slave, a.master), a.master_facets, by_index=by_index)
    a.gap = _checked_gap(a.gap, a.name)
    _check_surface(a.name, a.surface, alone=a.gap is None and a.normal is None)
    a.normal = _checked_normal(a.normal, a.u.function_space.mesh.geometry.dim, a.name)


def _check_large(a: Arguments) -> None:
    """Raise ``ValueError`` for what does not go with large sliding."""
    given = {
        "gap": a.gap is not None,
        "surface": a.surface is not None,
        "normal": a.normal is not None,
        "choice of the method": a.method not in (None, "mixed"),
        "choice of the quadrature": a.quadrature_degree is not None,
        "displacement of degree 2": displacement_degree(a.u) != 1,
        f"multiplier of degree {a.multiplier_degree}": a.multiplier_degree != 1,
    }
    for what, is_given in given.items():
        if is_given:
            raise ValueError(
                f"{a.name}: with sliding='large' there is no {what}: gaps and normals are those of "
                "the faces where they are, at nodes of degree 1, by a mortar of its own"
            )
    domain = a.u.function_space.mesh
    if domain.ufl_domain().ufl_coordinate_element().degree != 1:
        raise ValueError(f"{a.name}: with sliding='large' cells have straight edges")
    distance = a.search_distance
    good = distance is None or (is_number(distance) and np.isfinite(distance) and distance > 0)
    if not good:
        raise ValueError(f"{a.name}: the search distance must be positive, got {distance!r}")


def _given(a: Arguments) -> dict[str, Any]:
    given = {"gap": a.gap is None, "surface": a.surface is None}
    return given | {"symmetry": repr(a.symmetry)}


class ContactPair(ContactSurface):
    """Two faces of one mesh that may touch each other, with a law; sliding is small or large.

    The mesh has several parts, or a crack (`meshing.crack`). The contact points, the multiplier and
    everything that is written are those of the *slave*: n points from it to the master, tractions
    and forces are those on it, ``un`` and ``ut`` are gap and slip of the slave from the master.

    Faces *match* where every node of the slave has one of the master opposite to it, at its place
    or across a gap along the normal. Where a crack ends slave and master share nodes; these carry
    no contact. Faces that do not match are coupled by a `mortar` at nodes, or in the integral
    method at Gauss points of the parts that a facet of the slave and one of the master have in
    common; mixed contact is refused. Nodes of the slave that have nothing opposite carry no contact
    either, of its facets the covered part counts, and those of which less than 5 % is covered are
    dropped. The slave should be the finer face, and not one whose nodes are all held; of two that
    are alike the one that is smaller, softer or more curved, so that every point of it keeps
    something opposite: the wheel, not the rail.

    Pairs may meet: the arms of cracks that cross, or the joints between several blocks. Where the
    jumps at such a place go around, one of them depends on the others (`points.crossings`), and a
    point there carries no contact of its own: it has the letter d, and its neighbours along each
    arm take its part, so that uniform tractions are transmitted up to the crossing and the gap of a
    neighbour is a mean with that of the crossing. An arm needs a node that can take it, and so two
    facets between a crossing and its end in the body, or the next crossing, in every method
    multipliers of degree 1, and faces that match.

    By default sliding and turning are small: a point keeps the point opposite to it, along the
    normal of the reference configuration, wherever the bodies go. A solve measures the error of
    that (`Result.slidings`), and warns if a point that is closed, or carries something across a gap
    as bonds do, has moved half a facet of the master, or half the face of the slave, along the
    master or has left its face, if normals have turned by 3 degrees, or if a gap is off by 1e-3 of
    the size of the bodies; then nothing is proved either (`Result.unique`, `find_solutions`,
    `analysis.renard_criterion`, `analysis.stability_at_rest`). Histories, motions and paths measure
    every accepted step, and warn once a run; branches warn of the points that they put into the
    problem, as the last one; charts and regions prove nothing where bodies slide too far. Make
    facets larger than the slip, start from a mesh in which the bodies lie where they will touch, or
    take ``sliding="large"``.

    With ``sliding="large"`` the bodies may go anywhere: at every state each facet of the slave is
    cut by the facets of the master that lie opposite to it, along normals that are averaged at the
    nodes of the slave where it is now, and its nodes have the law, with gaps and slips that are
    weighted means over what they have opposite (`points.sliding.facing`, with the formulas; a
    mortar with multipliers of degree 1). Slips are increments since the last accepted state of an
    evolution, along the surface of then: bodies that turn together do not slip. Under the static
    law they are counted from the mesh: a solve is one step, and what has slid far needs a history.
    Faces need not match, or be opposite in the mesh at all, but they may share no nodes. What lies
    within ``search_distance`` along the normal, before the slave or behind it, counts as opposite;
    nodes with nothing there are open, and their gap is NaN in tables. Where a node is hardly
    covered, at the edge of a master, its traction is partly the mean of those around it: there gap
    and shear of a table need not obey the law. Steps should be no longer than a facet of the
    master; of a step in which bodies may have passed through each other the result has a doubt. The
    soft body should be the slave; the face of the master should go around the edges of a tool, and
    not end there, but that of a slave may not, as it has one normal at a node. Tractions are
    nominal: per area of the mesh.
    Limits: degree 1 and straight cells, no gap, surface or normal that is given, no law with bonds,
    a nonlocal one or Tresca's, bodies of revolution without friction alone; velocities of motions
    (`NSCD`), reduced problems, proofs and classical algorithms that need one B refuse it by name.

    Args:
        u: displacement of all bodies, a vector Lagrange Function of degree 1 or 2.
        facets: as for `ContactSurface`; of arrays those of the slave.
        law: of contact and friction.
        slave: tag, or name of a physical group of a mesh from gmsh.
        master: likewise.
        master_facets: local indices of the facets of the master, where those of the slave are
            given by indices.
        gap: initial gap, UFL or a number; by default that of the geometry. Where Constants and
            Functions in it change, it may not become negative either, or less than
            ``interference`` allows.
        surface: the true shape of the master, an obstacle, where facets are chords of a curve: gap
            and normal are then its at the nodes of the slave, and not off by the sagitta of chords.
        normal: direction from the slave to the master (dim,), along which faces are opposite to
            each other and gap and pressure act; by default the normals of the slave. Where both
            faces are curved, as those of two spheres, and flatten each other it is that of the
            contact between, and the slave's are not. Faces that do not match need degree 1 for it,
            and areas are those seen along it.
        interference: whether the bodies may overlap in the mesh, as in a press fit, whose overlap
            presses them; or by how much they may, a length. Else an overlap is an error.
        remove_overlap: a length: an overlap in the mesh of this or less at a node of the slave is
            taken from its gap for good, so that the bodies touch there at the start, without
            stress. A larger one is an error.
        method: as for `ContactSurface`, and so the rest.
        multiplier_degree: of the multiplier.
        quadrature_degree: of the Gauss points.
        sliding: ``"small"`` or ``"large"``.
        search_distance: with large sliding, how far before and behind the slave something counts as
            opposite, a length; by default a quarter of the size of the smaller face. It should be
            larger than what bodies come closer in a step, and smaller than they are thick.
        symmetry: with large sliding, the planes of symmetry at which the slave ends, where they
            are by their axis: ``{0: 0.0}`` for x = 0. Normals and slips of nodes there are means
            with their mirror images, and behind them are images of the master, which lies on the
            same side. Dirichlet data have to hold the nodes of both on a plane across it.
        axisymmetric: as for `ContactSurface`.
        name: used in messages and tables.

    Raises:
        ValueError: on every rank, as `ContactSurface`; and if both faces have facets in common, do
            not match where they have to, have equal normals, touch at a node without matching, or
            overlap without ``interference`` or by more than it or ``remove_overlap`` allows: by
            more than round-off where they match, else by more than 5 % of a facet, since facets of
            curved faces are chords; and if a given normal is more than 60 degrees off that of the
            slave. Of pairs that cross where nothing beside the crossing can take its part, when
            they enter a problem. With large sliding also if the slave has an edge, faces have a
            node in common, or the master lies behind the slave.
    """

    @collective("a contact pair", _check, compare=_given, local=_SIDES, where="name")
    def __init__(
        self,
        u: fem.Function,
        facets: GmshMesh | mesh.MeshTags | npt.NDArray[np.int32],
        *,
        law: Law,
        slave: int | str | None = None,
        master: int | str | None = None,
        master_facets: npt.NDArray[np.int32] | None = None,
        gap: Any = None,
        surface: Obstacle | None = None,
        normal: npt.ArrayLike | None = None,
        interference: bool | float = False,
        remove_overlap: float | None = None,
        method: Method | None = None,
        multiplier_degree: int = 1,
        quadrature_degree: int | None = None,
        sliding: SlidingKind = "small",
        search_distance: float | None = None,
        symmetry: Mapping[int, float] | None = None,
        axisymmetric: bool = False,
        name: str = "contact",
    ):
        V = u.function_space
        keep(V.mesh)
        theirs = facets if master_facets is None else master_facets
        sides = [
            _facets_of_side(V.mesh, facets, slave, f"{name}, slave"),
            _facets_of_side(V.mesh, theirs, master, f"{name}, master"),
        ]
        self.master_facets = sides[1]
        if axisymmetric:
            check_section(V.mesh, sides[1], f"{name}, master")
        large = sliding == "large"
        overlap = Overlap.of(name, interference, remove_overlap)
        master_face: Obstacle
        if large:
            from dolfinx_contact.points.sliding.points import SlidingFacets, check_slave

            master_face = SlidingFacets(
                V, sides[0], sides[1], search_distance, name, planes=symmetry or {}
            )
        else:
            master_face = OppositeFacets(
                V,
                sides[0],
                sides[1],
                gap=gap,
                surface=surface,
                normal=None if normal is None else np.asarray(normal, dtype=np.float64),
                overlap=overlap,
                must_match=method == "mixed",
                axisymmetric=bool(axisymmetric),
                name=name,
            )
        super().__init__(
            u,
            sides[0],
            obstacle=master_face,
            law=law,
            method="mixed" if large else method,
            multiplier_degree=multiplier_degree,
            quadrature_degree=quadrature_degree,
            axisymmetric=axisymmetric,
            name=name,
        )
        if large:
            self._given_gap = ""
            check_slave(
                self.points,
                self.law_at_points,
                name,
                overlap,
                axisymmetric=bool(axisymmetric),
            )
            return
        #: How the bodies have slid and turned.
        self.motion = PairMotion(u, self.points, sides[0], sides[1])
        #: The opposing points while no function of a node is given away.
        self._apart: Opposite = self.obstacle.opposite
        self._given_gap = ""
        self._overlap = overlap
        if np.isfinite(overlap.most) and (gap is not None or surface is not None):
            self._given_gap = "given gap" if surface is None else "gap to the given surface"
        self.check_gaps()

    def check_gaps(self) -> None:
        if not self._given_gap:
            return
        gaps = self.points.vertex_gaps
        worst = self.comm.allreduce(float(np.min(gaps, initial=np.inf)), op=min)
        words = "interference=True for a press fit"
        if self._overlap.presses:
            words = f"interference allows {self._overlap.most:.3g}"
        require(
            self.comm,
            not self._overlap.exceeded_by(worst),
            f"{self.name}: the {self._given_gap} is {worst:.3g}; {words}",
        )

    def hold(self, fixed: npt.NDArray[np.bool_], crossing: npt.NDArray[np.bool_]) -> None:
        """Give away the functions of nodes without a multiplier; see `held_ends`. Collective.

        Of faces that do not match these are the nodes whose jump is fixed.

        Args:
            fixed: local nodes x dim, by Dirichlet data.
            crossing: local vertices at which pairs cross.

        Raises:
            ValueError: if there is no node beside a crossing that could take its part.
        """
        if self.slides:
            self.points.require_held(fixed, self.name)
            return
        V = self.u.function_space
        trace = self.points.vertex_trace_dofs
        matching = self._apart.matching
        self._check_crossing(crossing)
        given = crossing
        if self.method == "nodal" and not matching:
            given = crossing | held_in_place(V, self._apart, fixed)[trace]
        idle = np.all(resting(V, self._apart, fixed)[trace], axis=1)
        given = self.points.give(given, idle & ~given)
        left = np.flatnonzero(
            (crossing & ~given)[: self.points.vertices.dofmap.index_map.size_local]
        )
        x = self.node_positions[trace[left]]
        first = next((row.tolist() for rows in self.comm.allgather(x) for row in rows), None)
        require(
            self.comm,
            first is None,
            f"{self.name}: crosses other pairs at ({_shown(first)}), where it has no node beside "
            "the crossing that could take its part: between a crossing and its end, or the next "
            "crossing, it needs two facets; refine the mesh, or end one of the cracks before",
        )
        if matching:
            return
        marks = SharedValues(V.dofmap.index_map).sums(trace, given.astype(float))
        object.__setattr__(self.obstacle, "opposite", in_place(self._apart, marks > 0))

    def _check_crossing(self, crossing: npt.NDArray[np.bool_]) -> None:
        """Raise ``ValueError`` if multipliers cannot leave out a crossing. Collective."""
        degree = self.degrees[1]
        crosses = self.comm.allreduce(int(crossing.any()))
        require(
            self.comm,
            degree == 1 or not crosses,
            f"{self.name}: crosses other pairs, where a multiplier of degree {degree} is not "
            "unique; take multiplier_degree=1",
        )


def _shown(x: list[float] | None) -> str:
    """A position, without the round-off of zeros."""
    return ", ".join(f"{round(c, 12) + 0.0:.6g}" for c in x or [])


def _facets_of_side(
    domain: mesh.Mesh,
    facets: GmshMesh | mesh.MeshTags | npt.NDArray[np.int32],
    tag: int | str | None,
    side: str,
) -> npt.NDArray[np.int32]:
    """Exterior facets of the slave or the master on this rank. Collective."""
    return exterior_facets(domain, *tagged_facets(domain.comm, facets, tag, side), side)


def _check_sides(
    name: str,
    tags: tuple[int | str | None, int | str | None],
    master_facets: npt.NDArray[np.int32] | None,
    *,
    by_index: bool,
) -> None:
    """Raise ``ValueError`` if both sides are not given by tags, or both by indices."""
    if master_facets is not None and any(tag is not None for tag in tags):
        raise ValueError(f"{name}: facets by their indices have no tags slave and master")
    if master_facets is None and by_index:
        raise ValueError(f"{name}: facets of the slave by their indices need master_facets")


def _check_surface(name: str, surface: Any, *, alone: bool) -> None:
    """Raise ``ValueError`` if a given shape of the master is none, or is not given alone."""
    if surface is None:
        return
    if not isinstance(surface, Obstacle) or isinstance(surface, RigidBody):
        raise ValueError(f"{name}: the surface must be a HalfSpace, Sphere, Cylinder, LevelSet")
    if surface.outline is not None:
        raise ValueError(f"{name}: the surface of a pair is given by a formula, not by facets")
    if not alone:
        raise ValueError(f"{name}: a given surface has a gap and a normal of its own")


def _checked_gap(gap: Any, name: str) -> Any:
    """A given gap, or ``ValueError`` if it is neither a finite number nor a UFL scalar."""
    if gap is None:
        return None
    if is_number(gap):
        if not np.isfinite(gap):
            raise ValueError(f"{name}: the gap must be finite, got {gap}")
        return float(gap)
    if not isinstance(gap, ufl.core.expr.Expr) or gap.ufl_shape != ():
        raise ValueError(f"{name}: the gap must be a number or a UFL scalar, got {gap!r}")
    return gap


def _checked_normal(
    normal: npt.ArrayLike | None, dim: int, name: str
) -> npt.NDArray[np.float64] | None:
    """A given normal of length one, or ``ValueError`` if it is no direction."""
    if normal is None:
        return None
    if isinstance(normal, ufl.core.expr.Expr) or has_ufl(normal):
        raise ValueError(f"{name}: the normal is copied, and must be numbers, got {normal!r}")
    try:
        n = np.asarray(normal, dtype=np.float64)
    except (TypeError, ValueError):
        n = np.zeros(0)
    if n.shape != (dim,) or not np.isfinite(n).all() or not n.any():
        raise ValueError(f"{name}: the normal must be {dim} numbers, not all 0, got {normal!r}")
    n = n / np.abs(n).max()
    return np.asarray(n / np.linalg.norm(n))
