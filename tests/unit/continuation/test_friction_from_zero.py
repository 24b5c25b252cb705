"""Branches that begin or end where the friction is exactly 0: there closed points cannot stick.

So the statuses have fewer borders at 0 than beside it, and a piece there is one of several.
"""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block

from dolfinx_contact import RCCM, Coulomb, NormalCompliance, ParametricContact, records
from dolfinx_contact.continuation import Events, StepControl, follow
from dolfinx_contact.continuation.system import fractions_to_borders
from dolfinx_contact.points.memory import Memory

COMM = MPI.COMM_WORLD
END = 0.3
LAWS = {
    "coulomb": Coulomb,
    "bonds": lambda F: RCCM(100.0, 100.0, 1e-3, F),
    "soft bonds": lambda F: RCCM(100.0, 100.0, 1e-3, F, contact=NormalCompliance(1e4)),
}


def pushed(law, push, cell, friction, n=2):
    """A block that is pressed and pushed to one side, its bonds half broken; solved."""
    aside = () if cell == "tri" else (0.001,)
    given = {"top": (push, *aside, -0.01), "options": {"snes_rtol": 1e-12}}
    problem = block(n=n, cell=cell, law=LAWS[law](friction), **given)
    (surface,) = problem.surfaces
    if law != "coulomb":
        n = surface.points.number
        half = Memory(np.zeros((n, surface.dim)), {"beta": np.full(n, 0.5)}, 0.1)
        problem = problem.with_memory([half])
    problem.solve()
    return problem


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("law", "push", "cell", "kinks"),
    [
        ("coulomb", 0.004, "tri", "batched"),
        ("coulomb", -0.004, "tri", "exact"),
        pytest.param("coulomb", -0.004, "tri", "stepping", marks=pytest.mark.long),
        pytest.param("coulomb", 0.004, "tet", "exact", marks=pytest.mark.long),
        pytest.param("bonds", -0.004, "tri", "batched", marks=pytest.mark.long),
        ("bonds", 0.004, "tet", "exact"),
        ("soft bonds", -0.004, "tri", "exact"),
    ],
)
def test_from_zero_and_back(law, push, cell, kinks):
    """Up and down the branch ends in the solutions there, and its events are the same."""
    events = []
    for start, end in ((0.0, END), (END, 0.0)):
        problem = pushed(law, push, cell, start)
        (surface,) = problem.surfaces
        system = ParametricContact(problem, surface.law.friction)
        x = system.create_vector()
        problem.write(x)
        # The first step goes beyond the first event.
        control = StepControl(initial=0.3, maximum=0.3, kinks=kinks)
        direction = "increasing" if end > start else "decreasing"
        span = {"gamma_range": (0.0, END), "direction": direction}
        branch = follow(system, x, start, control=control, **span)
        assert branch.reason == "gamma reached the end of its range"
        assert branch.points[-1].gamma == end
        assert {s.kind for s in branch.special} == {"event"}
        statuses = [row["status"] for row in records.journal_of(system, [branch], {}).rows()]
        there = problem.u.x.array.copy()
        wanted = pushed(law, push, cell, end)
        np.testing.assert_allclose(there, wanted.u.x.array, rtol=0, atol=1e-9)
        if cell == "tri" and end > 0:
            assert statuses[-1] == statuses_of(wanted)
            if push < 0:  # without friction it moves as with little
                assert set(statuses[0]) <= set("-lo")
        events.append([s.gamma for s in branch.special])
    assert events[0]
    if kinks == "exact":
        np.testing.assert_allclose(events[0], events[1][::-1], rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("law", "push", "span", "length"),
    [("coulomb", -0.004, (0.075, 0.085), 0.19), ("soft bonds", 0.004, (0.17, 0.1995), 0.48)],
)
def test_a_point_that_sticks_for_a_moment(law, push, span, length):
    """Its slip comes to zero and begins again within one step: the branch does not turn back."""
    low, high = span
    problem = pushed(law, push, "tet", high, 4)
    system = ParametricContact(problem, problem.surfaces[0].law.friction)
    x = system.create_vector()
    problem.write(x)
    control = StepControl(initial=length, maximum=length, kinks="exact")
    branch = follow(system, x, high, gamma_range=span, direction="decreasing", control=control)
    assert branch.reason == "gamma reached the end of its range"
    assert branch.points[-1].gamma == low
    assert [(s.kind, s.parity) for s in branch.special] == [("event", 1)] * 2
    (first,), (second,) = (s.changes for s in branch.special)
    assert (first.rank, first.point) == (second.rank, second.point)
    assert (first.before, first.after) == (second.after, second.before) == (2, 1)
    there = problem.u.x.array.copy()
    wanted = pushed(law, push, "tet", low, 4)
    np.testing.assert_allclose(there, wanted.u.x.array, rtol=0, atol=1e-9)
    middle = float(np.mean([s.gamma for s in branch.special]))
    stuck = branch.points[branch.special[0].index].piece
    assert system.letters(stuck) == statuses_of(pushed(law, push, "tet", middle, 4))


def statuses_of(problem):
    """The statuses of a solution as a journal writes them."""
    system = ParametricContact(problem, problem.surfaces[0].law.friction)
    x = system.create_vector()
    problem.write(x)
    piece = system.piece_at(x, float(problem.surfaces[0].law.friction.value))
    return system.letters(piece)


def test_borders_that_begin_and_end():
    low = Events(np.array([2.0, 3.0]), np.array([0, 2]), np.array([1, 1]))
    high = Events(np.array([-2.0, -1.0, 5.0]), np.array([0, 1, 1]), np.array([1, 2, 1]))
    np.testing.assert_array_equal(fractions_to_borders(low, high), [0.5, 0.5, np.inf])
    np.testing.assert_array_equal(fractions_to_borders(low, high, (1.0, 3.0)), [0.25, 0.5, np.inf])
    same = Events(np.array([-6.0, 1.0]), np.array([0, 2]), np.array([3, 3]))
    np.testing.assert_array_equal(fractions_to_borders(low, same), [0.25, np.inf])
