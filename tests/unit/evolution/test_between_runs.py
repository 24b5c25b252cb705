"""Where runs of evolutions start, what they read and what they leave."""

import logging
import pickle

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block, box, facets
from test_evolution import dragged, put

import ufl
from dolfinx import fem

from dolfinx_contact import (
    RCCM,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    State,
)
from dolfinx_contact.evolution import NSCD, ArcLength, QuasiStatic
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.records import EvolutionRecord

COMM = MPI.COMM_WORLD
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
        domain = box(COMM, 2, "quad")
        V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
        self.u = fem.Function(V)
        self.top = fem.Function(V)
        floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
        law = RCCM(200.0, 150.0, 0.004, 0.2)
        surface = ContactSurface(self.u, facets(domain, 1, 0.0), obstacle=floor, law=law)
        held = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
        energy = LinearElastic.from_young(100.0, 0.3).energy(self.u) * ufl.dx
        bcs = [fem.dirichletbc(self.top, held)]
        self.problem = ContactProblem(energy, self.u, [surface], bcs=bcs)

    def load(self, t):
        put(self.top, (0.0, np.interp(t, [0, 1, 2, 3], [0, 0.02, 0.0, 0.02])))

    def history(self):
        return QuasiStatic(self.problem, self.load)


def off(a, b):
    """Largest difference of two arrays, on all ranks."""
    return COMM.allreduce(float(np.abs(a - b).max(initial=0.0)), max)


def size(a):
    return off(a, 0.0 * a)


def force(step):
    return step.result.resultants["contact"]


# -- starts ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", EVOLUTIONS)
def test_a_later_run_starts_where_the_last_one_has_ended(kind):
    """Whatever has been put into the Functions since."""
    whole = Rubbing(kind)
    expected = force(whole.evolution.run([0.0, 0.2, 0.4, 0.6, 0.8]).steps[-1])
    parts = Rubbing(kind)
    parts.evolution.run([0.0, 0.2, 0.4])
    for f in parts.problem.fields:
        f.x.array[:] = 7.0
    parts.problem.solve()
    found = force(parts.evolution.run([0.4, 0.6, 0.8]).steps[-1])
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("kind", EVOLUTIONS)
def test_another_evolution_of_a_problem_needs_a_start(kind):
    """From the state of the last step it continues; from a snapshot it has virgin memory."""
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


def test_bonds_are_those_of_the_start():
    """Broken in the state of a history, intact in a snapshot."""
    glued = Glued()
    first = glued.history().run(np.linspace(0.0, 2.0, 11))
    intact = max(np.abs(force(s)).max() for s in first.steps)
    state = first.steps[-1].state
    broken = glued.history().run(np.linspace(2.0, 3.0, 6), start=state)
    assert max(np.abs(force(s)).max() for s in broken.steps) < 0.05 * intact
    glued.u.x.array[:] = 0.0
    glued.problem.surfaces[0].multiplier.x.array[:] = 0.0
    glued.load(2.0)
    start = glued.problem.snapshot()
    again = glued.history().run(np.linspace(2.0, 3.0, 6), start=start)
    assert max(np.abs(force(s)).max() for s in again.steps) == pytest.approx(intact, rel=1e-6)


def test_a_path_starts_from_the_state_of_a_history():
    """With the bonds of that state, and with intact ones from a snapshot."""
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


@pytest.mark.ranks(2)
def test_an_unloaded_start_is_a_solution(caplog):
    """Data that differ by round-off from those of the start carry no load."""
    problem, top = dragged(n=2)

    def load(t):
        put(top, (0.0, 1e-17 - 0.01 * t))

    with caplog.at_level(logging.WARNING):
        QuasiStatic(problem, load).run([0.0, 1.0])
    assert "not a solution" not in COMM.bcast(caplog.text)
    other, top = dragged(n=2)
    with caplog.at_level(logging.WARNING):
        QuasiStatic(other, lambda t: put(top, (0.0, -0.001 - 0.01 * t))).run([0.0, 1.0])
    assert "the start of the evolution is not a solution" in COMM.bcast(caplog.text)


# -- states ----------------------------------------------------------------------------------------


@pytest.mark.ranks(2)
@pytest.mark.parametrize("kind", EVOLUTIONS)
def test_steps_have_their_states(kind):
    """Evaluators have the tables of a step from its state, and leave the Functions as they are."""
    rubbing = Rubbing(kind)
    seen = []
    history = rubbing.evolution.run(
        [0.0, 0.4, 0.8, 1.2], observer=lambda step: seen.append(step.state)
    )
    problem = rubbing.evolution.problem
    (surface,) = problem.surfaces
    before = [f.x.array.copy() for f in problem.fields]
    assert [s.state for s in history.steps] == seen
    for step in history.steps:
        state = step.state
        assert isinstance(state, State)
        assert state.time == step.time
        assert state.energies["dissipated"] == step.energies.dissipated
        assert (state.velocity is None) == (kind is QuasiStatic)
        table = problem.table(surface, state=pickle.loads(pickle.dumps(state)))
        expected = step.result.tables["contact"]
        assert table.status == expected.status
        for name in ("increment", "ut", "pressure"):
            values = getattr(expected, name)
            np.testing.assert_allclose(
                getattr(table, name), values, rtol=0, atol=1e-12 * (1 + np.abs(values).max())
            )
    assert np.abs(history.steps[-1].result.tables["contact"].increment).max() > 0
    for f, values in zip(problem.fields, before, strict=True):
        np.testing.assert_array_equal(f.x.array, values)


@pytest.mark.parametrize("kind", EVOLUTIONS)
@pytest.mark.parametrize("who", ["observer", "accept", "stop"])
def test_what_is_written_within_a_run_is_lost(kind, who, folder):
    """Neither the next step nor the record has it."""
    answer = {"accept": True, "stop": "", "observer": None}[who]
    found = []
    for writes in (False, True):
        rubbing = Rubbing(kind)

        def call(step, rubbing=rubbing, writes=writes):
            if writes:
                for f in rubbing.problem.fields:
                    f.x.array[:] *= 1.1
                if kind is NSCD:
                    rubbing.evolution.velocity.x.array[:] += 1.0
            return answer

        with EvolutionRecord(folder / f"{writes}", rubbing.evolution) as record:
            history = rubbing.evolution.run([0.0, 0.1, 0.2], record=record, **{who: call})
            record.show(2)
            found.append((force(history.steps[-1]), rubbing.problem.u.x.array.copy()))
    for a, b in zip(*found, strict=True):
        np.testing.assert_array_equal(a, b)


def test_an_accept_that_never_accepts_ends():
    rubbing = Rubbing()
    asked = []

    def never(step):
        asked.append(step.time - step.start)
        return False

    with pytest.raises(ValueError, match=r"accept rejects every step from the time 0, down to"):
        rubbing.evolution.run([0.0, 1.0], accept=never, shortest=0.01)
    assert asked == [0.5**k for k in range(7)]
    assert rubbing.evolution.run([0.0, 1.0]).complete


# -- data ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", EVOLUTIONS)
def test_data_are_read_when_a_run_starts(kind):
    """A coefficient of friction that is changed between two runs is that of the second one."""
    rubbing = Rubbing(kind)
    rubbing.evolution.run([0.0, 0.5])
    rubbing.friction.value = 0.1
    step = rubbing.evolution.run([0.5, 1.0]).steps[-1]
    found = np.abs(force(step))
    assert found[0] == pytest.approx(0.1 * found[1], rel=1e-6)
    assert size(rubbing.top.x.array) == pytest.approx(0.012)


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


def test_the_data_after_a_run_are_those_of_its_last_time():
    """Also if the last step was not solved."""
    rubbing = Rubbing()

    def load(t):
        rubbing.load(t)
        if t > 0.55:
            raise RuntimeError("no load")

    rubbing.evolution.load = load
    with pytest.raises(RuntimeError, match="no load"):
        rubbing.evolution.run([0.0, 0.5, 1.0])
    rubbing.evolution.load = rubbing.load
    rubbing.evolution.run([0.0, 0.5])
    expected = rubbing.top.x.array.copy()
    rubbing.load(0.5)
    np.testing.assert_array_equal(rubbing.top.x.array, expected)


def test_mass_and_damping_are_assembled_when_a_run_starts():
    """Both may be changed between two runs, and not within one."""
    ends = []
    for changed in (False, True):
        rubbing = Rubbing()
        domain = rubbing.problem.V.mesh
        density = fem.Constant(domain, 1.0 if changed else 3.0)
        rate = fem.Constant(domain, 0.1 if changed else 2.0)
        motion = NSCD(
            rubbing.problem, density, dt=0.1, load=rubbing.load, damping=(rate, 0.0), theta=1.0
        )
        motion.velocity.x.array[:] = 0.0
        if changed:
            density.value, rate.value = 3.0, 2.0
        motion.run([0.0, 0.3])
        density.value = 5.0
        ends.append(force(motion.run([0.3, 0.6]).steps[-1]))

        def load(t, rubbing=rubbing, density=density):
            rubbing.load(t)
            density.value = 5.0 + t - 0.6

        motion.load = load
        with pytest.raises(ValueError, match=r"the load at the time 0\.7 changes .*the density"):
            motion.run([0.6, 0.7, 0.8])
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-10)


@pytest.mark.ranks(2)
def test_data_that_are_changed_between_two_runs_of_a_record(folder):
    """The second run has the new data; a later resumption needs them as well."""
    block = Rubbing()
    with EvolutionRecord(folder, block.evolution) as record:
        block.evolution.run([0.0, 0.1], record=record)
        block.friction.value = 0.1
        block.evolution.run([0.1, 0.2], record=record)
    words = r"differs at the time 0\.2: the friction .* \(0\.1 recorded, 0\.4 now\)"
    with pytest.raises(ValueError, match=words):
        EvolutionRecord(folder, Rubbing().evolution, resume=True)


def test_a_record_says_which_method_is_another(folder):
    block = Rubbing(NSCD)
    with EvolutionRecord(folder, block.evolution) as record:
        block.evolution.run([0.0, 0.1], record=record)
    other = NSCD(block.problem, 1e-3, dt=0.1, load=block.load, theta=0.6)
    words = r"differs: the method"
    with pytest.raises(ValueError, match=words):
        EvolutionRecord(folder, other, resume=True)


def test_a_load_moves_the_mesh_of_another_problem():
    """That a mesh stays within a step is known of that of the step alone."""
    problem = block()
    other = block()
    said = []

    def load(t):
        if t > 0:
            other.solve()
            x = other.V.mesh.geometry.x
            before = x.copy()
            x[:, 1] *= 1.01
            with pytest.raises(ValueError, match="the mesh has moved"):
                other.solve()
            x[:] = before
            said.append(t)

    problem.solve()
    QuasiStatic(problem, load).run([0.0, 1.0])
    assert said
