"""Assumption: users know which state, data and memory a question refers to.

States are values that can be taken, put back, stored and compared; a problem by itself has the
static law; questions about a state refer to the data as they are now. A question that has no answer
for them raises an error giving the residual or naming the way.
"""

import pickle

from mpi4py import MPI

import numpy as np
import pytest
from support.bodies import block, free_row, friction_ratio, normal_force, one_point, table_of
from support.checks import assert_close, solved_start

import ufl
from dolfinx import fem

from dolfinx_contact import RCCM, Coulomb, ParametricContact, State
from dolfinx_contact.analysis import critical_friction
from dolfinx_contact.continuation import follow, points_at
from dolfinx_contact.evolution import QuasiStatic

COMM = MPI.COMM_WORLD


def dragged(aside=0.05, friction=0.2, cells=(2, 1)):
    """A block that is pressed by 0.01 and dragged: for 0.05 and more its whole bottom slips."""
    body = block(cells)
    body.move_top(aside, -0.01)
    return body, body.problem(Coulomb(friction))


def slid(t):
    """Displacement of the top in a history: to the right up to t = 1, and back."""
    return 0.05 * min(t, 2.0 - t), -0.01


def test_a_state_survives_pickling_and_cannot_be_written_to():
    _, problem = dragged()
    problem.solve()
    state = problem.snapshot()
    table = table_of(problem)
    again = pickle.loads(pickle.dumps(state))
    assert isinstance(again, State)
    for one in (state, again):
        for array in (one.displacement, *one.multipliers, *one.statuses):
            assert not array.flags.writeable
    problem.u.x.array[:] = 0.0
    problem.restore(again)
    assert_close(table_of(problem).force, table.force, 0.0)


@pytest.mark.sample
def test_a_solve_after_a_history_means_the_static_law():
    """Dragged to the right and half way back: the slip to the left of a step, or of the whole."""
    body, problem = dragged(0.0)
    problem.solve()
    history = QuasiStatic(problem, lambda t: body.move_top(*slid(t))).run([0.0, 1.0, 1.4])
    assert_close(friction_ratio(history.steps[-1].result.tables["contact"]), -0.2)
    static = problem.solve().tables["contact"]
    assert_close(friction_ratio(static), 0.2)
    assert np.all(static.letters == "+")


def test_a_step_from_a_state_opposes_the_increment():
    body, problem = dragged(0.0)
    problem.solve()
    start = problem.snapshot()
    body.move_top(0.05, -0.01)
    problem.step_from(start).solve()
    right = problem.snapshot()
    body.move_top(0.03, -0.01)
    back = problem.step_from(right).solve()
    assert_close(friction_ratio(back.tables["contact"]), -0.2)
    problem.restore(start)
    forth = problem.step_from(start).solve()
    assert_close(friction_ratio(forth.tables["contact"]), 0.2)


def lifted_bond():
    """A point on a bond (u0 = 0.1) and a stiff spring, K = 5; a history lifts it to 0.3."""
    body, energy = one_point([[50.0, 0.0], [0.0, 250.0]])
    problem = body.problem(RCCM(100.0, 0.0, 1.0), energy)

    def history_to(*lifts):
        return QuasiStatic(problem, lambda t: body.move_top(0.0, float(np.interp(t, *lifts))))

    first = history_to([0.0, 1.0], [0.0, 0.3]).run([0.0, 0.25, 0.5, 0.75, 1.0])
    return problem, first, history_to


def opening_and_bond(step):
    table = step.result.tables["contact"]
    k = free_row(table)
    return table.un[k], table.beta[k]


def test_a_history_from_the_end_of_another_keeps_its_damage():
    """Unloading goes along the secant: u = U K / (K + beta^2)."""
    _, first, history_to = lifted_bond()
    beta = opening_and_bond(first.steps[-1])[1]
    assert 0.1 < beta < 0.5
    second = history_to([1.0, 2.0], [0.3, 0.15])
    history = second.run([1.0, 1.5, 2.0], start=first.steps[-1].state)
    for step in history.steps:
        lift = np.interp(step.time, [1.0, 2.0], [0.3, 0.15])
        assert_close(opening_and_bond(step), [lift * 5.0 / (5.0 + beta**2), beta], 1e-4)


def test_a_history_run_again_from_its_first_step_repeats_the_rest():
    _, first, history_to = lifted_bond()
    second = history_to([0.0, 1.0], [0.0, 0.3])
    history = second.run([0.5, 0.75, 1.0], start=first.steps[1].state)
    for one, other in zip(history.steps, first.steps[2:], strict=True):
        assert_close(one.time, other.time)
        assert_close(opening_and_bond(one), opening_and_bond(other))


def test_a_state_can_be_drawn_and_tabulated_under_the_law_of_its_step():
    problem, first, _ = lifted_bond()
    problem.u.x.array[:] = 0.0
    surface = problem.surfaces[0]
    for step in first.steps:
        table = problem.table(surface, state=step.state)
        assert_close(table.force, step.result.tables["contact"].force)
        assert_close(table.un, step.result.tables["contact"].un)
    assert np.all(problem.u.x.array == 0.0)


def test_a_constant_that_is_changed_counts_in_the_next_solve_from_any_start():
    body = block((2, 1))
    load = fem.Constant(body.domain, (0.0, 0.0))
    problem = body.problem(Coulomb(0.2), body.elastic() - ufl.dot(load, body.u) * ufl.dx)
    start = problem.snapshot()
    for force in (1.0, 3.0, 2.0):
        load.value[1] = -force
        for fresh in (True, False):
            if fresh:
                problem.restore(start)
            assert_close(normal_force(problem.solve()), force / 2)


NO_SOLUTION = "not a solution of the problem as it is now: residual [0-9.e+-]+ "


@pytest.mark.sample
def test_uniqueness_refers_to_the_friction_as_it_is_now():
    """All points stick under 0.2, and under 0.4; under 0.01 they would slip."""
    _, problem = dragged(0.001)
    assert set(problem.solve().tables["contact"].letters) == {"k"}
    friction = problem.surfaces[0].law.friction
    for value in (0.2, 0.4):
        friction.value = value
        assert problem.uniqueness().verdict == "proved"
    friction.value = 0.01
    with pytest.raises(ValueError, match=NO_SOLUTION):
        problem.uniqueness()
    assert "k" not in problem.solve().tables["contact"].letters
    assert problem.uniqueness().verdict == "proved"


def test_questions_about_an_old_state_give_its_residual():
    body, problem = dragged()
    problem.solve()
    state = problem.snapshot()
    body.move_top(0.05, -0.02)
    problem.solve()
    assert problem.uniqueness().verdict == "proved"
    with pytest.raises(ValueError, match=NO_SOLUTION):
        problem.uniqueness(state=state)
    problem.restore(state)
    with pytest.raises(ValueError, match=NO_SOLUTION):
        critical_friction(problem, "solution")


def test_points_of_a_branch_refer_to_the_friction_as_it_is_now():
    """All points stick under 0.2; under 0.01 they would slip."""
    body, problem = dragged(0.0)
    gamma = fem.Constant(body.domain, 0.1)
    way = ufl.as_vector((0.001 * gamma, -0.01 * gamma))
    system = ParametricContact(problem, gamma, driven=[(body.moved, way)])
    branch = follow(system, solved_start(system, 0.1), 0.1, gamma_range=(0.1, 1.0))
    assert points_at(system, branch, 0.5, gamma_range=(0.1, 1.0))
    problem.surfaces[0].law.friction.value = 0.01
    with pytest.raises(ValueError, match=NO_SOLUTION):
        points_at(system, branch, 0.5, gamma_range=(0.1, 1.0))


@pytest.mark.sample
def test_a_result_survives_pickling():
    _, problem = dragged()
    result = problem.solve()
    again = pickle.loads(pickle.dumps(result))
    assert_close(again.resultants["contact"], result.resultants["contact"], 0.0)
    assert_close(again.tables["contact"].force, result.tables["contact"].force, 0.0)
    assert again.counts == result.counts
    assert again.warnings == result.warnings
    assert str(again) == str(result)


@pytest.mark.sample
def test_results_can_be_read_on_one_rank_alone():
    """Numbers and tables are on every rank; reading them is not collective."""
    _, problem = dragged()
    result = problem.solve()
    if COMM.rank == 0:
        assert_close(result.resultants["contact"], [-2.0, 10.0])
        assert result.tables["contact"].status.count("+") == 3
        assert result.counts
        assert not result.warnings
        assert result.min_det_F is None or result.min_det_F > 0
        assert repr(result)
        assert str(result)
    COMM.barrier()
    assert_close(normal_force(problem.solve()), 10.0)
