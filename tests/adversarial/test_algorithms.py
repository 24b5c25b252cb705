"""Assumption: contact nodes can move, loads have a size, and classical algorithms converge.

The problems are rows of stiff cells sticking everywhere, and gaps and loads of round-off. Each
algorithm returns the solution in closed form.
"""

from mpi4py import MPI

import numpy as np
import pytest
from support.bodies import block, move, two_blocks
from support.checks import assert_close

import ufl
from dolfinx import fem
from dolfinx.fem.petsc import LinearProblem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, HalfSpace, materials

COMM = MPI.COMM_WORLD

METHODS = ("newton", "lemke", "gauss-seidel", "interior-point")


def loaded(body, load, young=1000.0, poisson=0.3, friction=0.5):
    """A body under a force per volume, a Constant."""
    energy = body.elastic(young, poisson) - ufl.dot(load, body.u) * ufl.dx
    return body.problem(Coulomb(friction), energy)


def letters_of(result):
    return result.tables["contact"].letters


ROWS = {  # modulus, unit of length, cells, direction of the force, algorithms
    "large": (1000.0, 1.0, (4, 1), (0.3, -1.0), METHODS),
    "steel in millimetres": (210e9, 1e-3, (4, 1), (0.3, -1.0), METHODS),
    "soft and huge": (1e-9, 1e9, (4, 1), (0.3, -1.0), METHODS),
    "in space": (1e9, 1e-6, (2, 2, 1), (0.2, -0.1, -1.0), METHODS),
    "in space, pressed": (1000.0, 1.0, (2, 2, 1), (0, 0, -1.0), ("newton", "gauss-seidel")),
    "other algorithms": (
        1e6,
        1e-3,
        (2, 1),
        (0.3, -1.0),
        ("tresca", "uzawa", "penalty", "sor", "projected-gradient"),
    ),
}


@pytest.mark.parametrize("name", [pytest.param("large", marks=pytest.mark.sample), *list(ROWS)[1:]])
def test_one_row_of_cells_that_friction_holds_carries_half_of_the_load(name):
    """P1 on one row of equal cells: u = 0, and the top carries the other half."""
    young, unit, cells, force, algorithms = ROWS[name]
    dim = len(cells)
    size = np.array((1.0,) * (dim - 1) + (0.25,)) * unit
    body = block(cells, tuple(size))
    load = young / unit * 1e-3 * np.array(force)
    problem = loaded(body, fem.Constant(body.domain, load), young)
    for algorithm in algorithms:
        body.u.x.array[:] = 0.0
        result = problem.solve(algorithm=algorithm)
        assert_close(result.resultants["contact"], -load * np.prod(size) / 2)
        assert set(letters_of(result)) == {"k"}
        assert np.abs(body.u.x.array).max(initial=0.0) <= 1e-10 * unit


@pytest.mark.parametrize(
    ("height", "press"), [(-1e-12, 0.0), (1e-12, 0.0), (0.0, 1e-9), (0.1, 1e-6), (0.0, 1e-3)]
)
def test_gaps_and_pushes_of_round_off_have_no_or_their_force(height, press):
    """The top goes to the floor and presses by ``press``: the force is E times that."""
    body = block((3, 1))
    at = fem.Constant(body.domain, (0.0, height))
    problem = body.problem(Coulomb(3.0), body.elastic(1e5), obstacle=HalfSpace(at, (0, 1)))
    body.move_top(0.0, height - press)
    for algorithm in ("newton", "lemke", "gauss-seidel"):
        body.u.x.array[:] = 0.0
        result = problem.solve(algorithm=algorithm)
        assert_close(result.resultants["contact"][1], 1e5 * press)
        assert_close(np.abs(result.tables["contact"].un).max(), 0.0, 1e-11)


@pytest.mark.parametrize("algorithm", [*METHODS, "tresca", "uzawa"])
def test_loads_that_come_and_go_and_loads_of_round_off_have_their_forces(algorithm):
    body = block((2, 1))
    load = fem.Constant(body.domain, (0.0, 0.0))
    problem = loaded(body, load)
    for size in (0.0, 1.0, 0.0, 1e-14, 1.0, 2.0):
        load.value[:] = 0.2 * size, -size
        unit = size or 1.0
        found = problem.solve(algorithm=algorithm).resultants["contact"]
        assert_close(found / unit, np.array([-0.1 * size, 0.5 * size]) / unit)


def half_held(mirrored):
    """Tables of all algorithms for a row sticking on one half and slipping on the other."""
    body = block((4, 1), (1.0, 0.25))
    friction = fem.Function(fem.functionspace(body.domain, ("Lagrange", 1)))
    friction.interpolate(lambda x: 20.0 * (x[0] > 0.4 if mirrored else x[0] < 0.6))
    load = fem.Constant(body.domain, (-0.5 if mirrored else 0.5, -1.0))
    problem = loaded(body, load, friction=friction)
    tables = []
    for algorithm in METHODS:
        body.u.x.array[:] = 0.0
        tables.append(problem.solve(algorithm=algorithm).tables["contact"])
    return tables


def test_a_row_held_in_one_half_slips_in_the_other_and_mirrored():
    tables = half_held(False)
    one = tables[0]
    assert set(one.letters[3:]) == {"+"}
    assert set(one.letters[:3]) == {"k"}
    assert_close(one.force[3:, 0], [0.0, 0.0], 1e-9)
    for table in tables[1:]:
        assert_close(table.force, one.force)
    for table in half_held(True):
        assert_close(table.force[::-1] * [-1, 1], one.force)


def test_two_rows_that_stick_are_the_body_in_one_piece():
    both = two_blocks((3, 1), (3, 1), depth=1.0)
    force = (0.2, -1.0)
    steel = materials.LinearElastic.from_young(100.0, 0.3)

    def energy_of(body):
        f = fem.Constant(body.domain, force)
        return steel.energy(body.u) * ufl.dx - ufl.dot(f, body.u) * ufl.dx

    move(both.top, 0.0, -0.02)
    pair = ContactPair(
        both.u, both.slave, master_facets=both.master, law=Coulomb(20.0), method="nodal"
    )
    problem = ContactProblem(energy_of(both), both.u, [pair], bcs=both.bcs)
    whole = block((3, 2), (1.0, 2.0))
    whole.move_top(0.0, -0.02)
    bottom = fem.locate_dofs_topological(whole.V, 1, whole.bottom)
    held = [*whole.bcs, fem.dirichletbc(np.zeros(2), bottom, whole.V)]
    F = ufl.derivative(energy_of(whole), whole.u)
    a = ufl.derivative(F, whole.u)
    right = LinearProblem(a, -ufl.replace(F, {whole.u: 0 * whole.u}), bcs=held).solve()

    def square(u):
        return COMM.allreduce(fem.assemble_scalar(fem.form(ufl.dot(u, u) * ufl.dx)))

    for algorithm in ("newton", "lemke", "gauss-seidel"):
        both.u.x.array[:] = 0.0
        result = problem.solve(algorithm=algorithm)
        assert_close(square(both.u), square(right))
        assert set(letters_of(result)) == {"k"}
