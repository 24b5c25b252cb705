"""Data with kinks and jumps: in a part of the body, in vectors of gamma, beside wild iterates."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import box, facets

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    ConvergenceError,
    Frictionless,
    HalfSpace,
    ParametricContact,
    RigidBody,
    materials,
)
from dolfinx_contact.continuation import find_solutions, follow

COMM = MPI.COMM_WORLD
FLOOR = HalfSpace((0.0, 0.0), (0.0, 1.0))


class Column:
    """A square of modulus 1000 without lateral strain, held on top, on a floor."""

    def __init__(self, obstacle=FLOOR, more=lambda column: 0):
        self.mesh = box(COMM, 4, "quad")
        V = fem.functionspace(self.mesh, ("Lagrange", 1, (2,)))
        self.u = fem.Function(V)
        self.top = fem.Function(V)
        self.x = ufl.SpatialCoordinate(self.mesh)
        self.gamma = fem.Constant(self.mesh, 0.5)
        energy = materials.LinearElastic.from_young(1000.0, 0.0).energy(self.u) * ufl.dx
        dofs = fem.locate_dofs_topological(V, 1, facets(self.mesh, 1, 1.0))
        obstacle = obstacle if obstacle is FLOOR else obstacle(self.gamma)
        bottom = facets(self.mesh, 1, 0.0)
        floor = ContactSurface(self.u, bottom, obstacle=obstacle, law=Frictionless())
        held = [fem.dirichletbc(self.top, dofs)]
        self.problem = ContactProblem(energy + more(self), self.u, [floor], bcs=held)

    def solved(self, driven=()):
        """The system at gamma = 1/2 with its solution there."""
        system = ParametricContact(self.problem, self.gamma, driven=driven)
        system.set_parameter(0.5)
        self.problem.solve()
        x = system.create_vector()
        self.problem.write(x)
        return system, x


def in_one_cell(column):
    chosen = fem.Function(fem.functionspace(column.mesh, ("DG", 0)))
    chosen.interpolate(lambda x: 1.0 * ((x[0] > 0.75) & (x[1] < 0.25)))
    return 20.0 * chosen * abs(column.u[0]) * ufl.dx


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    "more",
    [
        lambda c: ufl.conditional(ufl.lt(c.x[1], 1e-6), 20.0, 0.0) * abs(c.u[0]) * ufl.ds,
        in_one_cell,
    ],
)
def test_a_jump_in_a_part(more):
    """Friction in a part of the body: the error of the solve names a law instead."""
    column = Column(more=lambda c: more(c) - 2.0 * c.u[0] * ufl.dx)
    column.top.x.array[1::2] = -0.01
    with pytest.raises(ConvergenceError, match=r"kinks in u.* as Tresca"):
        column.problem.solve(progress=False)


@pytest.mark.verifies(
    "bulk with kinks",
    reference="closed form: a column on a spring that only pushes",
    aspects=("2D",),
)
def test_a_kink_in_a_part():
    def more(c):
        lower = ufl.conditional(ufl.lt(c.x[1], 1e-6), 1.0, 0.0)
        return 1500.0 * lower * ufl.max_value(-c.u[1] - 0.002, 0.0) ** 2 * ufl.ds

    column = Column(lambda gamma: HalfSpace((0.0, -0.5), (0.0, 1.0)), more)
    column.top.x.array[1::2] = -0.01
    table = column.problem.solve().tables["contact"]
    np.testing.assert_allclose(0.5 - table.un, 16.0 / 4000.0, rtol=1e-7)


def test_beyond_a_kink():
    """What was solved to excess on the way measured the residuals of all later points."""

    def rises(gamma):
        way = 0.01 * (1 - abs(gamma - 1))
        return RigidBody(FLOOR, about=(0.5, 0.0), motion={"y": way}, held=["x", "rz"])

    system, x = Column(rises).solved()
    branch = follow(system, x, 0.5, gamma_range=(0.5, 1.8))
    gammas = [p.gamma for p in branch.points]
    found = [system.result_at(p).resultants["contact"][1] for p in branch.points]
    assert gammas[-1] == 1.8
    np.testing.assert_allclose(found, 10 * (1 - np.abs(np.array(gammas) - 1)), rtol=1e-9)


def test_solutions_leave_no_scales():
    """As wild states of deflation are, residuals of what is followed afterwards are not."""
    column = Column()
    way = ufl.as_vector((0.0, -0.01 * ufl.min_value(column.gamma, 1.0)))
    system, x = column.solved(driven=[(column.top, way)])
    before = system.scales
    found = find_solutions(system, [x], 1.7, lengths=(0.5,), max_iterations=20)
    assert system.scales == before
    forces = [
        system.result_at(p).resultants["contact"][1] for p in found.points(system, found.found)
    ]
    np.testing.assert_allclose(forces, [10.0], rtol=1e-9)
