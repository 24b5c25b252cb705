# SPDX-License-Identifier: LGPL-3.0-or-later
"""A rigid surface of facets as an obstacle, with corners, edges and open rims."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import mesh

from dolfinx_contact._geometry import area_vectors, unit
from dolfinx_contact._mpi import Arguments, collective, on_root
from dolfinx_contact._validate import ReadOnly, copy_with, is_number, positive, word
from dolfinx_contact.obstacles import Measured, Obstacle, Outline, Start
from dolfinx_contact.rigid_surfaces.closest import ClosestFacets
from dolfinx_contact.rigid_surfaces.distance import Distances, distances_from
from dolfinx_contact.rigid_surfaces.files import facets_in
from dolfinx_contact.rigid_surfaces.triangulation import mended, merged, triangulated

__all__ = ["RigidSurface"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class RigidSurface(ReadOnly, Obstacle):
    """A rigid surface of segments (2D) or triangles (3D), such as a tool from a file.

    Gaps and normals belong to the closest point of the surface and have exact derivatives. The
    surface moves as the shape of a `RigidBody`. The gap is the signed distance, exact for the
    facets, also at edges and corners: in the cone of normals there it is the distance from them.
    Facets of a curved surface are its chords, inside of it by h^2/(8 R).

    *Sides.* Normals point out of the obstacle, to the body. Triangles are counter-clockwise as seen
    from the body; segments have the obstacle on their left. A closed surface encloses the obstacle;
    inward normals and facets that disagree with their neighbours are errors. ``mend`` turns such
    facets: each connected part keeps the orientation of most of its area, and closed parts get
    outward normals. It also unites points at one place, removes facets with two corners at one
    place, as writers of STL leave them, and repeated facets, and cuts facets at points of rims on
    their edges. With ``reverse`` the body is on the other side, as inside a die.

    *Edges.* Normals are those of the smooth surface whose chords the facets are, computed at points
    and interpolated on facets (`rigid_surfaces.normals`). They are not averaged across edges where
    the normals of facets differ by more than ``crease`` degrees, nor at a tip, such as that of a
    cone; with 0 they are those of the facets everywhere. At a crease the normal jumps from that of
    one facet to that of the other. With a radius ``rounding``, by which the obstacle is larger than
    its surface, protruding edges are round and their normals continuous.

    *Rims.* An open surface ends at its rim: points past it leave, and there is no contact behind
    it. A sliding face leaves gradually, within one of its facets, so that forces decrease to zero;
    if ``rounding`` is larger, around that.

    The law holds at contact points. Between them, a corner or edge of the surface enters the facet
    of the body (indicator ``between_points``), and nodes next to a sharp edge are pushed by its
    side: a sliding edge ploughs, with several times the friction, on every mesh (indicator
    ``across``). In the integral method nodes pass under edges. Each rank has the whole surface
    (about 1 kB per facet). Parts that intersect, such as solids that a CAD program has not united,
    are not searched for: distances from outside are exact.

    Args:
        points: points, lengths, shape (m, dim).
        cells: point numbers of the facets, shape (k, dim).
        crease: angle in degrees between normals of facets up to which they are averaged.
        rounding: radius of the edges, a length.
        reverse: whether the body is on the side opposite to the normals of the facets.
        mend: whether facets that do not fit are turned, cut or removed.
        name: name for messages.

    Attributes:
        points: points as they are used, read-only.
        cells: facets as they are used, read-only.
        closed: whether it has no rim.
        mark: hash of all data, for the comparison of ranks and for records.
        crease: angle of creases in degrees.
        rounding: radius of the edges, a length.
        name: name for messages.

    Raises:
        ValueError: if points or cells are not of that shape or not finite, facets are degenerate
            or there twice, an edge has more than two facets, sides do not fit, as above, or rims
            have points (nearly) in one place.
        AttributeError: where attributes are set afterwards.

    Example:
        ::

            punch = RigidSurface.read("punch.stl", scale=1e-3)  # in mm
            tool = RigidBody(punch, about=(0, 0, 0.1), load={"z": -1e3}, held=["x", "y", ...])
            contact = ContactSurface(u, body, tag="top", obstacle=tool, law=Coulomb(0.3))
    """

    _instead: ClassVar[Mapping[str, str]] = {
        "": "a RigidBody moves it; for another shape make another RigidSurface, surface and problem"
    }

    def __init__(
        self,
        points: npt.ArrayLike,
        cells: npt.ArrayLike,
        *,
        crease: float = 30.0,
        rounding: float = 0.0,
        reverse: bool = False,
        mend: bool = False,
        name: str = "rigid surface",
    ):
        word(name, "the name of a rigid surface")
        for what, value, most in (("crease", crease, 180.0), ("rounding", rounding, np.inf)):
            if not (is_number(value) and np.isfinite(value) and 0 <= value <= most):
                limit = f" to {most:g} degrees" if np.isfinite(most) else ""
                raise ValueError(f"{name}: {what} must be a number from 0{limit}, got {value!r}")
        x, facets = _arrays(points, cells, name)
        if mend:
            x, facets = merged(x, facets)
            facets = mended(x, facets, name)
        found = triangulated(x, facets, np.radians(crease), name)
        if reverse:
            found = triangulated(x, facets[:, ::-1], np.radians(crease), name, inward=True)
        self._surface = found
        self._closest = ClosestFacets(found.points, found.cells)
        #: Sizes of the facets of a face that slides off, and removed overlap, in UFL.
        self._face: tuple[Any, ...] = ()
        self.points = found.points
        self.cells = found.cells
        self.closed = found.closed
        self.crease = float(crease)
        self.rounding = float(rounding)
        self.name = name
        for array in (self.points, self.cells):
            array.flags.writeable = False
        numbers = repr((self.crease, self.rounding)).encode()
        content = b"|".join((self.points.tobytes(), self.cells.tobytes(), numbers))
        self.mark = hashlib.sha256(content).hexdigest()[:32]

    @classmethod
    def read(
        cls,
        path: str | os.PathLike[str],
        *,
        group: str | int | None = None,
        scale: float = 1.0,
        comm: MPI.Comm = MPI.COMM_WORLD,
        **options: Any,
    ) -> Self:
        """Read a surface from a file on rank 0. Collective.

        Args:
            path: STL file, ASCII or binary, or gmsh file ``.msh``, with surfaces for a 3D problem
                or curves in a plane of constant z for a 2D problem.
            group: physical group of gmsh, by name or tag; None for all facets of the file.
            scale: length unit of the file in that of the mesh: 1e-3 for a file in mm.
            comm: communicator of the ranks that call.
            **options: arguments of the class; the default name is that of the file.

        Raises:
            OSError: on every rank, if rank 0 cannot read the file.
            ValueError: on every rank, if its content does not fit, there is no such group, it is
                empty, or arguments differ between ranks; and as of the class.
        """
        points, cells = _read(comm, Path(path), group, scale)
        options.setdefault("name", Path(path).name)
        return cls(points, cells, **options)

    @property
    def outline(self) -> Outline | None:
        return Outline(self.points, self.cells, -unit(self._surface.point_normals))

    @cached_property
    def facet_size(self) -> float:
        """Mean size of its facets, a length."""
        areas = np.linalg.norm(area_vectors(self.points[self.cells]), axis=1)
        return float(areas.mean() ** (1 / (self.points.shape[1] - 1)))

    @property
    def edges(self) -> Ints:
        """Its sharp edges and rims by their points (k, 2), in 3D; in 2D there are none."""
        return self._surface.edges

    def distances(self, x: npt.ArrayLike) -> Distances:
        """How far points (n, dim) are from the surface, without rounding. Not collective.

        Raises:
            ValueError: if points are not of that shape.
        """
        places = np.asarray(x, dtype=np.float64)
        dim = self.points.shape[1]
        if places.ndim != 2 or places.shape[1] != dim:
            raise ValueError(
                f"{self.name}: points are an array (n, {dim}), got the shape {places.shape}"
            )
        return distances_from(self._surface, self._closest, places)

    def at(self, domain: mesh.Mesh, x: Any) -> tuple[Any, Any]:
        dim = self.points.shape[1]
        if domain.geometry.dim != dim:
            what = {2: "a surface of segments", 3: "a surface of triangles"}[dim]
            raise ValueError(
                f"{self.name} is {what}, for a {dim}D mesh; the mesh is {domain.geometry.dim}D"
            )
        measured = Measured(domain, x, self._measure, self._face)
        return measured.gap, measured.normal

    def ended(self, face: Callable[[], tuple[Any, Any]]) -> RigidSurface:
        return self if self.closed else copy_with(self, _face=face())

    def starts(self, x: Array, widths: Array) -> Start:
        ends = self._ends(widths)
        gap, _, normal, _ = self._measure(x, widths)
        found = distances_from(self._surface, self._closest, x)
        rim = found.past
        feet = found.feet[rim]
        at_rim = distances_from(self._surface, self._closest, feet, np.ones(len(feet))).normal
        away = (x - found.feet)[rim]
        z = np.einsum("ni,ni->n", away, at_rim)
        height = gap.copy()
        height[rim] = z - self.rounding
        normal[rim] = -at_rim
        held = np.ones(len(x), dtype=bool)
        held[rim] = (z > -ends[rim]) & (np.sum(away**2, axis=1) - z**2 < ends[rim] ** 2)
        return Start(gap, height, normal, held)

    def _ends(self, widths: Array) -> Array:
        """Within which a face leaves the rim; an end that is given is round as it is given."""
        return np.where(widths > self.rounding, widths, 0.0)

    def _measure(
        self, x: Array, width: Array | None = None, removed: Array | None = None
    ) -> tuple[Array, Array, Array, Array]:
        """Gaps, their gradients, normals into the obstacle and their derivatives."""
        ends = None if width is None else self._ends(width)
        found = distances_from(self._surface, self._closest, x, ends, removed)
        return found.distance - self.rounding, found.slope, -found.normal, -found.turn


def _check_file(a: Arguments) -> None:
    a.path = Path(a.path)
    positive(a.scale, f"{a.path}: scale")
    named = isinstance(a.group, str | int | None) and not isinstance(a.group, bool)
    if not named:
        raise ValueError(f"{a.path}: a group is a name or a tag, got {a.group!r}")


@collective("a surface from a file", _check_file)
def _read(comm: MPI.Comm, path: Path, group: str | int | None, scale: float) -> tuple[Array, Ints]:
    """Points and facets, the same on every rank."""
    points, cells = on_root(comm, lambda: facets_in(path, group))
    return merged(scale * points, cells)


def _arrays(points: npt.ArrayLike, cells: npt.ArrayLike, name: str) -> tuple[Array, Ints]:
    """Copies of points and facets, or ``ValueError``."""
    try:
        x = np.array(points, dtype=np.float64)
        facets = np.array(cells)
    except (TypeError, ValueError):
        x, facets = np.empty(0), np.empty(0)
    if x.ndim != 2 or x.shape[1] not in (2, 3) or not np.isfinite(x).all():
        raise ValueError(f"{name}: points are a finite array (m, 2) or (m, 3)")
    fits = facets.ndim == 2 and len(facets) and facets.shape[1] == x.shape[1]
    if not fits or facets.dtype.kind not in "iu":
        what = "segments" if x.shape[1] == 2 else "triangles"
        raise ValueError(f"{name}: cells are {what} by numbers of points (k, {x.shape[1]})")
    if facets.min() < 0 or facets.max() >= len(x):
        raise ValueError(f"{name}: cells have numbers of points that there are not")
    used, places = np.unique(facets, return_inverse=True)
    return x[used], places.reshape(facets.shape).astype(np.int64)
