"""Assumption: observers look, and the problem is at the point that they are told of.

They read displacement, tables, forms and data, stop runs, raise, solve and write to Functions. Each
point has a closed form: a block with Poisson's ratio 0 comes down by 0.01 gamma on a floor 0.004
below it, so that its force is 1000 (0.01 gamma - 0.004) where that is positive.
"""

from mpi4py import MPI

import numpy as np
import pytest
from support.bodies import block, floor, table_of, two_blocks
from support.checks import assert_close, solved_start
from support.recorded_run import resume

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Coulomb,
    Frictionless,
    HalfSpace,
    LevelSet,
    ParametricContact,
    RigidBody,
    materials,
)
from dolfinx_contact.continuation import Observer, Observers, StepControl, explore, follow
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.records import BranchRecord, read_journal

COMM = MPI.COMM_WORLD


def lowered(law=None, degree=1, **options):
    """The block and its system; it stands in the Functions at gamma = 0."""
    body = block((2, 1), degree=degree)
    problem = body.problem(law or Coulomb(0.3), obstacle=floor(-0.004), **options)
    gamma = fem.Constant(body.domain, 0.0)
    way = ufl.as_vector((0.0, -0.01 * gamma))
    system = ParametricContact(problem, gamma, driven=[(body.moved, way)])
    return body, system, Reader(body, system, gamma)


def followed(system, observer, **options):
    options = {"gamma_range": (0.0, 1.0), **options}
    return follow(system, system.create_vector(), 0.0, observer=observer, **options)


class Reader(Observer):
    """Reads Constant, force, way of the top and a form at every point."""

    def __init__(self, body, system, gamma):
        self.body = body
        self.system = system
        self.gamma = gamma
        self.seen = []
        self.size = fem.form(ufl.dot(body.u, body.u) * ufl.dx)
        self.top = fem.locate_dofs_topological(body.V, 1, body.top)

    def step(self, step, state):
        table = table_of(self.system.problem)
        ways = self.body.u.x.array.reshape(-1, 2)[self.top, 1]
        self.seen.append(
            (
                step.point.gamma,
                float(self.gamma.value),
                np.sum(table.rn),
                COMM.allreduce(float(np.max(-ways, initial=0.0)), op=MPI.MAX),
                COMM.allreduce(fem.assemble_scalar(self.size)),
                "o" in table.status,
            )
        )

    def column(self, k):
        return np.array([row[k] for row in self.seen], dtype=float)


def assert_right(reader):
    """Compare all that was read with the closed form."""
    way = 0.01 * reader.column(0)
    deep = np.maximum(way - 0.004, 0.0)
    foot = np.minimum(way, 0.004)  # the displacement is linear between foot and top
    assert_close(reader.column(1), reader.column(0))
    assert_close(reader.column(2), 1000.0 * deep)
    assert_close(reader.column(3), way)
    assert_close(reader.column(4), (foot**2 + foot * way + way**2) / 3.0)
    assert not np.any(reader.column(5)[deep > 1e-9])


@pytest.mark.parametrize(
    "route", [pytest.param("pivoting", marks=pytest.mark.sample), "steps", "auto"]
)
def test_the_problem_is_at_each_point_that_is_told(route):
    _, system, reader = lowered()
    branch = followed(system, reader, route=route)
    assert_close(reader.column(0), [p.gamma for p in branch.points])
    assert_close(branch.points[-1].gamma, 1.0)
    assert_right(reader)


@pytest.mark.parametrize(("degree", "method"), [(2, "integral"), (1, "mixed")])
def test_the_problem_is_at_each_point_in_other_discretisations(degree, method):
    _, system, reader = lowered(Frictionless(), degree=degree, method=method)
    followed(system, reader)
    assert_right(reader)


def test_explore_tells_of_the_points_of_all_branches_and_leaves_the_problem():
    body, system, reader = lowered()
    x = solved_start(system, 0.7)
    before = [f.x.array.copy() for f in (body.u, body.moved)]
    diagram = explore(
        system,
        [(x, 0.7), (system.create_vector(), 0.0)],
        gamma_range=(0.0, 1.0),
        observer=reader,
        max_branches=6,
    )
    points = {round(p.gamma, 9) for edge in diagram.edges for p in edge.branch.points}
    assert points <= set(np.round(reader.column(0), 9))
    assert_right(reader)
    for f, values in zip((body.u, body.moved), before, strict=True):
        assert_close(f.x.array, values)
    assert_close(float(reader.gamma.value), 0.7)


class Meddler(Observer):
    """Solves, and leaves other values in the Functions."""

    def __init__(self, body, problem):
        self.body = body
        self.problem = problem

    def step(self, step, state):
        if step.index == 2:
            self.problem.solve()
        self.body.u.x.array[:] = 0.5
        self.body.moved.x.array[:] = -0.3
        self.problem.surfaces[0].multiplier.x.array[:] = 7.0


@pytest.mark.parametrize("route", ["pivoting", "steps"])
def test_changes_by_an_observer_are_lost_at_the_next_point(route):
    body, system, reader = lowered()
    branch = followed(system, Observers(reader, Meddler(body, system.problem)), route=route)
    assert_right(reader)
    forces = [system.result_at(p).resultants["contact"][1] for p in branch.points]
    assert_close(forces, reader.column(2))


@pytest.mark.sample
def test_a_history_whose_observer_writes_to_the_displacement_is_right():
    body = block((2, 1))
    problem = body.problem(Coulomb(0.3), obstacle=floor(-0.004))

    def meddle(step):
        body.u.x.array[:] = 0.5

    evolution = QuasiStatic(problem, lambda t: body.move_top(0.0, -0.01 * t))
    history = evolution.run([0.0, 0.3, 0.6, 1.0], observer=meddle)
    for step in history.steps:
        right = 1000.0 * max(0.01 * step.time - 0.004, 0.0)
        assert_close(step.result.resultants["contact"][1], right)


class Stopped(Exception):
    pass


class Raises(Observer):
    def step(self, step, state):
        if step.index == 2:
            raise Stopped


def test_a_branch_whose_observer_raised_can_be_followed_again():
    body, system, reader = lowered()
    with pytest.raises(Stopped):
        followed(system, Observers(reader, Raises()))
    assert len(reader.seen) == 3
    assert_right(reader)
    again = Reader(body, system, reader.gamma)
    followed(system, again)
    assert_right(again)
    assert_close(np.sum(table_of(system.problem).rn), 6.0)


@pytest.mark.parametrize("most", [3.0, 0.0])
def test_a_branch_stops_at_the_first_force_beyond_a_number(most):
    _, system, _ = lowered()

    def stop(step):
        force = float(np.sum(table_of(system.problem).rn))
        return f"the force is {force}" if force > most else ""

    control = StepControl(maximum=0.05)
    branch = followed(system, None, stop=stop, control=control, route="steps")
    gammas = np.array([p.gamma for p in branch.points])
    forces = 1000.0 * np.maximum(0.01 * gammas - 0.004, 0.0)
    assert forces[-1] > most
    assert np.all(forces[:-1] <= most)
    assert_close(np.sum(table_of(system.problem).rn), forces[-1])


def energy_of(problem):
    """The energy of the body, a function of the problem."""
    form = fem.form(problem.energy)
    return lambda problem: problem.comm.allreduce(fem.assemble_scalar(form))


def test_a_branch_resumed_with_an_observer_tells_of_right_points(folder):
    def force(problem):
        return float(np.sum(table_of(problem).rn))

    _, system, reader = lowered()
    work = {"energy": energy_of(system.problem), "force": force}
    with BranchRecord(folder / "branch", system, work, every=4) as record:
        control = StepControl(maximum=0.06)
        followed(system, reader, max_steps=14, control=control, record=record, route="steps")
    _, system, reader = lowered()
    work = {"energy": energy_of(system.problem), "force": force}
    branch = resume(folder / "branch", system, work, every=4, max_steps=200, observer=reader)
    assert_close(branch.points[-1].gamma, 1.0)
    assert_right(reader)
    columns = read_journal(folder / "branch").columns()
    deep = np.maximum(0.01 * np.asarray(columns["gamma"]) - 0.004, 0.0)
    assert len(deep) > 16
    assert_close(columns["force"], 1000.0 * deep)
    assert_close(columns["energy"], 500.0 * deep**2)


class Rows(Observer):
    """Reads force, gaps and ways at every point."""

    def __init__(self, problem, more):
        self.problem = problem
        self.more = more
        self.rows = []

    def step(self, step, state):
        table = table_of(self.problem)
        gaps = float(np.min(table.un)), float(np.max(table.un))
        self.rows.append((step.point.gamma, np.sum(table.rn), *gaps, self.more()))


@pytest.mark.parametrize("kind", ["floor", "plate"])
def test_data_of_gamma_other_than_displacements_stand_when_a_point_is_told(kind):
    """A floor rising by 0.01 gamma, and a plate pressed by 10 gamma."""
    body = block((2, 1))
    gamma = fem.Constant(body.domain, 0.0)
    obstacle = LevelSet(lambda x: x[1] - 0.01 * gamma)
    if kind == "plate":
        obstacle = RigidBody(
            HalfSpace(point=(0.5, 0.0), normal=(0.0, 1.0)),
            about=(0.5, 0.0),
            load={"y": 10.0 * gamma},
            held=["x", "rz"],
        )
    problem = body.problem(obstacle=obstacle)
    system = ParametricContact(problem, gamma)
    nodes = fem.locate_dofs_topological(body.V, 1, body.bottom)
    nodes = nodes[nodes < body.V.dofmap.index_map.size_local]

    def foot():
        return COMM.allreduce(float(np.sum(body.u.x.array.reshape(-1, 2)[nodes, 1])))

    x = solved_start(system, 0.2)
    reader = Rows(problem, foot)
    follow(system, x, 0.2, gamma_range=(0.2, 1.0), observer=reader, max_steps=60)
    gammas, force, lowest, highest, feet = np.array(reader.rows).T
    assert_close(gammas[-1], 1.0)
    assert_close(force, 10.0 * gammas)
    assert_close(feet, 3 * 0.01 * gammas)
    assert_close(1e3 * np.maximum(np.abs(lowest), np.abs(highest)), 0 * gammas)


def test_an_observer_of_two_bodies_reads_force_gap_and_way():
    """They come together by 0.01 gamma and slide; the pressure is E / 1.5 beyond a gap of 0.004."""
    both = two_blocks((2, 1), (2, 1))
    law = Coulomb(0.2)
    pair = ContactPair(both.u, both.slave, master_facets=both.master, law=law, gap=0.004)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    problem = ContactProblem(steel.energy(both.u) * ufl.dx, both.u, [pair], bcs=both.bcs)
    gamma = fem.Constant(both.domain, 0.0)
    way = ufl.as_vector((0.03 * gamma, -0.01 * gamma))
    system = ParametricContact(problem, gamma, driven=[(both.top, way)])
    reader = Rows(problem, lambda: COMM.allreduce(float(np.min(both.top.x.array)), op=MPI.MIN))
    branch = followed(system, reader)
    gammas, force, lowest, _, way = np.array(reader.rows).T
    depth = 0.01 * gammas - 0.004
    assert_close(gammas, [p.gamma for p in branch.points])
    assert_close(gammas[-1], 1.0)
    assert_close(way, -0.01 * gammas)
    assert_close(force, 1000.0 / 1.5 * np.maximum(depth, 0.0))
    assert_close(lowest, np.maximum(-depth, 0.0))
