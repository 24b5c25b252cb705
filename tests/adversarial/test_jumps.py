"""Assumption: a quasi-static evolution continues, and its steps are solved.

Bonds snap, friction turns the load back, and loads leap, break down or graze the border of a jump.
The states before and after are known in closed form; "no solution continues" is claimed only where
it is true.
"""

from mpi4py import MPI

import numpy as np
import pytest
from support.bodies import block, free_row, one_point, table_of
from support.checks import assert_close

import ufl

from dolfinx_contact import (
    RCCM,
    ConvergenceError,
    Coulomb,
    materials,
)
from dolfinx_contact.evolution import NoContinuation, QuasiStatic

COMM = MPI.COMM_WORLD

TURNS = [[1.0, -1.5], [-1.5, 4.0]]  # with friction 1: no solution continues beyond the lift 0.2
PROOF = "no solution continues"


def history_of_a_point(stiffness, law, top, start=0.0, dim=2):
    """A point on springs, solved at the beginning; ``top(t)`` moves the other end."""
    body, energy = one_point(stiffness, dim)
    problem = body.problem(law, energy)
    body.move_top(*top(start))
    problem.solve()
    return problem, QuasiStatic(problem, lambda t: body.move_top(*top(t)))


def lifted(friction):
    return history_of_a_point(TURNS, Coulomb(friction), lambda t: (1.0, t), -1.0)[1]


def state_of(step):
    """Slip, gap and force of the free point."""
    table = step.result.tables["contact"]
    k = free_row(table)
    return table.ut[k, 0], table.un[k], table.force[k]


def jumps_of(history):
    return [step for step in history.steps if step.jump]


@pytest.mark.sample
def test_a_point_with_much_friction_jumps_open():
    history = lifted(1.0).run([-1.0, -0.6, -0.2, 0.15, 0.5, 1.0], locate_jumps=True, at_jump="jump")
    assert_close(history.time, 1.0)
    assert_close(state_of(history.steps[-1])[:2], [1.0, 1.0])
    (leap,) = jumps_of(history)
    assert leap.start <= 0.2 + 1e-9
    assert leap.time >= 0.2 - 1e-9
    assert_close(leap.time, 0.2, 1e-3)


def test_an_evolution_ends_where_it_is_proved_that_nothing_continues():
    with pytest.raises(NoContinuation, match=PROOF) as error:
        lifted(1.0).run([-1.0, 0.0, 1.0], locate_jumps=True)
    assert_close(error.value.history.time, 0.2, 1e-4)


def test_a_point_with_less_friction_slips_on():
    """From -0.5 on, twice as fast as the lift."""
    history = lifted(0.5).run(
        [-1.0, -0.6, -0.2, 0.15, 0.5, 1.0], locate_jumps=True, at_jump="raise"
    )
    assert_close(state_of(history.steps[-1])[:2], [1.0, 1.0])
    assert not jumps_of(history)
    for step in history.steps:
        if -0.5 < step.time < 0:
            assert_close(state_of(step)[0], 2 * (step.time + 0.5))


@pytest.mark.parametrize("middle", [[], [-0.8], [-0.5], [0.0]])
def test_a_jump_in_the_first_or_second_step_is_found(middle):
    times = [-1.0, *middle, 1.0]
    (leap,) = jumps_of(lifted(1.0).run(times, locate_jumps=True, at_jump="jump"))
    assert_close(leap.time, 0.2, 1e-3)
    with pytest.raises(NoContinuation) as error:
        lifted(1.0).run(times, locate_jumps=True)
    assert_close(error.value.history.time, 0.2, 1e-3)


def test_long_steps_hold_no_jump_where_a_point_only_begins_to_slip():
    times = [-1.0, -0.2, 0.1, 0.3, 1.0]
    history = lifted(0.6).run(times, shortest=0.3, locate_jumps=True)
    assert_close([s.time for s in history.steps], times[1:])
    assert not jumps_of(history)
    assert_close(state_of(history.steps[-1])[0], 1.0)


#: Lifts that come to the border of the jump and turn back, stay there, or graze it twice; times.
GRAZING = {
    "turns": (lambda t: 0.2 - abs(t - 1), [0.0, 1.0, 2.0]),
    "turns within a step": (lambda t: 0.2 - abs(t - 1), [0.0, 0.7, 1.3, 2.0]),
    "stays": (lambda t: min(t - 0.8, 0.2 * (1 - 1e-9)), [0.0, 0.5, 1.0, 1.5, 2.0]),
    "twice": (
        lambda t: 0.2 * (1 - 1e-7) - 0.1 * abs(abs(t - 2) - 1),
        [0.0, 1.0, 2.0, 3.0, 4.0],
    ),
    "far from it": (lambda t: -0.1 - abs(t - 1), [0.0, 1.0, 2.0]),
}


@pytest.mark.parametrize("name", GRAZING)
def test_a_load_that_turns_at_the_border_of_a_jump_is_followed(name):
    lift, times = GRAZING[name]
    _, evolution = history_of_a_point(TURNS, Coulomb(1.0), lambda t: (1.0, lift(t)))
    history = evolution.run(times, locate_jumps=True)
    assert_close(history.time, times[-1])
    assert not jumps_of(history)
    slip, gap, force = state_of(history.steps[-1])
    if history.steps[-1].result.tables["contact"].status.replace("d", "") == "k":
        assert_close(slip, 0.0)
    assert_close(force[1], 1.5 * (1 - slip) - 4 * lift(times[-1]))
    assert gap < 1e-9


def test_several_evolutions_from_the_border_of_slip_are_counted():
    top = lambda t: (1.0, 0.2 - abs(t - 0.2))  # noqa: E731
    _, evolution = history_of_a_point(TURNS, Coulomb(1.0), top)
    history = evolution.run([0.0, 0.1, 0.2, 0.25, 0.3], locate_jumps=True, rays=True)
    assert_close(history.at(0.25).directions, 2)


# --- bonds and weakening friction ---


def bond(K, lift):
    """Opening of RCCM's bond (u0 = 1) on a spring of K times its stiffness."""
    if lift <= 1 + 1 / K:
        return lift * K / (K + 1)
    return max(r.real for r in np.roots([1.0, -lift, 0, 0, 1 / K]) if abs(r.imag) < 1e-9)


def pulled(K, times, at_jump):
    spring = [[50.0, 0.0], [0.0, K * 50.0]]
    body, energy = one_point(spring)
    problem = body.problem(RCCM(100.0, 0.0, 1.0), energy)
    evolution = QuasiStatic(problem, lambda t: body.move_top(0.0, 0.1 * t))
    return evolution.run(times, locate_jumps=True, at_jump=at_jump, shortest=1e-3)


def test_an_evolution_ends_where_a_bond_snaps():
    with pytest.raises(NoContinuation) as error:
        pulled(0.5, [0.0, 2.0, 5.0], "raise")
    assert_close(error.value.history.time, 3.0, 1e-3)


# --- histories of one point under other loads ---


def test_cycles_in_the_plane_are_returns_to_the_disc_of_friction():
    """The spring is isotropic: each step is a radial return, in ten lines of numpy."""
    kt, kn, friction = 2.0, 3.0, 0.4
    sides = np.array([[0, 0, -1], [1, 0, -1], [1, 1, -2], [-1, 1, -1], [-1, -1, -0.5], [1, 0, -1]])

    def top(t):
        k = min(int(t), len(sides) - 2)
        return sides[k] + (t - k) * (sides[k + 1] - sides[k])

    _, evolution = history_of_a_point(np.diag([kt, kt, kn]), Coulomb(friction), top, 0.0, 3)
    times = np.linspace(0.0, 5.0, 16)
    parts = (times[:7], times[6:11], times[10:])
    steps = [s for part in parts for s in evolution.run(part).steps]
    slip, dissipated = np.zeros(2), 0.0
    for step in steps:
        U = top(step.time)
        pull = kt * (U[:2] - slip)
        bound = -friction * kn * U[2]
        size = np.linalg.norm(pull)
        if size > bound:
            way = (size - bound) / kt * pull / size
            slip = slip + way
            dissipated += bound * np.linalg.norm(way)
        table = step.result.tables["contact"]
        k = free_row(table)
        assert_close(table.ut[k][:2], slip)
        assert_close(table.force[k], [*(-kt * (U[:2] - slip)), -kn * U[2]])
        assert_close(step.energies.dissipated, dissipated)
    assert len(steps) == 15


def breaking(broken):
    """A point under pressure 1 whose load breaks down after t = 0.61; it slips by t - 0.25."""

    def top(t):
        if t > 0.61 and isinstance(broken, Exception) and COMM.rank == 0:
            raise broken
        return (t if t <= 0.61 or isinstance(broken, Exception) else broken), -1.0

    return history_of_a_point([[2.0, 0.0], [0.0, 1.0]], Coulomb(0.5), top)


@pytest.mark.parametrize("broken", [np.nan, np.inf])
def test_a_load_that_is_not_a_number_ends_the_run_at_its_last_state(broken):
    problem, evolution = breaking(broken)
    seen = []
    with pytest.raises((ValueError, ConvergenceError, NoContinuation)) as error:
        evolution.run([0.0, 0.3, 0.6, 0.9], observer=seen.append)
    assert PROOF not in str(error.value)
    assert_close([s.time for s in seen], [0.3, 0.6])
    table = table_of(problem)
    assert_close(table.ut[free_row(table), 0], 0.35)


def test_a_load_that_raises_on_one_rank_ends_the_run_on_all():
    """The run evaluates the load at its last time when it starts; the state is unchanged."""
    problem, evolution = breaking(ArithmeticError("no load"))
    with pytest.raises(Exception, match="no load"):
        evolution.run([0.0, 0.3, 0.6, 0.9])
    table = table_of(problem)
    assert_close(table.ut[free_row(table), 0], 0.0)


@pytest.mark.parametrize("at_jump", ["raise", "stop", "jump"])
def test_a_load_that_leaps_is_no_loss_of_solutions(at_jump):
    """The top is aside by 0.1 t, from t = 0.5 on by 1; the slip is 0 before, 0.75 after."""

    def top(t):
        return 0.1 * t if t < 0.5 else 1.0, -1.0

    _, evolution = history_of_a_point([[2.0, 0.0], [0.0, 1.0]], Coulomb(0.5), top)
    history = evolution.run([0.0, 0.2, 0.4, 0.6, 0.8], locate_jumps=True, at_jump=at_jump)
    assert PROOF not in history.reason
    assert_close(history.time, 0.8)
    for step in history.steps:
        assert_close(state_of(step)[0], 0.75 if step.time >= 0.5 else 0.0)


def rubber(**options):
    """A block of rubber that is pressed and dragged."""
    body = block((3, 2))
    energy = materials.NeoHookean(*materials.lame(100.0, 0.3)).energy(body.u) * ufl.dx
    problem = body.problem(Coulomb(0.5), energy, petsc_options=options)
    load = lambda t: body.move_top(0.3 * t, -0.2 * min(1.0, 3 * t))  # noqa: E731
    return problem, QuasiStatic(problem, load)


def test_short_steps_make_up_for_few_iterations():
    right = rubber()[1].run([0.0, 0.3, 0.6])
    assert right.complete
    problem, evolution = rubber(snes_max_it=2)
    history = evolution.run([0.0, 0.3, 0.6], shortest=0.02, locate_jumps=True)
    assert_close(*(h.steps[-1].result.resultants["contact"] for h in (history, right)), 1e-2)
    assert np.all(np.isfinite(problem.u.x.array))
