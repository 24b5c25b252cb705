"""Problems of one step from a state: friction opposes the increment since the state."""

from itertools import pairwise

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import box, facets
from support.histories import cycle, dragged, put

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.continuation import find_solutions, follow
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD
TIMES = [0.0, 1.0, 2.0, 3.0, 4.0]


@pytest.mark.ranks(2)
def test_steps_one_by_one_are_a_history():
    """The same displacements as those of a run, step by step."""
    problem, top = dragged()
    load = cycle(top)
    found = []
    step = problem
    for start, end in pairwise(TIMES):
        state = step.snapshot()
        load(end)
        step = problem.step_from(state, step=end - start)
        result = step.solve(expected=[state.statuses])
        found.append((result.tables["contact"].status, problem.u.x.array.copy()))
    other, top = dragged()
    seen = []
    QuasiStatic(other, cycle(top)).run(
        TIMES,
        observer=lambda s: seen.append((s.status, other.u.x.array.copy())),
    )
    assert [s for s, _ in found] == [s for s, _ in seen]
    for (_, a), (_, b) in zip(found, seen, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)


def test_a_step_without_a_change_of_the_load_stays():
    """At zero increment friction allows every shear within the bound, the static law only one."""
    problem, top = dragged()
    put(top, (0.0, -0.01))
    problem.solve()
    state = problem.snapshot()
    put(top, (0.006, -0.01))
    problem.step_from(state).solve()
    state = problem.step_from(state).snapshot()
    put(top, (0.0, -0.01))
    step = problem.step_from(state)
    back = step.solve()
    again = problem.step_from(step.snapshot()).solve(expected=[step.snapshot().statuses])
    shear = back.tables["contact"].rt
    np.testing.assert_allclose(again.tables["contact"].rt, shear, rtol=0, atol=1e-9)
    static = problem.solve().tables["contact"].rt
    size = np.abs(shear).max()
    assert np.abs(static - shear).max() > 0.1 * size


class Column:
    """A linear block on a floor whose top is moved by a parameter."""

    def __init__(self):
        domain = box(COMM, 2, "quad")
        self.gamma = fem.Constant(domain, 0.0)
        V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
        self.u = fem.Function(V)
        self.top = fem.Function(V)
        floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
        surface = ContactSurface(self.u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(0.3))
        held = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
        energy = LinearElastic.from_young(100.0, 0.3).energy(self.u) * ufl.dx
        self.problem = ContactProblem(
            energy, self.u, [surface], bcs=[fem.dirichletbc(self.top, held)]
        )
        self.way = ufl.as_vector((0.01 * self.gamma, -0.01))

    def system(self, problem):
        return ParametricContact(problem, self.gamma, driven=[(self.top, self.way)])


@pytest.mark.ranks(2)
def test_a_step_answers_what_a_problem_answers():
    """Branches, all solutions and solves of a step agree, and differ from the static law."""
    column = Column()
    problem = column.problem
    static = column.system(problem)
    static.set_parameter(0.0)
    problem.solve()
    state = problem.snapshot()
    static.set_parameter(1.0)
    step = problem.step_from(state)
    step.solve()
    dragged_state = step.snapshot()
    static.set_parameter(1.0)
    step = problem.step_from(dragged_state)
    system = column.system(step)
    x = system.create_vector()
    step.write(x)
    branch = follow(system, x, 1.0, gamma_range=(0.2, 1.0), direction="decreasing")
    end = branch.points[-1].y
    n = x.getLocalSize()
    (found,) = find_solutions(system, [x], 0.2).found
    np.testing.assert_allclose(end.array_r[:n], found.x.array_r, rtol=0, atol=1e-9)
    system.set_parameter(0.2)
    step.solve()
    step.write(x)
    np.testing.assert_allclose(x.array_r, found.x.array_r, rtol=0, atol=1e-9)
    problem.solve()
    y = system.create_vector()
    problem.write(y)
    assert COMM.allreduce(float(np.abs(y.array_r - x.array_r).max(initial=0.0)), max) > 1e-5


def test_a_step_leaves_the_static_law_of_the_problem():
    problem, top = dragged()
    put(top, (0.006, -0.01))
    before = problem.solve().tables["contact"].rt
    state = problem.snapshot()
    problem.step_from(state).solve()
    problem.restore(state)
    after = problem.solve().tables["contact"].rt
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-12 * np.abs(before).max())
