"""Contact problems as systems: derivatives with respect to gamma, and branches with known folds."""

from mpi4py import MPI

import cases.friction_parameter
import cases.single_element
import numpy as np
import pytest
from cases._triangle import linear_triangle
from support.blocks import block
from support.histories import driven_block

from dolfinx_contact import (
    RCCM,
    Coulomb,
    ParametricContact,
    records,
)
from dolfinx_contact.continuation import StepControl, find_solutions, follow
from dolfinx_contact.materials import NeoHookean
from dolfinx_contact.points.memory import Memory

COMM = MPI.COMM_WORLD


@pytest.mark.ranks(2, 3)
@pytest.mark.each_value
@pytest.mark.parametrize("kind", ["load", "friction", "obstacle", "dirichlet"])
@pytest.mark.parametrize("material", [None, NeoHookean(600.0, 400.0)])
@pytest.mark.verifies(
    "branches",
    "friction as parameter",
    "moving obstacles",
    reference="differences: central differences",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_derivative_by_gamma_agrees_with_differences(kind, material):
    """dH/dgamma against central differences on a held piece, second order in the step."""
    system = driven_block(kind, material=material)
    problem = system.problem
    gamma = 0.7
    problem.solve()
    x, b, c, d = (system.create_vector() for _ in range(4))
    problem.write(x)
    if kind == "dirichlet":
        system.set_parameter(gamma)
        problem.u.x.array[:] = np.where(
            problem.equations.constraints.fixed.reshape(-1),
            problem.equations.constraints.values(fill=0.0).reshape(-1),
            problem.u.x.array,
        )
        problem.write(x)
    piece = system.piece_at(x, gamma)
    system.parameter_derivative(x, gamma, c, piece)
    assert c.norm() > 0
    errors = []
    for h in (1e-2, 5e-3):
        system.residual(x, gamma + h, b, piece)
        system.residual(x, gamma - h, d, piece)
        b.axpy(-1.0, d)
        b.scale(1 / (2 * h))
        b.axpy(-1.0, c)
        errors.append(b.norm() / c.norm())
    assert errors[1] < 1e-4
    assert errors[1] < 0.3 * errors[0] or errors[1] < 1e-9


@pytest.mark.ranks(2, 3)
@pytest.mark.verifies(
    "branches",
    "Coulomb",
    reference="closed form: folds of Hild's element",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_single_element_folds_at_its_closed_form(folder):
    """Hild's triangle along a load: folds where the closed form has them, and no bifurcation."""
    summary = cases.single_element.main(["--output", str(folder)])
    folds = [f["gamma"] for f in summary["folds"]]
    np.testing.assert_allclose(folds, [0.625, 346 / 182 / 4], atol=1e-10)
    assert [(f["before"], f["after"]) for f in summary["folds"]] == [("k", "-"), ("-", "o")]
    assert summary["bifurcations"] == 0
    np.testing.assert_allclose(summary["folds_closed_form"], folds, atol=1e-10)
    assert len(summary["solutions_at"]["solutions"]) == 3
    assert (folder / "branch.png").stat().st_size > 10_000


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "friction as parameter",
    reference="closed form: where stick and slip are born",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_stick_and_slip_begin_at_their_closed_form(folder):
    """Stick and slip are born together where the closed form has it."""
    summary = cases.friction_parameter.main(["--output", str(folder)])
    (fold,) = summary["folds"]
    assert not fold["smooth"]
    assert abs(fold["gamma"] - 2.4) < 1e-10
    assert summary["slip_error"] < 1e-10
    assert summary["gamma_end"] == pytest.approx(5.0, abs=1e-12)
    assert (folder / "branch.png").stat().st_size > 10_000


def test_singular_piece_is_a_continuum():
    """Hild's element at the critical friction: a continuum, including the two solutions."""
    system = linear_triangle(1, 2.0, (4.0, 2.0), (1.0, 1.0), comm=MPI.COMM_SELF)
    x = system.create_vector()
    found = find_solutions(system, [x], 1.0)
    assert len(found.found) == 2
    assert not found.complete
    assert "continua" in found.method
    (continuum,) = found.continua
    assert system.letters(continuum.piece) == "-d"
    assert {id(s) for s in continuum.ends} == {id(s) for s in found.found}
    # Every state between the ends solves the problem on that piece, and H itself.
    a, b = (s.x for s in continuum.ends)
    for part in (0.0, 0.3, 1.0):
        a.copy(x)
        x.axpby(part, 1 - part, b)
        residual = system.create_vector()
        assert system.residual(x, 1.0, residual, None) < 1e-10


END = 0.3
LAWS = {
    "coulomb": Coulomb,
    "bonds": lambda F: RCCM(100.0, 100.0, 1e-3, F),
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
    ],
)
def test_branches_up_and_down_have_the_same_events(law, push, cell, kinks):
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
