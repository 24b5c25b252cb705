"""Corrections of a few rows between the Newton steps of all."""

from mpi4py import MPI
from petsc4py import PETSc

import demo_3d_branch
import numpy as np
import pytest

from dolfinx_contact._settling import settle
from dolfinx_contact.continuation import Follower, StepControl
from dolfinx_contact.solvers.multigrid import Multigrid

COMM = MPI.COMM_WORLD


def vectors(n, *, start):
    x, b, d = (PETSc.Vec().createMPI(n, comm=COMM) for _ in range(3))
    x.set(start)
    return x, b, d


@pytest.mark.ranks(2)
@pytest.mark.parametrize("rounds", [1, 2, 5])
def test_rounds(rounds):
    """x^2 = 4 in all rows, by Newton steps; none is made that is not asked for."""
    x, b, d = vectors(4, start=3.0)
    calls = []

    def evaluate(x, b):
        b.array[:] = x.array_r**2 - 4

    def correct(x, b, d):
        calls.append(1)
        d.array[:] = b.array_r / (2 * x.array_r)
        return len(calls) <= 3

    assert settle(evaluate, correct, x, b, d, rounds)
    expected = 3.0
    for _ in range(min(rounds, 3)):
        expected -= (expected**2 - 4) / (2 * expected)
    np.testing.assert_allclose(x.array_r, expected, rtol=1e-15)
    assert len(calls) == min(rounds, 4)


@pytest.mark.parametrize("correction", [-11.0, float("nan")])
@pytest.mark.parametrize("good", [0, 1])
def test_a_correction_that_harms_is_not_taken(correction, good):
    """Nor are the good ones before it lost."""
    x, b, d = vectors(4, start=1.0)
    corrections = iter([0.5] * good + [correction])

    def correct(x, b, d):
        d.set(next(corrections))
        return True

    assert settle(lambda x, b: x.copy(b), correct, x, b, d, 3) == bool(good)
    np.testing.assert_array_equal(x.array_r, 0.5 if good else 1.0)


def test_nothing_to_correct():
    x, b, d = vectors(4, start=1.0)
    assert not settle(lambda x, b: x.copy(b), lambda *_: False, x, b, d, 2)
    np.testing.assert_array_equal(x.array_r, 1.0)


@pytest.mark.long
def test_corrections_of_the_surface_save_those_of_a_branch(monkeypatch):
    """The foot in batches of events: to the same end."""
    PETSc.Options()["contact_linear_solver"] = "amg"
    efforts = []
    ends = []
    for _ in range(2):
        system, _ = demo_3d_branch.foot(demo_3d_branch.arguments(["--n", "10"]), COMM)
        x = system.create_vector()
        x.set(0.0)
        with Follower(system, StepControl(kinks="batched"), gamma_scale=1.0) as follower:
            branch = follower.run(follower.start(x, 0.0), gamma_range=(0.0, 0.5))
        efforts.append(sum(p.corrections for p in branch.points))
        assert branch.points[-1].gamma == 0.5
        ends.append(branch.points[-1].y.norm())
        monkeypatch.setattr(Multigrid, "correct", lambda *_: False)
    assert efforts[0] < efforts[1]
    assert ends[0] == pytest.approx(ends[1], rel=1e-6)
