"""Jumps of histories that means over a body do not show, and their indicators."""

import logging

from mpi4py import MPI

import cases.flattened_ring
import numpy as np
import pytest
from support.blocks import facets
from support.mortars import stacked
from support.own_laws import SlipWeakening, SpeedWeakening
from support.sliding_bodies import TIMES, Bodies, sliding_history

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, Coulomb, Frictionless, HalfSpace
from dolfinx_contact.continuation import Ending
from dolfinx_contact.evolution import NoContinuation, QuasiStatic
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
@pytest.mark.parametrize(
    ("stiffness", "steps", "degree"),
    [
        ((0.5, 1.0, 2.0, 4.0), 7, 1),
        pytest.param((0.5, 1.0, 2.0, 4.0), 3, 1, marks=pytest.mark.long),
        pytest.param((0.5, 1.0, 2.0, 4.0), 23, 2, marks=pytest.mark.long),
        pytest.param(
            (0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.4, 1.6, 1.8), 20, 1, marks=pytest.mark.long
        ),
        pytest.param(
            np.linspace(0.5, 2.0, 24).tolist(), 40, 1, marks=pytest.mark.long, id="24 bonds"
        ),
    ],
)
@pytest.mark.verifies(
    "jumps", "RCCM adhesion", reference="closed form: columns snap at 1 + 1/k", aspects=("2D",)
)
def test_columns_come_off_one_by_one_at_their_closed_form(stiffness, steps, degree):
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
    """By default a history takes the given times, and one warning names the step of a jump."""
    times = np.linspace(0.0, 4.0, 24)
    history = pulled((0.5, 4.0)).run(times)
    assert [s.time for s in history.steps] == times[1:].tolist()
    assert not any(s.inserted or s.jump for s in history.steps)
    (snap,) = (s for s in history.steps if s.start < 3.0 < s.time)
    (warned,) = (s for s in history.steps if "jump" in s.result.warnings)
    assert warned is snap
    assert history.warnings["jump"] == [snap.number]
    assert f"jump (step {snap.number})" in str(history)
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


def slid(steps):
    """A column under friction that weakens with the speed; it slides at 0.02, then at 0.2.

    Args:
        steps: number of steps in a unit of time.
    """
    problem, top = columns([1.0], SpeedWeakening(0.4, 0.2, 0.05))

    def load(time):
        top.value[:] = np.interp(time, [1.0, 3.0, 4.0], [0.0, 0.04, 0.24]), -0.03 * min(time, 1.0)

    return QuasiStatic(problem, load).run(np.linspace(0.0, 4.0, 4 * steps + 1))


@pytest.mark.ranks(2)
def test_a_law_that_weakens_with_the_speed_gets_another_remedy():
    """A warning of a sudden change names longer steps, since short ones have several solutions."""
    history = slid(2)
    texts = [s.result.warnings.get("jump", "") for s in history.steps]
    (text,) = filter(None, texts)
    assert "weakens with the speed, take longer steps, or NSCD with mass='lumped'" in text


@pytest.mark.ranks(2)
def test_friction_that_alternates_from_step_to_step_gives_a_warning(caplog):
    """Short steps multiply errors by less than -1; the coefficient is 0.334 in long ones."""
    assert not any("alternation" in s.result.warnings for s in slid(2).steps)
    steps = slid(8).steps
    shears = [s.result.resultants["contact"] for s in steps]
    ratios = np.array([-f[0] / f[1] for f in shears])
    for k, step in enumerate(steps[2:], 2):
        changes = np.diff(ratios[max(k - 3, 0) : k + 1])
        turns = len(changes) == 3 and (changes[1:] * changes[:-1] < 0).all()
        value = np.abs(changes).min() / ratios[k - 3 : k + 1].max() if turns else 0.0
        assert step.result.indicators.step.alternation == pytest.approx(value, abs=1e-9)
        assert ("alternation" in step.result.warnings) == (value > 0.05)
    found = [r.getMessage() for r in caplog.records if "friction alternates" in r.getMessage()]
    assert len(found) == (COMM.rank == 0)


@pytest.mark.ranks(2)
def test_a_coarse_step_names_where_its_load_turns_back():
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
def test_a_jump_reaches_a_distant_state(stiffness, law, pressed, times):
    """Friction weakening with slip snaps once, at mu p / k; the state beyond is far off."""
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


def same(a, b, tolerance):
    """Whether two problems are at the same state, relative to its size."""
    off = np.array(
        [
            [np.abs(f.x.array - g.x.array).max(initial=0.0), np.abs(f.x.array).max(initial=0.0)]
            for f, g in zip(a.fields, b.fields, strict=True)
        ]
    )
    off, size = COMM.allreduce(off, np.maximum).T
    return bool(np.all(off <= tolerance * size))


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "self contact",
    reference="itself: steps of which none is halved",
    aspects=("2D", "large sliding"),
)
def test_a_step_in_a_cycle_is_halved(caplog):
    """A ring that first touches itself: no strategy but Newton's method is tried."""
    args = cases.flattened_ring.arguments(["--n=32", "--friction=0.5"])
    times = np.linspace(0.0, 1.65, 18)
    ends = []

    def pressed(times):
        ring = cases.flattened_ring.Ring(args, COMM, whole=True)

        def load(t):
            ring.plate.value[1] = cases.flattened_ring.OUTER - t

        history = QuasiStatic(ring.problem, load).run(
            times,
            halve_steps=True,
            stop=lambda step: "it was halved" if step.rejected else "",
        )
        ends.append(ring.problem)
        return history

    with caplog.at_level(logging.INFO, "dolfinx_contact"):
        history = pressed(times)
    last = history.steps[-1]
    assert last.rejected == 1
    assert last.time - last.start == pytest.approx(times[1] / 2)
    assert COMM.rank > 0 or "statuses recur in a cycle" in caplog.text
    assert all("failed" not in r.message for r in caplog.records if r.levelno > logging.INFO)
    again = pressed([0.0, *(s.time for s in history.steps)])
    assert not any(s.rejected for s in again.steps)
    assert same(*ends, 1e-8)


@pytest.mark.long
@pytest.mark.verifies(
    "sliding pairs",
    reference="itself: solves that begin at the state before",
    aspects=("2D", "pairs", "large sliding"),
)
def test_extrapolation_changes_no_result():
    """To and fro over facets: the same end, and fewer iterations."""
    ends = []
    counts = []
    for extrapolate in (False, True):
        bodies = Bodies(stacked(10, 7, (-1.0, 2.0), (0.0, 1.0), "quad"), 2, Coulomb(0.3))
        history = sliding_history(bodies).run(TIMES, extrapolate=extrapolate)
        assert history.reason == "the last time is reached"
        ends.append(bodies.problem)
        counts.append(sum(s.result.iterations for s in history.steps))
    assert same(*ends, 1e-7)
    assert counts[1] < counts[0]


def pressed_block(way):
    """A soft block on another, pressed down by a part of its height, and its history."""
    bodies = Bodies(stacked(4, 3, (-0.5, 1.5), (0.0, 1.0), "quad"), 3, Frictionless())

    def load(t):
        bodies.move(lambda X: np.tile([0.0, -way * t], (len(X), 1)))

    return QuasiStatic(bodies.problem, load)


@pytest.mark.verifies(
    "sliding pairs",
    "hyperelastic bodies",
    reference="itself: shorter steps",
    aspects=("2D", "pairs", "large sliding"),
)
def test_a_fall_of_the_smallest_det_is_refused():
    """A folded solution ends a run; if steps are halved, the run continues."""
    with pytest.raises(
        NoContinuation, match=r"the smallest det F falls from .*halve_steps=True"
    ) as error:
        pressed_block(0.9).run([0.0, 1.0])
    assert error.value.__cause__ is None  # whose text would be printed as well
    history = pressed_block(0.9).run([0.0, 1.0], halve_steps=True)
    assert history.complete
    assert sum(s.rejected for s in history.steps) > 0
    assert [s.inserted for s in history.steps] == [True] * (len(history.steps) - 1) + [False]


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "sliding pairs",
    reference="closed form: a way over the size of a facet",
    aspects=("2D", "pairs", "large sliding"),
)
def test_facets_passed_in_a_step_are_counted_and_warned_of_once(caplog):
    """A block sliding without friction over a plate: the way, and a word about it, once."""
    bodies = Bodies(stacked(40, 5, (-1.0, 2.0), (0.0, 1.0), "quad"), 3, Frictionless())

    def load(t):
        shift = [0.15 * max(t - 1.0, 0.0), -1e-3 * min(t, 1.0)]
        bodies.move(lambda X: np.tile(shift, (len(X), 1)))

    history = QuasiStatic(bodies.problem, load).run([0.0, 1.0, 2.0, 4.0, 6.0])
    ways = [s.result.indicators.surfaces["contact"].slip_in_step for s in history.steps]
    facet = 3.0 / 40
    expected = np.array([0.0, 0.15, 0.3, 0.3]) / facet
    np.testing.assert_allclose(ways, expected, atol=0.03)
    told = [r for r in caplog.records if "facets of the other face" in r.message]
    assert len(told) == (COMM.rank == 0)
