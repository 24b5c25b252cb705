"""Bodies that lean, with friction on one side, for questions about critical friction."""

from mpi4py import MPI

import numpy as np
import scipy.sparse

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
)
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD


def on_box(
    domain,
    *,
    material=None,
    sides=None,
    law=None,
    friction=0.3,
    clamped=True,
    floor=None,
    **surface,
):
    """A body clamped at its top, the last coordinate, with contact at its bottom."""
    material = material or LinearElastic.from_young(1.0, 0.3)
    dim = domain.geometry.dim
    top = domain.comm.allreduce(domain.geometry.x[:, dim - 1].max(initial=-np.inf), op=MPI.MAX)
    facets = [
        mesh.locate_entities_boundary(domain, dim - 1, lambda x, y=y: np.isclose(x[dim - 1], y))
        for y in (0.0, top)
    ]
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    dofs = fem.locate_dofs_topological(V, dim - 1, facets[1])
    bcs = [fem.dirichletbc(np.zeros(dim), dofs, V)] if clamped else []
    bcs += sides(V) if sides else []
    floor = floor or HalfSpace(np.zeros(dim), np.eye(dim)[-1])
    s = ContactSurface(u, facets[0], obstacle=floor, law=law or Coulomb(friction), **surface)
    return ContactProblem(material.energy(u) * ufl.dx, u, [s], bcs=bcs)


def leaning(n, *, height=2.0, offset=1.0, cell=mesh.CellType.quadrilateral, width=1.0, comm=COMM):
    box = [[0.0, 0.0], [width, height]]
    domain = mesh.create_rectangle(comm, box, [n, max(round(n * height / width), 1)], cell)
    domain.geometry.x[:, 0] += offset * domain.geometry.x[:, 1] / height
    return on_box(domain)


def block(n, lean=(0.5, 0.2), comm=COMM, **given):
    domain = mesh.create_box(
        comm, [[0, 0, 0], [1, 0.6, 1.5]], [n, max(n // 2, 1), n], mesh.CellType.hexahedron
    )
    x = domain.geometry.x
    x[:, :2] += np.outer(x[:, 2], lean)
    return on_box(domain, **given)


def in_plane(V):
    """Plane strain: no motion along y."""
    domain = V.mesh
    domain.topology.create_connectivity(3, 3)
    cells = domain.topology.index_map(3)
    every = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
    dofs = fem.locate_dofs_topological(V.sub(1), 3, every)
    return [fem.dirichletbc(0.0, dofs, V.sub(1))]


QUADS = mesh.CellType.quadrilateral


FASTEST = {
    2: (0.1987611737 + 3.4110748932j, 0.4313555153 + 3.2384000632j),
    4: (0.0980819683 + 2.9400657677j, 0.3760006800 + 4.1775935998j),
}


def pad(n, comm=COMM, **given):
    return on_box(mesh.create_unit_square(comm, n, n, QUADS), **given)


def to_the(sign):
    return lambda x: np.tile(sign * np.eye(x.shape[1])[0], (len(x), 1))


def stiffness_of_points(problem):
    """S (m, dim, m, dim) and the local nodes, dense, on one rank; gaps along -n."""
    V = problem.V
    dim = V.mesh.geometry.dim
    n = V.dofmap.index_map.size_local
    K = problem.equations.bulk.stiffness(problem.u.x.array).getValuesCSR()
    K = scipy.sparse.csr_matrix((K[2], K[1], K[0])).toarray()
    free = ~problem.equations.fixed
    nodes = problem.surfaces[0].points.trace_nodes
    nodes = nodes[free.reshape(n, dim)[nodes].all(axis=1)]
    on = (dim * nodes[:, None] + np.arange(dim)).ravel()
    inside = np.setdiff1d(np.flatnonzero(free), on)
    S = K[np.ix_(on, on)] - K[np.ix_(on, inside)] @ np.linalg.solve(
        K[np.ix_(inside, inside)], K[np.ix_(inside, on)]
    )
    return S.reshape(len(nodes), dim, len(nodes), dim), V.tabulate_dof_coordinates()[nodes]


def swirl(x):
    """Directions that turn, shorter than 1 here and there."""
    angle = 5 * x[:, 0] + 3 * x[:, 1]
    size = 0.5 + 0.5 * np.cos(7 * x[:, 0]) ** 2
    return (size * np.array([np.cos(angle), np.sin(angle), 0 * angle])).T
