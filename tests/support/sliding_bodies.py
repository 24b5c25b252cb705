"""Two bodies in large sliding, and a U in self-contact."""

from mpi4py import MPI

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
)
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import NeoHookean, lame
from support.blocks import CELLS
from support.pairs import displacement

COMM = MPI.COMM_WORLD


RUBBER = NeoHookean(*lame(1000.0, 0.3))


class Bodies:
    """Two blocks on each other; the lower one is held below, the upper one is moved above."""

    def __init__(self, both, slave, law, material=RUBBER, options=None, **given):
        self.both = both
        domain = both.mesh
        dim = domain.geometry.dim
        self.dim = dim
        self.u = u = displacement(domain)
        V = u.function_space
        given = {"sliding": "large"} | given
        contact = ContactPair(u, both, slave=slave, master=5 - slave, law=law, **given)
        self.below, self.above = fem.Function(V), fem.Function(V)
        bcs = []
        for tag, f in ((1, self.below), (4, self.above)):
            nodes = fem.locate_dofs_topological(V, dim - 1, both.facet_tags.find(tag))
            bcs.append(fem.dirichletbc(f, nodes))
        energy = material.energy(u) * ufl.dx
        self.problem = ContactProblem(energy, u, [contact], bcs=bcs, petsc_options=options)
        (self.pair,) = self.problem.surfaces

    def move(self, motion, below=None):
        """Prescribe motions of positions X (n, dim), above and below."""
        X = self.u.function_space.tabulate_dof_coordinates()[:, : self.dim]
        self.above.x.array[:] = motion(X).reshape(-1)
        if below is not None:
            self.below.x.array[:] = below(X).reshape(-1)


def flat_disc(cell, n, comm=COMM):
    """A disc of radius 1 and height 0.5 above z = 0."""
    aside = [np.linspace(-1.0, 1.0, n + 1)] * 2
    disc = create_grid(comm, [*aside, [0.0, 0.5]], CELLS[cell])
    x = disc.geometry.x
    squares = x[:, :2] ** 2
    x[:, :2] *= np.sqrt(1.0 - 0.5 * squares[:, ::-1])
    return disc


def of_upper(both, V):
    """Owned nodes of the upper body."""
    dim = both.mesh.topology.dim
    cells = mesh.locate_entities(both.mesh, dim, lambda x: x[dim - 1] >= -1e-9)
    nodes = np.unique(V.dofmap.list[cells])
    return nodes[nodes < V.dofmap.index_map.size_local]


def smooth(x, seed, size):
    """A smooth vector field at positions x (n, dim)."""
    rng = np.random.default_rng(seed)
    dim = x.shape[1]
    return size * np.sin(x @ rng.normal(size=(dim, dim)) * 2 + rng.normal(size=dim))


def sliding_history(bodies):
    """Pressed, then pulled by more than two facets, and back by one."""

    def load(t):
        def motion(X):
            moved = np.zeros_like(X)
            moved[:, -1] = -0.05 * min(t, 1.0)
            moved[:, 0] = 0.5 * (max(t - 1.0, 0.0) - 2 * max(t - 2.0, 0.0))
            return moved

        bodies.move(motion)

    return QuasiStatic(bodies.problem, load)


TIMES = np.concatenate([[0.0, 0.5], np.linspace(1.0, 2.5, 13)])


def hairpin(h=0.1, stretch=1.15, comm=COMM):
    """A U of quadrilaterals whose upper arm has other nodes; its inner face has the tag 1."""
    nx, ny = round(6 / h), round(2.5 / h)
    grid = np.stack(np.meshgrid(np.linspace(0, 6, nx + 1), np.linspace(0, 2.5, ny + 1)), -1)
    points = grid.reshape(-1, 2)
    i, j = (v.reshape(-1) for v in np.meshgrid(np.arange(nx), np.arange(ny)))
    first = j * (nx + 1) + i
    cells = np.stack([first, first + 1, first + nx + 1, first + nx + 2], 1)
    middle = points[cells].mean(axis=1)
    hole = (middle[:, 0] > 1) & (middle[:, 1] > 1) & (middle[:, 1] < 1.5)
    used, inverse = np.unique(cells[~hole], return_inverse=True)
    points = points[used]
    arm = (points[:, 1] >= 1.5 - 1e-9) & (points[:, 0] > 1)
    points[arm, 0] = 1 + 5 * ((points[arm, 0] - 1) / 5) ** stretch
    cells = inverse.reshape(-1, 4).astype(np.int64)
    if comm.rank:
        cells, points = cells[:0], points[:0]
    element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
    domain = mesh.create_mesh(comm, cells=cells, x=points, e=element)

    def inner(x):
        return (x[0] > 1 - 1e-9) & (x[1] > 1 - 1e-9) & (x[1] < 1.5 + 1e-9)

    found = mesh.locate_entities_boundary(domain, 1, inner)
    middles = mesh.compute_midpoints(domain, 1, found)
    found = found[~np.isclose(middles[:, 0], 6.0)]
    return domain, mesh.meshtags(domain, 1, np.sort(found), np.full(len(found), 1, np.int32))
