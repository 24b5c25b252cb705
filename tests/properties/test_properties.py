"""Properties of all solutions, on random bodies, laws, obstacles and places.

A failure is reduced to the simplest case, and printed as a script running by itself. By default a
few cases are drawn, always the same; with --long many, which differ from day to day.
"""

import pytest
import seeded_faults
from hypothesis import strategies as st
from support.properties import (
    COMM,
    FEW,
    accounts_for_energies,
    balances,
    cases,
    examine,
    falls_under_refinement,
    holds,
    is_a_history_of_one_step,
    is_among_all,
    on_every_rank,
    resumes,
    solves_again,
    stays_on_ranks,
    stays_under_places,
)
from support.random_bodies import Case


@pytest.mark.verifies(
    "Signorini",
    "Coulomb",
    "Tresca",
    "laws of one's own",
    "normal compliance",
    "units",
    reference="theorem: axes, units, numbers of nodes and names of surfaces mean nothing",
    aspects=("2D", "3D"),
)
def test_solutions_do_not_depend_on_axes_and_units(request):
    """Turned, mirrored, in other units, renumbered, as two surfaces: the same solution."""
    examine(stays_under_places, request)


@pytest.mark.verifies(
    "balance of forces",
    "nodal contact",
    reference="independent code: forces and work at the nodes, and the law in numpy",
    aspects=("2D", "3D"),
)
def test_forces_balance_node_by_node(request):
    """Equilibrium node by node, resultants, energies, the law, computed from the displacement."""
    examine(balances, request)


def test_solution_for_new_data_is_that_of_a_new_problem(request):
    examine(solves_again, request)


@pytest.mark.verifies(
    "all solutions", reference="itself: a solve beside an enumeration", aspects=("2D", "3D")
)
def test_a_solve_finds_one_of_all_solutions(request):
    examine(is_among_all, request)


@pytest.mark.verifies("quasi-static", reference="itself: the static problem", aspects=("2D", "3D"))
def test_history_of_one_step_is_a_solve(request):
    examine(is_a_history_of_one_step, request)


@pytest.mark.verifies(
    "energies of histories",
    reference="independent code: sums of forces times slips, step by step",
    aspects=("2D", "3D"),
)
def test_a_history_accounts_for_its_energies(request):
    examine(accounts_for_energies, request)


@pytest.mark.verifies(
    "records of histories", reference="itself: a run that is not interrupted", aspects=("records",)
)
def test_an_interrupted_history_resumes_to_the_same_end(request):
    examine(resumes, request)


@pytest.mark.verifies("Tresca", reference="theorem: minima over nested sets", aspects=("2D", "3D"))
def test_energy_falls_under_refinement(request):
    examine(falls_under_refinement, request)


def test_round_off_of_a_sliding_body_is_no_rise_of_energy():
    """Its energy is nothing but round-off, which does not fall."""
    falls_under_refinement(Case(cells=(1, 1), law="frictionless", push=0.0, drag=(0.05,)))


@pytest.mark.ranks(2, 3)
@pytest.mark.skipif(COMM.size == 1, reason="one rank and all ranks are the same")
def test_all_ranks_find_what_one_rank_finds():
    some = [kind for kind in FEW if kind[1] in ("Coulomb", "Tresca")]
    drawn = st.tuples(cases(some, friction=(0.1, 0.1)))
    holds(on_every_rank(stays_on_ranks), drawn, examples=5)


@pytest.mark.long
@pytest.mark.parametrize("name", seeded_faults.FAULTS)
def test_a_seeded_fault_fails_a_property(name):
    """A property fails within 200 examples."""
    assert " fails with example " in seeded_faults.seen(name)


@pytest.mark.long
def test_no_property_fails_without_a_fault(capsys):
    seeded_faults.draw()
    assert capsys.readouterr().out == f"no property fails in {seeded_faults.MOST} examples\n"
