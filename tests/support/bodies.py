"""Small bodies whose contact forces have a closed form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, meshing
from dolfinx_contact.laws import FrictionLaw
from dolfinx_contact.materials import LinearElastic
from support.blocks import CELLS

COMM = MPI.COMM_WORLD


def floor(height: float = 0.0, dim: int = 2) -> HalfSpace:
    """Return the half-space below a height."""
    return HalfSpace(height * np.eye(dim)[-1], np.eye(dim)[-1])


def move(f: fem.Function, *components: float) -> None:
    """Set a vector Function to a constant."""
    f.interpolate(lambda x: np.outer(components, np.ones(x.shape[1])))


@dataclass
class Block:
    """A rectangle or box with its displacement, held at its top.

    Attributes:
        domain: mesh.
        V: space of the displacement.
        u: displacement.
        bottom: facets of the lowest face.
        top: facets of the highest face.
        moved: prescribed displacement of the top.
        bcs: the Dirichlet condition of the top.
    """

    domain: mesh.Mesh
    V: fem.FunctionSpace
    u: fem.Function
    bottom: Any
    top: Any
    moved: fem.Function
    bcs: list[fem.DirichletBC]

    def move_top(self, *components: float) -> None:
        """Prescribe a constant displacement of the top."""
        move(self.moved, *components)

    def at_bottom(self) -> Any:
        """Return the UFL indicator of the lowest face (height 0, body of size 1)."""
        return ufl.conditional(
            ufl.lt(ufl.SpatialCoordinate(self.domain)[len(self.u) - 1], 1e-6), 1.0, 0.0
        )

    def elastic(self, young: Any = 1000.0, poisson: float = 0.0) -> Any:
        """Return the elastic energy, a form."""
        return LinearElastic.from_young(young, poisson).energy(self.u) * ufl.dx

    def dofs_of(self, component: int, where: Any) -> Any:
        """Return the dofs of one component on facets."""
        return fem.locate_dofs_topological(
            self.V.sub(component), self.domain.topology.dim - 1, where
        )

    def problem(
        self,
        law: Any = None,
        bulk: Any = None,
        *,
        obstacle: Any = None,
        bcs: Any = None,
        petsc_options: Any = None,
        **options: Any,
    ) -> ContactProblem:
        """Return the problem of the body on an obstacle that its bottom touches.

        Args:
            law: contact law, frictionless by default.
            bulk: energy or residual, by default of a modulus 1000 and Poisson's ratio 0.
            obstacle: obstacle, by default the floor at height 0.
            bcs: Dirichlet conditions, by default that of the top.
            petsc_options: options of the problem.
            options: options of the surface.
        """
        obstacle = obstacle or floor(0.0, len(self.u))
        law = law or Frictionless()
        surface = ContactSurface(self.u, self.bottom, obstacle=obstacle, law=law, **options)
        bulk = self.elastic() if bulk is None else bulk
        bcs = self.bcs if bcs is None else bcs
        return ContactProblem(bulk, self.u, [surface], bcs=bcs, petsc_options=petsc_options)


def block(
    cells: tuple[int, ...] = (2, 2),
    size: tuple[float, ...] | None = None,
    cell: str | None = None,
    degree: int = 1,
    *,
    comm: MPI.Comm = COMM,
    **grid: Any,
) -> Block:
    """Return a body on [0, a] x [0, b] (x [0, c]) that is held at its top and free elsewhere.

    Args:
        cells: numbers of cells along the axes, two or three.
        size: lengths of the edges, by default 1.
        cell: "tri", "quad", "tet" or "hex"; quadrilaterals or hexahedra by default.
        degree: degree of the displacement.
        comm: communicator.
        grid: further arguments of ``create_rectangle`` or ``create_box``.
    """
    dim = len(cells)
    size = (1.0,) * dim if size is None else size
    corners = [np.zeros(dim), np.asarray(size, dtype=float)]
    create = mesh.create_rectangle if dim == 2 else mesh.create_box
    domain = create(comm, corners, cells, CELLS[cell or ("quad" if dim == 2 else "hex")], **grid)

    def face(value: float) -> Any:
        return mesh.locate_entities_boundary(
            domain, dim - 1, lambda x: np.isclose(x[dim - 1], value, atol=1e-9 * max(size))
        )

    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V, name="displacement")
    moved = fem.Function(V, name="moved")
    top = face(size[-1])
    held = fem.dirichletbc(moved, fem.locate_dofs_topological(V, dim - 1, top))
    return Block(domain, V, u, face(0.0), top, moved, [held])


def one_point(stiffness: Any, dim: int = 2) -> tuple[Block, Any]:
    """Return a body of simplices with one free node, and its energy.

    The free node is the corner at the origin. A spring S ties it to the corner above: the force on
    it is S (U - u) where the top moves by U.

    Args:
        stiffness: S, shape (dim, dim), tangents before the normal.
        dim: dimension.
    """
    body = block((1,) * dim, cell="tri" if dim == 2 else "tet")
    others = fem.locate_dofs_geometrical(
        body.V, lambda x: np.isclose(x[dim - 1], 0) & (np.sum(x, axis=0) > 0.5)
    )
    body.bcs.append(fem.dirichletbc(np.zeros(dim), others, body.V))
    return body, _springs(body, stiffness, float(dim))


def _springs(body: Block, stiffness: Any, factor: float) -> Any:
    strain = body.u.dx(len(body.u) - 1)
    S = ufl.as_matrix(np.asarray(stiffness, dtype=float).tolist())
    return factor / 2 * ufl.dot(strain, ufl.dot(S, strain)) * ufl.dx


def free_row(table: Any) -> int:
    """Return the row of the free node of `one_point` in the table of the bottom."""
    return int(np.argmin(np.linalg.norm(table.x, axis=1)))


@dataclass
class TwoBlocks:
    """One block on another, held at the top of the upper one and at the foot of the lower one.

    Attributes:
        domain: mesh of both.
        parts: cell tags, 1 above and 2 below.
        V: space of the displacement.
        u: displacement.
        slave: facets of the upper block at the interface.
        master: facets of the lower block at the interface.
        top: prescribed displacement of the top.
        foot: prescribed displacement of the foot.
        bcs: Dirichlet conditions of top and foot.
    """

    domain: mesh.Mesh
    parts: mesh.MeshTags
    V: fem.FunctionSpace
    u: fem.Function
    slave: Any
    master: Any
    top: fem.Function
    foot: fem.Function
    bcs: list[fem.DirichletBC]


def two_blocks(
    upper: tuple[int, ...] = (2, 2),
    lower: tuple[int, ...] = (4, 2),
    *,
    unit: float = 1.0,
    wide: tuple[float, float] = (0.0, 1.0),
    at: float = 0.0,
    depth: float = 0.5,
    cell: str = "quad",
    degree: int = 1,
) -> TwoBlocks:
    """Return a unit square (cube) on a lower block, which may be wider.

    Args:
        upper: numbers of cells of the upper block along the axes, two or three.
        lower: numbers of cells of the lower block.
        unit: unit of length.
        wide: ends of the lower block along x.
        at: left end of the upper block.
        depth: height of the lower block.
        cell: "tri", "quad", "tet" or "hex".
        degree: degree of the displacement.
    """
    dim = len(upper)
    create = mesh.create_rectangle if dim == 2 else mesh.create_box
    boxes = (
        (upper, [at, *[0.0] * (dim - 1)], [at + 1.0, *[1.0] * (dim - 1)]),
        (lower, [wide[0], *[0.0] * (dim - 2), -depth], [wide[1], *[1.0] * (dim - 2), 0.0]),
    )
    both = meshing.join(
        [create(COMM, unit * np.array([a, b]), n, CELLS[cell]) for n, a, b in boxes]
    )
    domain = both.mesh

    def face(value: float) -> Any:
        return mesh.locate_entities_boundary(
            domain, dim - 1, lambda x: np.isclose(x[dim - 1], value * unit, atol=1e-9 * unit)
        )

    between = face(0.0)
    domain.topology.create_connectivity(dim - 1, dim)
    to_cells = domain.topology.connectivity(dim - 1, dim)
    above = np.isin(to_cells.array[to_cells.offsets[between]], both.cell_tags.find(1))
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V, name="displacement")
    moved = [fem.Function(V) for _ in range(2)]
    bcs = [
        fem.dirichletbc(f, fem.locate_dofs_topological(V, dim - 1, face(value)))
        for f, value in zip(moved, (1.0, -depth), strict=True)
    ]
    return TwoBlocks(domain, both.cell_tags, V, u, between[above], between[~above], *moved, bcs)


def normal_force(result: Any, name: str = "contact") -> float:
    """Return the resultant along the last axis."""
    return result.resultants[name][-1]


def friction_ratio(table: Any) -> float:
    """Return the whole tangential force along the first axis over the normal force, Q/P."""
    return float(-np.sum(table.rt[:, 0]) / np.sum(table.rn))


def triangle(at: float = 0.0, comm: MPI.Comm = MPI.COMM_SELF) -> mesh.Mesh:
    """Return one right triangle on the floor, its slope to be held: one node moves.

    Args:
        at: position of the right angle, the node that moves.
        comm: communicator; the cell is on its rank 0.
    """
    corners = np.array([[at, 0.0], [at + 1.0, 0.0], [at, 1.0]])
    cells = np.array([[0, 1, 2]])
    if comm.rank:
        cells, corners = cells[:0], corners[:0]
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    return mesh.create_mesh(comm, cells=cells, x=corners, e=element)


def table_of(problem: ContactProblem) -> Any:
    """Return the table of the first surface at the state in the Functions."""
    return problem.table(problem.surfaces[0])


@dataclass(frozen=True)
class SlipWeakening(FrictionLaw):
    """Friction falling with the distance slipped, from ``static`` to ``kinetic``."""

    static: Any
    kinetic: Any
    distance: Any

    def bound(self, a: Any, p: Any) -> Any:
        """Return the bound of the shear under the pressure ``p``."""
        fade = ufl.exp(-a.slid / self.distance)
        return (self.kinetic + (self.static - self.kinetic) * fade) * p
