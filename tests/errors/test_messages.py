"""Options, linear solvers, extreme data, and code of users: errors and correct answers."""

import logging

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block, box, facets, same_tables
from support.checks import solved_start

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    ConvergenceError,
    Coulomb,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.continuation import Observer, find_solutions, follow
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.records import BranchRecord

# Every case runs on two ranks, because the errors must be the same on both.
pytestmark = [
    pytest.mark.ranks(2, every_case=True),
    pytest.mark.usefixtures("nothing_hangs"),
]

COMM = MPI.COMM_WORLD
LAST = COMM.rank == COMM.size - 1


def loaded(n=4, friction=0.3):
    """Return a block on a floor under a prescribed displacement and the boundary load gamma."""
    domain = box(COMM, n, "tri")
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    gamma = fem.Constant(domain, 0.0)
    push = ufl.dot(ufl.as_vector([gamma, -1.0]), u) * ufl.ds
    s = ContactSurface(
        u,
        facets(domain, 1, 0.0),
        obstacle=HalfSpace((0.0, 0.0), (0.0, 1.0)),
        law=Coulomb(friction),
    )
    top = fem.locate_dofs_topological(u.function_space, 1, facets(domain, 1, 1.0))
    bc = fem.dirichletbc(np.array([0.0, -0.01]), top, u.function_space)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy - push, u, [s], bcs=[bc])
    system = ParametricContact(problem, gamma)
    return system, solved_start(system)


# -- options ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["newtonls", "newtontr", "newtontrdc", "vinewtonssls"])
@pytest.mark.verifies("options", reference="itself: the default", aspects=("2D",))
def test_snes_types_have_the_same_solution(kind):
    expected = block(n=8, law=Coulomb(1.0)).solve().tables["contact"]
    table = block(n=8, law=Coulomb(1.0), options={"snes_type": kind}).solve().tables["contact"]
    np.testing.assert_allclose(table.force, expected.force, rtol=0, atol=1e-8 * expected.rn.max())
    assert table.status == expected.status


# -- linear solvers --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"ksp_type": "gmres", "pc_type": "none", "ksp_max_it": 2}, ("in 2 it", "DIVERGED_MAX_IT")),
        ({"ksp_type": "cg", "pc_type": "jacobi"}, ("cg with jacobi", "KSP DIVERGED_")),
    ],
    ids=["iterations", "breakdown"],
)
def test_failure_of_the_chosen_linear_solver_ends_the_solve(options, words):
    """No other strategy is tried, because its linear systems would be like these."""
    with pytest.raises(ConvergenceError, match="linear_solver='amg'") as info:
        block(options=options).solve()
    (attempt,) = info.value.attempts
    assert attempt.strategy == "full steps"
    assert len(set(COMM.allgather(attempt.reason))) == 1
    assert "cycle" not in attempt.reason
    for word in words:
        assert word in attempt.reason


def test_an_attempt_names_a_linear_solver_that_did_not_solve():
    attempt = block(options={"ksp_type": "preonly", "pc_type": "jacobi"}).solve().attempts[0]
    for word in ("the linear solve is inaccurate", "preonly with jacobi"):
        assert word in attempt.reason


def test_iterative_solvers_work_without_a_factorisation_package():
    """The default factorisation package is set for direct solvers only."""
    options = {"ksp_type": "gmres", "ksp_rtol": 1e-12, "pc_type": "sor", "ksp_max_it": 500}
    options |= {"ksp_gmres_restart": 200}
    assert "pc_factor_mat_solver_type" not in block(options=options).linear_solver.defaults
    assert block().linear_solver.defaults["pc_factor_mat_solver_type"] == "mumps"


# -- data at the edge of numbers -------------------------------------------------------------------


@pytest.mark.parametrize("far", [1e8, 1e20, -1e100])
def test_solution_does_not_depend_on_a_start_far_away(far):
    """The scales of convergence do not contain the residual of the start."""
    expected = block().solve().tables["contact"]
    problem = block()
    problem.u.x.array[:] = far
    result = problem.solve()
    same_tables(result.tables["contact"], expected)
    assert result.attempts[-1].strategy == "full steps"


def test_solve_converges_to_a_state_without_forces():
    """All forces of the solution are round-off."""
    problem = block(top=(0.0, 0.01))
    problem.u.interpolate(lambda x: np.vstack([0.1 * x[1], 0.3 * x[1]]))
    result = problem.solve()
    assert result.attempts[-1].strategy == "full steps"
    assert result.attempts[-1].iterations <= 5
    assert np.abs(result.tables["contact"].force).max() < 1e-9


def test_ghosts_of_a_friction_field_follow_their_owners():
    """Only owned values are set; a solve updates the ghosts."""
    domain = box(COMM, 3, "tri")  # on two ranks, contact nodes of one are ghosts of the other
    F = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
    n = F.function_space.dofmap.index_map.size_local
    F.x.array[:n] = 0.2 + 0.2 * F.function_space.tabulate_dof_coordinates()[:n, 0]
    problem = block(domain=domain, law=Coulomb(F))
    (s,) = problem.surfaces

    def slope():
        return problem.evaluate().surfaces[0].answers.unit_bound

    np.testing.assert_allclose(slope(), 0.2 + 0.2 * s.positions[:, 0], rtol=1e-12)
    F.x.array[:n] *= 2
    np.testing.assert_allclose(slope(), 0.4 + 0.4 * s.positions[:, 0], rtol=1e-12)


def test_numpy_numbers_are_accepted():
    expected = block(law=Coulomb(0.25), r=64.0).solve().tables["contact"]
    law = Coulomb(np.float32(0.25))
    options = {"snes_max_it": np.int64(40), "snes_rtol": "1e-10"}
    same_tables(block(law=law, r=np.int64(64), options=options).solve().tables["contact"], expected)


# -- solutions -------------------------------------------------------------------------------------


@pytest.mark.parametrize("gamma", [0.3, 1e12, -1e100])
def test_find_solutions_works_at_any_size_of_the_load(gamma):
    system, x = loaded(n=2)
    there = find_solutions(system, [x], gamma)
    assert there.complete
    assert len(there.found) == 1
    b = system.create_vector()
    assert system.residual(there.found[0].x, gamma, b, None) < 1e-9


# -- code of the user ------------------------------------------------------------------------------


def recorded(folder, functional):
    system, x = loaded(n=2)
    with BranchRecord(folder / "record", system, {"mine": functional}) as record:
        follow(system, x, 0.0, gamma_range=(0.0, 1.0), record=record)


@pytest.mark.parametrize(
    ("functional", "error", "message"),
    [
        (lambda _p: 1 / 0 if LAST else 1.0, ZeroDivisionError, "division"),
        (lambda _p: "many" if LAST else 1.0, ValueError, "did not return a number"),
        (lambda _p: None, ValueError, "did not return a number"),
        (lambda _p: [1.0, 2.0], ValueError, "did not return a number"),
    ],
    ids=["raises", "word", "nothing", "list"],
)
def test_record_refuses_functionals_without_a_number(folder, functional, error, message):
    with pytest.raises(error, match=message) as info:
        recorded(folder, functional)
    assert len(set(COMM.allgather(str(info.value)))) == 1


@pytest.mark.ranks(2)
@pytest.mark.skipif(COMM.size == 1, reason="for ranks that differ")
def test_record_refuses_functionals_that_differ_between_ranks(folder):
    with pytest.raises(ValueError, match=r"differs between ranks .*: sum over them"):
        recorded(folder, lambda _p: 1.0 + COMM.rank)


def test_failed_branch_restores_functions_statuses_and_gamma():
    system, x = loaded()
    fields = system.problem.fields
    before = [f.x.array.copy() for f in fields]
    statuses = system.problem.statuses

    class Impatient(Observer):
        def step(self, step, state):
            if step.index == 1:
                raise TimeoutError("enough")

    with pytest.raises(TimeoutError):
        follow(system, x, 0.0, gamma_range=(0.0, 1.0), observer=Impatient())
    for f, values in zip(fields, before, strict=True):
        np.testing.assert_array_equal(f.x.array, values)
    assert float(system.constant.value) == 0.0
    for codes, held in zip(system.problem.statuses, statuses, strict=True):
        np.testing.assert_array_equal(codes, held)


def test_monitors_and_observers_may_exist_on_one_rank_only():
    heard = []

    class Heard(Observer):
        def step(self, *_):
            heard.append("point")

    def monitor(_step):
        heard.append("step")

    block().solve(monitor=monitor if LAST else None)
    steps = COMM.allreduce(len(heard))
    assert 3 <= steps <= 6
    system, x = loaded()
    branch = follow(
        system, x, 0.0, gamma_range=(0.0, 1.0), observer=Heard() if COMM.rank == 0 else None
    )
    assert COMM.allreduce(len(heard)) - steps == len(branch.points)


def test_package_sets_no_log_level():
    assert logging.getLogger("dolfinx_contact").level == logging.NOTSET


def test_result_prints_round_off_as_zero():
    assert "loads and springs: (0, 0)" in str(block(n=3).solve())


def test_result_prints_its_law():
    problem = block(n=3)
    assert str(problem.solve()).startswith("static law: full steps, ")
    step = problem.step_from(problem.snapshot())
    assert str(step.solve()).startswith("step from a state: full steps, ")
