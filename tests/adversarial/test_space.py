"""Assumption: a search for all solutions in three dimensions includes the solution of a solve.

Searches begin at zero and use another method than a solve. Their solutions are compared with closed
forms, resultants and the solve, in several units. No incomplete list may be called complete.
"""

import numpy as np
import pytest
from support.bodies import block, free_row, one_point
from support.checks import assert_close, verdict

import ufl
from dolfinx import fem

from dolfinx_contact import Coulomb, Frictionless, ParametricContact, Sphere
from dolfinx_contact.continuation import find_solutions


def tables_found(system, gamma, guesses=None, lengths=(0.5,)):
    """A search leaving the displacement unchanged, and the tables of its solutions."""
    guesses = guesses or [system.create_vector()]
    u = system.problem.u.x.array
    before = u.copy()
    found = find_solutions(system, guesses, gamma, lengths=lengths, max_iterations=20)
    assert np.array_equal(u, before)
    results = [system.result_at(p) for p in found.points(system, found.found)]
    assert results
    return found, [r.tables["contact"] for r in results]


@pytest.mark.sample
def test_a_body_without_supports_balances_its_load():
    """Its weight presses it on the floor, and the horizontal load is below the friction bound."""
    body = block((1, 1, 1), (1.0, 1.0, 0.5))
    gamma = fem.Constant(body.domain, 1.0)
    load = gamma * ufl.as_vector((0.2, 0.1, -1.0))
    energy = body.elastic(100.0, 0.3) - ufl.dot(load, body.u) * ufl.dx
    problem = body.problem(Coulomb(0.5), energy, bcs=[])
    system = ParametricContact(problem, gamma)
    right = np.array([-0.1, -0.05, 0.5])
    assert_close(problem.solve().resultants["contact"], right)
    for table in tables_found(system, 1.0)[1]:
        assert_close(table.force.sum(axis=0), right)


@pytest.mark.parametrize(("law", "sliding"), [(Frictionless(), "large"), (Coulomb(0.5), "small")])
def test_a_ball_pressed_into_a_block_and_turned_is_found(law, sliding):
    body = block((2, 2, 1))
    ball = Sphere((0.5, 0.5, -2.0), 2.0)
    problem = body.problem(law, body.elastic(100.0, 0.3), obstacle=ball, sliding=sliding)
    body.move_top(0.01, 0.02, -0.05)
    system = ParametricContact(problem)
    right = problem.solve().resultants["contact"]
    body.u.x.array[:] = 0.0
    _, tables = tables_found(system, 0.0)
    off = min(np.abs(t.force.sum(axis=0) - right).max() for t in tables)
    assert off < 1e-5 * np.abs(right).max()


def test_of_three_solutions_of_a_point_none_is_called_the_only_one():
    """It sticks, slips or hangs free: slips 0, 0.5, 1 along (0.6, 0.8), forces 1.1, 0.35, 0."""
    body, energy = one_point([[1.0, 0.0, -0.9], [0.0, 1.0, -1.2], [-0.9, -1.2, 4.0]], 3)
    problem = body.problem(Coulomb(1.0), energy)
    body.move_top(0.6, 0.8, 0.1)
    system = ParametricContact(problem)
    guesses = [system.create_vector(), system.create_vector()]
    guesses[1].set(5.0)
    search, tables = tables_found(system, 0.0, guesses, (0.5, 0.1))
    right = [(0.0, 1.1), (0.5, 0.35), (1.0, 0.0)]
    seen = set()
    for table in tables:
        k = free_row(table)
        state = float(table.ut[k] @ [0.6, 0.8, 0.0]), float(table.force[k, 2])
        near = [i for i, known in enumerate(right) if np.allclose(state, known, atol=1e-6)]
        assert near
        seen.update(near)
    assert not search.complete or len(seen) == 3
    problem.solve()
    assert verdict(problem) != "proved"
