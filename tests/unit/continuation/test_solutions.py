"""Several solutions at one gamma."""

from mpi4py import MPI

import numpy as np
import pytest
from cases._triangle import linear_triangle
from support.blocks import block
from support.checks import solved_start
from support.textbook import gould, state

from dolfinx import fem

from dolfinx_contact import Coulomb, ParametricContact, Sphere
from dolfinx_contact.continuation import find_solutions


def whole(system, x):
    return np.concatenate(system.comm.allgather(x.array_r.copy()))


@pytest.mark.verifies(
    "all solutions", reference="closed form: three points of Gould's nonconvex problem", alone=True
)
def test_goulds_problem_has_three_solutions():
    """Three KKT points from one guess (Gould's nonconvex problem)."""
    system = gould()
    solutions = find_solutions(system, [state(system, [0.2, 0.2, 0, 0])], 0.0)
    points = sorted(whole(system, s.x)[:2].tolist() for s in solutions.found)
    np.testing.assert_allclose(points, [[0, 1 / 2], [1 / 4, 1 / 2], [11 / 32, 15 / 32]], atol=1e-9)
    assert "deflation" in solutions.method
    assert not solutions.complete


@pytest.mark.parametrize("deflation", [False, pytest.param(True, marks=pytest.mark.long)])
@pytest.mark.verifies(
    "all solutions",
    reference="closed form: open, stick and slip of Hild's element",
    aspects=("2D",),
    alone=True,
)
def test_open_stick_and_slip_of_one_element_are_found(deflation):
    """Hild's element between its folds: open, stick and slip, by enumeration and by deflation."""
    system = linear_triangle(1, 2.5, (4.0, 0.0), preload=(0.0, -1.0), comm=MPI.COMM_SELF)
    gamma = 0.55  # between 0.4752747 and 0.625
    x = system.create_vector()
    x.set(0.0)
    solutions = find_solutions(system, [x], gamma, deflation=deflation)
    assert {system.letters(s.piece)[0] for s in solutions.found} == {"o", "k", "-"}
    assert len(solutions.found) == 3
    assert solutions.complete is not deflation
    b = system.create_vector()
    for s in solutions.found:
        assert system.residual(s.x, gamma, b, s.piece) < 1e-9


@pytest.mark.parametrize(
    ("n", "vertical", "deflation"),
    [
        (8, 8.3, False),
        (4, 9.05, False),
        pytest.param(4, 9.05, True, marks=pytest.mark.long),
    ],
)
def test_triangle_has_three_solutions(n, vertical, deflation):
    """F = 1.8: three solutions at gamma = 1; the enumeration of 4^n pieces is a proof."""
    system = linear_triangle(n, 1.8, load=(26.0, vertical))
    x = system.create_vector()
    x.set(0.0)
    solutions = find_solutions(system, [x], 1.0, deflation=deflation)
    found = sorted(system.letters(s.piece) for s in solutions.found)
    rest = (n - 1) * "o" + "d"
    assert found == ["-" + rest, "k" + rest, "o" + rest]
    assert solutions.complete is not deflation


@pytest.mark.parametrize(
    "options",
    [
        dict(cell="hex"),
        dict(cell="hex", method="integral"),
        dict(cell="hex", obstacle=Sphere((0.5, 0.5, -3.0), 3.0), top=(0.02, 0.01, -0.015)),
        dict(cell="tet"),
    ],
    ids=str,
)
def test_what_a_solve_finds_in_space_is_found(options):
    """The search starts at zero with few Newton steps, and the Functions stay unchanged."""
    first = block(n=2, **options)
    friction = fem.Constant(first.V.mesh, 0.3)
    problem = block(**options, law=Coulomb(friction), domain=first.V.mesh)
    system = ParametricContact(problem, friction)
    nothing = state(system, np.zeros(system.create_vector().getSize()))
    few = dict(lengths=(0.5,), max_iterations=3, proof_seconds=0.0)
    solutions = find_solutions(system, [nothing], 0.3, **few)
    assert problem.u.x.array.max(initial=0.0) == 0.0
    assert nothing.norm() == 0.0
    known = solved_start(system)
    (found,) = solutions.found
    assert (found.x - known).norm() <= 1e-8 * known.norm()
    assert solutions.method.startswith("solve() by full steps, deflation")
    assert not solutions.complete
    again = find_solutions(system, [nothing], 0.3, known=[known], **few)
    assert len(again.found) == 1


@pytest.mark.ranks(2)
def test_what_was_not_found_is_said():
    domain = block(n=2, cell="tet").V.mesh
    friction = fem.Constant(domain, 0.3)
    problem = block(cell="tet", domain=domain, law=Coulomb(friction), options={"snes_max_it": 0})
    system = ParametricContact(problem, friction)
    nothing = state(system, np.zeros(system.create_vector().getSize()))
    few = dict(lengths=(0.5,), max_iterations=1, proof_seconds=0.0)
    solutions = find_solutions(system, [nothing], 0.3, **few)
    assert solutions.found == ()
    assert not solutions.complete
    assert solutions.method.startswith("not found: solve() found no solution (full steps: ")
    assert "deflation" in solutions.method
