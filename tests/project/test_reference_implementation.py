"""The reference implementation in the documentation computes the same numbers as the package."""

import runpy
from pathlib import Path
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, ParametricContact
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import LinearElastic

PAGE = Path(__file__).parents[2] / "docs" / "theory" / "reference_implementation.py"
FRICTION = 0.6
YOUNG = 1000.0
R = 800.0


@pytest.fixture(scope="module")
def reference():
    """The names that the page defines; its own assertions are tested as well."""
    return SimpleNamespace(**runpy.run_path(str(PAGE)))


def on_side(domain, axis, value):
    fdim = domain.topology.dim - 1
    return mesh.locate_entities_boundary(domain, fdim, lambda x: np.isclose(x[axis], value))


class Case:
    """A block on a tilted floor in both implementations, with two traction components on its side.

    Its top is moved. With ``clamped``, one side is moved as well, so that some nodes of the contact
    surface belong to a support.
    """

    def __init__(self, reference, dim, clamped):
        n = (12, 5) if dim == 2 else (5, 3, 3)
        create = mesh.create_unit_square if dim == 2 else mesh.create_unit_cube
        self.domain = create(MPI.COMM_SELF, *n)
        V = fem.functionspace(self.domain, ("Lagrange", 1, (dim,)))
        self.u = fem.Function(V)
        self.moved = fem.Constant(self.domain, np.zeros(dim))
        sides = [(dim - 1, 1.0), (0, 1.0)][: 1 + clamped]
        held = np.concatenate([on_side(self.domain, *side) for side in sides])
        dofs = fem.locate_dofs_topological(V, dim - 1, np.unique(held))
        self.bcs = [fem.dirichletbc(self.moved, dofs, V)]
        self.gamma = fem.Constant(self.domain, 1.0)
        left = mesh.meshtags(self.domain, dim - 1, np.sort(on_side(self.domain, 0, 0.0)), 1)
        ds = ufl.Measure("ds", self.domain, subdomain_data=left)
        pull = fem.Constant(self.domain, np.linspace(3.0, 1.0, dim))
        self.energy = LinearElastic.from_young(YOUNG, 0.3).energy(self.u) * ufl.dx
        self.energy -= self.gamma * ufl.dot(pull, self.u) * ds(1)
        self.bottom = on_side(self.domain, dim - 1, 0.0)
        self.normal = np.array([0.03, *[0.02] * (dim - 2), 1.0])
        self.point = np.array([*[0.0] * (dim - 1), 0.005])
        self.reference = reference

        floor = HalfSpace(self.point, self.normal)
        surface = ContactSurface(self.u, self.bottom, obstacle=floor, law=Coulomb(FRICTION))
        self.problem = ContactProblem(
            self.energy,
            self.u,
            [surface],
            bcs=self.bcs,
            r=R,
            petsc_options={"snes_rtol": 1e-14},
        )
        self.prescribe(0.0)
        discrete = self.discrete
        self.positions = ParametricContact(self.problem, self.gamma).positions
        Q = self.problem.fields[1].function_space
        places = V.tabulate_dof_coordinates()[discrete.nodes, :dim]
        self.dofs = rows_of(places, Q.tabulate_dof_coordinates()[:, :dim])
        self.points = rows_of(places, self.positions)

    def prescribe(self, aside):
        """Move the top, and discretise again for the reference."""
        dim = self.domain.geometry.dim
        self.moved.value[:] = [aside, *np.linspace(0.0, 0.3 * aside, dim - 1)[:-1], -0.01]
        before = self.u.x.array.copy()
        floor = self.reference.plane(self.point, self.normal)
        self.discrete = self.reference.discretise(
            self.energy, self.u, self.bcs, self.bottom, floor, F=FRICTION, r=R
        )
        self.u.x.array[:] = before

    @property
    def multipliers(self):
        return self.problem.fields[1].x.array.reshape(-1, self.domain.geometry.dim)

    def vector(self, u, t):
        """Unknowns of the package for displacements and tractions of the reference."""
        self.u.x.array[:] = u
        self.multipliers[self.dofs] = t
        x = self.problem.create_vector()
        self.problem.write(x)
        return x

    def rows(self, b):
        """Rows of the reference in a vector of the package."""
        N = len(self.discrete.load)
        contact = b.array_r[N:].reshape(self.multipliers.shape)[self.dofs]
        return np.concatenate([b.array_r[:N], contact.ravel()])

    def start(self):
        return np.zeros(len(self.discrete.load)), np.zeros(self.discrete.n.shape)


def rows_of(places, among):
    """Indices of places among others."""
    distance = np.abs(places[:, None] - among).max(axis=2)
    found = distance.argmin(axis=1)
    assert distance[np.arange(len(places)), found].max() < 1e-14
    return found


def assert_close(a, b, tolerance=1e-12):
    assert np.abs(a - b).max() <= tolerance * np.abs(b).max()


@pytest.fixture(params=[(2, False), (2, True), (3, False), (3, True)], ids=str)
def case(request, reference):
    return Case(reference, *request.param)


def test_page_is_short():
    assert len(PAGE.read_text().splitlines()) <= 300


@pytest.mark.parametrize("stepping", [False, True], ids=["static", "step"])
@pytest.mark.parametrize("seed", range(3))
def test_residual_jacobian_and_statuses_at_random_states(case, seed, stepping):
    random = np.random.default_rng(seed)
    discrete = case.discrete
    N = len(discrete.load)

    def displacement():
        return np.where(discrete.held, discrete.values, 0.01 * random.standard_normal(N))

    problem, memory = case.problem, None
    if stepping:
        before = displacement()
        memory = (discrete.B @ before).reshape(discrete.n.shape)
        case.vector(before, np.zeros_like(memory))
        problem = problem.step_from(problem.snapshot())
    u = displacement()
    t = 10.0 * random.standard_normal(discrete.n.shape) - 20.0 * discrete.n
    H, J, statuses = case.reference.evaluate(discrete, u, t, memory)
    assert len(set(statuses)) == (4 if discrete.n.shape[1] == 2 else 3)

    x = case.vector(u, t)
    b = problem.create_vector()
    found = problem.residual(x, b)
    assert np.array_equal(found.statuses[0][case.points], statuses)
    assert_close(case.rows(b), H)

    v = np.where(discrete.held, 0.0, random.standard_normal(N))
    w = YOUNG * random.standard_normal(discrete.n.shape)
    gamma = float(case.gamma.value)
    system = ParametricContact(problem, case.gamma)
    system.jacobian(x, gamma, system.piece_at(x, gamma))
    system.matrix.mult(case.vector(v, w), b)
    assert_close(case.rows(b), J @ np.concatenate([v, w.ravel()]))


def check_solution(case, result, u, t, statuses):
    """The Functions and the table of a result hold the solution of the reference."""
    assert_close(case.u.x.array, u)
    assert_close(case.multipliers[case.dofs], t)
    table = result.tables["contact"]
    points = rows_of(case.positions[case.points], table.x)
    letters = "ok+-" if table.dim == 2 else "oks"
    assert "".join(table.letters[points]) == "".join(letters[k] for k in statuses)
    assert len(set(statuses)) > 1


def test_static_solve(case):
    case.prescribe(0.02)
    u, t, statuses = case.reference.solve(case.discrete, *case.start())
    check_solution(case, case.problem.solve(), u, t, statuses)


def test_reference_step_opposes_the_increment(case):
    """Friction opposes the increment since the static solution, not the total slip."""
    case.prescribe(0.02)
    u, t, _ = case.reference.solve(case.discrete, *case.start())
    case.problem.solve()
    start = case.problem.snapshot()

    case.prescribe(0.005)
    memory = (case.discrete.B @ u).reshape(t.shape)
    u, t, statuses = case.reference.solve(case.discrete, u, t, memory)
    check_solution(case, case.problem.step_from(start).solve(), u, t, statuses)

    evolution = QuasiStatic(case.problem, lambda s: case.prescribe(0.02 - 0.015 * s))
    case.problem.restore(start)
    (step,) = evolution.run([0.0, 1.0]).steps
    check_solution(case, step.result, u, t, statuses)

    static, _, _ = case.reference.solve(case.discrete, u, t)
    assert np.abs(static - u).max() > 1e-5  # memory matters
