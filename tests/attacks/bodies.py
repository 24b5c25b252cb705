"""Small bodies that the attacks share, so that few forms are compiled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

from dolfinx import fem, mesh

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
    bottom, top = face(0.0), face(size[dim - 1])
    held = fem.dirichletbc(moved, fem.locate_dofs_topological(V, dim - 1, top))
    return Block(domain, V, u, bottom, top, moved, [held])
