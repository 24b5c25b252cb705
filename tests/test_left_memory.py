"""What surfaces remember where a history has ended, and another one, or a motion, begins."""

import logging

from mpi4py import MPI

import numpy as np
import pytest
from blocks import box, facets

import ufl
from dolfinx import fem

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.laws import FrictionLaw
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD


class Wears(FrictionLaw):
    """Friction that falls with the distance slipped."""

    def bound(self, a, p):
        return (0.2 + 0.1 * ufl.exp(-a.slid / 0.05)) * p


class Glued:
    """A block on a floor, whose top is moved."""

    def __init__(self, law):
        domain = box(COMM, 2, "quad")
        V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
        self.u = fem.Function(V)
        self.top = fem.Constant(domain, (0.0, 0.0))
        floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
        self.surface = ContactSurface(self.u, facets(domain, 1, 0.0), obstacle=floor, law=law)
        held = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
        energy = LinearElastic.from_young(100.0, 0.3).energy(self.u) * ufl.dx
        bcs = [fem.dirichletbc(self.top, held, V)]
        self.problem = ContactProblem(energy, self.u, [self.surface], bcs=bcs)

    def through(self, times, ways):
        """A load that moves the top through points, one at each time."""
        ways = np.array(ways)

        def load(t):
            self.top.value[:] = [np.interp(t, times, w) for w in ways.T]

        return load

    def history(self, times, ways, step=0.2):
        evolution = QuasiStatic(self.problem, self.through(times, ways))
        number = round((times[-1] - times[0]) / step) + 1
        return evolution, evolution.run(np.linspace(times[0], times[-1], number), sudden=np.inf)


def force(history):
    return history.steps[-1].result.resultants["contact"]


def broken():
    """A block whose bond has lost most of its strength, and that touches the floor again."""
    block = Glued(RCCM(200.0, 150.0, 0.004, 0.2, viscosity=0.001))
    evolution, _ = block.history([0.0, 1.0, 2.0], [(0.0, 0.0), (0.0, 0.02), (0.0, 0.0)])
    return block, evolution


LIFTED = [2.0, 3.0], [(0.0, 0.0), (0.0, 0.004)]


def test_bonds_stay_broken_in_another_history(caplog):
    """Of which the log warns where the body is undeformed, as where a study would begin anew."""
    block, evolution = broken()
    evolution.load = block.through(*LIFTED)
    expected = force(evolution.run(np.linspace(2.0, 3.0, 6), sudden=np.inf))
    words = "undeformed, as a history has left it with beta"
    block, _ = broken()
    caplog.clear()
    _, again = block.history(*LIFTED)
    assert (words in caplog.text) == (COMM.rank == 0)
    block, _ = broken()
    block.surface.memory = None
    caplog.clear()
    _, intact = block.history(*LIFTED)
    assert words not in caplog.text
    assert force(again) == pytest.approx(expected, rel=1e-9)
    assert np.linalg.norm(force(intact)) > 50 * np.linalg.norm(expected)


def test_bonds_stay_broken_in_a_jump():
    block, evolution = broken()
    before = block.surface.memory.fields["beta"].copy()
    evolution.jump(NSCD(block.problem, 1.0, dt=0.01, damping=(20.0, 0.0)), 2.0, 50.0)
    assert np.abs(block.surface.memory.fields["beta"] - before).max(initial=0.0) < 1e-9


def test_the_distance_slipped_is_remembered(caplog):
    ways = [(0.0, -0.01), (0.05, -0.01), (0.0, -0.01)]
    block = Glued(Wears())
    block.top.value[:] = ways[0]
    block.problem.solve()
    _, first = block.history([0.0, 1.0, 2.0], ways)
    slid = first.steps[-1].result.tables["contact"].slid
    caplog.clear()
    _, then = block.history([2.0, 3.0], [ways[0], (0.001, -0.01)])
    assert "undeformed" not in caplog.text
    assert (slid > 0.05).all()
    assert (then.steps[-1].result.tables["contact"].slid >= slid).all()


def test_what_is_remembered_of_another_state_is_said(caplog):
    """Bonds are those of the law then, as in a study that begins at zero again."""
    block, _ = broken()
    block.top.value[:] = 0.0, 0.001
    block.problem.solve()
    with caplog.at_level(logging.WARNING):
        _, history = block.history(LIFTED[0], [(0.0, 0.001), (0.0, 0.001)])
    said = COMM.bcast(caplog.text if COMM.rank == 0 else None)
    assert "the surfaces remember beta of a history that ended in another state" in said
    assert (history.steps[-1].result.tables["contact"].internal["beta"] > 0.5).all()
