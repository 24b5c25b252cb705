"""Where runs of evolutions start, what they read and what they leave."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import box, facets
from support.histories import dragged, put

import ufl
from dolfinx import fem

from dolfinx_contact import (
    RCCM,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.evolution import NSCD, ArcLength, QuasiStatic
from dolfinx_contact.materials import LinearElastic

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


def force(step):
    return step.result.resultants["contact"]


# -- starts ----------------------------------------------------------------------------------------


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


# -- states ----------------------------------------------------------------------------------------


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
