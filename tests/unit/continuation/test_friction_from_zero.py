"""Branches that begin or end where the friction is exactly 0: there closed points cannot stick.

So the statuses have fewer borders at 0 than beside it, and a piece there is one of several.
"""

import numpy as np
import pytest
from support.blocks import block

from dolfinx_contact import RCCM, Coulomb, NormalCompliance, ParametricContact, records
from dolfinx_contact.continuation import StepControl, follow
from dolfinx_contact.points.memory import Memory

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


def statuses_of(problem):
    """The statuses of a solution as a journal writes them."""
    system = ParametricContact(problem, problem.surfaces[0].law.friction)
    x = system.create_vector()
    problem.write(x)
    piece = system.piece_at(x, float(problem.surfaces[0].law.friction.value))
    return system.letters(piece)
