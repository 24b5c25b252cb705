# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid obstacle bounded by a surface of facets, with corners, edges and open rims."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import mesh

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._geometry import area_vectors, dot, unit
from dolfinx_contact._mpi import Arguments, collective, on_root
from dolfinx_contact._validate import ReadOnly, copy_with, nonnegative, number, positive, word
from dolfinx_contact.obstacles import Measured, Obstacle, Outline, Start
from dolfinx_contact.rigid_surfaces.closest import ClosestFacets
from dolfinx_contact.rigid_surfaces.distance import Distances, distances_from
from dolfinx_contact.rigid_surfaces.facet_files import facets_in
from dolfinx_contact.rigid_surfaces.triangulation import merged, triangulated

__all__ = ["RigidSurface"]


class RigidSurface(ReadOnly, Obstacle):
    """Rigid surface of segments (2D) or triangles (3D), for example a tool read from a file.

    Gaps and normals are evaluated at the closest point of the surface, with exact derivatives. The
    surface moves as the shape of a `RigidBody`. The gap is the exact signed distance from the
    facets. For points in the normal cone of an edge or a corner, it is the distance from this edge
    or corner. Facets of size h of a convex surface with the radius of curvature R are chords, which
    lie up to h^2/(8 R) inside the surface (indicator ``facets``).

    *Orientation.* Normals point out of the obstacle, towards the body. Triangles are
    counter-clockwise as seen from the body; segments have the obstacle on their left. A closed
    surface encloses the obstacle. Inward normals, inconsistent orientations, and facets that are
    degenerate, repeated or torn apart are errors. With ``reverse`` the body is on the opposite
    side, for example inside a die. PyVista merges coincident points, removes facets with two
    coincident corners and orients the others::

        repaired = pyvista.read(path).clean().compute_normals(auto_orient_normals=True)
        tool = RigidSurface(repaired.points, repaired.regular_faces)

    *Edges.* Normals approximate the normals of a smooth surface through the points. They are
    computed at the points and interpolated on facets (`rigid_surfaces.normals`). They are not
    averaged across creases, where the facet normals differ by more than ``crease`` degrees, nor at
    a tip such as the apex of a cone; ``crease=0`` uses facet normals everywhere. At a crease the
    normal is discontinuous. A positive ``rounding`` offsets the surface outwards by this distance,
    so that protruding edges are round with continuous normals.

    *Rims.* An open surface ends at its rim. Points past the rim leave the surface, and no contact
    occurs behind it. A sliding face leaves gradually, within the size of one of its facets (or
    within ``rounding`` if that is larger), so that forces decrease to zero.

    The law is enforced at contact points. Between contact points, a corner or edge of the surface
    can penetrate a facet of the body (indicator ``between_points``). Nodes next to a sharp edge are
    pushed sideways: a sliding edge ploughs, which multiplies the friction on every mesh (indicator
    ``across``). With ``method="integral"``, nodes can pass below edges. Each rank stores the whole
    surface (about 1 kB per facet). Self-intersections, for example between solids that were not
    united, are not detected; distances from outside remain exact.

    Args:
        points: coordinates of the points, lengths, shape (m, dim).
        cells: indices of the points of each facet, shape (k, dim).
        crease: largest angle in degrees between facet normals that are averaged.
        rounding: radius of rounded edges, a length.
        reverse: whether the body is on the side opposite to the facet normals.
        name: name of the surface in messages.

    Attributes:
        points: coordinates of the points of the facets, read-only, shape (m, dim).
        cells: indices of the points of each facet, read-only, shape (k, dim).
        closed: whether the surface has no rim.
        mark: hash of all data, used to compare ranks and in records.
        crease: crease angle in degrees.
        rounding: radius of rounded edges, a length.
        name: name of the surface in messages.

    Raises:
        ValueError: if points or cells have another shape or are not finite, if facets are
            degenerate or repeated, if an edge has more than two facets, if orientations are
            inconsistent, or if points of rims (nearly) coincide.
        AttributeError: if an attribute is set after construction.

    Example:
        ::

            punch = RigidSurface.read("punch.stl", scale=1e-3)  # in mm
            tool = RigidBody(punch, about=(0, 0, 0.1), load={"z": -1e3}, held=["x", "y", ...])
            contact = ContactSurface(u, body, tag="top", obstacle=tool, law=Coulomb(0.3))
    """

    _advice = (
        "a RigidBody moves it; for another shape make another RigidSurface, surface and problem"
    )

    def __init__(
        self,
        points: npt.ArrayLike,
        cells: npt.ArrayLike,
        *,
        crease: float = 30.0,
        rounding: float = 0.0,
        reverse: bool = False,
        name: str = "rigid surface",
    ):
        word(name, "the name of a rigid surface")
        if not 0 <= number(crease, f"{name}: crease") <= 180:
            raise ValueError(f"{name}: crease must be from 0 to 180 degrees, got {crease!r}")
        nonnegative(rounding, f"{name}: rounding")
        x, facets = _arrays(points, cells, name)
        found = triangulated(x, facets, np.radians(crease), name)
        if reverse:
            found = triangulated(x, facets[:, ::-1], np.radians(crease), name, inward=True)
        self._surface = found
        self._closest = ClosestFacets(found.points, found.cells)
        #: Sizes of the facets of a sliding face, and removed overlap, in UFL.
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

    def __repr__(self) -> str:
        kind = "closed" if self.closed else "open"
        return f"<RigidSurface {self.name!r}: {len(self.cells)} facets, {kind}>"

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
            scale: factor from the length unit of the file to the length unit of the mesh: 1e-3 for
                a file in mm if the mesh is in m.
            comm: communicator of the calling ranks.
            **options: other arguments of the class; ``name`` defaults to the file name.

        Raises:
            OSError: on every rank, if rank 0 cannot read the file.
            ValueError: on every rank, if the content of the file is invalid or empty, if the group
                does not exist, if arguments differ between ranks, or if the surface is invalid (see
                `RigidSurface`).
        """
        points, cells = _read(comm, Path(path), group, scale)
        options.setdefault("name", Path(path).name)
        return cls(points, cells, **options)

    @property
    def outline(self) -> Outline | None:
        return Outline(self.points, self.cells, -unit(self._surface.of_points.normals))

    @cached_property
    def facet_size(self) -> float:
        """Mean length of the facets in 2D, square root of their mean area in 3D."""
        areas = np.linalg.norm(area_vectors(self.points[self.cells]), axis=1)
        return float(areas.mean() ** (1 / (self.points.shape[1] - 1)))

    @cached_property
    def heights(self) -> tuple[Array, Array]:
        """Height of the smooth surface above each of k facets, and width of each facet.

        Both have the shape (k,). Heights follow from the averaged normals: 0 for flat parts, h^2/(8
        R) for chords of length h of a circle of radius R.
        """
        corners = self.points[self.cells]
        tilts = self._surface.corner_normals - self._surface.normals[:, None]
        along = np.ptp(np.einsum("kci,kti->kct", corners, tilts), axis=1).max(axis=1)
        most = np.linalg.norm(tilts, axis=2).max(axis=1)
        return along / 4, along / np.maximum(most, np.finfo(float).tiny)

    @property
    def edges(self) -> Ints:
        """Creases and edges of the rim, as pairs of point indices, shape (n, 2); empty in 2D."""
        return self._surface.edges

    def distances(self, x: npt.ArrayLike) -> Distances:
        """Return signed distances of points from the facets, without `rounding`. Not collective.

        Args:
            x: points, shape (n, dim).

        Raises:
            ValueError: if the points do not have the shape (n, dim).
        """
        places = np.asarray(x, dtype=np.float64)
        dim = self.points.shape[1]
        if places.ndim != 2 or places.shape[1] != dim:
            raise ValueError(
                f"{self.name}: points must be an array (n, {dim}), got the shape {places.shape}"
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
        z = dot(away, at_rim)
        height = gap.copy()
        height[rim] = z - self.rounding
        normal[rim] = -at_rim
        on_obstacle = np.ones(len(x), dtype=bool)
        on_obstacle[rim] = (z > -ends[rim]) & (dot(away, away) - z**2 < ends[rim] ** 2)
        return Start(gap, height, normal, on_obstacle)

    def _ends(self, widths: Array) -> Array:
        """Return the distances past the rim within which points leave gradually.

        These are the facet sizes ``widths`` of the sliding face; sizes up to the rounding radius
        become 0.
        """
        return np.where(widths > self.rounding, widths, 0.0)

    def _measure(
        self, x: Array, width: Array | None = None, removed: Array | None = None
    ) -> tuple[Array, Array, Array, Array]:
        """Return gaps, gap gradients, normals into the obstacle, and derivatives of the normals."""
        ends = None if width is None else self._ends(width)
        found = distances_from(self._surface, self._closest, x, ends, removed)
        return found.distance - self.rounding, found.slope, -found.normal, -found.turn


def _check_file(a: Arguments) -> None:
    a.path = Path(a.path)
    positive(a.scale, f"{a.path}: scale")
    named = isinstance(a.group, str | int | None) and not isinstance(a.group, bool)
    if not named:
        raise ValueError(f"{a.path}: group must be a name or a tag, got {a.group!r}")


@collective("a surface from a file", _check_file)
def _read(comm: MPI.Comm, path: Path, group: str | int | None, scale: float) -> tuple[Array, Ints]:
    """Return points and facets read on rank 0, identical on every rank. Collective."""
    points, cells = on_root(comm, lambda: facets_in(path, group))
    return merged(scale * points, cells)


def _arrays(points: npt.ArrayLike, cells: npt.ArrayLike, name: str) -> tuple[Array, Ints]:
    """Return validated copies of points and facets; raise ``ValueError`` if they are invalid."""
    x = np.array(points, dtype=np.float64)
    facets = np.array(cells)
    if x.ndim != 2 or x.shape[1] not in (2, 3) or not np.isfinite(x).all():
        raise ValueError(f"{name}: points must be a finite array (m, 2) or (m, 3)")
    fits = facets.ndim == 2 and len(facets) and facets.shape[1] == x.shape[1]
    if not fits or facets.dtype.kind not in "iu":
        what = "segments" if x.shape[1] == 2 else "triangles"
        raise ValueError(f"{name}: cells must be {what}, indices of points (k, {x.shape[1]})")
    if facets.min() < 0 or facets.max() >= len(x):
        raise ValueError(f"{name}: cells contain indices of points that do not exist")
    used, places = np.unique(facets, return_inverse=True)
    return x[used], places.reshape(facets.shape).astype(np.int64)
