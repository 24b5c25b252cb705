"""Assumption: calls end well, on all ranks, and objects are freed by all ranks together.

Solves fail and observers raise only on one rank while problems are dropped; every rank gets an
error, nothing hangs, and the next problem is solved.
"""

import gc

from mpi4py import MPI

import pytest
from support.bodies import block, normal_force
from support.checks import assert_close

from dolfinx_contact import ConvergenceError, Coulomb
from dolfinx_contact.algorithms import Uzawa
from dolfinx_contact.evolution import NSCD, QuasiStatic

COMM = MPI.COMM_WORLD


def pressed(law=None):
    body = block()
    body.move_top(0.0, -0.01)
    return body.problem(law)


def assert_alive():
    """Assert that collectives work and that a problem is solved."""
    assert COMM.allreduce(1) == COMM.size
    assert_close(normal_force(pressed().solve()), 10.0)


@pytest.mark.sample
def test_problems_dropped_while_their_solves_fail_do_not_hang():
    for k in range(40):
        algorithm = -1 if k % 2 else 1
        with pytest.raises((ValueError, ConvergenceError)):
            pressed(Coulomb(0.3)).solve(algorithm=Uzawa(max_iterations=algorithm))
        if k % 7 == COMM.rank:
            gc.collect()
    assert_alive()


class OwnError(Exception):
    """An error of the user."""


def raises_on_the_last_rank(*_):
    if COMM.rank == COMM.size - 1:
        raise OwnError("on one rank")


@pytest.mark.parametrize("kind", ["history", "motion"])
def test_an_observer_that_raises_on_one_rank_ends_the_run_on_all(kind):
    for k in range(8):
        problem = pressed(Coulomb(0.3))
        problem.solve()
        if kind == "history":
            evolution, times = QuasiStatic(problem, lambda t: None), [0.0, 1.0]
        else:
            evolution, times = NSCD(problem, 1.0, dt=0.01), [0.0, 0.01]
        with pytest.raises(Exception, match="on one rank"):
            evolution.run(times, observer=raises_on_the_last_rank)
        del evolution
        del problem
        if k % 2 == COMM.rank:
            gc.collect()
    assert_alive()
