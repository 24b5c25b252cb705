"""Small bodies that the attacks share, so that few forms are compiled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, HalfSpace, materials, meshing

_CELLS = {
    "triangle": mesh.CellType.triangle,
    "quadrilateral": mesh.CellType.quadrilateral,
    "tetrahedron": mesh.CellType.tetrahedron,
    "hexahedron": mesh.CellType.hexahedron,
}


@dataclass
class Block:
    """A rectangle or box with its displacement, its faces and a hold of its top."""

    domain: mesh.Mesh
    V: fem.FunctionSpace
    u: fem.Function
    bottom: Any  # facets
    top: Any  # facets
    moved: fem.Function  # displacement of the top
    bcs: list[fem.DirichletBC]


def block(
    comm: MPI.Comm,
    cells: tuple[int, ...] = (4, 4),
    size: tuple[float, ...] = (1.0, 1.0),
    cell: str | None = None,
    degree: int = 1,
) -> Block:
    """A body on [0, a] x [0, b] (x [0, c]) that is held on its top and free elsewhere.

    Args:
        comm: communicator.
        cells: along the axes, two or three.
        size: of the edges.
        cell: its type; triangles in 2D and hexahedra in 3D by default.
        degree: of the displacement.
    """
    dim = len(cells)
    kind = _CELLS[cell or ("triangle" if dim == 2 else "hexahedron")]
    corners = [np.zeros(dim), np.asarray(size[:dim], dtype=float)]
    create = mesh.create_rectangle if dim == 2 else mesh.create_box
    domain = create(comm, corners, cells, kind)

    def face(value: float) -> Any:
        return mesh.locate_entities_boundary(
            domain, dim - 1, lambda x: np.isclose(x[dim - 1], value, atol=1e-9 * max(size))
        )

    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V, name="displacement")
    moved = fem.Function(V, name="moved")
    bottom = face(0.0)
    top = face(size[dim - 1])
    held = fem.dirichletbc(moved, fem.locate_dofs_topological(V, dim - 1, top))
    return Block(domain, V, u, bottom, top, moved, [held])


def dense(form: Any) -> np.ndarray:
    """Matrix of a bilinear form on a mesh of one rank, without conditions, as an array."""
    return fem.assemble_matrix(fem.form(form)).to_dense()


def nodes_of(V: fem.FunctionSpace, where: Any) -> np.ndarray:
    """Nodes (not dofs) of a space on one rank where ``where(y)`` holds, by coordinates.

    Args:
        V: vector space.
        where: mask of positions (n, 3).
    """
    y = V.tabulate_dof_coordinates()
    found = np.flatnonzero(where(y))
    return found[np.lexsort(y[found].round(12).T[::-1])]


def condensed(K: np.ndarray, kept: np.ndarray, gone: np.ndarray) -> np.ndarray:
    """Schur complement of ``K`` on dofs ``kept``; all but these and ``gone`` are eliminated."""
    rest = np.setdiff1d(np.arange(len(K)), np.concatenate([kept, gone]))
    S = K[np.ix_(kept, kept)]
    if len(rest):
        inner = np.linalg.solve(K[np.ix_(rest, rest)], K[np.ix_(rest, kept)])
        S = S - K[np.ix_(kept, rest)] @ inner
    return S


@dataclass
class TwoBlocks:
    """One block on another, held at the top of the upper and the foot of the lower."""

    domain: mesh.Mesh
    parts: mesh.MeshTags  # 1 above, 2 below
    V: fem.FunctionSpace
    u: fem.Function
    slave: Any  # facets of the upper
    master: Any  # facets of the lower
    top: fem.Function  # displacement of the top
    foot: fem.Function  # displacement of the foot
    bcs: list[fem.DirichletBC]


def two_blocks(
    comm: MPI.Comm,
    upper: tuple[int, ...] = (2, 2),
    lower: tuple[int, ...] = (4, 2),
    *,
    unit: float = 1.0,
    wide: tuple[float, float] = (0.0, 1.0),
    at: float = 0.0,
    cell: str = "quadrilateral",
    degree: int = 1,
) -> TwoBlocks:
    """A unit square (cube) that lies on a block of half its height, which may be wider.

    Args:
        comm: communicator.
        upper: cells of the upper block along the axes, two or three.
        lower: cells of the lower block.
        unit: of length.
        wide: ends of the lower block along x.
        at: where the upper block begins along x.
        cell: type of all cells.
        degree: of the displacement.
    """
    dim = len(upper)
    create = mesh.create_rectangle if dim == 2 else mesh.create_box
    boxes = (
        (upper, [at, *[0.0] * (dim - 1)], [at + 1.0, *[1.0] * (dim - 1)]),
        (lower, [wide[0], *[0.0] * (dim - 2), -0.5], [wide[1], *[1.0] * (dim - 2), 0.0]),
    )
    both = meshing.join(
        [create(comm, unit * np.array([a, b]), n, _CELLS[cell]) for n, a, b in boxes]
    )
    domain = both.mesh
    parts = both.cell_tags

    def face(value: float) -> Any:
        return mesh.locate_entities_boundary(
            domain, dim - 1, lambda x: np.isclose(x[dim - 1], value * unit, atol=1e-9 * unit)
        )

    between = face(0.0)
    domain.topology.create_connectivity(dim - 1, dim)
    to_cells = domain.topology.connectivity(dim - 1, dim)
    above = np.isin(to_cells.array[to_cells.offsets[between]], parts.find(1))
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V, name="displacement")
    moved = [fem.Function(V) for _ in range(2)]
    bcs = [
        fem.dirichletbc(f, fem.locate_dofs_topological(V, dim - 1, face(value)))
        for f, value in zip(moved, (1.0, -0.5), strict=True)
    ]
    return TwoBlocks(domain, parts, V, u, between[above], between[~above], *moved, bcs)


def copied(u: fem.Function, own: fem.Function) -> None:
    """Values of ``u``, of all ranks, into ``own`` on one rank, by the places of nodes. Collective.

    Args:
        u: a vector Function.
        own: one of the same element on the same mesh, on COMM_SELF.
    """
    dim = u.function_space.dofmap.index_map_bs
    x = u.function_space.tabulate_dof_coordinates()
    parts = u.function_space.mesh.comm.allgather((x, u.x.array.reshape(-1, dim)))
    places = np.concatenate([p[0] for p in parts])
    values = np.concatenate([p[1] for p in parts])
    for i, y in enumerate(own.function_space.tabulate_dof_coordinates()):
        nearest = np.argmin(np.linalg.norm(places - y, axis=1))
        own.x.array[dim * i : dim * (i + 1)] = values[nearest]


def springs(
    comm: MPI.Comm,
    stiffness: Any,
    cells: tuple[int, ...] = (2, 1),
    size: tuple[float, ...] = (1.0, 1.0),
    cell: str = "quadrilateral",
) -> tuple[Block, Any]:
    """A block of springs that stand beside each other, and its energy.

    Whatever moves its top as a whole moves its bottom as a whole, as one point that a spring of
    the stiffness S per area (dim, dim), tangents before the normal, ties to the top. So one point
    by hand is the right answer.
    """
    body = block(comm, cells, size, cell)
    dim = len(cells)
    strain = body.u.dx(dim - 1)
    if isinstance(stiffness, (list, tuple, np.ndarray)):
        stiffness = ufl.as_matrix(np.asarray(stiffness, dtype=float).tolist())
    energy = size[dim - 1] / 2 * ufl.dot(strain, ufl.dot(stiffness, strain)) * ufl.dx
    return body, energy


def moves(body: Block, *components: float) -> None:
    """Move the top as a whole."""
    body.moved.interpolate(lambda x: np.stack([c + 0 * x[0] for c in components]))


def one_point(comm: MPI.Comm, stiffness: Any, dim: int = 2) -> tuple[Block, Any]:
    """A body of simplices of which the corner at the origin alone is free, and its energy.

    A spring of the stiffness S (dim, dim), a force per length, tangents before the normal, ties it
    to the corner above: S (U - u) is the force on it where the top moves by U. The other corners
    of the bottom are held.
    """
    body = block(comm, (1,) * dim, (1.0,) * dim, cell="triangle" if dim == 2 else "tetrahedron")
    strain = body.u.dx(dim - 1)
    S = ufl.as_matrix(np.asarray(stiffness, dtype=float).tolist())
    energy = dim / 2 * ufl.dot(strain, ufl.dot(S, strain)) * ufl.dx
    others = fem.locate_dofs_geometrical(
        body.V, lambda x: np.isclose(x[dim - 1], 0) & (np.sum(x, axis=0) > 0.5)
    )
    body.bcs.append(fem.dirichletbc(np.zeros(dim), others, body.V))
    return body, energy


def free_point(table: Any) -> int:
    """Which row of the table of the bottom of `one_point` is the free corner."""
    return int(np.argmin(np.linalg.norm(table.x, axis=1)))


def on_floor(
    body: Block, law: Any, *, obstacle: Any = None, young: Any = 1000.0, **options: Any
) -> tuple[ContactProblem, ContactSurface]:
    """A linear body with Poisson's ratio 0 on a floor at height 0: its problem and its surface.

    Args:
        body: that touches it with its bottom.
        law: of contact and friction.
        obstacle: another one than the floor.
        young: modulus.
        options: of the surface.
    """
    dim = body.domain.geometry.dim
    floor = obstacle or HalfSpace(point=np.zeros(dim), normal=np.eye(dim)[-1])
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=law, **options)
    steel = materials.LinearElastic.from_young(young, 0.0)
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)
    return problem, contact


def ratio(table: Any) -> float:
    """Of a surface along the first axis the whole tangential force over the normal one."""
    return float(-np.sum(table.rt[:, 0]) / np.sum(table.rn))


def refused(do: Callable[[], object]) -> str:
    """The words with which something is refused; "" if it is not."""
    try:
        do()
    except (ValueError, AttributeError) as error:
        return str(error)
    return ""
