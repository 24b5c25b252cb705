"""Jumps of histories that no mean over a body shows, and what is stated of them."""

from mpi4py import MPI

import numpy as np
import pytest
from cases.own_law import SlipWeakening
from support.blocks import facets

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace
from dolfinx_contact.continuation import Ending
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.meshing import join

COMM = MPI.COMM_WORLD
C = 100.0
W = 1.0  # of a bond; it yields at the opening sqrt(W/C)
U0 = np.sqrt(W / C)

LONG = pytest.mark.long


def columns(stiffness, law, degree=1):
    """Columns side by side that do not know of each other, on one floor, and their top.

    Their energy is k |grad u|^2/2: a spring k across and along.
    """
    line = np.linspace(0.0, 1.0, 2)
    both = join(
        [
            create_grid(COMM, (line + 2 * i, line), mesh.CellType.quadrilateral)
            for i in range(len(stiffness))
        ]
    )
    V = fem.functionspace(both.mesh, ("Lagrange", degree, (2,)))
    u = fem.Function(V)
    top = fem.Constant(both.mesh, np.zeros(2))
    low, high = (facets(both.mesh, 1, value) for value in (0.0, 1.0))
    surface = ContactSurface(u, low, obstacle=HalfSpace((0.0, 0.0), (0.0, 1.0)), law=law)
    dx = ufl.Measure("dx", both.mesh, subdomain_data=both.cell_tags)
    strain = ufl.inner(ufl.grad(u), ufl.grad(u)) / 2
    energy = sum(k * strain * dx(i) for i, k in enumerate(stiffness, 1))
    held = fem.dirichletbc(top, fem.locate_dofs_topological(V, 1, high), V)
    return ContactProblem(energy, u, [surface], bcs=[held]), top


def pulled(stiffness, degree=1):
    """Columns on brittle bonds, whose top is lifted by the time in openings at which they yield."""
    problem, top = columns([k * C for k in stiffness], RCCM(C, C, W), degree)

    def load(time):
        top.value[1] = U0 * time

    return QuasiStatic(problem, load)


def jumps_of(history):
    return [(s.start, s.time) for s in history.steps if s.jump]


@pytest.mark.long
@pytest.mark.chatty
@pytest.mark.parametrize(
    ("stiffness", "steps", "degree"),
    [
        ((0.5, 1.0, 2.0, 4.0), 7, 1),
        pytest.param((0.5, 1.0, 2.0, 4.0), 3, 1, marks=pytest.mark.long),
        pytest.param((0.5, 1.0, 2.0, 4.0), 23, 2, marks=pytest.mark.long),
        pytest.param(
            (0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.4, 1.6, 1.8), 20, 1, marks=pytest.mark.long
        ),
    ],
)
@pytest.mark.verifies(
    "jumps", "RCCM adhesion", reference="closed form: columns snap at 1 + 1/k", aspects=("2D",)
)
def test_columns_that_come_off_one_by_one(stiffness, steps, degree):
    """A bond under a column of stiffness k C snaps at (1 + 1/k) times its opening, for k < 3.

    It is one of many, in steps as long as from one to the next.
    """
    history = pulled(stiffness, degree).run(
        np.linspace(0.0, 4.0, steps + 1), locate_jumps=True, at_jump="jump"
    )
    exact = sorted(1 + 1 / k for k in stiffness if k < 3)
    found = jumps_of(history)
    assert len(found) == len(exact)
    for (start, end), load in zip(found, exact, strict=True):
        assert start - 2e-5 < load < end + 2e-5


@pytest.mark.verifies(
    "jumps", "RCCM adhesion", reference="closed form: columns snap at 1 + 1/k", aspects=("2D",)
)
def test_a_step_in_which_the_state_may_jump_gives_a_warning(caplog):
    """By default a history takes the given times; the step of a jump is named once."""
    times = np.linspace(0.0, 4.0, 24)
    history = pulled((0.5, 4.0)).run(times)
    assert [s.time for s in history.steps] == times[1:].tolist()
    assert not any(s.inserted or s.jump for s in history.steps)
    (snap,) = (s for s in history.steps if s.start < 3.0 < s.time)
    (warned,) = (s for s in history.steps if "jump" in s.result.warnings)
    assert warned is snap
    text = snap.result.warnings["jump"]
    assert f"in step {snap.number} from the time" in text
    assert "locate_jumps=True" in text
    assert sum(text in r.message for r in caplog.records) == (COMM.rank == 0)
    indicators = snap.result.indicators.step
    change = snap.energies.residue - history.steps[snap.number - 2].energies.residue
    assert indicators.residue > 0.1
    assert change > 0
    assert "jump" not in history.steps[0].result.warnings
    located = pulled((0.5, 4.0)).run(times, locate_jumps=True, at_jump="jump", shortest=1e-3)
    assert sum(s.jump for s in located.steps) == 1
    assert all(s.inserted == (s.time not in times) for s in located.steps)
    assert not any("jump" in s.result.warnings for s in located.steps)


@pytest.mark.ranks(2)
def test_what_is_proved_of_a_coarse_step():
    """The load turns back in the step, not where it begins; shorter steps lead nearer."""
    evolution = pulled([1.0])
    history = evolution.run([0.0, 1.8, 2.1], locate_jumps=True, at_jump="stop", shortest=0.6)
    assert "beyond the time 1.8" not in history.reason
    assert "continues the evolution in the step from 1.8 to 2.1" in history.reason
    assert "at 0.6667 of its change" in history.reason
    assert history.ending is Ending.NO_SOLUTION
    later = evolution.run([1.8, 1.9, 1.999], locate_jumps=True, at_jump="stop")
    assert later.complete
    assert jumps_of(later) == []


@pytest.mark.chatty
@pytest.mark.parametrize(
    ("stiffness", "law", "pressed", "times"),
    [
        pytest.param(200.0, (0.6, 0.3, 0.002), 0.01, np.linspace(0.0, 0.018, 21), marks=LONG),
        pytest.param(200.0, (0.6, 0.3, 0.002), 0.01, np.linspace(0.0, 0.018, 31), marks=LONG),
        pytest.param(1.0, (0.6, 0.2, 0.1), 1.0, [0.0, 0.2, 0.4, 0.55, 0.8, 1.0], marks=LONG),
    ],
)
@pytest.mark.verifies(
    "jumps",
    "friction of the slip",
    reference="closed form: the load at which a column snaps, and where it ends",
    aspects=("2D",),
)
def test_a_jump_from_which_no_solution_is_near(stiffness, law, pressed, times):
    """Friction that weakens by slip snaps once, at mu p / k; the state beyond is far off."""
    static, kinetic, distance = law
    problem, top = columns([stiffness], SlipWeakening(*law))

    def load(time):
        top.value[:] = time, -pressed

    load(0.0)
    problem.solve()
    history = QuasiStatic(problem, load).run(
        times, locate_jumps=True, at_jump="jump", progress=False
    )
    assert history.complete
    ((start, end),) = jumps_of(history)
    assert start - 1e-4 * times[-1] <= static * pressed <= end + 1e-4 * times[-1]
    slip = history.steps[-1].result.tables["contact"].ut[:, 0]
    bound = kinetic + (static - kinetic) * np.exp(-slip / distance)
    np.testing.assert_allclose(times[-1] - slip, bound * pressed, rtol=1e-6)
