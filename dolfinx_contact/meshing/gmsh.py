# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes from gmsh with named physical groups.

The body must consist of one or more physical groups of the highest dimension. Each part of its
boundary that a problem uses must be a physical group of one dimension less.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact._arrays import Array, Indices
from dolfinx_contact._compat import gmsh_io
from dolfinx_contact._install import optional
from dolfinx_contact._mpi import Arguments, collective, everywhere, keep, largest, require

__all__ = [
    "GmshMesh",
    "NamedTags",
    "draw_polygon",
    "empty_model",
    "mesh_from_gmsh",
    "no_tags",
    "read_mesh",
]

logger = logging.getLogger(__name__)


class NamedTags(mesh.MeshTags):  # type: ignore[misc]
    """MeshTags with the names of their groups.

    Args:
        tags: MeshTags of cells or facets.
        names: tag of each group, by name.
    """

    def __init__(self, tags: mesh.MeshTags, names: Mapping[str, int]):
        super().__init__(tags._cpp_object)
        self.names = dict(names)

    def tag(self, name: str) -> int:
        """Return the tag of the group ``name``, or raise ``ValueError``."""
        if name not in self.names:
            what = "cells" if self.dim == self.topology.dim else "facets"
            known = f"names: {sorted(self.names)}" if self.names else "no group has a name"
            raise ValueError(f"no group of {what} is named {name!r}; {known}")
        return self.names[name]


def _check_space(a: Arguments) -> None:
    space = a.V[0] if isinstance(a.V, list | tuple) else a.V
    if space.mesh is not a.self.mesh:
        raise ValueError("the space is not on this mesh")


class GmshMesh(NamedTuple):
    """A mesh and its physical groups.

    Attributes:
        mesh: mesh of the body.
        cell_tags: MeshTags of the groups of cells with their names, possibly empty.
        facet_tags: MeshTags of the groups of facets with their names, possibly empty.

    Example:
        Parts of the boundary by their names::

            body = read_mesh(comm, "body.msh", groups=("top", "side", "contact"))
            held = fem.dirichletbc(np.zeros(3), body.dofs(V, "top"), V)
            contact = ContactSurface(u, body, tag="contact", obstacle=floor, law=Coulomb(0.4))
            load = ufl.dot(traction, u) * body.ds("side")

        and parts of the body, for example of two materials::

            energy = steel.energy(u) * body.dx("wheel") + rubber.energy(u) * body.dx("tyre")
    """

    mesh: mesh.Mesh
    cell_tags: NamedTags
    facet_tags: NamedTags

    @property
    def names(self) -> dict[str, tuple[int, int]]:
        """Dimension and tag of each group of cells or facets, by name.

        If a group of cells and a group of facets have the same name, the entry belongs to the
        facets; ``cell_tags``, ``facet_tags``, `dx` and `ds` contain both.
        """
        groups = self.cell_tags, self.facet_tags
        return {name: (t.dim, tag) for t in groups for name, tag in t.names.items()}

    def tag(self, name: str) -> int:
        """Return the tag of the group ``name``, or raise ``ValueError``."""
        if name not in self.names:
            raise ValueError(f"no physical group is named {name!r}; names: {sorted(self.names)}")
        return self.names[name][1]

    @collective("facets of a group")
    def facets(self, name: str) -> Indices:
        """Return the local indices of the n facets of the group ``name``, shape (n,). Collective.

        Raises:
            ValueError: on every rank, if no group has this name, or ranks request different ones.
        """
        tags = self.facet_tags
        return np.asarray(tags.find(tags.tag(name)), dtype=np.int32)

    def bounds(self, name: str) -> Array:
        """Return the bounding box of the facets of the group ``name``, shape (2, 3). Collective.

        The rows are lower and upper bounds; for an empty group infinity and minus infinity. Errors
        are raised as by `facets`.
        """
        facets = self.facets(name)
        dim = self.facet_tags.dim
        x = np.empty((0, 3))
        if len(facets):  # DOLFINx divides by their number
            self.mesh.topology.create_connectivity(dim, self.mesh.topology.dim)
            x = self.mesh.geometry.x[mesh.entities_to_geometry(self.mesh, dim, facets).ravel()]
        ends = np.stack([-x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)])
        opposite, high = largest(self.mesh.comm, ends)
        return np.stack([-opposite, high])

    @collective("dofs of a group", _check_space)
    def dofs(self, V: Any, name: str) -> Any:
        """Return dofs on the facets of the group ``name`` for Dirichlet conditions. Collective.

        Args:
            V: space on the mesh, a component of one, or a component and its collapsed space, as for
                ``fem.locate_dofs_topological``.
            name: name of the group.

        Raises:
            ValueError: on every rank, if no group has this name, ranks request different ones, or
                the space is not on the mesh.
        """
        facets = self.facets(name)
        return fem.locate_dofs_topological(V, self.facet_tags.dim, facets)

    @collective("a measure of a group")
    def ds(self, name: str, **metadata: Any) -> ufl.Measure:
        """Return a UFL measure for loads on the facets of the group ``name``. Collective.

        Args:
            name: name of the group.
            metadata: metadata of the measure, such as ``quadrature_degree=4``.

        Raises:
            ValueError: on every rank, if no group has this name, ranks request different ones, or
                facets of the group lie inside the body, where ``ds`` is 0.
        """
        tag = self.facet_tags.tag(name)
        _refuse_interior(self.facet_tags, tag, name, self.mesh)
        return ufl.Measure(
            "ds", self.mesh, subdomain_id=tag, subdomain_data=self.facet_tags, metadata=metadata
        )

    @collective("a measure of a group")
    def dx(self, name: str, **metadata: Any) -> ufl.Measure:
        """Return a UFL measure of the cells of the group ``name``. Collective.

        Args:
            name: name of the group.
            metadata: metadata of the measure, such as ``quadrature_degree=4``.

        Raises:
            ValueError: on every rank, if no group has this name, or ranks request different ones.
        """
        return ufl.Measure(
            "dx",
            self.mesh,
            subdomain_id=self.cell_tags.tag(name),
            subdomain_data=self.cell_tags,
            metadata=metadata,
        )


def _refuse_interior(tags: mesh.MeshTags, tag: int, name: str, domain: mesh.Mesh) -> None:
    """Raise ``ValueError`` if facets with a tag lie inside the body. Collective."""
    topology = domain.topology
    topology.create_connectivity(tags.dim, topology.dim)
    found = np.asarray(tags.find(tag))
    found = found[found < topology.index_map(tags.dim).size_local]
    inside = len(np.setdiff1d(found, mesh.exterior_facet_indices(topology)))
    count, inside = domain.comm.allreduce(np.array([len(found), inside]))
    require(
        domain.comm,
        not inside,
        f"the group {name!r} has {inside} of {count} facets inside the body, but ds covers only"
        ' its boundary: integrate over interior facets with dS = ufl.Measure("dS", body.mesh, '
        f"subdomain_data=body.facet_tags), over this group dS({tag}) (on several ranks DOLFINx "
        "needs a mesh with ghost cells for it)",
    )


@collective("a mesh file")
def read_mesh(
    comm: MPI.Comm,
    filename: str | os.PathLike[str],
    *,
    dim: int | None = None,
    groups: Iterable[str] = (),
) -> GmshMesh:
    """Read a gmsh file on rank 0 and distribute the mesh. Collective.

    Args:
        comm: communicator of the mesh.
        filename: path of a ``.msh`` file with physical groups.
        dim: required dimension of the body, 2 or 3; default: any.
        groups: required names of groups of facets; default: none.

    Raises:
        FileNotFoundError: on every rank, if the file does not exist.
        ValueError: on every rank, if gmsh cannot read the file, if the mesh is not admissible (see
            `mesh_from_gmsh`), or if arguments differ between ranks.
    """
    gmsh = optional("gmsh", "gmsh")
    filename = os.fspath(filename)
    found = comm.bcast(Path(filename).is_file() if comm.rank == 0 else None)
    if not found:
        raise FileNotFoundError(f"there is no mesh file {filename}")
    return mesh_from_gmsh(comm, lambda: gmsh.merge(filename), dim=dim, groups=groups)


@collective("a mesh from gmsh", local=("draw",))
def mesh_from_gmsh(
    comm: MPI.Comm,
    draw: Callable[[], Any],
    *,
    dim: int | None = None,
    groups: Iterable[str] = (),
) -> GmshMesh:
    """Distribute a mesh drawn in gmsh on rank 0. Collective.

    Args:
        comm: communicator of the mesh.
        draw: function that makes a mesh with physical groups in the current, empty gmsh model;
            called on rank 0 only. All entities with the same name must be in one physical group.
        dim: see `read_mesh`.
        groups: see `read_mesh`.

    Raises:
        ValueError: on every rank, if ``draw`` fails; if the model has no mesh, no physical group,
            or no group of the highest dimension; if one of ``groups`` is missing; if groups of
            cells or of facets overlap; if the cells are of several kinds; if a mesh of dimension 2
            is not in a plane of constant z; or if arguments differ between ranks. KeyboardInterrupt
            and SystemExit of ``draw`` are raised on every rank.
    """
    gmsh = optional("gmsh", "gmsh")
    with ExitStack() as session:
        model = None
        with everywhere(comm, "drawing in gmsh"):  # whatever is raised, the other ranks wait
            if comm.rank == 0:
                model = session.enter_context(empty_model(gmsh))
                _fill(model, draw, dim, list(groups))
        return _distribute(comm, model)


def draw_polygon(
    corners: Sequence[tuple[float, float]], size: float, sides: Mapping[str, Sequence[int]]
) -> None:
    """Draw and mesh a polygon in the current gmsh model, for `mesh_from_gmsh`, on rank 0.

    Args:
        corners: corners in order; the inside becomes the group ``body``.
        size: size of the cells.
        sides: indices of the sides in each group, by group name; side 0 leads from corner 0 to
            corner 1.

    Example:
        ::

            square = [(0, 0), (1, 0), (1, 1), (0, 1)]
            sides = {"contact": [0], "top": [2]}
            body = mesh_from_gmsh(comm, lambda: draw_polygon(square, 0.1, sides))
    """
    model = optional("gmsh", "gmsh").model
    points = [model.geo.addPoint(x, y, 0, size) for x, y in corners]
    ends = [*points[1:], points[0]]
    lines = [model.geo.addLine(a, b) for a, b in zip(points, ends, strict=True)]
    face = model.geo.addPlaneSurface([model.geo.addCurveLoop(lines)])
    model.geo.synchronize()
    model.addPhysicalGroup(2, [face], name="body")
    for name, numbers in sides.items():
        model.addPhysicalGroup(1, [lines[i] for i in numbers], name=name)
    model.mesh.generate(2)


@contextmanager
def empty_model(gmsh: Any) -> Iterator[Any]:
    """Context manager providing an empty gmsh model; models of an open session remain."""
    mine = not gmsh.isInitialized()
    if mine:
        gmsh.initialize(readConfigFiles=False, interruptible=False)
    current = None if mine else gmsh.model.getCurrent()
    talkative = gmsh.option.getNumber("General.Terminal")
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("dolfinx_contact")
    try:
        yield gmsh.model
    finally:
        gmsh.model.remove()
        gmsh.option.setNumber("General.Terminal", talkative)
        if current is not None:
            gmsh.model.setCurrent(current)
        if mine:
            gmsh.finalize()


def _fill(model: Any, draw: Callable[[], Any], dim: int | None, wanted: list[str]) -> None:
    """Draw the mesh by ``draw``; raise ``ValueError`` if it cannot be used. On rank 0."""
    try:
        draw()
        if model.getNumberOfPartitions():  # DOLFINx makes a partition of its own
            model.mesh.unpartition()
        objection = next(_objections(model, dim, wanted), "")
    except Exception as error:
        raise ValueError(f"gmsh made no mesh: {error}") from error
    if objection:
        raise ValueError(f"the gmsh model cannot be used: {objection}")
    _warn_of_lost_names(model)


def _distribute(comm: MPI.Comm, model: Any) -> GmshMesh:
    """Return a distributed mesh, made from a gmsh model on rank 0. Collective."""
    named: list[dict[str, int]] = []
    body = 0
    if comm.rank == 0:
        body = max(d for d, _ in model.getPhysicalGroups())
        named = [_names_of(model, d) for d in (body, body - 1)]
        model.mesh.renumberNodes()  # DOLFINx requires numbers without holes
    named, body = comm.bcast((named, body))
    domain, cell_tags, facet_tags = gmsh_io.model_to_mesh(model, comm, 0, gdim=body)[:3]
    keep(domain)
    domain.topology.create_entities(body - 1)
    facets = no_tags(domain, body - 1) if facet_tags is None else NamedTags(facet_tags, named[1])
    return GmshMesh(domain, NamedTags(cell_tags, named[0]), facets)


def no_tags(domain: mesh.Mesh, dim: int) -> NamedTags:
    """Return MeshTags without entities, for a mesh without groups of a dimension."""
    none = np.empty(0, dtype=np.int32)
    return NamedTags(mesh.meshtags(domain, dim, none, none), {})


def _warn_of_lost_names(model: Any) -> None:
    """Warn about unnamed physical groups if other groups of their dimension have a name.

    gmsh drops a name that is assigned twice in one dimension, for example to two arcs of a circle.
    On rank 0.
    """
    for dim in range(1, 4):
        tags = _groups(model, dim)
        unnamed = sorted(tag for tag, name in tags.items() if not name)
        if 0 < len(unnamed) < len(tags):
            logger.warning(
                "physical groups of dimension %d without a name: tags %s; gmsh drops a name that "
                "is given to a second group of this dimension: give all its parts to one group",
                dim,
                ", ".join(map(str, unnamed)),
            )


def _groups(model: Any, dim: int) -> dict[int, str]:
    """Return the names of the physical groups of a dimension by tag; "" if unnamed. On rank 0."""
    return {int(tag): model.getPhysicalName(d, tag) for d, tag in model.getPhysicalGroups(dim)}


def _names_of(model: Any, dim: int) -> dict[str, int]:
    """Return the tag of each named physical group of a dimension, by name. On rank 0."""
    return {name: tag for tag, name in _groups(model, dim).items() if name}


def _objections(model: Any, dim: int | None, wanted: list[str]) -> Iterator[str]:
    """Yield reasons why a model cannot be the mesh of a body, the most basic first. On rank 0."""
    x = model.mesh.getNodes()[1].reshape(-1, 3)
    groups = model.getPhysicalGroups()
    if not len(x):
        yield "it has no mesh: call gmsh.model.mesh.generate(), or read a .msh file"
    if not groups:
        yield (
            "it has no physical groups: name the body and the parts of its boundary, in gmsh by "
            "gmsh.model.addPhysicalGroup or Physical Volume / Surface / Curve"
        )
    body = max(d for d, _ in groups)
    cells = max(d for d in range(4) if len(model.mesh.getElements(d)[0]))
    if body < max(cells, 2):
        yield (
            f"no physical group holds the body: cells are of dimension {cells}, groups of "
            f"dimension {sorted({d for d, _ in groups})}"
        )
    if body == 2 and np.ptp(x[:, 2]) > 1e-10 * np.abs(x).max():
        yield (
            "the body is a surface that is not in a plane of constant z; if it has a volume, the "
            "volume needs a physical group (gmsh saves only what is in one)"
        )
    if dim not in (None, body):
        yield f"the mesh has dimension {body}, but {dim} is required"
    for d in (body, body - 1):
        named = [e for k, g in groups if k == d for e in model.getEntitiesForPhysicalGroup(d, g)]
        meshed = {e for _, e in model.getEntities(d) if len(model.mesh.getElements(d, e)[0])}
        if len(set(named)) < len(named):
            yield (
                f"physical groups of dimension {d} overlap, but a cell or facet can have only one "
                "tag"
            )
        if set(named) - meshed:
            yield f"a physical group of dimension {d} has a part without elements"
        if d == body and meshed - set(named):
            yield "some cells are in no physical group; the whole body must be in one or more"
    kinds = [model.mesh.getElementProperties(k)[0] for k in model.mesh.getElements(body)[0]]
    if len(kinds) > 1 or kinds[0].startswith(("Prism", "Pyramid")):
        yield f"the cells must be of one kind, without prisms and pyramids; got {', '.join(kinds)}"
    facets = sorted(_names_of(model, body - 1))
    missing = [name for name in wanted if name not in facets]
    if missing:
        yield (
            f"no physical group of dimension {body - 1} is named {', '.join(missing)}; there are: "
            f"{', '.join(facets) or 'none'}"
        )
