"""States of a problem as values: snapshots, statuses and evaluators at a state."""

from dataclasses import replace
from itertools import pairwise

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block, facets
from support.histories import cycle, dragged, put
from support.own_laws import SlipWeakening

import ufl
from dolfinx import fem

from dolfinx_contact import (
    RCCM,
    BilinearCohesive,
    ContactProblem,
    Coulomb,
    Frictionless,
    HalfSpace,
    MaxwellLayer,
    ParametricContact,
)
from dolfinx_contact.continuation import find_solutions, follow
from dolfinx_contact.evolution import NSCD, ArcLength, QuasiStatic
from dolfinx_contact.io import write_fields
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD
SOFT = LinearElastic.from_young(100.0, 0.3)


def moved_block():
    """A block on a floor, and a function moving its top."""
    problem, top = dragged()

    def move(x, y):
        put(top, (x, y))

    return problem, move


def functions(problem):
    return [f.x.array.copy() for f in problem.fields]


def same(a, b):
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


@pytest.mark.ranks(2)
def test_restore_is_exact():
    problem, move = moved_block()
    move(0.01, -0.02)
    problem.solve()
    state = problem.snapshot()
    values = functions(problem)
    table = problem.table(problem.surfaces[0])
    move(-0.02, -0.03)
    problem.solve()
    assert not COMM.allreduce(same(functions(problem), values), op=MPI.LAND)
    problem.restore(state)
    assert same(functions(problem), values)
    move(0.01, -0.02)
    assert problem.table(problem.surfaces[0]).status == table.status
    assert problem.solve().iterations == 0


def test_statuses_are_those_of_the_last_write():
    """On a border the unknowns do not determine them; other unknowns do determine theirs."""
    problem, _ = moved_block()
    free = problem.snapshot()  # without load all points are on the border of all statuses
    (codes,) = free.statuses
    for status in (0, 1):
        problem.restore(replace(free, statuses=(np.full_like(codes, status),)))
        assert np.all(problem.snapshot().statuses[0] == status)
    (f,) = (s.multiplier for s in problem.surfaces)
    f.x.array.reshape(-1, 2)[:, 1] = -1.0  # pulls
    assert np.all(problem.snapshot().statuses[0] == 0)
    f.x.array.reshape(-1, 2)[:, 1] = 1.0  # presses
    assert np.all(problem.snapshot().statuses[0] == 1)


@pytest.mark.ranks(2)
def test_evaluations_at_a_state_leave_the_functions_unchanged():
    """Evaluations at a state agree with those of the Functions and do not change them."""
    problem, move = moved_block()
    (s,) = problem.surfaces
    move(0.01, -0.02)
    problem.solve()
    state = problem.snapshot()

    def evaluated(**at):
        table = problem.table(s, **at)
        fields = problem.contact_fields(s, **at)
        return [
            *(table.force, table.un, table.ut, table.bound),
            *(f.x.array for f in fields.values()),
            problem.support_forces(s, **at),
        ], table.status

    before, status = evaluated()
    move(-0.02, -0.03)
    problem.solve()
    values = functions(problem)
    after, other = evaluated(state=state)
    assert same(before, after)
    assert status == other
    assert same(functions(problem), values)


def test_a_table_in_an_observer_has_the_law_of_the_step():
    """Increments and bonds belong to the step; after the run they belong to the last step."""
    law = RCCM(normal=1e3, tangential=1e3, work=0.005, friction=0.2, viscosity=1e-2)
    problem = block(law=law, top=(0.0, 0.0))
    top = problem.bcs[0].g.value
    found = []

    def load(t):
        top[1] = 0.02 * t

    def observe(step):
        table = problem.table(problem.surfaces[0])
        expected = step.result.tables["contact"]
        for name in ("increment", "adhesion"):
            np.testing.assert_array_equal(getattr(table, name), getattr(expected, name))
        np.testing.assert_array_equal(table.internal["beta"], expected.internal["beta"])
        found.append(table.internal["beta"])

    QuasiStatic(problem, load).run([0.0, 0.5, 1.0], observer=observe)
    after = problem.table(problem.surfaces[0]).internal["beta"]
    np.testing.assert_array_equal(after, found[-1])
    assert COMM.allreduce(after.min(initial=1.0), op=MPI.MIN) < 1.0


def test_the_mean_of_a_variable_of_a_law_leaves_out_clamped_points():
    law = RCCM(normal=1e3, tangential=1e3, work=0.005, viscosity=1e-2)
    wall = HalfSpace((0.0, 0.0), (1.0, 0.0))
    problem = block(law=law, obstacle=wall, where=lambda d: facets(d, 0, 0.0), top=(0.0, 0.0))
    top = problem.bcs[0].g.value

    def load(t):
        top[0] = 0.02 * t

    history = QuasiStatic(problem, load).run([0.0, 1.0])
    table = history.steps[-1].result.tables["contact"]
    free = table.letters != "d"
    assert np.count_nonzero(~free) == 1
    mean = np.average(table.internal["beta"][free], weights=table.area[free])
    assert mean < 1.0
    assert history.rows()[-1]["contact_beta"] == pytest.approx(mean, rel=1e-12)


def test_a_state_of_another_mesh_is_refused():
    """Also if it has as many unknowns."""
    problem, other = block(), block()
    domain = other.u.function_space.mesh
    state = problem.snapshot()
    domain.geometry.x[:, 0] *= 2.0
    wide = ContactProblem(other.energy, other.u, other.contacts, bcs=other.bcs)
    for ask in (
        lambda: wide.restore(state),
        lambda: wide.step_from(state),
        lambda: wide.table(wide.surfaces[0], state=state),
    ):
        with pytest.raises(ValueError, match="a State of this problem, of the same mesh"):
            ask()


@pytest.mark.ranks(2)
def test_states_of_other_contact_points_are_refused():
    """On the same mesh, with as many points of the same name, too; other laws are accepted."""
    problem = block(cell="quad")
    state = problem.snapshot()
    (contact,) = problem.contacts

    def problem_with(**changes):
        surface = replace(contact, **changes)
        return ContactProblem(problem.energy, problem.u, [surface], bcs=problem.bcs)

    left = facets(problem.V.mesh, 0, 0.0)
    for other in (problem_with(facets=left), problem_with(method="mixed")):
        with pytest.raises(ValueError, match="a State of this problem, of the same mesh, contact"):
            other.restore(state)
    problem_with(law=Coulomb(0.7)).restore(state)


def test_a_state_without_the_variables_of_a_law_begins_no_step():
    problem = block(law=Coulomb(0.3))
    state = problem.snapshot()
    (contact,) = problem.contacts
    bonded = replace(contact, law=RCCM(0.3, 100.0, 100.0, 0.1))
    other = ContactProblem(problem.energy, problem.u, [bonded], bcs=problem.bcs)
    with pytest.raises(
        ValueError, match="the memory belongs to other contact surfaces, another law"
    ):
        other.step_from(state)


@pytest.mark.parametrize("step", [-0.5, np.nan, np.inf, "a"])
def test_the_duration_of_a_step_is_a_nonnegative_number(step):
    problem = block()
    with pytest.raises(ValueError, match="the duration of a step must be a nonnegative number"):
        problem.step_from(problem.snapshot(), step=step)


@pytest.mark.ranks(2)
def test_files_of_a_state_contain_the_state(tmp_path):
    problem, move = moved_block()
    move(0.01, -0.02)
    problem.solve()
    state = problem.snapshot()
    folder = COMM.bcast(tmp_path)
    before = write_fields(folder / "before", problem, format="vtk")
    move(-0.02, -0.03)
    problem.solve()
    values = functions(problem)
    after = write_fields(folder / "after", problem, state=state, format="vtk")
    assert same(functions(problem), values)
    if COMM.rank == 0:
        assert [a.name for a in before] == [b.name for b in after]
        for a in (folder / "before").glob("*.vtu"):
            assert a.read_bytes() == (folder / "after" / a.name).read_bytes()


@pytest.mark.ranks(2)
def test_every_call_refuses_a_moved_mesh():
    """The next public call raises; a mesh that is moved back is the same mesh."""
    problem, move = moved_block()
    move(0.01, -0.02)
    problem.solve()
    state = problem.snapshot()
    system = ParametricContact(problem)
    solution = problem.create_vector()
    problem.write(solution)
    x = problem.V.mesh.geometry.x
    before = x.copy()
    x[:, 1] *= 1.01
    for call in (
        problem.solve,
        problem.snapshot,
        problem.uniqueness,
        problem.theory,
        lambda: problem.table(problem.surfaces[0]),
        lambda: problem.table(problem.surfaces[0], state=state),
        lambda: problem.step_from(state),
        lambda: problem.restore(state),
        problem.evaluate,
        lambda: problem.evaluate(state),
        lambda: QuasiStatic(problem, lambda t: None).run([0.0, 1.0]),
        lambda: follow(system, solution, 0.0, gamma_range=(0.0, 1.0)),
        lambda: find_solutions(system, [solution], 0.0),
    ):
        with pytest.raises(ValueError, match="the mesh has moved since the problem was made"):
            call()
    x[:] = before
    assert problem.solve().iterations == 0


@pytest.mark.ranks(2)
def test_monitor_that_fails_on_one_rank_ends_all():
    problem, move = moved_block()
    move(0.01, -0.02)
    values = functions(problem)

    def monitor(step):
        if COMM.rank == COMM.size - 1:
            raise ZeroDivisionError("enough")

    with pytest.raises(ZeroDivisionError, match="enough"):
        problem.solve(monitor=monitor if COMM.rank == COMM.size - 1 else None)
    assert same(functions(problem), values)


TIMES = [0.0, 1.0, 2.0, 3.0, 4.0]


@pytest.mark.ranks(2)
def test_steps_one_by_one_are_a_history():
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
    """A block on a floor whose top is moved by a parameter."""

    def __init__(self):
        self.problem, self.top = dragged(n=2, energy=SOFT)
        self.gamma = fem.Constant(self.problem.V.mesh, 0.0)
        self.way = ufl.as_vector((0.01 * self.gamma, -0.01))

    def system(self, problem):
        return ParametricContact(problem, self.gamma, driven=[(self.top, self.way)])


@pytest.mark.ranks(2)
def test_step_supports_branches_and_all_solutions():
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


# -- snapshots between the steps of a loop ---------------------------------------------------------


#: Law, and the motions of the top after the steps of a loop. The bonds break in the second step,
#: the layer flows, and the distance slipped grows while the top goes back and forth.
LOOPS = {
    "adhesion": (RCCM(200.0, 150.0, 0.004, 0.2), [(0, 0.002), (0, 0.03), (0, 0.01), (0, 0.006)]),
    "cohesion": (
        BilinearCohesive(2.0, 0.001, 0.01, 0.3),
        [(0, 0.002), (0, 0.03), (0, 0.01), (0, 0.006)],
    ),
    "layer": (MaxwellLayer(500.0, 200.0, 10.0), [(0, 0.01), (0.01, 0.01), (0.01, 0.01), (0, 0)]),
    "slip": (
        SlipWeakening(0.6, 0.2, 0.004),
        [(0, -0.01), (0.02, -0.01), (-0.02, -0.01), (0.01, -0.01)],
    ),
}


def remembered(state):
    """Return memory, statuses and displacement of a state, as arrays by name."""
    (memory,), (statuses,) = state.memory, state.statuses
    return {**memory.fields, "jump": memory.jump, "statuses": statuses, "u": state.displacement}


def assert_equal(a, b):
    a, b = remembered(a), remembered(b)
    assert a.keys() == b.keys()
    for name, values in a.items():
        np.testing.assert_array_equal(values, b[name], err_msg=name)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("kind", LOOPS)
def test_a_snapshot_after_a_step_or_a_restored_state_is_the_state_of_the_step(kind):
    """Bonds stay broken, layers stay deformed, and the distance slipped is kept."""
    law, motions = LOOPS[kind]
    problem, top = dragged(n=2, energy=SOFT, law=lambda _: law)
    state = virgin = problem.snapshot()
    states = []
    for motion in motions:
        put(top, motion)
        step = problem.step_from(state, step=1.0)
        step.solve()
        state = problem.snapshot()
        assert_equal(state, step.snapshot())
        states.append(state)
    for state in reversed(states):
        problem.restore(state)
        put(top, (0.0, 0.0))  # data do not change a state
        assert_equal(problem.snapshot(), state)
        assert problem.snapshot().previous[0] is state.previous[0]
    # unknowns of the user have no history
    for f in problem.fields:
        f.x.array[:] = 0.0
    assert_equal(problem.snapshot(), virgin)
    problem.restore(states[-1])
    problem.u.x.array[:] *= 1.0 + 1e-12
    fresh, _ = dragged(n=2, energy=SOFT, law=lambda _: law)
    for f, g in zip(fresh.fields, problem.fields, strict=True):
        f.x.array[:] = g.x.array
    assert_equal(problem.snapshot(), fresh.snapshot())
    changed, kept = (remembered(s) for s in (problem.snapshot(), states[-1]))
    lost = [
        np.abs(changed[k] - kept[k]).max(initial=0.0) for k in changed if k not in ("jump", "u")
    ]
    assert COMM.allreduce(max(lost), op=MPI.MAX) > 1e-3


def test_a_state_of_another_law_is_the_start_of_a_loop():
    """The frictionless history knows of no bonds: they are intact under the displacement."""
    free, top = dragged(n=2, energy=SOFT, law=lambda _: Frictionless())
    glued, _ = dragged(n=2, energy=SOFT, law=lambda _: LOOPS["adhesion"][0])
    put(top, (0.0, -0.01))
    step = free.step_from(free.snapshot())
    step.solve()
    glued.restore(step.snapshot())
    (memory,) = glued.snapshot().memory
    np.testing.assert_array_equal(memory.fields["beta"], 1.0)


EVOLUTIONS = [QuasiStatic, NSCD]


class Rubbing:
    """A block that is pressed on a floor, dragged to the right and back; friction is a Constant."""

    def __init__(self, kind=QuasiStatic):
        self.problem, self.top = dragged(n=2, law=self.law)
        self.load(0.0)
        self.problem.solve()
        self.evolution = self.begun(kind)

    def law(self, domain):
        self.friction = fem.Constant(domain, 0.4)
        return Coulomb(self.friction)

    def begun(self, kind):
        if kind is NSCD:
            return NSCD(self.problem, 1e-3, dt=0.1, load=self.load, theta=1.0)
        return QuasiStatic(self.problem, self.load)

    def load(self, t):
        put(self.top, (0.012 * np.interp(t, [0, 1, 2], [0, 1, -1]), -0.01))


class Glued:
    """A block on a floor with bonds that break, whose top is moved."""

    def __init__(self):
        bonds = RCCM(200.0, 150.0, 0.004, 0.2)
        self.problem, self.top = dragged(n=2, energy=SOFT, law=lambda _: bonds)

    def load(self, t):
        put(self.top, (0.0, np.interp(t, [0, 1, 2, 3], [0, 0.02, 0.0, 0.02])))

    def history(self):
        return QuasiStatic(self.problem, self.load)


def force(step):
    return step.result.resultants["contact"]


# -- starts ----------------------------------------------------------------------------------------


@pytest.mark.ranks(2)
@pytest.mark.parametrize("kind", EVOLUTIONS)
def test_another_evolution_of_a_problem_needs_a_start(kind):
    """From the state of the last step it continues; from a state before it begins again."""
    whole = Rubbing(kind)
    expected = force(whole.evolution.run([0.0, 0.5, 1.0, 1.2, 1.4]).steps[-1])
    parts = Rubbing(kind)
    history = parts.evolution.run([0.0, 0.5, 1.0, 1.2])
    other = parts.begun(kind)
    with pytest.raises(ValueError, match=r"start=history\.steps\[-1\]\.state .*snapshot"):
        other.run([1.2, 1.4])
    state = history.steps[-1].state
    put(parts.problem.u, (0.0, 0.0))
    found = other.run([1.2, 1.4], start=state)
    np.testing.assert_allclose(force(found.steps[-1]), expected, rtol=1e-8)
    assert found.start == 1.2
    # A later run of the same evolution may start elsewhere, too.
    again = other.run([1.2, 1.4], start=state)
    np.testing.assert_allclose(force(again.steps[-1]), expected, rtol=1e-8)


def test_a_path_starts_from_the_state_of_a_history():
    """With the bonds of that state, and with intact ones from zero displacement."""
    glued = Glued()
    state = glued.history().run(np.linspace(0.0, 2.0, 11)).steps[-1].state
    lift = fem.Constant(glued.problem.V.mesh, 0.0)
    way = ufl.as_vector((0.0 * lift, 0.02 * lift))
    system = ParametricContact(glued.problem, lift, driven=[(glued.top, way)])
    peaks = []
    for start in (state, None):
        if start is None:
            for f in glued.problem.fields:
                f.x.array[:] = 0.0
            system.set_parameter(0.0)
            start = glued.problem.snapshot()
        path = ArcLength(system)
        if start is state:
            with pytest.raises(ValueError, match="the problem has had another evolution"):
                path.run(gamma_range=(-0.1, 0.3))
        steps = path.run(gamma_range=(-0.1, 0.3), start=start, max_steps=12).steps
        peaks.append(max(np.abs(force(s)).max() for s in steps))
        assert steps[-1].state.gamma == steps[-1].gamma
    assert peaks[0] < 0.1 * peaks[1]


# -- data ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", EVOLUTIONS)
def test_loads_that_depend_on_earlier_calls_are_refused(kind):
    rubbing = Rubbing(kind)

    def adds(t):
        rubbing.load(t)
        rubbing.friction.value += 0.01

    def leaves(t):
        rubbing.load(t)
        if t > 0.1:
            rubbing.friction.value = 0.2

    for load in (adds, leaves):
        rubbing.evolution.load = load
        with pytest.raises(ValueError, match=r"the load at the time 0 depends on earlier calls"):
            rubbing.evolution.run([0.0, 0.1, 0.2])
        rubbing.friction.value = 0.4
    rubbing.evolution.load = rubbing.load
    assert rubbing.evolution.run([0.0, 0.1]).complete
