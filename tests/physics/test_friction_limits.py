"""The ends of the friction axis: F to 0 is the frictionless body, F to infinity is not clamping.

(M. Raous, The art of modelling in contact mechanics, 2017.)
"""

from mpi4py import MPI

import numpy as np
import pytest
from cases.block import arguments
from cases.block import problem as block

from dolfinx_contact import ParametricContact, records
from dolfinx_contact.continuation import follow

COMM = MPI.COMM_WORLD


def body(friction):
    """A block on a floor, pressed by 0.01 and pushed to the right by 0.03."""
    given = dict(n=6, press=0.01, shift=0.03, friction=friction)
    return block(arguments([f"--{k}={v}" for k, v in given.items()]), COMM)


def end_of_branch(start, end):
    """The system at F = end, on the branch from the solution at F = start, and its rows."""
    problem = body(start)
    problem.solve()
    system = ParametricContact(problem, problem.surfaces[0].law.friction)
    x = system.create_vector()
    problem.write(x)
    span = (min(start, end), max(start, end))
    direction = "increasing" if end > start else "decreasing"
    branch = follow(system, x, start, gamma_range=span, direction=direction)
    last = branch.points[-1]
    assert last.gamma == end
    x.array[:] = last.y.array_r[: x.getLocalSize()]
    system.put(x, last.gamma, last.piece)
    return problem, records.journal_of(system, [branch], {}).rows()


def test_no_friction():
    problem, rows = end_of_branch(0.5, 1e-8)
    assert {row["status"] for row in rows} == {"o++++++", "+++++++"}
    smooth = body(0.0)
    smooth.solve()
    np.testing.assert_allclose(problem.u.x.array, smooth.u.x.array, atol=1e-9)


@pytest.mark.ranks(2)
def test_infinite_friction():
    """Nothing slips in the end, and then nothing changes; but the body still lifts off."""
    problem, rows = end_of_branch(0.5, 20.0)
    assert rows[-1]["status"] == "ookkkkk"
    there = problem.u.x.array.copy()
    problem.surfaces[0].law.friction.value = 1e6
    problem.solve()
    np.testing.assert_allclose(problem.u.x.array, there, atol=1e-10)
    table = problem.table(problem.surfaces[0])
    assert table.status == "ookkkkk"
    assert table.un[0] > table.un[1] > 1e-4
