"""What histories, motions and paths refuse: the call and its message."""

import math

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import box, facets
from support.bonds import C, W, bar
from support.histories import cycle, dragged
from support.histories import falling_block as block
from support.textbook import gould, one_node, smooth, start, state

import ufl
from dolfinx import fem

from dolfinx_contact import (
    RCCM,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    NormalCompliance,
    Regularised,
    io,
)
from dolfinx_contact.continuation import (
    Ending,
    Follower,
    StepControl,
    explore,
    find_solutions,
    follow,
)
from dolfinx_contact.evolution import NSCD, ArcLength, QuasiStatic
from dolfinx_contact.materials import LinearElastic

U0 = np.sqrt(W / C)


ENDS = (0.0, 8 * U0)


@pytest.mark.ranks(2)
def test_arc_length_refuses_laws_and_options():
    with pytest.raises(ValueError, match="a ParametricContact is needed, got int"):
        ArcLength(3)
    slow = bar(1.0, 1, law=RCCM(C, C, W, viscosity=0.1), comm=MPI.COMM_SELF)
    with pytest.raises(
        ValueError, match="RCCM answers to the time or length of a step, by its vis"
    ):
        ArcLength(slow)
    for law, name in [
        (Regularised(Coulomb(0.3), 0.1), "width"),
        (NormalCompliance(1e3, friction=Coulomb(0.3), tangential=10.0), "tangential"),
        (NormalCompliance(1e3, friction=Regularised(Coulomb(0.3), 0.1)), "friction.width"),
    ]:
        with pytest.raises(ValueError, match=f"length of a step, by its {name}; a path"):
            ArcLength(bar(1.0, 1, law=law, comm=MPI.COMM_SELF))
    ArcLength(bar(1.0, 1, law=NormalCompliance(1e3, friction=Coulomb(0.3)), comm=MPI.COMM_SELF))
    system = bar(1.0, 1)
    path = ArcLength(system)
    for given, message in [
        ({"gamma_range": (0.1, 0.2)}, "must lie in the range"),
        ({"gamma_range": (0.0, np.nan)}, "finite number"),
        ({"direction": "back"}, "the direction of the first run must be one of"),
        ({"control": StepControl(kinks="batched")}, "passes kinks exactly, not 'batched'"),
        ({"max_steps": 0}, "max_steps must be a whole number"),
        ({"rays": "all"}, "rays must be one of True, False, None; got 'all'"),
        ({"stop": 3}, "stop must be a function"),
        ({"observer": 3}, "or a function of a step; got 3"),
        ({"stop": lambda s: None}, "stop must answer with the reason"),
    ]:
        before = system.problem.u.x.array.copy()
        with pytest.raises(ValueError, match=message):
            path.run(**{"gamma_range": ENDS, **given})
        if "stop" not in given:
            np.testing.assert_array_equal(system.problem.u.x.array, before)
    with pytest.raises(ValueError, match="the direction of a later run must be one of"):
        path.run(gamma_range=ENDS, direction="decreasing")
    system.problem.surfaces[0].law.viscosity.value = 1.0
    with pytest.raises(ValueError, match="answers to the time or length of a step"):
        path.run(gamma_range=ENDS)


COMM = MPI.COMM_WORLD


@pytest.mark.ranks(2)
def test_quasi_static_refuses_times_and_options():
    problem, top = dragged(n=2)
    evolution = QuasiStatic(problem, cycle(top))
    for times in ([0.0], [0.0, math.nan], [0.0, 1.0, 1.0], [0.0, 1.0, 0.5], ["a", "b"], None):
        with pytest.raises(ValueError, match=r"times|convert"):
            evolution.run(times)
    ranks = COMM.rank if COMM.size > 1 else math.nan
    for given in (
        {"longest": 1.0 + ranks},
        {"observer": "x"},
        {"shortest": 0.0},
        {"shortest": math.nan},
        {"longest": 0.0},
        {"longest": math.nan},
        {"longest": "a"},
        {"shortest": "a"},
        {"at_jump": "ignore"},
        {"at_jump": "jump"},
        {"rays": "all"},
    ):
        with pytest.raises(ValueError, match="|".join(given)):
            evolution.run([0.0, 1.0], **given)
    for every in (0, 1.5, True, "2", *([1 + COMM.rank] if COMM.size > 1 else [])):
        with pytest.raises(ValueError, match="every"):
            io.EvolutionSeries("unwritten", problem, every=every)
    with pytest.raises(ValueError, match="a ContactProblem is needed"):
        QuasiStatic(None, cycle(top))
    with pytest.raises(ValueError, match="a function of the time"):
        QuasiStatic(problem, 1.0)
    domain = box(COMM, 2, "quad")
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    springs = NormalCompliance(1.0, friction=Coulomb(0.3), tangential=1.0)
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=springs)
    energy = LinearElastic.from_young(1.0, 0.3).energy(u) * ufl.dx
    with pytest.raises(ValueError, match="lacks a memory of the stretch of its tangential springs"):
        QuasiStatic(ContactProblem(energy, u, [surface]), cycle(top))
    history = evolution.run([0.0, 1.0])
    with pytest.raises(ValueError, match=r"the evolution is at the time 1\.0"):
        evolution.run([0.0, 2.0])
    assert evolution.run([1.0, 1.5]).complete
    assert history.at(1.0).number == 1
    other, _ = dragged(n=3)
    with pytest.raises(ValueError, match="another law, sliding or mesh"):
        other.with_memory(evolution.memory)
    with pytest.raises(ValueError, match="another law, sliding or mesh"):
        other.with_memory([])
    with pytest.raises(ValueError, match="expected statuses"):
        other.solve(expected=[problem.statuses])


def test_step_from_refuses_states_of_other_problems():
    problem, _ = dragged()
    other, _ = dragged(n=3)
    with pytest.raises(ValueError, match="a State of this problem"):
        other.step_from(problem.snapshot())


BAD = [
    ({"density": 0.0}, "density must be positive"),
    ({"density": -1.0}, "density must be positive"),
    ({"density": np.nan}, "density must be positive"),
    ({"density": "some"}, "density must be positive everywhere"),
    ({"dt": 0.0}, "dt must be a positive time"),
    ({"dt": -1.0}, "dt must be a positive time"),
    ({"dt": np.nan}, "dt must be a positive time"),
    ({"theta": 0.49}, "theta must be between 0.5 and 1"),
    ({"theta": 1.01}, "theta must be between 0.5 and 1"),
    ({"theta": np.nan}, "theta must be between 0.5 and 1"),
    ({"restitution": 1.1, "level": "velocity"}, "restitution must be between 0 and 1"),
    ({"restitution": -0.1, "level": "velocity"}, "restitution must be between 0 and 1"),
    ({"restitution": 0.5}, "level='velocity'"),
    ({"level": "velocity", "mass": "redistributed"}, "a node needs mass"),
    ({"scheme": "newmark"}, "known are 'theta', 'theta-euler', 'modified-theta'"),
    ({"level": "speed"}, "known are 'position', 'velocity'"),
    ({"mass": "none"}, "known are 'consistent', 'lumped', 'redistributed'"),
    ({"damping": (-1.0, 0.0)}, "numbers that are not negative"),
    ({"damping": 1.0}, "a form or a pair"),
]


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("given", "message"), BAD, ids=lambda x: str(x)[:30])
def test_nscd_refuses_schemes_and_masses(given, message):
    problem, _ = block("tri", 2)
    if given.get("density") == "some":
        given = {"density": ufl.SpatialCoordinate(problem.V.mesh)[0] - 0.5}
    with pytest.raises(ValueError, match=message) as info:
        NSCD(problem, **({"density": 1.0, "dt": 0.1, "mass": "lumped"} | given))
    assert len(set(COMM.allgather(str(info.value)))) == 1


@pytest.mark.ranks(2)
def test_velocity_level_refuses_laws():
    problem, _ = block("tri", 2)
    u = problem.u
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    below = facets(problem.V.mesh, 1, 0.0)
    glued = ContactSurface(u, below, obstacle=floor, law=RCCM(10.0, 10.0, 1.0))
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    with pytest.raises(ValueError, match="adhesion is about positions"):
        NSCD(ContactProblem(energy, u, [glued]), 1.0, dt=0.1, level="velocity", mass="lumped")


def test_follow_refuses_starts_and_controls():
    system = one_node(2.0, 2.0, 1.0, 3.0, (0.0, -1.0), (-1.0, 0.0))
    x = start(system, [0, 0, 0, 1.0])
    with pytest.raises(ValueError, match="must lie in the range"):
        follow(system, x, 7.0, gamma_range=(0.0, 5.0))
    with pytest.raises(ValueError, match="max_steps must be a whole number"):
        follow(system, x, 0.0, gamma_range=(0.0, 5.0), max_steps=0)
    still = one_node(2.0, 2.0, 1.0, 3.0, (0.0, -1.0), (0.0, 0.0))
    with pytest.raises(ValueError, match="gamma does not appear in H"):
        follow(still, x, 0.0, gamma_range=(0.0, 5.0))
    for bad in (
        dict(initial=1.0),
        dict(minimum=0.0),
        dict(increase=0.5),
        dict(decrease=2.0),
        dict(cosine=1.0),
        dict(tolerance=0.0),
    ):
        with pytest.raises(ValueError):  # noqa: PT011
            StepControl(**bad)
    nowhere = smooth(
        1, lambda x, g: x**2 + 1 + g**2, lambda x, g: [[2 * x[0]]], lambda x, g: [2 * g + 1e-3]
    )
    with pytest.raises(ValueError, match="no solution near"):
        follow(nowhere, start(nowhere, [1.0]), 0.0, gamma_range=(-1.0, 1.0))


@pytest.mark.ranks(2)
def test_explore_refuses_budgets():
    system = smooth(
        1,
        lambda x, g: x * (g - x**2),
        lambda x, g: [[g - 3 * x[0] ** 2]],
        lambda x, g: [x[0]],
    )
    x = start(system, [0.0])
    diagram = explore(system, [(x, -1.0)], gamma_range=(-1.0, 1.0), max_branches=2)
    assert diagram.reason == "the budget of 2 branches is exhausted"
    assert diagram.ending is Ending.BUDGET
    assert not diagram.complete
    assert len(diagram.edges) == 2
    with pytest.raises(ValueError, match="must lie in the range"):
        explore(system, [(x, 3.0)], gamma_range=(-1.0, 1.0))
    with pytest.raises(ValueError, match="max_branches must be a whole number"):
        explore(system, [(x, 0.5)], gamma_range=(-1.0, 1.0), max_branches=0)
    with pytest.raises(ValueError, match="route must be one of"):
        explore(system, [(x, 0.5)], gamma_range=(-1.0, 1.0), route="guess")
    with pytest.raises(ValueError, match="not affine"):
        explore(system, [(x, 0.5)], gamma_range=(-1.0, 1.0), route="pivoting")


@pytest.mark.ranks(2)
def test_step_control_refuses_ways_to_pass_kinks():
    with pytest.raises(ValueError, match="kinks are passed"):
        StepControl(kinks="somehow")
    system = one_node(2.0, 2.0, 1.0, 3.0, (0.0, -1.0), (-1.0, 0.0))
    with pytest.raises(ValueError, match="nothing to locate"):
        Follower(system, StepControl(), gamma_scale=1.0, locate=lambda change: True)


@pytest.mark.ranks(2)
def test_find_solutions_refuses_guesses():
    system = gould()
    with pytest.raises(ValueError, match="at least one guess"):
        find_solutions(system, [], 0.0)
    with pytest.raises(ValueError, match="must be a positive number"):
        find_solutions(system, [state(system, np.zeros(4))], 0.0, lengths=(0.0,))
