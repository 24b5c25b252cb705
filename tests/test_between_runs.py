"""What users change between two runs, or within one, is taken, refused or said, and never lost."""

import re

from mpi4py import MPI

import numpy as np
import pytest
from blocks import block
from test_evolution import dragged, put

from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    Coulomb,
    HalfSpace,
    RigidBody,
)
from dolfinx_contact._compat import dirichlet_value
from dolfinx_contact.evolution import NSCD, QuasiStatic
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


def said(caplog):
    return COMM.bcast(caplog.text if COMM.rank == 0 else None)


@pytest.mark.parametrize("kind", EVOLUTIONS)
def test_a_state_that_is_set_between_two_runs_is_refused(kind):
    """Another evolution begins with it; what solves and other runs leave is none of the user's."""
    block = Rubbing(kind)
    evolution = block.evolution
    evolution.run([0.0, 0.2])
    given = {"displacement": block.problem.u}
    if kind is NSCD:
        given["velocity"] = evolution.velocity
    if kind is QuasiStatic:
        given["multiplier of 'contact'"] = block.problem.surfaces[0].multiplier
    for name, f in given.items():
        kept = f.x.array.copy()
        f.x.array[:] = 1.1 * kept
        words = f"the {name} has been changed since the last run ended at 0.2.*{kind.__name__}"
        with pytest.raises(ValueError, match=words):
            evolution.run([0.2, 0.3])
        f.x.array[:] = 3.0 * kept
        f.x.array[:] /= 3.0  # as for a picture: but for round-off what was there
    evolution.run([0.2, 0.3])
    block.problem.solve()
    evolution.run([0.3, 0.4])
    block.begun(NSCD).run([0.4, 0.5])
    evolution.run([0.4, 0.5])
    problem = block.problem
    others = ContactProblem(problem.energy, problem.u, problem.contacts, bcs=problem.bcs)
    others.solve()
    evolution.run([0.5, 0.6])
    if kind is NSCD:
        evolution.velocity.x.array[:] += 1.0
        with pytest.raises(ValueError, match="the velocity has been changed"):
            evolution.settle(1.0)


def test_the_motion_of_a_rigid_body_that_is_set_between_two_runs_is_refused():
    """It may be set where a solve or another history begins, and solves of others move it."""
    problem, top = dragged(n=2, law=lambda domain: Coulomb(0.4), obstacle=pressing)
    (punch,) = problem.rigid_bodies
    put(top, (0.0, 0.0))
    problem.solve()

    def load(t):
        put(top, (0.01 * t, 0.0))

    history = QuasiStatic(problem, load)
    history.run([0.0, 0.2])
    kept = punch.values
    punch.values = kept + 0.1
    with pytest.raises(ValueError, match="the motion of 'punch' has been changed since the last"):
        history.run([0.2, 0.3])
    punch.values = kept.copy()
    history.run([0.2, 0.3])
    problem.solve()
    history.run([0.3, 0.4])
    history.run([0.4, 0.5], observer=lambda step: setattr(punch, "values", kept + 0.1))
    history.run([0.5, 0.6])


def pressing(domain):
    """A floor as a rigid body that is pressed on the block from below."""
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    return RigidBody(floor, about=(0.0, 0.0), load={"y": 0.5}, held=["x", "rz"], name="punch")


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


def test_a_load_that_knows_more_than_the_time_later(caplog):
    """Where a step is tried again it is refused; where it leaves what it has set, that is said."""
    block = Rubbing()

    def adds(t):
        block.load(t)
        if t > 0.5:
            block.friction.value += 0.01

    evolution = QuasiStatic(block.problem, adds)
    with pytest.raises(ValueError, match=r"the load at the time .* depends on earlier calls"):
        evolution.run([0.0, 0.4, 0.8, 1.0], accept=lambda step: step.time < 0.7, shortest=0.1)
    block = Rubbing()

    def leaves(t):
        block.load(t)
        if t > 0.5:
            block.friction.value = 0.2

    QuasiStatic(block.problem, leaves).run([0.0, 0.4, 0.8])
    words = r"does not set all that it changes: .* the time 0 of its start it leaves the friction"
    assert re.search(words, said(caplog))


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("load", "the monitor has changed the value of the Dirichlet condition 1"),
        ("friction", "the monitor has changed the friction of Coulomb"),
        ("mesh", "the mesh has moved since the problem was made"),
    ],
)
@pytest.mark.parametrize("algorithm", ["newton", "gauss-seidel"])
def test_what_a_monitor_changes_is_refused(algorithm, what, message):
    """Of the last iterate the answers of the laws are kept for the result."""
    problem = block()
    x = problem.V.mesh.geometry.x

    def monitor(_):
        if what == "load":
            dirichlet_value(problem.bcs[0]).value[1] -= 0.001
        elif what == "friction":
            problem.surfaces[0].law.friction.value = 0.1
        else:
            x[:, 1] *= 1.01

    with pytest.raises(ValueError, match=message):
        problem.solve(algorithm=algorithm, monitor=monitor)


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
