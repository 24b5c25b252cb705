"""Blocks pressed on curved obstacles and rigid bodies in large sliding."""

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Cylinder,
    Frictionless,
    LevelSet,
    Sphere,
    materials,
)
from dolfinx_contact.equations.jacobian import Jacobian
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.points.memory import Memory
from support.blocks import box, facets
from support.sliding_bodies import smooth

COMM = MPI.COMM_WORLD


DX = ufl.dx(metadata={"quadrature_degree": 2})  # assembly would take most of the time


RUBBER = materials.NeoHookean(*materials.lame(1000.0, 0.3))


def block(obstacle, *, cell="quad", n=4, top=None, law=None, material=RUBBER, degree=1, **given):
    """A unit block held and moved at its top, in contact at its bottom."""
    domain = box(COMM, n, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    options = given.pop("options", None)
    surface = ContactSurface(
        u, facets(domain, dim - 1, 0.0), obstacle=obstacle, law=law or Frictionless(), **given
    )
    moved = np.array(top if top is not None else [*[0.0] * (dim - 1), -0.1])
    held = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
    bcs = [fem.dirichletbc(moved, held, V)]
    energy = material.energy(u) * DX
    return ContactProblem(energy, u, [surface], bcs=bcs, petsc_options=options)


OBSTACLES = {
    "disc": Sphere((0.4, -3.0), 3.0),
    "ball": Sphere((0.4, 0.6, -3.0), 3.0),
    "cylinder": Cylinder((0.4, 0.5, -2.0), (0.3, 1.0, 0.1), 2.0),
    "ellipse": LevelSet(lambda x: (x[0] - 0.4) ** 2 / 4 + (x[1] + 1.0) ** 2 - 1.0),
    "bumps": LevelSet(lambda x: x[2] + 0.1 * ufl.sin(3 * x[0]) * ufl.cos(2 * x[1])),
}


def shaken(problem, size, seed):
    """Unknowns of some size, the same on any number of ranks."""
    units = problem.equations.unknowns.units
    x = problem.create_vector()
    for f, unit in zip(problem.fields, units, strict=False):

        def waves(x, unit=unit, n=f.function_space.dofmap.index_map_bs):
            phase = 12.99 * x[0] + 78.23 * x[1] + 37.72 * x[2] + seed
            return unit * size * np.array([np.sin(43.76 * (phase + i)) for i in range(n)])

        f.interpolate(waves)
        f.x.scatter_forward()
    problem.write(x)
    return x


def shaken_and_direction(problem, motions, rates):
    """Shaken unknowns that satisfy the Dirichlet conditions, and a direction that leaves them.

    Args:
        problem: contact problem.
        motions: unknowns of rigid bodies.
        rates: entries of the direction for rigid bodies.
    """
    eq = problem.equations
    x, v = (shaken(problem, size, seed) for size, seed in ((0.05, 1.0), (1.0, 2.0)))
    n = eq.owned_sizes[0]
    fixed = eq.fixed[:n]
    x.array[:n][fixed] = eq.constraints.displacement()[:n][fixed]
    v.array[:n][fixed] = 0.0
    rest = n + eq.owned_sizes[1]
    x.array[rest:] = motions
    v.array[rest:] = rates
    return x, v


def ellipse(domain, centre, angle):
    """An ellipse about a centre that has turned by an angle; both may be UFL of Constants."""

    def phi(x):
        c = ufl.cos(angle)
        s = ufl.sin(angle)
        a = x[0] - centre[0]
        b = x[1] - centre[1]
        return (c * a + s * b) ** 2 / 4 + (c * b - s * a) ** 2 - 1.0

    return LevelSet(phi)


def remembering(problem):
    """The problem of a step at whose beginning the contact points were somewhere else."""
    (s,) = problem.surfaces
    place = smooth(s.positions, 5, 0.05)
    return problem.with_memory([Memory(np.zeros_like(place), place=place, step=1.0)])


def errors_of_differences(problem, x, v, sizes):
    """Return errors of J v against central differences of several sizes at x, relative to J v.

    Collective. Only contact rows are compared. Every status occurs, and no status changes.
    """
    eq = problem.equations
    (s,) = problem.surfaces
    n = eq.owned_sizes[0]
    codes = s.law_at_points.codes
    mine = np.arange(s.points.number) + COMM.rank
    statuses = [np.array(codes, dtype=np.int8)[mine % len(codes)]]
    b, after, before, product = (x.duplicate() for _ in range(4))
    jacobian = Jacobian(eq)
    jacobian.update(eq.residual(x, b, statuses))
    jacobian.matrix.mult(v, product)
    errors = []
    for eps in sizes:
        for sign, f in ((eps, after), (-eps, before)):
            y = x.copy()
            y.axpy(sign, v)
            eq.residual(y, f, statuses)
        after.axpy(-1.0, before)
        after.scale(0.5 / eps)
        after.axpy(-1.0, product)
        rows = [np.sum(f.array_r[n:] ** 2) for f in (after, product)]
        errors.append(np.sqrt(np.divide(*COMM.allreduce(np.array(rows)))))
    return errors


class OnBody:
    """A block held and moved at its top, on a body or another obstacle at its bottom."""

    def __init__(self, dim, obstacle, law, *, n=3, comm=COMM, cell=None, **given):
        cell = cell or ("quad" if dim == 2 else "hex")
        domain = box(comm, n, cell)
        lifted = given.pop("lifted", None)
        if lifted is not None:
            x = domain.geometry.x
            x[:, dim - 1] += (1.0 - x[:, dim - 1]) * lifted(x[:, : dim - 1])
        self.dim = dim
        V = fem.functionspace(domain, ("Lagrange", given.pop("degree", 1), (dim,)))
        self.X = V.tabulate_dof_coordinates()[:, :dim]
        self.u = fem.Function(V)
        self.top = fem.Function(V)
        material = given.pop("material", RUBBER)
        bottom = mesh.locate_entities_boundary(domain, dim - 1, self._below(dim, lifted))
        obstacle = obstacle(domain) if callable(obstacle) else obstacle
        surface = ContactSurface(self.u, bottom, obstacle=obstacle, law=law, **given)
        held = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
        bcs = [fem.dirichletbc(self.top, held)]
        energy = material.energy(self.u) * DX
        options = {"snes_rtol": 1e-11}
        self.problem = ContactProblem(energy, self.u, [surface], bcs=bcs, petsc_options=options)
        (self.surface,) = self.problem.surfaces

    @staticmethod
    def _below(dim, lifted):
        """Which points are on the lower face."""

        def at(x):
            z = np.zeros(x.shape[1]) if lifted is None else lifted(x[: dim - 1].T)
            return np.isclose(x[dim - 1], z, atol=1e-9)

        return at

    def move(self, motion):
        """Prescribe displacements (n, dim) of the positions X (n, dim) at the top."""
        self.top.x.array[:] = motion(self.X).reshape(-1)

    def run(self, motion, times, **given):
        """A history; its energies, tables and steps."""

        def load(t):
            self.move(lambda X: motion(t, X))

        self.evolution = QuasiStatic(self.problem, load)
        return self.evolution.run(times, **given)


def pressed_and_led(t, X, press=0.06, shear=0.04):
    """Down until t = 1, then to the side."""
    moved = np.zeros_like(X)
    moved[:, -1] = -press * min(t, 1.0)
    moved[:, 0] = shear * max(t - 1.0, 0.0)
    return moved


class Stopped(Exception):
    """Exception of an observer."""
