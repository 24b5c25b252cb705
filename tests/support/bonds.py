"""Bonded blocks and bars, one bonded node, and one point led through prescribed jumps."""

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    RCCM,
    ContactPair,
    ContactProblem,
    ContactSurface,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.laws import LawAtPoints, PointData
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.points.memory import Memory, with_memory
from support.blocks import box, facets
from support.histories import put
from support.pairs import displacement, held, stacked

COMM = MPI.COMM_WORLD


C = 100.0


W = 1.0


U0 = np.sqrt(W / C)


TIGHT = {"snes_rtol": 1e-13}


def bonded(
    cell="quad",
    n=2,
    *,
    law,
    method=None,
    degree=1,
    young=1000.0,
    poisson=0.0,
    pair=False,
    comm=COMM,
    **options,
):
    """A block on a floor or on another block, and the Function by which its top moves."""
    dim = 2 if cell in ("tri", "quad") else 3
    energy = LinearElastic.from_young(young, poisson).energy
    if pair:
        both = stacked(dim, cell, n)
        domain = both.mesh
        tags = both.facet_tags
        u = displacement(domain)
        surface = ContactPair(u, tags, slave=3, master=2, law=law)
        below = [held(u, tags, 1, np.zeros(dim))]
        above = tags.find(4)
    else:
        domain = box(comm, n, cell)
        below = []
        u = displacement(domain, degree)
        floor = HalfSpace(np.zeros(dim), np.eye(dim)[-1])
        given = {"obstacle": floor, "law": law, "method": method}
        surface = ContactSurface(u, facets(domain, dim - 1, 0.0), **given)
        above = facets(domain, dim - 1, 1.0)
    V = u.function_space
    top = fem.Function(V)
    bcs = [fem.dirichletbc(top, fem.locate_dofs_topological(V, dim - 1, above)), *below]
    return ContactProblem(
        energy(u) * ufl.dx, u, [surface], bcs=bcs, petsc_options=TIGHT | options
    ), top


def along(top, *corners):
    """A load from corner to corner, one in each unit of time."""
    x = np.array([np.zeros_like(corners[0]), *corners], dtype=float)
    return lambda t: put(top, [np.interp(t, np.arange(len(x)), v) for v in x.T])


class Point:
    """A point on a floor at y = 0, led through jumps; open, or pressed with friction's slip."""

    def __init__(self, law, dim=2, r=1.0):
        self._r = r
        self.law = law
        self.at = LawAtPoints(law, dim, 1, COMM)
        self._fields = {k: np.full(1, float(v)) for k, v in law.given.items()}
        self._n = -np.eye(dim)[-1:]
        self.time = 0.0
        self.memory = None
        self.answers = None
        self.values = None

    def to(self, time, jump, traction=None):
        """The intensity at the end of a step."""
        jump = np.array([jump], dtype=float)
        traction = 0.0 * jump if traction is None else np.array([traction], dtype=float)
        memory = None if self.memory is None else self.memory.later(time - self.time)
        data = PointData(self._n, np.zeros(1), np.full(1, self._r), self._fields)
        seen = jump if memory is None else jump - memory.reference(self._n)
        self.answers = self.at(seen, traction, with_memory(self.at.compiled, memory, data))
        names = self.law.memory(self._n.shape[1])
        fields = {name: self.answers.bond(f"after.{name}") for name in names}
        self.time = time
        self.memory = Memory(jump, fields)
        before = self.values
        self.values = np.array([values[0] for values in fields.values()])
        self.lost = 0.0 if before is None else float(before[0] - self.values[0])
        return float(self.values[0]) if names[0] in self.law.given else self.values


def bar(k, n=8, *, law=None, free=False, comm=COMM):
    """A bar of stiffness k C on a bond; gamma moves its end; it may bend if it is free."""
    corners = [[0.0, 0.0], [0.05, 1.0]]
    domain = mesh.create_rectangle(comm, corners, [1, n], mesh.CellType.quadrilateral)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    gamma = fem.Constant(domain, 0.0)
    top = fem.Function(V)
    end = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 1.0))
    sides = V.sub(0)
    every = np.arange(sides.dofmap.index_map.size_local + sides.dofmap.index_map.num_ghosts)
    still = fem.dirichletbc(fem.Constant(domain, 0.0), 2 * every.astype(np.int32), sides)
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
    law = law or RCCM(C, C, W)
    surface = ContactSurface(u, below, obstacle=HalfSpace((0, 0), (0, 1)), law=law)
    energy = LinearElastic.from_young(k * C, 0.0).energy(u) * ufl.dx
    bcs = [fem.dirichletbc(top, end), *[still][free:]]
    problem = ContactProblem(energy, u, [surface], bcs=bcs)
    return ParametricContact(problem, gamma, driven=[(top, ufl.as_vector((0.0, gamma)))])
